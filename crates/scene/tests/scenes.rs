//! Reading and writing the real files beside the repository; a note is printed where they are absent.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // helpers of tests are tests

use std::path::{Path, PathBuf};
use std::time::Instant;

use lightkiln_scene::{
    BakedLight, ExtensionInfo, Fallback, LayerFiles, PartLight, ReadOptions, Scene, write,
};

fn scenes() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes");
    let Ok(entries) = std::fs::read_dir(&folder) else {
        println!("no scenes at {}: skipped", folder.display());
        return Vec::new();
    };
    let mut out: Vec<PathBuf> = entries
        .filter_map(|e| e.ok().map(|e| e.path()))
        .filter(|p| p.extension().is_some_and(|e| e == "glb" || e == "gltf"))
        .collect();
    out.sort();
    out
}

fn scene(name: &str) -> Option<Scene> {
    let path = scenes().into_iter().find(|p| p.file_name().is_some_and(|n| n == name))?;
    Some(Scene::read(&path, &ReadOptions::default()).unwrap())
}

fn png() -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    image::GrayImage::from_pixel(4, 4, image::Luma([128]))
        .write_to(&mut out, image::ImageFormat::Png)
        .unwrap();
    out.into_inner()
}

/// Two layers whose codes differ between triangles now and then, so that some vertices split and most do not.
fn made_up(scene: &Scene, every: usize) -> BakedLight {
    let parts = scene.parts.iter().enumerate().map(|(number, part)| {
        let mut light = PartLight { corner_codes: vec![Vec::new(); 2], ..PartLight::default() };
        for t in 0..part.triangles.len() {
            let corners = scene.gltf_corners(number, t);
            let bump = u16::from(every > 0 && t % every == 0);
            light.corner_codes[0].push(corners.map(|v| [(v % 60000) as u16 + bump, 0x8000]));
            light.corner_codes[1].push(corners.map(|v| [(v % 50000) as u16, 0x8000 | (bump << 3)]));
            light.corner_fallback.push(corners.map(|v| [(v % 100) as f32 / 100.0; 3]));
        }
        light
    });
    let layer = |signal: &str, channels: u32| LayerFiles {
        pages: vec![png(), png()],
        table: (channels == 3).then(png),
        info: serde_json::json!({"signal": signal, "channels": channels, "curve": "linear", "range": [0, 1]})
            .as_object()
            .unwrap()
            .clone(),
        texture: None,
    };
    BakedLight {
        parts: parts.collect(),
        layers: vec![layer("ambientOcclusion", 1), layer("irradiance", 3)],
        extension: ExtensionInfo { root: serde_json::json!({"generator": "a test"}) },
        fallback: Fallback::Color0,
        ..BakedLight::default()
    }
}

