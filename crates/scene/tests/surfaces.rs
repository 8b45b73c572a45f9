//! What surfaces reflect, emit and let through.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // helpers of tests are tests

mod common;

use common::{Gltf, png};
use lightkiln_scene::{Glass, MAX_ALBEDO, ReadOptions, Scene, SceneError};
use serde_json::{Value, json};

fn surfaces() -> ReadOptions {
    ReadOptions { surfaces: true, ..ReadOptions::default() }
}

fn read(g: &Gltf) -> Scene {
    Scene::read_bytes(&g.glb(), &surfaces()).unwrap()
}

/// The quad with texture coordinates 0..1 and a material; its textures are images of `texels`.
fn quad(material: Value, texels: &[[[u8; 4]; 4]]) -> Gltf {
    let mut g = Gltf::quad();
    for texels in texels {
        let mut image = image::RgbaImage::new(2, 2);
        image.pixels_mut().zip(texels).for_each(|(p, t)| p.0 = *t);
        let view = g.view(&png(&image));
        let source = g.push("images", json!({"bufferView": view, "mimeType": "image/png", "name": "map"}));
        g.push("textures", json!({"source": source}));
    }
    let uv = g.floats("VEC2", &[0.25, 0.25, 0.75, 0.25, 0.25, 0.75, 0.75, 0.75]);
    g.push("materials", material);
    g.json["meshes"][0]["primitives"][0]["material"] = 0.into();
    g.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = uv.into();
    g
}

fn close(a: [f32; 3], b: [f32; 3]) {
    assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-3), "{a:?}, expected {b:?}");
}

const FIRST: [f32; 2] = [0.0, 0.0];
const SECOND: [f32; 2] = [1.0, 0.0];

#[test]
fn surface_albedo_is_factor_times_texture_times_vertex_color() {
    let texels = [[188, 255, 0, 255], [255; 4], [255; 4], [255; 4]];
    let pbr =
        json!({"baseColorFactor": [1, 0.5, 1, 1], "baseColorTexture": {"index": 0}, "metallicFactor": 1});
    let mut g = quad(json!({"pbrMetallicRoughness": pbr}), &[texels]);
    let scene = read(&g);
    close(scene.triangle_albedo(0, 0, FIRST), [0.503, 0.5, 0.0]);
    close(scene.triangle_albedo(0, 0, SECOND), [MAX_ALBEDO, 0.5, MAX_ALBEDO]);
    close(scene.triangle_albedo(0, 0, [0.5, 0.0]), [0.7515, 0.5, 0.5]);
    let color = g.floats("VEC3", &[0.5, 1., 1., 1., 1., 0.25, 1., 1., 1., 1., 1., 1.]);
    g.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = color.into();
    let scene = read(&g);
    close(scene.triangle_albedo(0, 0, FIRST), [0.2515, 0.5, 0.0]);
    close(scene.triangle_albedo(0, 0, SECOND), [MAX_ALBEDO, 0.5, 0.25]);
    // Without surfaces the factor alone is known, and no image is decoded.
    close(g.read().unwrap().triangle_albedo(0, 0, FIRST), [MAX_ALBEDO, 0.5, MAX_ALBEDO]);
}

#[test]
fn surface_without_material_is_white() {
    let scene = read(&Gltf::quad());
    assert_eq!(scene.triangle_albedo(0, 1, [0.3, 0.3]), [MAX_ALBEDO; 3]);
    assert_eq!(scene.triangle_emission(0, 1, [0.3, 0.3]), [0.0; 3]);
    assert_eq!(scene.triangle_transmission(0, 1, [0.3, 0.3]), [0.0; 3]);
    assert!(scene.emissive_triangles().is_empty());
}

#[test]
fn surface_wraps_and_transforms_move_the_lookup() {
    let texels = [[0, 0, 0, 255], [255; 4], [255; 4], [255; 4]];
    let moved = |offset: Value| {
        let transform = json!({"KHR_texture_transform": {"offset": offset}});
        let info = json!({"index": 0, "extensions": transform});
        quad(json!({"pbrMetallicRoughness": {"baseColorTexture": info}}), &[texels])
    };
    close(read(&moved(json!([1.0, -3.0]))).triangle_albedo(0, 0, FIRST), [0.0; 3]);
    close(read(&moved(json!([0.5, 0.0]))).triangle_albedo(0, 0, FIRST), [MAX_ALBEDO; 3]);
    let mut mirrored = moved(json!([1.0, 0.0]));
    mirrored.push("samplers", json!({"wrapS": 33648, "wrapT": 33648}));
    mirrored.json["textures"][0]["sampler"] = 0.into();
    close(read(&mirrored).triangle_albedo(0, 0, FIRST), [MAX_ALBEDO; 3]);
}

