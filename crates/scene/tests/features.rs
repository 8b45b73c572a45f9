//! One small file per feature of the format.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // helpers of tests are tests

mod common;

use common::{Folder, Gltf, QUAD, json_of, light, png, rich};
use glam::Vec3;
use lightkiln_scene::{ATTRIBUTE, Fallback, ORIGINAL_COLOR, ReadOptions, Scene, write};
use serde_json::{Value, json};

/// The normal of a triangle's front.
fn front(scene: &Scene, part: usize, t: usize) -> Vec3 {
    let p = &scene.parts[part];
    let [a, b, c] = p.triangles[t].map(|v| p.positions[v as usize]);
    (b - a).cross(c - a).normalize()
}

fn close(a: Vec3, b: Vec3) -> bool {
    a.distance(b) < 1e-4
}

fn warned(scene: &Scene, text: &str) -> bool {
    scene.warnings.iter().any(|w| w.message.contains(text))
}

#[test]
fn read_quad_has_positions_normals_triangles() {
    let scene = Gltf::quad().read().unwrap();
    let part = &scene.parts[0];
    assert_eq!((part.node, part.mesh, part.instance), (0, 0, None));
    assert_eq!(part.triangles, [[0, 1, 2], [2, 1, 3]]);
    assert_eq!(part.positions[3], Vec3::new(1.0, 1.0, 0.0));
    assert!(part.normals.iter().all(|n| *n == Vec3::Z));
    assert!(scene.warnings.is_empty());
}

#[test]
fn read_without_indices_strips_and_fans() {
    for (mode, vertices, expected) in [
        (4, vec![0, 1, 2, 2, 1, 3], vec![[0, 1, 2], [3, 4, 5]]),
        (5, vec![0, 1, 2, 3], vec![[0, 1, 2], [1, 3, 2]]),
        (6, vec![0, 1, 3, 2], vec![[1, 2, 0], [2, 3, 0]]),
    ] {
        let mut g = Gltf::new();
        let p: Vec<f32> = vertices.iter().flat_map(|&v: &usize| QUAD[3 * v..3 * v + 3].to_vec()).collect();
        let p = g.floats("VEC3", &p);
        let n = g.floats("VEC3", &[0., 0., 1.].repeat(vertices.len()));
        g.primitive(json!({"attributes": {"POSITION": p, "NORMAL": n}, "mode": mode}));
        let scene = g.read().unwrap();
        assert_eq!(scene.parts[0].triangles, expected, "mode {mode}");
        assert!((0..2).all(|t| close(front(&scene, 0, t), Vec3::Z)), "mode {mode}");
    }
}

#[test]
fn read_points_and_lines_are_left_alone() {
    let mut g = Gltf::quad();
    g.primitive(json!({"attributes": {"POSITION": 0}, "mode": 0}));
    g.primitive(json!({"attributes": {"POSITION": 0}, "mode": 1}));
    let scene = g.read().unwrap();
    assert_eq!(scene.parts.len(), 1);
    assert_eq!(scene.parts[0].primitives, [0]);
}

#[test]
fn read_missing_normals_become_flat_and_stay_absent() {
    let mut g = Gltf::quad();
    g.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("NORMAL");
    let scene = g.read().unwrap();
    let part = &scene.parts[0];
    assert_eq!(part.positions.len(), 6);
    assert_eq!(part.triangles, [[0, 1, 2], [3, 4, 5]]);
    assert!(part.normals.iter().all(|n| close(*n, Vec3::Z)));
    assert_eq!(scene.gltf_corners(0, 1), [2, 1, 3]);
    let folder = Folder::new("flat");
    let out = folder.0.join("out.glb");
    let written = write(&scene, &light(&scene, false), &out).unwrap();
    assert_eq!((written.parts[0].original_vertices, written.parts[0].added_vertices), (4, 0));
    let json = json_of(&std::fs::read(&out).unwrap());
    assert!(json["meshes"][0]["primitives"][0]["attributes"].get("NORMAL").is_none());
}

