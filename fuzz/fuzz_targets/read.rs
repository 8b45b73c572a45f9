//! Any bytes: an error or a scene, never a panic and never more memory than they deserve.
//!
//! `cargo +nightly fuzz run read` (from the repository root). `crates/scene/tests/fuzz_smoke.rs` does a part of
//! this with the stable compiler.
#![no_main]

use libfuzzer_sys::fuzz_target;
use lightkiln_scene::{ReadOptions, Scene};

fuzz_target!(|bytes: &[u8]| {
    let options = ReadOptions { max_triangles: 1 << 18, surfaces: true, ..ReadOptions::default() };
    if let Ok(scene) = Scene::read_bytes(bytes, &options) {
        for (number, part) in scene.parts.iter().enumerate() {
            for triangle in 0..part.triangles.len().min(8) {
                let opacity = scene.triangle_opacity(number, triangle, [0.25, 0.5]);
                assert!((0.0..=1.0).contains(&opacity));
                let passes = scene.triangle_transmission(number, triangle, [0.25, 0.5]);
                assert!(passes.iter().all(|x| (0.0..=1.0).contains(x)));
                let emission = scene.triangle_emission(number, triangle, [0.25, 0.5]);
                assert!(emission.iter().all(|x| x.is_finite()));
            }
        }
        let _ = scene.read_lightmap();
        let _ = scene.read_fallback();
    }
});