#[test]
fn surface_specular_glossiness_gives_color_and_alpha() {
    let glossy = json!({"diffuseFactor": [0.5, 1, 1, 0.5], "diffuseTexture": {"index": 0}});
    let material = json!({"alphaMode": "BLEND",
        "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]},
        "extensions": {"KHR_materials_pbrSpecularGlossiness": glossy}});
    let scene = read(&quad(material, &[[[255, 255, 255, 51], [255; 4], [255; 4], [255; 4]]]));
    close(scene.triangle_albedo(0, 0, FIRST), [0.5, MAX_ALBEDO, MAX_ALBEDO]);
    assert!((scene.triangle_opacity(0, 0, FIRST) - 0.1).abs() < 1e-6);
}

#[test]
fn surface_emission_has_texture_strength_and_coverage() {
    let glow = json!({"emissiveFactor": [1, 0.5, 0], "emissiveTexture": {"index": 0},
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 1000}}});
    let black = [0, 0, 0, 255];
    let scene = read(&quad(glow.clone(), &[[[188, 255, 255, 255], black, black, black]]));
    let at = scene.triangle_emission(0, 0, FIRST);
    assert!((at[0] - 503.0).abs() < 1.0 && at[1] == 500.0 && at[2] == 0.0, "{at:?}");
    assert_eq!(scene.triangle_emission(0, 0, SECOND), [0.0; 3]);
    // The second triangle touches the lit corner nowhere, but lies beside it.
    let listed = scene.emissive_triangles();
    assert_eq!(listed[0].triangle, 0);
    assert!(listed[0].mean_emission[0] > 100.0 && listed[0].mean_emission[0] < 300.0, "{listed:?}");
    let scene = read(&quad(glow.clone(), &[[black; 4]]));
    assert!(scene.emissive_triangles().is_empty());

    let mut hole = glow.clone();
    hole["alphaMode"] = "MASK".into();
    hole["pbrMetallicRoughness"] = json!({"baseColorFactor": [1, 1, 1, 0.25]});
    let scene = read(&quad(hole, &[[[255; 4]; 4]]));
    assert_eq!(scene.triangle_emission(0, 0, FIRST), [0.0; 3]);
    assert_eq!(scene.triangle_transmission(0, 0, FIRST), [1.0; 3]);

    let mut unlit = glow;
    unlit["extensions"]["KHR_materials_unlit"] = json!({});
    let scene = read(&quad(unlit, &[[[255; 4]; 4]]));
    assert!(scene.materials[0].unlit);
    assert_eq!(scene.triangle_emission(0, 0, FIRST), [0.0; 3]);
    assert_eq!(scene.triangle_albedo(0, 0, FIRST), [MAX_ALBEDO; 3]);
}

#[test]
fn surface_emission_factor_alone_is_emitted_everywhere() {
    let scene = Gltf::quad();
    let mut g = scene;
    g.push("materials", json!({"emissiveFactor": [1e300, -5, 0.25]}));
    g.json["meshes"][0]["primitives"][0]["material"] = 0.into();
    let scene = g.read().unwrap();
    let listed = scene.emissive_triangles();
    assert_eq!(listed.len(), 2);
    assert!(listed.iter().all(|t| t.mean_emission.iter().all(|e| e.is_finite() && *e >= 0.0)));
    assert_eq!(scene.triangle_emission(0, 1, FIRST)[2], 0.25);
}

