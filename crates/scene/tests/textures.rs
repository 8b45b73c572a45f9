//! Textures as signals: what a point of a triangle shows.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // helpers of tests are tests

mod common;

use common::{Gltf, png};
use lightkiln_scene::{Scene, Slot};
use serde_json::json;

/// A quad of two triangles with texture coordinates 0..1 in a second set, and an image of 2 x 2 pixels.
fn textured() -> Gltf {
    let mut g = Gltf::quad();
    let mut image = image::RgbaImage::from_pixel(2, 2, image::Rgba([255; 4]));
    image.put_pixel(0, 0, image::Rgba([0, 188, 51, 255]));
    let view = g.view(&png(&image));
    g.push("images", json!({"bufferView": view, "mimeType": "image/png"}));
    g.push("samplers", json!({"wrapS": 33071, "wrapT": 33071}));
    g.push("textures", json!({"source": 0, "sampler": 0}));
    let uv = g.floats("VEC2", &[0., 0., 1., 0., 0., 1., 1., 1.]);
    g.push("materials", json!({}));
    g.json["meshes"][0]["primitives"][0]["material"] = 0.into();
    g.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = uv.into();
    g
}

fn look(scene: &Scene, slot: Slot, triangle: usize, barycentric: [f32; 2]) -> Vec<f32> {
    let textures = scene.textures(slot).unwrap().expect("the slot has a texture");
    let mut out = vec![f32::NAN; textures.channels()];
    assert!(textures.sample(0, triangle, barycentric, &mut out));
    out
}

#[test]
fn texture_base_color_is_linear_times_its_factor() {
    let mut g = textured();
    let info = json!({"index": 0, "texCoord": 1});
    g.json["materials"][0]["pbrMetallicRoughness"] =
        json!({"baseColorTexture": info, "baseColorFactor": [1, 1, 0.5, 1]});
    let scene = g.read().unwrap();
    let at = look(&scene, Slot::BaseColor, 0, [0.0, 0.0]);
    // 188 is half the light, 51 a fifth of the code.
    for (value, expected) in at.iter().zip([0.0, 0.503, 0.0331 * 0.5]) {
        assert!((value - expected).abs() < 1e-3, "{at:?}");
    }
    let far = look(&scene, Slot::BaseColor, 1, [0.0, 1.0]);
    assert_eq!(far, [1.0, 1.0, 0.5]);
    assert!(scene.textures(Slot::Occlusion).unwrap().is_none());
}

#[test]
fn texture_occlusion_is_not_decoded_and_has_a_strength() {
    let mut g = textured();
    g.json["materials"][0]["occlusionTexture"] = json!({"index": 0, "texCoord": 1, "strength": 0.5});
    let scene = g.read().unwrap();
    assert_eq!(look(&scene, Slot::Occlusion, 0, [0.0, 0.0]), [0.5]);
    // Halfway between the middles of dark and bright texel.
    assert!((look(&scene, Slot::Occlusion, 0, [0.5, 0.0])[0] - 0.75).abs() < 1e-6);
}

#[test]
fn texture_transform_moves_the_lookup_and_chooses_the_set() {
    let mut g = textured();
    let transform = json!({"KHR_texture_transform": {"offset": [0.5, 0.0], "texCoord": 1}});
    g.json["materials"][0]["occlusionTexture"] = json!({"index": 0, "extensions": transform});
    let scene = g.read().unwrap();
    assert!((look(&scene, Slot::Occlusion, 0, [0.0, 0.0])[0] - 0.5).abs() < 1e-6);
    g.json["samplers"][0]["wrapS"] = 33648.into();
    assert!((look(&g.read().unwrap(), Slot::Occlusion, 0, [0.5, 0.0])[0] - 1.0).abs() < 1e-6);
}

#[test]
fn texture_lightmap_extension_has_an_intensity() {
    let mut g = textured();
    let lightmap = json!({"MOZ_lightmap": {"index": 0, "texCoord": 1, "intensity": 3.0}});
    g.json["materials"][0]["extensions"] = lightmap;
    assert_eq!(look(&g.read().unwrap(), Slot::Lightmap, 1, [0.0, 1.0]), [3.0; 3]);
}

#[test]
fn texture_file_needs_its_set_of_coordinates() {
    let folder = std::env::temp_dir().join(format!("lightkiln-textures-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let file = folder.join("grey.png");
    std::fs::write(&file, png(&image::RgbaImage::from_pixel(3, 3, image::Rgba([188; 4])))).unwrap();
    let scene = textured().read().unwrap();
    assert!(scene.textured_with(&file, 0).unwrap().is_none());
    let textures = scene.textured_with(&file, 1).unwrap().expect("the set is there");
    let mut out = [0.0; 3];
    assert!(textures.sample(0, 0, [0.2, 0.3], &mut out));
    assert!(out.iter().all(|v| (v - 0.503).abs() < 1e-3), "{out:?}");
    std::fs::write(&file, b"no image").unwrap();
    assert!(scene.textured_with(&file, 1).is_err());
    assert!(scene.textured_with(&folder.join("missing.png"), 1).is_err());
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn texture_image_that_does_not_decode_is_an_error() {
    let mut g = textured();
    g.json["images"][0] = json!({"uri": "data:image/ktx2;base64,AAAA"});
    g.json["materials"][0]["occlusionTexture"] = json!({"index": 0, "texCoord": 1});
    assert!(g.read().unwrap().textures(Slot::Occlusion).is_err());
}
