//! Several layers in one file: round trips, what is taken out again, and what is refused.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // helpers of tests are tests

mod common;

use std::path::Path;

use common::{Folder, Gltf, codes, glb, json_of, layer, light, png, rich, three_layers};
use lightkiln_scene::{
    BakedLight, EXTENSION, ErrorKind, Fallback, PartLight, ReadOptions, Scene, SceneError, Slot,
    attribute_name, write,
};
use serde_json::{Value, json};

fn read(path: &Path) -> Scene {
    Scene::read(path, &ReadOptions::default()).unwrap()
}

fn file_json(path: &Path) -> Value {
    let bytes = std::fs::read(path).unwrap();
    if path.extension().is_some_and(|e| e == "glb") {
        json_of(&bytes)
    } else {
        serde_json::from_slice(&bytes).unwrap()
    }
}

#[test]
fn layers_round_trip() {
    let folder = Folder::new("layers");
    let scene = rich().read().unwrap();
    let light = three_layers(&scene);
    for name in ["out.glb", "out.gltf"] {
        let path = folder.0.join(name);
        let written = write(&scene, &light, &path).unwrap();
        assert!(written.parts.iter().all(|p| p.stride == p.original_stride + 3 * 4 + 4));
        let vertices: usize = written.parts.iter().map(|p| p.original_vertices + p.added_vertices).sum();
        assert_eq!(written.light_bytes, 3 * 4 * vertices as u64);
        assert!(written.layers.iter().all(|l| l.attribute_bytes == 4 * vertices as u64));
        assert_eq!(written.atlas_bytes, 3 * written.layers[1].atlas_bytes);
        assert_eq!(written.table_bytes, written.layers[2].table_bytes);
        let again = read(&path);
        let map = again.read_lightmap().unwrap().unwrap();
        assert_eq!((map.extension["version"].as_u64(), map.layers.len()), (Some(2), 3));
        for (number, (read, given)) in map.layers.iter().zip(&light.layers).enumerate() {
            assert_eq!(read.info["signal"], given.info["signal"]);
            assert_eq!(read.info["attribute"], attribute_name(number));
            assert_eq!(read.info["codes"], if number == 2 { "table" } else { "packed" });
            assert!(read.pages.iter().map(|p| &p.png).eq(&given.pages));
            assert_eq!(read.table.as_ref().map(|t| &t.png), given.table.as_ref());
            assert!(read.parts.iter().eq(light.parts.iter().map(|p| &p.corner_codes[number])));
        }
        let fallback = again.read_fallback().unwrap();
        assert!(fallback.iter().zip(&scene.parts).all(|(f, p)| f.len() == p.triangles.len()));
    }
    let mut names: Vec<_> = std::fs::read_dir(&folder.0)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    let pages =
        ["", "_1", "_2"].map(|layer| ["0", "1"].map(|page| format!("out.lightkiln{layer}.{page}.png")));
    let mut expected = pages.concat();
    expected.extend(["out.bin", "out.glb", "out.gltf", "out.lightkiln_2.table.png"].map(str::to_owned));
    expected.sort();
    assert_eq!(names, expected);
}