fn output_folder(test: &str) -> PathBuf {
    let base = std::env::var_os("LIGHTKILN_KEEP").map_or_else(std::env::temp_dir, PathBuf::from);
    let folder = base.join(format!("lightkiln-{test}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn clean(folder: &Path) {
    if std::env::var_os("LIGHTKILN_KEEP").is_none() {
        std::fs::remove_dir_all(folder).unwrap();
    }
}

#[test]
fn scenes_round_trip() {
    let folder = output_folder("scenes");
    for path in scenes() {
        let start = Instant::now();
        let scene =
            Scene::read(&path, &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}\n in {}", e.place()));
        let read = start.elapsed();
        let triangles: usize = scene.parts.iter().map(|p| p.triangles.len()).sum();
        assert!(triangles > 0);
        for part in &scene.parts {
            assert_eq!(part.positions.len(), part.normals.len());
            assert!(part.normals.iter().all(|n| n.length() == 0.0 || (n.length() - 1.0).abs() < 1e-4));
        }
        for (every, extension) in [(0, "glb"), (7, "glb"), (7, "gltf")] {
            let light = made_up(&scene, every);
            let name = format!("{}.{every}.{extension}", path.file_stem().unwrap().to_string_lossy());
            let out = folder.join(name);
            let start = Instant::now();
            let written = write(&scene, &light, &out).unwrap_or_else(|e| panic!("{e}\n in {}", e.place()));
            let wrote = start.elapsed();
            let added: usize = written.parts.iter().map(|p| p.added_vertices).sum();
            println!(
                "{:40} {triangles} triangles, {} parts, read {read:?}, wrote {wrote:?}, +{added} vertices, dropped {}, wasted {}",
                out.file_name().unwrap().to_string_lossy(),
                scene.parts.len(),
                written.dropped_bytes,
                written.wasted_bytes
            );
            for w in written.warnings.iter().chain(&scene.warnings) {
                println!("    {} x {}", w.message, w.count);
            }
            // Suzanne has vertices of its own for each triangle: nothing is shared, nothing splits.
            assert_eq!(added > 0, every > 0 && !path.ends_with("suzanne.glb"));
            let again = Scene::read(&out, &ReadOptions::default())
                .unwrap_or_else(|e| panic!("{e}\n in {}", e.place()));
            assert_eq!(again.parts.len(), scene.parts.len());
            for (a, b) in again.parts.iter().zip(&scene.parts) {
                assert_eq!(a.triangles.len(), b.triangles.len());
                let place = |p: &lightkiln_scene::Part, t: usize| {
                    p.triangles[t].map(|v| (p.positions[v as usize], p.normals[v as usize]))
                };
                assert!((0..a.triangles.len()).all(|t| place(a, t) == place(b, t)));
                assert_eq!(a.triangle_primitives, b.triangle_primitives);
                assert_eq!(a.primitive_materials, b.primitive_materials);
            }
            let map = again.read_lightmap().unwrap().unwrap();
            assert_eq!(map.layers.len(), 2);
            for (number, layer) in map.layers.iter().enumerate() {
                assert_eq!((layer.pages.len(), &layer.pages[0].png), (2, &png()));
                assert_eq!(layer.table.is_some(), number == 1);
                for (read, given) in layer.parts.iter().zip(&light.parts) {
                    assert_eq!(*read, given.corner_codes[number]);
                }
            }
            // Baking again gives the same file as baking the original.
            if every == 0 {
                let twice = folder.join("twice.glb");
                write(&again, &light, &twice).unwrap();
                assert_eq!(
                    std::fs::read(&twice).unwrap().len(),
                    std::fs::read(&out).unwrap().len(),
                    "{}",
                    out.display()
                );
                std::fs::remove_file(twice).unwrap();
            }
        }
    }
    clean(&folder);
}

#[test]
fn scene_meshopt_equals_plain() {
    let (Some(plain), Some(packed)) =
        (scene("lamborghini_huracan.glb"), scene("lamborghini_huracan.meshopt.glb"))
    else {
        return;
    };
    assert_eq!(plain.parts.len(), packed.parts.len());
    for (a, b) in plain.parts.iter().zip(&packed.parts) {
        assert_eq!(a.triangles.len(), b.triangles.len());
        // The encoder may turn the corners of a triangle and order triangles anew.
        let key = |p: &lightkiln_scene::Part| {
            let mut all: Vec<[[u32; 3]; 3]> = p
                .triangles
                .iter()
                .map(|t| {
                    let mut c = t.map(|v| p.positions[v as usize].to_array().map(f32::to_bits));
                    let first = (0..3).min_by_key(|&k| c[k]).unwrap();
                    c.rotate_left(first);
                    c
                })
                .collect();
            all.sort_unstable();
            all
        };
        assert!(key(a) == key(b));
    }
}

#[test]
fn scene_draco_equals_plain() {
    let (Some(plain), Some(packed)) = (scene("duck.glb"), scene("duck.draco.glb")) else { return };
    let (a, b) = (&plain.parts[0], &packed.parts[0]);
    assert_eq!(a.triangles.len(), b.triangles.len());
    let size = a.positions.iter().fold(0.0_f32, |m, p| m.max(p.abs().max_element()));
    let centres = |p: &lightkiln_scene::Part| {
        let c =
            p.triangles.iter().map(|t| t.iter().map(|&v| p.positions[v as usize]).sum::<glam::Vec3>() / 3.0);
        c.collect::<Vec<_>>()
    };
    let (ca, cb) = (centres(a), centres(b));
    for x in &ca {
        let nearest = cb.iter().map(|y| x.distance(*y)).fold(f32::INFINITY, f32::min);
        assert!(nearest < size * 2e-3, "{nearest} of {size}");
    }
}
