//! Occlusion textures that a file has already, multiplied in at their own resolution.
#![allow(clippy::unwrap_used)] // helpers of tests are tests

mod harness;

use std::path::{Path, PathBuf};

use harness::room::{add_texture, corner};
use harness::{Folder, bake, glb, succeed};
use lightkiln_bake::{FileLight, Opened, Opening};
use lightkiln_encode::LightCode;
use lightkiln_mesh::TriangleId;
use serde_json::{Value, json};

/// Texels along the metre that the texture lies over.
const SIDE: u32 = 256;

/// A bake of texels 1/30 wide, and its profile.
fn with<'a>(extra: &[&'a str]) -> Vec<&'a str> {
    ["--detail", "0.0667", "--ao-distance", "1"].iter().chain(extra).copied().collect()
}

/// The corner of a room whose material has an occlusion texture, and beside it a wall of another material.
fn scene(folder: &Folder, repeat: f32, value: impl Fn(u32, u32) -> f32) -> PathBuf {
    let (mut json, mut binary) = corner(1);
    let texture = add_texture(&mut json, &mut binary, SIDE, value);
    json["extensionsUsed"].as_array_mut().unwrap().push("KHR_texture_transform".into());
    let transform = json!({"KHR_texture_transform": {"scale": [repeat, repeat]}});
    json["materials"][0]["occlusionTexture"] = json!({"index": texture, "extensions": transform});
    json["meshes"][1] = json!({"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2}]});
    json["scenes"][0]["nodes"] = json!([0, 2]);
    json["nodes"][2]["translation"] = json!([9, 0, 0]);
    folder.write("in.glb", glb(&json, &binary))
}

/// Squares of 16 texels.
fn checker(x: u32, y: u32) -> f32 {
    if (x / 16 + y / 16).is_multiple_of(2) { 0.3 } else { 0.9 }
}

/// Texels of a metre along, for each triangle that has texels.
fn densities(path: &Path) -> Vec<Option<f64>> {
    let opened = Opened::read(path, Opening { needs_light: true, ..Opening::default() }).unwrap();
    let surface = opened.scenery.surface("file", &opened.options).unwrap();
    let light = FileLight::read(&surface, "file").unwrap();
    let density = |t: TriangleId| {
        let [Some(a), Some(b), Some(c)] = light.codes(t).map(LightCode::position) else { return None };
        let area = 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs();
        Some((f64::from(area) / surface.mesh.area(t)).sqrt())
    };
    (0..surface.mesh.triangle_count() as u32).map(|t| density(TriangleId(t))).collect()
}

fn texture_rmse(report: &Value) -> f64 {
    report["errors"]["texture"]["rmse"].as_f64().unwrap()
}

#[test]
fn authored_occlusion_keeps_its_own_resolution() {
    let folder = Folder::new("own-resolution");
    let (input, out) = (scene(&folder, 1.0, checker), folder.path("out.glb"));
    let fine = bake(&input, &out, &with(&["--profile", "stock"]));
    // Of the corner.
    for density in &densities(&out)[..4] {
        let density = density.unwrap();
        assert!((1.0..1.1).contains(&(density / f64::from(SIDE))), "{density} texels a metre");
    }
    assert!(!fine["warnings"].to_string().contains("texels of"), "{}", fine["warnings"]);
    let verify = ["--points", "2000", "--rays", "64", "--quiet"];
    succeed([&["verify", out.to_str().unwrap()], &verify[..]].concat());
    let coarse =
        bake(&input, &out, &with(&["--profile", "stock", "--authored-occlusion", "multiply-coarse"]));
    assert!(coarse["warnings"].to_string().contains("multiply keeps it"), "{}", coarse["warnings"]);
    let [fine, coarse] = [fine, coarse]
        .map(|report| (texture_rmse(&report), report["bytes"]["light"]["atlas"].as_u64().unwrap()));
    assert!(fine.0 < 0.04 && coarse.0 > 0.1, "{} and {}", fine.0, coarse.0);
    // Two squares with 256 texels a side, up to 9 % more for the steps of widths, and gutters; and the coarse wall.
    assert!((2 * 256 * 256..2 * 284 * 284 + 6000).contains(&fine.1), "{} texels", fine.1);
    assert!(coarse.1 < 6000, "{} texels", coarse.1);
}

#[test]
fn authored_occlusion_leaves_other_materials_their_texels() {
    let folder = Folder::new("two-densities");
    let (input, out) = (scene(&folder, 1.0, checker), folder.path("out.glb"));
    bake(&input, &out, &with(&["--profile", "lightmap"]));
    let densities: Vec<f64> = densities(&out).into_iter().map(Option::unwrap).collect();
    assert_eq!(densities.len(), 8);
    for (triangle, density) in densities.iter().enumerate() {
        let wanted = if triangle < 4 { f64::from(SIDE)..1.1 * f64::from(SIDE) } else { 29.0..31.0 };
        assert!(wanted.contains(density), "triangle {triangle}: {density} texels a metre");
    }
}

#[test]
fn authored_occlusion_counts_the_scale_of_a_node() {
    let folder = Folder::new("scaled-node");
    let input = scene(&folder, 1.0, checker);
    let (mut json, binary) = harness::glb_parts(&std::fs::read(&input).unwrap());
    json["nodes"][0]["scale"] = json!([2, 2, 2]);
    let (input, out) = (folder.write("in.glb", glb(&json, &binary)), folder.path("out.glb"));
    bake(&input, &out, &with(&["--profile", "stock"]));
    let density = densities(&out)[0].unwrap() / f64::from(SIDE);
    assert!((0.5..0.55).contains(&density), "{density} of the texels of the texture");
}

#[test]
fn authored_occlusion_that_vertices_carry_needs_no_texels() {
    let folder = Folder::new("gradient");
    // As smooth as 8 bits make it, and constant.
    for value in [|x: u32, _| 0.4 + 0.5 * x as f32 / SIDE as f32, |_, _| 0.7] {
        let (input, out) = (scene(&folder, 0.99, value), folder.path("out.glb"));
        let texture = |how: &str| {
            let report = bake(&input, &out, &with(&["--profile", "stock", "--authored-occlusion", how]));
            report["classes"]["textureBeforeClosing"]["triangles"].as_u64().unwrap()
        };
        assert_eq!(texture("multiply"), texture("multiply-coarse"));
    }
}

#[test]
fn authored_occlusion_beyond_the_largest_page_is_made_coarser_with_a_warning() {
    let folder = Folder::new("page-limit");
    // 100 copies along a metre: 25600 texels.
    let (input, out) = (scene(&folder, 100.0, checker), folder.path("out.glb"));
    let report = bake(&input, &out, &with(&["--profile", "stock"]));
    let page = ["width", "height"].map(|side| report["atlas"][side].as_u64().unwrap());
    assert!(page.iter().all(|&side| side <= 4096) && page[0] * page[1] > 4 << 20, "{page:?}");
    assert_eq!(report["atlas"]["pages"], 1);
    let warnings = report["warnings"].to_string();
    // Theirs are 1/25600 wide, and 2046 of ours fit into half of a page.
    assert!(
        warnings.contains("texels of 0.00004 where the largest page has room for texels of 0.0005"),
        "{warnings}"
    );
}

#[test]
fn authored_occlusion_is_the_same_for_any_number_of_threads() {
    let folder = Folder::new("own-threads");
    let input = scene(&folder, 1.0, checker);
    let bytes = ["1", "2"].map(|threads| {
        let out = folder.path("out.glb");
        bake(&input, &out, &with(&["--profile", "stock", "--threads", threads]));
        std::fs::read(&out).unwrap()
    });
    assert!(bytes[0] == bytes[1]);
}