#[test]
fn read_zero_and_nan_normals_are_replaced() {
    let mut g = Gltf::new();
    let p = g.floats("VEC3", &QUAD);
    let n = g.floats("VEC3", &[0., 0., 0., f32::NAN, 0., 1., 0., 0., 5., f32::INFINITY, 0., 0.]);
    let i = g.indices(&[0, 1, 2, 2, 1, 3]);
    g.primitive(json!({"attributes": {"POSITION": p, "NORMAL": n}, "indices": i}));
    let scene = g.read().unwrap();
    assert!(scene.parts[0].normals.iter().all(|n| close(*n, Vec3::Z)), "{:?}", scene.parts[0].normals);
    assert_eq!(scene.warnings[0].count, 3);
}

#[test]
fn read_scale_carries_normals_and_turns_mirrored_winding() {
    let mut g = Gltf::quad();
    // A plane x + z = const under scale (2, 1, 1) gets the normal (1, 0, 2) / sqrt 5.
    g.json["nodes"][0]["rotation"] = json!([0.0, 0.3826834323650898, 0.0, 0.9238795325112867]);
    g.json["nodes"].as_array_mut().unwrap().push(json!({"children": [0], "scale": [2, 1, 1]}));
    g.json["scenes"][0]["nodes"] = json!([1]);
    let scene = g.read().unwrap();
    assert!(close(scene.parts[0].normals[0], Vec3::new(1.0, 0.0, 2.0).normalize()));
    assert!(close(front(&scene, 0, 0), scene.parts[0].normals[0]));
    g.json["nodes"][1]["scale"] = json!([-2, 1, 1]);
    let scene = g.read().unwrap();
    assert!(close(scene.parts[0].normals[0], Vec3::new(-1.0, 0.0, 2.0).normalize()));
    assert!(close(front(&scene, 0, 0), scene.parts[0].normals[0]), "{:?}", front(&scene, 0, 0));
}

#[test]
fn read_quantized_interleaved_sparse() {
    let mut g = Gltf::new();
    // Interleaved: i16 position (8 bytes with padding), i8 normalized normal (4 bytes).
    let mut bytes = Vec::new();
    for v in 0..4 {
        for c in 0..3 {
            bytes.extend(((QUAD[3 * v + c] * 1000.0) as i16).to_le_bytes());
        }
        bytes.extend([0, 0, 0, 0, 127, 0]);
    }
    let view = g.view(&bytes);
    g.json["bufferViews"][view]["byteStride"] = 12.into();
    let p =
        g.push("accessors", json!({"bufferView": view, "componentType": 5122, "type": "VEC3", "count": 4}));
    let n = g.push(
        "accessors",
        json!({"bufferView": view, "byteOffset": 8, "componentType": 5120, "type": "VEC3",
        "count": 4, "normalized": true}),
    );
    let i = g.indices(&[0, 1, 2, 2, 1, 3]);
    g.primitive(json!({"attributes": {"POSITION": p, "NORMAL": n}, "indices": i}));
    g.json["nodes"][0]["scale"] = json!([0.001, 0.001, 0.001]);
    g.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let scene = g.read().unwrap();
    assert!(close(scene.parts[0].positions[3], Vec3::new(1.0, 1.0, 0.0)));
    assert!(close(scene.parts[0].normals[0], Vec3::Z));
    // One vertex moved by a sparse accessor.
    let values = g.view(&[0xd0, 0x07, 0xd0, 0x07, 0, 0]);
    let at = g.view(&[3]);
    g.json["accessors"][p]["sparse"] = json!({
        "count": 1, "indices": {"bufferView": at, "componentType": 5121}, "values": {"bufferView": values}});
    let scene = g.read().unwrap();
    assert!(close(scene.parts[0].positions[3], Vec3::new(2.0, 2.0, 0.0)));
    // Splitting keeps type and values.
    let folder = Folder::new("quantized");
    let out = folder.0.join("out.glb");
    write(&scene, &light(&scene, true), &out).unwrap();
    let again = Scene::read(&out, &ReadOptions::default()).unwrap();
    assert_eq!(again.parts[0].positions[..4], scene.parts[0].positions[..]);
    let json = json_of(&std::fs::read(&out).unwrap());
    let p = json["meshes"][0]["primitives"][0]["attributes"]["POSITION"].as_u64().unwrap() as usize;
    assert_eq!(json["accessors"][p]["componentType"], 5122);
    assert!(json["accessors"][p].get("sparse").is_none());
}