#[test]
fn surface_glass_tints_and_can_be_opaque() {
    let glass = json!({"transmissionFactor": 0.5, "transmissionTexture": {"index": 0}});
    let material = json!({"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0, 1]},
        "extensions": {"KHR_materials_transmission": glass}});
    let g = quad(material, &[[[255; 4], [51, 0, 0, 255], [255; 4], [255; 4]]]);
    let scene = read(&g);
    close(scene.triangle_transmission(0, 0, FIRST), [0.5, 0.25, 0.0]);
    // The texture is not sRGB.
    close(scene.triangle_transmission(0, 0, SECOND), [0.1, 0.05, 0.0]);
    assert!((scene.triangle_opacity(0, 0, SECOND) - 0.9).abs() < 1e-6);
    assert!(scene.triangle_flags(0, 0).translucent);
    let plain = g.read().unwrap();
    close(plain.triangle_transmission(0, 0, SECOND), [0.5, 0.25, 0.0]);
    assert_eq!(plain.triangle_opacity(0, 0, SECOND), 0.5);
    let options = ReadOptions { glass: Glass::Opaque, ..surfaces() };
    let opaque = Scene::read_bytes(&g.glb(), &options).unwrap();
    assert_eq!(opaque.triangle_transmission(0, 0, FIRST), [0.0; 3]);
    assert_eq!(opaque.triangle_opacity(0, 0, FIRST), 1.0);
    assert!(!opaque.triangle_flags(0, 0).translucent);
}