#[test]
fn layers_are_attributes_of_four_bytes_in_views_of_their_own() {
    let folder = Folder::new("views");
    let scene = Gltf::quad().read().unwrap();
    let path = folder.0.join("out.glb");
    write(&scene, &three_layers(&scene), &path).unwrap();
    let json = file_json(&path);
    let primitive = &json["meshes"][0]["primitives"][0];
    assert_eq!(
        primitive["extensions"][EXTENSION]["attributes"],
        json!(["_LIGHTUV", "_LIGHTUV_1", "_LIGHTUV_2"])
    );
    let mut views: Vec<&Value> = (0..3)
        .map(|layer| {
            let accessor =
                &json["accessors"][primitive["attributes"][attribute_name(layer)].as_u64().unwrap() as usize];
            assert_eq!((&accessor["componentType"], &accessor["type"]), (&json!(5123), &json!("VEC2")));
            &accessor["bufferView"]
        })
        .collect();
    for view in &views {
        assert_eq!(json["bufferViews"][view.as_u64().unwrap() as usize]["byteStride"], 4);
    }
    views.dedup();
    assert_eq!(views.len(), 3);
    // Tables are not filtered.
    let layers = json["extensions"][EXTENSION]["layers"].as_array().unwrap();
    let filter = |texture: &Value| {
        let texture = &json["textures"][texture.as_u64().unwrap() as usize];
        json["samplers"][texture["sampler"].as_u64().unwrap() as usize]["magFilter"].clone()
    };
    assert_eq!((filter(&layers[1]["pages"][0]), filter(&layers[2]["table"])), (json!(9729), json!(9728)));
}

#[test]
fn layers_split_where_the_tuple_differs_and_only_there() {
    let folder = Folder::new("tuple");
    let scene = Gltf::quad().read().unwrap();
    // Two triangles share the vertices 1 and 2.
    let by_triangle = codes(&scene, 0, |t, _| [t, 0x8000]);
    let by_vertex = codes(&scene, 0, |_, v| [v, 0x8000]);
    let mut only_two = by_vertex.clone();
    only_two[1][0] = [99, 0x8000];
    let added = |layers: &[&Vec<[[u16; 2]; 3]>]| {
        let mut light = light(&scene, true);
        light.parts[0].corner_codes = layers.iter().map(|&l| l.clone()).collect();
        light.layers = vec![layer("direct", 3, 1); layers.len()];
        let path = folder.0.join("out.glb");
        let written = write(&scene, &light, &path).unwrap();
        let map = read(&path).read_lightmap().unwrap().unwrap();
        assert!(map.layers.iter().map(|l| &l.parts[0]).eq(&light.parts[0].corner_codes));
        written.parts[0].added_vertices
    };
    assert_eq!(added(&[&by_vertex]), 0);
    assert_eq!(added(&[&by_vertex, &by_vertex]), 0);
    assert_eq!(added(&[&by_vertex, &only_two]), 1);
    assert_eq!(added(&[&only_two, &by_vertex, &only_two]), 1);
    assert_eq!(added(&[&by_triangle]), 2);
    // Both layers split the same two vertices: that costs no more than one.
    assert_eq!(added(&[&by_triangle, &by_triangle, &only_two]), 2);
}

#[test]
fn fallback_is_rgb_times_the_color_of_the_asset() {
    let folder = Folder::new("rgb");
    let mut g = Gltf::quad();
    let color = g.floats("VEC3", &[1.0, 0.5, 0.25].repeat(4));
    for own in [false, true] {
        if own {
            g.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = color.into();
        }
        let scene = g.read().unwrap();
        let mut light = light(&scene, true);
        light.parts[0].corner_fallback = codes(&scene, 0, |t, v| [t, v])
            .iter()
            .map(|c| c.map(|[t, v]| [f32::from(t), f32::from(v) / 4.0, 2.0]))
            .collect();
        let path = folder.0.join("out.glb");
        write(&scene, &light, &path).unwrap();
        let shown = read(&path).read_fallback().unwrap();
        for (shown, given) in shown[0].iter().flatten().zip(light.parts[0].corner_fallback.iter().flatten()) {
            let base = if own { [1.0, 0.5, 0.25] } else { [1.0; 3] };
            for c in 0..3 {
                assert!(
                    (shown[c] - (given[c] * base[c]).clamp(0.0, 1.0)).abs() < 0.6 / 255.0,
                    "{shown:?} {given:?}"
                );
            }
        }
        // Three channels of one byte each, four bytes apart.
        let json = file_json(&path);
        let accessor = &json["accessors"]
            [json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"].as_u64().unwrap() as usize];
        assert_eq!((&accessor["type"], &accessor["componentType"]), (&json!("VEC3"), &json!(5121)));
        assert_eq!(json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize]["byteStride"], 4);
    }
}