#[test]
fn read_scenes_can_be_chosen() {
    let mut g = Gltf::quad();
    g.push("nodes", json!({"mesh": 0, "translation": [5, 0, 0]}));
    g.push("scenes", json!({"nodes": [1]}));
    let bytes = g.glb();
    let read = |scene| Scene::read_bytes(&bytes, &ReadOptions { scene, ..ReadOptions::default() });
    assert_eq!(read(None).unwrap().parts[0].node, 0);
    assert_eq!(read(Some(1)).unwrap().parts[0].positions[0].x, 5.0);
    assert!(read(Some(2)).is_err());
}

#[test]
fn read_primitives_share_a_pool_only_with_equal_attributes() {
    let mut g = Gltf::quad();
    let i = g.indices(&[2, 1, 3]);
    let uv = g.floats("VEC2", &[0.0; 8]);
    g.primitive(json!({"attributes": {"NORMAL": 1, "POSITION": 0}, "indices": i}));
    g.primitive(json!({"attributes": {"NORMAL": 1, "POSITION": 0, "TEXCOORD_1": uv}, "indices": i}));
    let scene = g.read().unwrap();
    assert_eq!(scene.parts.len(), 2);
    assert_eq!(scene.parts[0].primitives, [0, 1]);
    assert_eq!(scene.parts[0].triangle_primitives, [0, 0, 1]);
    assert_eq!(scene.parts[1].primitives, [2]);
}

#[test]
fn read_instances_skins_morphs_and_animation() {
    let scene = rich().read().unwrap();
    // Node 4 draws twice; the second instance is moved and turned by 180 degrees about z.
    let instances: Vec<_> = scene.parts.iter().filter(|p| p.node == 4).collect();
    assert_eq!(instances.len(), 2);
    assert_eq!(instances[1].instance, Some(1));
    assert!(close(instances[1].positions[1], Vec3::new(4.0, 0.0, 0.0)), "{:?}", instances[1].positions[1]);
    // The morph target moves vertex 2 by half of (1, 0, 0).
    assert!(close(instances[0].positions[2], Vec3::new(0.5, 1.0, 0.0)));
    // Vertex 1 hangs on joint 1 alone: turned by 90 degrees about z, then lifted by joint 0.
    let skinned = scene.parts.iter().find(|p| p.node == 0).unwrap();
    assert!(close(skinned.positions[1], Vec3::new(0.0, 1.0, 1.0)), "{:?}", skinned.positions[1]);
    for text in ["skins", "morph"] {
        assert!(warned(&scene, text), "{text}");
    }
    let moved = (0..scene.parts.len()).filter(|&p| scene.moving_parts()[p]);
    assert_eq!(moved.map(|p| scene.parts[p].node).collect::<Vec<_>>(), [1]);
}

#[test]
fn read_gpu_instance_count_is_limited_before_it_is_drawn() {
    let bytes = rich().glb();
    let options = ReadOptions { max_triangles: 3, ..ReadOptions::default() };
    assert!(Scene::read_bytes(&bytes, &options).unwrap_err().to_string().contains("triangles"));
}