#[test]
fn surface_blend_lets_the_rest_through_untinted() {
    let material =
        json!({"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 0.25]}});
    let scene = read(&quad(material.clone(), &[]));
    close(scene.triangle_transmission(0, 0, FIRST), [0.75; 3]);
    let mut both = material;
    both["extensions"]["KHR_materials_transmission"]["transmissionFactor"] = 1.into();
    let scene = read(&quad(both, &[]));
    close(scene.triangle_transmission(0, 0, FIRST), [1.0, 0.75, 0.75]);
    assert_eq!(scene.triangle_opacity(0, 0, FIRST), 0.0);
}

#[test]
fn surface_images_that_do_not_decode_leave_the_factor_and_a_warning() {
    let pbr = json!({"baseColorFactor": [0.5, 0.25, 0.125, 1], "baseColorTexture": {"index": 0}});
    let mut g = quad(json!({"pbrMetallicRoughness": pbr}), &[]);
    let basisu = json!({"KHR_texture_basisu": {"source": 0}});
    for (image, texture) in [
        (json!({"uri": "data:image/ktx2;base64,AAAA", "name": "paint"}), json!({"source": 0})),
        (json!({"uri": "data:image/ktx2;base64,AAAA", "name": "paint"}), json!({"extensions": basisu})),
        (json!({"uri": "missing.png", "name": "paint"}), json!({"source": 0})),
    ] {
        g.json["images"] = json!([image]);
        g.json["textures"] = json!([texture]);
        let scene = read(&g);
        close(scene.triangle_albedo(0, 0, FIRST), [0.5, 0.25, 0.125]);
        let warning = scene.warnings.iter().find(|w| w.message.contains("factor")).expect("a warning");
        assert!(warning.to_string().contains("images[0] \"paint\""), "{warning}");
        assert!(g.read().unwrap().warnings.is_empty());
    }
    g.json["textures"] = json!([{"source": 7}]);
    assert!(matches!(Scene::read_bytes(&g.glb(), &surfaces()), Err(SceneError::Reference { .. })));
}

#[test]
fn surface_images_of_materials_that_nothing_shows_are_not_decoded() {
    let pbr = json!({"baseColorTexture": {"index": 0}});
    let mut g = quad(json!({}), &[]);
    g.json["images"] = json!([{"uri": "data:image/png;base64,AAAA"}]);
    g.json["textures"] = json!([{"source": 0}]);
    g.push("materials", json!({"pbrMetallicRoughness": pbr}));
    assert!(read(&g).warnings.is_empty());
    g.json["meshes"][0]["primitives"][0]["material"] = 1.into();
    assert_eq!(read(&g).warnings.len(), 1);
}

#[test]
fn surface_masked_foliage_keeps_opacity_with_surfaces() {
    let pbr = json!({"baseColorTexture": {"index": 0}});
    let texels = [[255, 0, 0, 0], [255; 4], [255; 4], [255; 4]];
    let g = quad(json!({"alphaMode": "MASK", "pbrMetallicRoughness": pbr}), &[texels]);
    for scene in [g.read().unwrap(), read(&g)] {
        assert_eq!(scene.triangle_opacity(0, 0, FIRST), 0.0);
        assert_eq!(scene.triangle_opacity(0, 0, SECOND), 1.0);
        assert_eq!(scene.triangle_transmission(0, 0, FIRST), [1.0; 3]);
    }
}

fn file(name: &str) -> Option<Scene> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes").join(name);
    if !path.exists() {
        println!("no {name}: skipped");
        return None;
    }
    let start = std::time::Instant::now();
    let scene = Scene::read(&path, &surfaces()).unwrap();
    println!("{name}: {:?}, {:?}", start.elapsed(), scene.warnings);
    Some(scene)
}

/// Means over the triangles of a scene, each as good as any other.
fn means(scene: &Scene, part: usize) -> [[f32; 3]; 3] {
    let count = scene.parts[part].triangles.len() as f32;
    let mut sums = [[0.0; 3]; 3];
    for t in 0..scene.parts[part].triangles.len() {
        let at = [1.0 / 3.0, 1.0 / 3.0];
        let values = [
            scene.triangle_albedo(part, t, at),
            scene.triangle_emission(part, t, at),
            scene.triangle_transmission(part, t, at),
        ];
        for (sum, value) in sums.iter_mut().zip(values) {
            assert!(value.iter().all(|v| v.is_finite() && *v >= 0.0), "{value:?}");
            (0..3).for_each(|c| sum[c] += value[c] / count);
        }
    }
    sums
}

#[test]
fn surface_of_real_files_is_finite_and_plausible() {
    for name in ["lights_punctual_lamp.glb", "toy_car.glb", "sunglasses.glb", "lamborghini_huracan.glb"] {
        let Some(scene) = file(name) else { continue };
        for part in 0..scene.parts.len() {
            let [albedo, emission, passes] = means(&scene, part);
            assert!(albedo.iter().all(|&a| a <= MAX_ALBEDO + 1e-3));
            assert!(passes.iter().all(|&t| t <= 1.0 + 1e-3));
            let material = scene.parts[part].primitive_materials[0].map(|m| scene.materials[m].name.clone());
            if emission[0] + passes[0] > 0.0 {
                println!("  {} {material:?} {albedo:?} {emission:?} {passes:?}", scene.part_name(part));
            }
        }
        let emits = scene.emissive_triangles();
        println!("  {} emissive triangles", emits.len());
        match name {
            // The lamp's glass, the toy's dashboard and headlights, the car's lights.
            "lights_punctual_lamp.glb" | "toy_car.glb" | "lamborghini_huracan.glb" => {
                assert!(!emits.is_empty())
            }
            _ => assert!(emits.is_empty()),
        }
    }
}

#[test]
fn surface_finish_is_factors_times_textures() {
    let gloss = [[255, 64, 128, 255], [255, 128, 255, 255], [0; 4], [0; 4]];
    let occlusion = [[0, 255, 255, 255], [255; 4], [255; 4], [255; 4]];
    let pbr = json!({"metallicFactor": 0.5, "roughnessFactor": 0.8,
        "metallicRoughnessTexture": {"index": 0}});
    let material = json!({"pbrMetallicRoughness": pbr, "occlusionTexture": {"index": 1, "strength": 0.6}});
    let g = quad(material, &[gloss, occlusion]);
    let finish = |options: &ReadOptions| {
        let scene = Scene::read_bytes(&g.glb(), options).unwrap();
        [FIRST, SECOND].map(|at| scene.triangle_finish(0, 0, at))
    };
    let [first, second] = finish(&ReadOptions { finish: true, ..surfaces() });
    close([first.metallic, first.roughness, first.occlusion], [0.251, 0.2008, 0.4]);
    close([second.metallic, second.roughness, second.occlusion], [0.5, 0.4016, 1.0]);
    assert_eq!((first.base_color, first.covered, first.passes), ([1.0; 3], 1.0, 0.0));
    // Without being asked for, no image is decoded.
    let [first, _] = finish(&surfaces());
    assert_eq!((first.metallic, first.roughness, first.occlusion), (0.5, 0.8, 1.0));
    let glossy = json!({"KHR_materials_pbrSpecularGlossiness": {"glossinessFactor": 0.75}});
    let g = quad(json!({"pbrMetallicRoughness": {"metallicFactor": 1}, "extensions": glossy}), &[]);
    let finish = read(&g).triangle_finish(0, 0, FIRST);
    assert_eq!((finish.metallic, finish.roughness), (0.0, 0.25));
}