/// The same file as format version 1 had it.
fn as_version_1(root: &mut Value) {
    let ours = &mut root["extensions"][EXTENSION];
    let mut old = ours["layers"][0].clone();
    old.as_object_mut().unwrap().retain(|key, _| ["signal", "range", "pages"].contains(&key.as_str()));
    old["version"] = 1.into();
    *ours = old;
    for primitive in root["meshes"]
        .as_array_mut()
        .unwrap()
        .iter_mut()
        .flat_map(|m| m["primitives"].as_array_mut().unwrap())
    {
        if let Some(ours) = primitive.get_mut("extensions").and_then(|e| e.get_mut(EXTENSION)) {
            ours.as_object_mut().unwrap().remove("attributes");
            ours["attribute"] = "_LIGHTUV".into();
            ours["lightmap"] = 0.into();
        }
    }
}

/// A GLB with another JSON.
fn altered(path: &Path, alter: impl Fn(&mut Value)) -> Vec<u8> {
    let bytes = std::fs::read(path).unwrap();
    let mut json = json_of(&bytes);
    let length = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
    alter(&mut json);
    glb(&serde_json::to_vec(&json).unwrap(), &bytes[28 + length..])
}

fn read_bytes(bytes: &[u8]) -> Scene {
    Scene::read_bytes(bytes, &ReadOptions::default()).unwrap()
}

#[test]
fn undo_takes_out_both_versions() {
    let folder = Folder::new("undo");
    let mut g = rich();
    // Nothing is dropped beside an extension that might refer to it.
    g.json["extensionsUsed"].as_array_mut().unwrap().retain(|e| e != "VENDOR_unknown");
    g.json.as_object_mut().unwrap().remove("extensions");
    let scene = g.read().unwrap();
    let [first, second] = ["first.glb", "second.glb"].map(|n| folder.0.join(n));
    let once = light(&scene, false);
    write(&scene, &once, &first).unwrap();
    let expected = std::fs::read(&first).unwrap();
    // Three layers go without a trace when one is written over them.
    let mut unsplit = three_layers(&scene);
    for (part, plain) in unsplit.parts.iter_mut().zip(&once.parts) {
        part.corner_codes[0].clone_from(&plain.corner_codes[0]);
    }
    write(&scene, &unsplit, &second).unwrap();
    let again = read(&second);
    assert!(again.warnings.iter().any(|w| w.message.contains("earlier bake")));
    // GPU instances have become nodes: the same parts, none of them an instance.
    write(&again, &light(&again, false), &second).unwrap();
    let left = std::fs::read(&second).unwrap();
    let [left_json, expected_json] = [&left, &expected].map(|b| json_of(b));
    for key in ["textures", "images", "samplers", "extensionsUsed", "meshes", "nodes"] {
        assert_eq!(
            left_json[key].as_array().unwrap().len(),
            expected_json[key].as_array().unwrap().len(),
            "{key}"
        );
    }
    assert!(!left_json.to_string().contains("_LIGHTUV_1"));
    assert_eq!(left.len(), expected.len());
    // Version 1 goes the same way.
    let old = read_bytes(&altered(&first, as_version_1));
    write(&old, &light(&old, false), &second).unwrap();
    assert_eq!(std::fs::read(&second).unwrap().len(), expected.len());
    let mut plain = light(&old, false);
    plain.fallback = Fallback::None;
    plain.layers[0].pages.clear();
    write(&old, &plain, &second).unwrap();
    assert_eq!(file_json(&second)["textures"].as_array().unwrap().len(), 1);
}