#[test]
fn opacity_follows_mask_blend_transmission_wrap_and_transform() {
    let mut g = Gltf::quad();
    let mut image = image::RgbaImage::from_pixel(2, 2, image::Rgba([255; 4]));
    image.put_pixel(0, 0, image::Rgba([255, 255, 255, 0]));
    let view = g.view(&png(&image));
    g.push("images", json!({"bufferView": view, "mimeType": "image/png"}));
    g.push("samplers", json!({"wrapS": 33071, "wrapT": 33071}));
    g.push("textures", json!({"source": 0, "sampler": 0}));
    let uv = g.floats("VEC2", &[0., 0., 1., 0., 0., 1., 1., 1.]);
    g.push(
        "materials",
        json!({"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}),
    );
    g.json["meshes"][0]["primitives"][0]["material"] = 0.into();
    g.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = uv.into();
    let at = |g: &Gltf, t, b| g.read().unwrap().triangle_opacity(0, t, b);
    assert_eq!((at(&g, 0, [0.0, 0.0]), at(&g, 0, [1.0, 0.0]), at(&g, 1, [0.0, 1.0])), (0.0, 1.0, 1.0));
    let scene = g.read().unwrap();
    assert!(scene.triangle_flags(0, 0).translucent && !scene.triangle_flags(0, 0).double_sided);
    // Blended: bilinear alpha halfway between the texel centres is a half.
    g.json["materials"][0]["alphaMode"] = "BLEND".into();
    assert!((at(&g, 0, [0.5, 0.0]) - 0.5).abs() < 1e-3);
    assert!((at(&g, 0, [0.25, 0.0]) - 0.0).abs() < 1e-3);
    // Repeating, the border of texel 0 mixes with texel 1 from the other side.
    g.json["samplers"][0]["wrapS"] = 10497.into();
    assert!((at(&g, 0, [0.0, 0.0]) - 0.5).abs() < 1e-3);
    // Moved by half an image, the corner lies between the texels.
    g.json["samplers"][0]["wrapS"] = 33071.into();
    g.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] =
        json!({"KHR_texture_transform": {"offset": [0.5, 0.0]}});
    assert!((at(&g, 0, [0.0, 0.0]) - 0.5).abs() < 1e-3);
    // Factor, vertex alpha and transmission multiply.
    g.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = json!([1, 1, 1, 0.5]);
    g.json["materials"][0]["extensions"] = json!({"KHR_materials_transmission": {"transmissionFactor": 0.5}});
    g.json["materials"][0]["doubleSided"] = true.into();
    let color = g.floats("VEC4", &[1., 1., 1., 0.5].repeat(4));
    g.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = color.into();
    assert!((at(&g, 1, [0.0, 1.0]) - 0.125).abs() < 1e-3);
    assert!(g.read().unwrap().triangle_flags(0, 0).double_sided);
    // An image that cannot be decoded counts as 1, with a warning.
    g.json["images"][0] = json!({"uri": "data:image/ktx2;base64,AAAA"});
    let scene = g.read().unwrap();
    assert!((scene.triangle_opacity(0, 0, [0.0, 0.0]) - 0.125).abs() < 1e-3);
    assert!(warned(&scene, "cannot be decoded"));
}

/// Every pointer of `a` that is missing or different in `b`.
fn differences(a: &Value, b: &Value, path: &str, out: &mut Vec<String>) {
    match (a, b) {
        (Value::Object(x), Value::Object(y)) => {
            let order: Vec<_> = y.keys().filter(|k| x.contains_key(*k)).collect();
            assert_eq!(
                order,
                x.keys().filter(|k| y.contains_key(*k)).collect::<Vec<_>>(),
                "order of keys at {path}"
            );
            for (k, v) in x {
                match y.get(k) {
                    Some(w) => differences(v, w, &format!("{path}/{k}"), out),
                    None => out.push(format!("{path}/{k}")),
                }
            }
        }
        (Value::Array(x), Value::Array(y)) if x.len() <= y.len() => {
            x.iter()
                .zip(y)
                .enumerate()
                .for_each(|(i, (v, w))| differences(v, w, &format!("{path}/{i}"), out));
        }
        _ if a == b => {}
        _ => out.push(path.to_owned()),
    }
}

#[test]
fn write_without_splits_only_adds() {
    let mut g = rich();
    // Without GPU instances, which become nodes.
    g.json["nodes"][4].as_object_mut().unwrap().remove("extensions");
    let before = json_of(&g.glb());
    let scene = g.read().unwrap();
    let folder = Folder::new("adds");
    let out = folder.0.join("out.glb");
    let written = write(&scene, &light(&scene, false), &out).unwrap();
    assert!(written.parts.iter().all(|p| p.added_vertices == 0));
    let after = json_of(&std::fs::read(&out).unwrap());
    let mut found = Vec::new();
    differences(&before, &after, "", &mut found);
    // Two more users of the mesh get clones; COLOR_0 is ours; the buffer grows.
    let expected = [
        "/nodes/1/mesh",
        "/nodes/4/mesh",
        "/meshes/0/primitives/0/attributes/COLOR_0",
        "/meshes/0/primitives/1/attributes/COLOR_0",
        "/buffers/0/byteLength",
    ];
    let mut expected = expected.map(str::to_owned).to_vec();
    expected.sort();
    found.sort();
    assert_eq!(found, expected);
    let primitive = &after["meshes"][0]["primitives"][0];
    assert_eq!(
        primitive["extensions"]["LIGHTKILN_lightmap"],
        json!({"attributes": [ATTRIBUTE], "color0": ORIGINAL_COLOR, "fallback": "COLOR_0"})
    );
    assert_eq!(
        primitive["attributes"][ORIGINAL_COLOR],
        before["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]
    );
    let codes = primitive["attributes"][ATTRIBUTE].as_u64().unwrap() as usize;
    let accessor = &after["accessors"][codes];
    assert_eq!(
        (&accessor["componentType"], &accessor["type"], &accessor["count"]),
        (&json!(5123), &json!("VEC2"), &json!(4))
    );
    assert!(accessor.get("normalized").is_none());
    let view = &after["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    assert_eq!((&view["byteStride"], &view["target"]), (&json!(4), &json!(34962)));
    let layer = json!({"signal": "ambientOcclusion", "channels": 1, "curve": "linear", "range": [0, 1],
        "attribute": "_LIGHTUV", "codes": "packed", "pages": [1]});
    assert_eq!(
        after["extensions"]["LIGHTKILN_lightmap"],
        json!({"version": 2, "generator": "a test", "layers": [layer]})
    );
    assert!(after["extensionsUsed"].as_array().unwrap().contains(&json!("LIGHTKILN_lightmap")));
    assert!(!after["extensionsRequired"].as_array().unwrap().contains(&json!("LIGHTKILN_lightmap")));
    // The meshes of clones share all accessors but ours.
    assert_eq!(after["meshes"][1]["primitives"][0]["attributes"]["POSITION"], 0);
}

#[test]
fn write_again_restores_the_original_first() {
    let folder = Folder::new("again");
    let g = rich();
    let scene = g.read().unwrap();
    let (first, second) = (folder.0.join("a.glb"), folder.0.join("b.glb"));
    write(&scene, &light(&scene, true), &first).unwrap();
    let baked = Scene::read(&first, &ReadOptions::default()).unwrap();
    assert!(warned(&baked, "earlier bake"));
    let map = baked.read_lightmap().unwrap().unwrap();
    assert_eq!(map.extension["version"], 2);
    assert_eq!(map.layers.len(), 1);
    assert_eq!(map.layers[0].pages.len(), 1);
    for (part, given) in map.layers[0].parts.iter().zip(&light(&scene, true).parts) {
        assert_eq!(*part, given.corner_codes[0]);
    }
    // Vertex 0 is (1, 1/2, 1/4) times (1/2, 1/4, 1), rounded to 8 bits.
    let color = baked.read_fallback().unwrap()[0][0][0];
    assert!(color.iter().zip([0.5, 0.125, 0.25]).all(|(a, b)| (a - b).abs() < 1.0 / 255.0), "{color:?}");
    // With no fallback, the original color stands where it stood.
    let mut plain = light(&baked, false);
    plain.fallback = Fallback::None;
    plain.layers[0].pages.clear();
    write(&baked, &plain, &second).unwrap();
    let json = json_of(&std::fs::read(&second).unwrap());
    assert_eq!(json["textures"].as_array().unwrap().len(), 1);
    assert_eq!(json["images"].as_array().unwrap().len(), 1);
    assert_eq!(json["samplers"].as_array().unwrap().len(), 1);
    let primitive = &json["meshes"][0]["primitives"][0];
    assert!(primitive["attributes"].get(ORIGINAL_COLOR).is_none());
    let color = &json["accessors"][primitive["attributes"]["COLOR_0"].as_u64().unwrap() as usize];
    assert_eq!(color["componentType"], 5126);
    let again = Scene::read(&second, &ReadOptions::default()).unwrap();
    for (a, b) in again.parts.iter().zip(&scene.parts) {
        for t in 0..a.triangles.len() {
            assert_eq!(
                a.triangles[t].map(|v| a.positions[v as usize]),
                b.triangles[t].map(|v| b.positions[v as usize])
            );
        }
    }
}

#[test]
fn write_unlit_users_of_a_mesh_keep_it_as_it_was() {
    let mut g = Gltf::quad();
    g.push("nodes", json!({"mesh": 0}));
    g.push("scenes", json!({"nodes": [1]}));
    let scene = g.read().unwrap();
    let folder = Folder::new("unlit");
    let out = folder.0.join("out.glb");
    let written = write(&scene, &light(&scene, true), &out).unwrap();
    assert_eq!(written.cloned_meshes, 1);
    let json = json_of(&std::fs::read(&out).unwrap());
    assert_eq!(json["meshes"][0], g.json["meshes"][0]);
    assert_eq!((&json["nodes"][0]["mesh"], &json["nodes"][1]["mesh"]), (&json!(1), &json!(0)));
}

#[test]
fn write_split_indices_grow_past_16_bits() {
    let mut g = Gltf::new();
    // 65 535 vertices are the most that 16-bit indices can name; one more needs 32 bits.
    let count = 65_535_usize;
    let positions: Vec<f32> = (0..count).flat_map(|v| [v as f32, (v % 7) as f32, 0.0]).collect();
    let p = g.floats("VEC3", &positions);
    let n = g.floats("VEC3", &[0., 0., 1.].repeat(count));
    let i = g.indices(&[0, 1, 2, 2, 1, 65_534]);
    g.primitive(json!({"attributes": {"POSITION": p, "NORMAL": n}, "indices": i}));
    let scene = g.read().unwrap();
    let folder = Folder::new("wide");
    let out = folder.0.join("out.glb");
    let written = write(&scene, &light(&scene, true), &out).unwrap();
    assert_eq!(written.parts[0].added_vertices, 2);
    let json = json_of(&std::fs::read(&out).unwrap());
    let i = json["meshes"][0]["primitives"][0]["indices"].as_u64().unwrap() as usize;
    assert_eq!(json["accessors"][i]["componentType"], 5125);
}

#[test]
fn write_mirrored_keeps_the_winding_of_the_file() {
    let mut g = Gltf::quad();
    g.json["nodes"][0]["scale"] = json!([-1, 1, 1]);
    let scene = g.read().unwrap();
    let folder = Folder::new("mirrored");
    let out = folder.0.join("out.glb");
    write(&scene, &light(&scene, true), &out).unwrap();
    let again = Scene::read(&out, &ReadOptions::default()).unwrap();
    assert!((0..2).all(|t| front(&again, 0, t) == front(&scene, 0, t)));
    assert_eq!(
        again.read_lightmap().unwrap().unwrap().layers[0].parts[0],
        light(&scene, true).parts[0].corner_codes[0]
    );
}

#[test]
fn write_gltf_copies_resources_and_leaves_no_temporary_files() {
    let folder = Folder::new("files");
    let (from, to) = (folder.0.join("from dir"), folder.0.join("to"));
    std::fs::create_dir_all(from.join("täx")).unwrap();
    let mut g = Gltf::quad();
    g.push("images", json!({"uri": "t%C3%A4x/a%20b.png"}));
    g.push("textures", json!({"source": 0}));
    g.json["buffers"][0]["uri"] = "geo%20metry.bin".into();
    g.json["buffers"][0]["byteLength"] = g.bin.len().into();
    std::fs::write(from.join("geo metry.bin"), &g.bin).unwrap();
    std::fs::write(from.join("täx/a b.png"), b"image").unwrap();
    std::fs::write(from.join("scene.gltf"), serde_json::to_vec(&g.json).unwrap()).unwrap();
    let scene = Scene::read(&from.join("scene.gltf"), &ReadOptions::default()).unwrap();
    let out = to.join("bäked scene.gltf");
    let written = write(&scene, &light(&scene, true), &out).unwrap();
    let mut names: Vec<String> =
        std::fs::read_dir(&to).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert_eq!(names, ["bäked scene.bin", "bäked scene.gltf", "bäked scene.lightkiln.0.png", "täx"]);
    assert!(to.join("täx/a b.png").exists());
    assert_eq!(written.files.last().unwrap().path, out);
    for file in &written.files {
        assert_eq!(std::fs::metadata(&file.path).unwrap().len(), file.bytes);
    }
    let again = Scene::read(&out, &ReadOptions::default()).unwrap();
    assert_eq!(
        again.read_lightmap().unwrap().unwrap().layers[0].pages[0].uri.as_deref(),
        Some("bäked%20scene.lightkiln.0.png")
    );
    // Into a .glb: the buffer moves inside.
    write(&scene, &light(&scene, true), &to.join("inside.glb")).unwrap();
    let inside = Scene::read(&to.join("inside.glb"), &ReadOptions::default()).unwrap();
    assert_eq!(inside.parts[0].triangles, again.parts[0].triangles);
}

#[test]
fn write_gpu_instances_become_nodes() {
    let scene = rich().read().unwrap();
    let folder = Folder::new("instances");
    let out = folder.0.join("out.glb");
    let written = write(&scene, &light(&scene, true), &out).unwrap();
    assert_eq!(written.expanded_instances, 2);
    let json = json_of(&std::fs::read(&out).unwrap());
    assert_eq!(json["nodes"][4], json!({"children": [5, 6]}));
    assert_eq!(json["nodes"][6]["translation"], json!([5.0, 0.0, 0.0]));
    assert!(!json["extensionsUsed"].as_array().unwrap().contains(&json!("EXT_mesh_gpu_instancing")));
    assert!(json.get("extensionsRequired").is_none());
    let again = Scene::read(&out, &ReadOptions::default()).unwrap();
    for (a, b) in again.parts.iter().zip(&scene.parts) {
        assert!((0..a.triangles.len()).all(|t| (0..3).all(|k| {
            let at = |p: &lightkiln_scene::Part| p.positions[p.triangles[t][k] as usize];
            close(at(a), at(b))
        })));
    }
}

#[test]
fn write_same_input_gives_same_bytes() {
    let folder = Folder::new("same");
    let scene = rich().read().unwrap();
    for name in ["a.glb", "b.glb"] {
        write(&scene, &light(&scene, true), &folder.0.join(name)).unwrap();
    }
    assert_eq!(
        std::fs::read(folder.0.join("a.glb")).unwrap(),
        std::fs::read(folder.0.join("b.glb")).unwrap()
    );
}