#[test]
fn version_1_is_not_read_but_named() {
    let folder = Folder::new("version");
    let scene = Gltf::quad().read().unwrap();
    let path = folder.0.join("out.glb");
    write(&scene, &light(&scene, true), &path).unwrap();
    let of = |alter: &dyn Fn(&mut Value)| read_bytes(&altered(&path, alter)).read_lightmap().unwrap_err();
    let old = of(&as_version_1);
    assert_eq!(old.kind(), ErrorKind::Unsupported);
    assert!(old.to_string().contains("baked by an older version"), "{old}");
    assert_eq!(old.remedy(), "bake again");
    let new = of(&|json| json["extensions"][EXTENSION]["version"] = 3.into());
    assert!(new.to_string().contains("version 3") && new.remedy().contains("newer"), "{new}");
}

#[test]
fn damaged_extension_objects_are_errors() {
    let folder = Folder::new("damaged");
    let scene = Gltf::quad().read().unwrap();
    let path = folder.0.join("out.glb");
    write(&scene, &three_layers(&scene), &path).unwrap();
    let cases: [(&str, Value); 23] = [
        ("", json!(5)),
        ("/version", json!("2")),
        ("/version", json!(null)),
        ("/version", json!(0)),
        ("/layers", json!(null)),
        ("/layers", json!([])),
        ("/layers", json!({"0": {}})),
        ("/layers/0", json!(7)),
        ("/layers/0/attribute", json!("_LIGHTUV_1")),
        ("/layers/0/attribute", json!("POSITION")),
        ("/layers/1/attribute", json!(null)),
        ("/layers/0/channels", json!(0)),
        ("/layers/0/channels", json!(4)),
        ("/layers/0/channels", json!("1")),
        ("/layers/0/pages", json!(0)),
        ("/layers/0/pages", json!([99])),
        ("/layers/0/pages", json!([-1])),
        ("/layers/1/pages", json!([])),
        ("/layers/0/codes", json!("other")),
        ("/layers/0/codes", json!("table")),
        ("/layers/2/codes", json!("packed")),
        ("/layers/2/table", json!([3])),
        ("/layers/2/table", json!(1000)),
    ];
    for (pointer, with) in cases {
        let bytes = altered(&path, |json| {
            *json["extensions"][EXTENSION].pointer_mut(pointer).unwrap() = with.clone()
        });
        let scene = read_bytes(&bytes);
        assert!(scene.read_lightmap().is_err(), "{pointer} = {with}");
        // Whatever it says, the next bake takes its place.
        write(&scene, &light(&scene, true), &folder.0.join("next.glb")).unwrap();
    }
    let cases: [(&str, Value); 7] = [
        ("/extensions/LIGHTKILN_lightmap", json!(true)),
        ("/extensions/LIGHTKILN_lightmap/attributes", json!("_LIGHTUV")),
        ("/extensions/LIGHTKILN_lightmap/attributes", json!(["_LIGHTUV"])),
        ("/extensions/LIGHTKILN_lightmap/attributes", json!(["_LIGHTUV_1", "_LIGHTUV", "_LIGHTUV_2"])),
        ("/extensions/LIGHTKILN_lightmap/attributes/1", json!("POSITION")),
        ("/attributes/_LIGHTUV", json!(0)),
        ("/attributes/_LIGHTUV", json!(1000)),
    ];
    for (pointer, with) in cases {
        let bytes = altered(&path, |json| {
            *json["meshes"][0]["primitives"][0].pointer_mut(pointer).unwrap() = with.clone()
        });
        let scene = read_bytes(&bytes);
        let error = scene.read_lightmap().unwrap_err();
        assert_eq!((error.place().mesh, error.place().primitive), (Some(0), Some(0)), "{pointer} = {with}");
    }
    // An attribute that is gone.
    let bytes = altered(&path, |json| {
        json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("_LIGHTUV_2");
    });
    assert!(matches!(read_bytes(&bytes).read_lightmap(), Err(SceneError::Value { .. })));
    // A damaged name of an attribute does not cost the asset its own.
    let bytes = altered(&path, |json| {
        json["meshes"][0]["primitives"][0]["extensions"][EXTENSION]["attributes"] =
            json!(["POSITION", "NORMAL"]);
    });
    assert_eq!(read_bytes(&bytes).parts[0].triangles.len(), 2);
}

#[test]
fn light_of_wrong_shape_is_refused() {
    let folder = Folder::new("shape");
    let scene = Gltf::quad().read().unwrap();
    let refuse = |alter: &dyn Fn(&mut BakedLight)| {
        let mut wrong = three_layers(&scene);
        alter(&mut wrong);
        write(&scene, &wrong, &folder.0.join("out.glb")).unwrap_err()
    };
    let is = |e: &SceneError, n, of| matches!(e, SceneError::Light { count, expected, .. } if (*count, *expected) == (n, of));
    assert!(is(&refuse(&|l| l.layers.clear()), 0, 1));
    assert!(is(&refuse(&|l| l.layers.truncate(2)), 3, 2));
    assert!(is(&refuse(&|l| l.layers[1].pages.truncate(1)), 1, 2));
    // All layers read the atlas at the same place, or none does.
    let place = |a: [u16; 2], b: [u16; 2]| {
        refuse(&|l| {
            l.parts[0].corner_codes[0][1][2] = a;
            l.parts[0].corner_codes[2][1][2] = b;
        })
    };
    for (a, b) in [([8, 8], [8, 16]), ([8, 8], [8, 0x8000]), ([8, 0x8001], [0, 0])] {
        let error = place(a, b);
        assert!(error.to_string().contains("triangle 1"), "{error}");
    }
    assert!(is(&refuse(&|l| l.parts[0].corner_codes.truncate(1)), 1, 3));
    assert!(is(&refuse(&|l| l.parts[0].corner_codes[2].truncate(1)), 1, 2));
    assert!(is(&refuse(&|l| l.parts[0].corner_fallback.truncate(1)), 1, 2));
    assert!(is(&refuse(&|l| l.parts.push(PartLight::default())), 2, 1));
    assert!(matches!(refuse(&|l| l.parts[0].corner_fallback[1][2][1] = f32::NAN), SceneError::Value { .. }));
    assert_eq!(std::fs::read_dir(&folder.0).unwrap().count(), 0);
}

/// A quad with three images: base color, lightmap, and one that the lightmap and the occlusion share.
fn with_old_light() -> Gltf {
    let mut g = Gltf::quad();
    let uv = g.floats("VEC2", &[0., 0., 1., 0., 0., 1., 1., 1.]);
    for value in [10, 20, 30] {
        let view = g.view(&png(&image::RgbaImage::from_pixel(16, 16, image::Rgba([value; 4]))));
        let image =
            g.push("images", json!({"bufferView": view, "mimeType": "image/png", "name": value.to_string()}));
        let sampler = g.push("samplers", json!({}));
        g.push("textures", json!({"source": image, "sampler": sampler}));
    }
    // The order is lightmap, base color, occlusion, so that numbers have to move.
    g.push(
        "materials",
        json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}, "occlusionTexture": {"index": 2},
            "extensions": {"MOZ_lightmap": {"index": 0, "intensity": 2.0}, "KHR_materials_clearcoat": {"clearcoatTexture": {"index": 2}}}}),
    );
    g.json["extensionsUsed"] = json!(["MOZ_lightmap", "KHR_materials_clearcoat"]);
    let primitive = &mut g.json["meshes"][0]["primitives"][0];
    primitive["material"] = 0.into();
    primitive["attributes"]["TEXCOORD_0"] = uv.into();
    g
}

#[test]
fn remove_takes_the_old_lightmap_and_its_image_out() {
    let folder = Folder::new("remove");
    let path = folder.0.join("out.glb");
    let names = |json: &Value| -> Vec<String> {
        json["images"]
            .as_array()
            .unwrap()
            .iter()
            .filter_map(|i| i["name"].as_str().map(str::to_owned))
            .collect()
    };
    let g = with_old_light();
    let scene = g.read().unwrap();
    let bake = |remove: Vec<Slot>| {
        let light = BakedLight { remove, ..light(&scene, false) };
        let written = write(&scene, &light, &path).unwrap();
        (file_json(&path), written.dropped_bytes)
    };
    // Off by default.
    let (kept, dropped) = bake(Vec::new());
    assert_eq!((kept["materials"] == g.json["materials"], names(&kept).len(), dropped), (true, 3, 0));
    let (json, dropped) = bake(vec![Slot::Lightmap]);
    assert_eq!(names(&json), ["20", "30"]);
    assert!(dropped > 0);
    assert_eq!(
        json["materials"][0],
        json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "occlusionTexture": {"index": 1},
            "extensions": {"KHR_materials_clearcoat": {"clearcoatTexture": {"index": 1}}}})
    );
    assert_eq!(json["textures"][0], json!({"source": 0, "sampler": 0}));
    assert_eq!(json["extensionsUsed"], json!(["KHR_materials_clearcoat", EXTENSION]));
    let again = read(&path);
    assert!(again.textures(Slot::Lightmap).unwrap().is_none());
    assert_eq!(again.read_lightmap().unwrap().unwrap().layers[0].pages.len(), 1);
    let texel = |scene: &Scene| {
        let shown = scene.textures(Slot::BaseColor).unwrap().unwrap();
        let mut out = vec![0.0; 3];
        shown.sample(0, 0, [0.25, 0.25], &mut out);
        out
    };
    assert_eq!(texel(&again), texel(&scene));
    // An image that something else shows stays.
    let (json, _) = bake(vec![Slot::Occlusion, Slot::Lightmap]);
    assert_eq!(names(&json), ["20", "30"]);
    assert!(json["materials"][0].get("occlusionTexture").is_none());
}

#[test]
fn remove_leaves_images_that_an_unknown_extension_may_show() {
    let folder = Folder::new("unknown");
    let mut g = with_old_light();
    g.json["extensionsUsed"].as_array_mut().unwrap().push("VENDOR_sky".into());
    let scene = g.read().unwrap();
    let path = folder.0.join("out.glb");
    let light = BakedLight { remove: vec![Slot::Lightmap], ..light(&scene, false) };
    write(&scene, &light, &path).unwrap();
    let json = file_json(&path);
    assert_eq!(json["images"].as_array().unwrap().len(), 4);
    assert!(json["materials"][0]["extensions"].get("MOZ_lightmap").is_none());
}

#[test]
fn remove_copies_no_file_of_a_removed_image() {
    let folder = Folder::new("copies");
    let mut g = Gltf::quad();
    g.push("images", json!({"uri": "old light.png"}));
    g.push("textures", json!({"source": 0}));
    g.push("materials", json!({"extensions": {"EXT_lightmap": {"index": 0}}}));
    g.json["extensionsUsed"] = json!(["EXT_lightmap"]);
    g.json["meshes"][0]["primitives"][0]["material"] = 0.into();
    std::fs::write(folder.0.join("old light.png"), b"image").unwrap();
    std::fs::write(folder.0.join("in.glb"), g.glb()).unwrap();
    let scene = read(&folder.0.join("in.glb"));
    for (remove, there) in [(vec![Slot::Lightmap], false), (Vec::new(), true)] {
        let light = BakedLight { remove, ..light(&scene, false) };
        write(&scene, &light, &folder.0.join("to/out.glb")).unwrap();
        assert_eq!(folder.0.join("to/old light.png").exists(), there);
    }
    let mut bare = light(&scene, false);
    (bare.remove, bare.layers[0].pages) = (vec![Slot::Lightmap], Vec::new());
    write(&scene, &bare, &folder.0.join("bare.glb")).unwrap();
    let json = file_json(&folder.0.join("bare.glb"));
    assert!(["images", "textures"].iter().all(|key| json.get(*key).is_none()), "{json}");
}
