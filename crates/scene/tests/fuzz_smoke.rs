//! Damaged files give errors, never panics. Deterministic; `LIGHTKILN_FUZZ_ROUNDS` makes it longer.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // helpers of tests are tests

mod common;

use std::panic::{AssertUnwindSafe, catch_unwind};

use common::{Folder, Gltf, glb, json_of, light, rich, three_layers};
use lightkiln_scene::{BakedLight, ReadOptions, Scene, Slot, write};
use serde_json::{Value, json};

struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((self.0 >> 33) as usize) % n.max(1)
    }
}

fn count(v: &Value) -> usize {
    1 + match v {
        Value::Array(a) => a.iter().map(count).sum(),
        Value::Object(o) => o.values().map(count).sum(),
        _ => 0,
    }
}

/// Replaces the n-th value of a tree.
fn replace(v: &mut Value, n: &mut usize, with: &Value) -> bool {
    if *n == 0 {
        *v = with.clone();
        return true;
    }
    *n -= 1;
    match v {
        Value::Array(a) => a.iter_mut().any(|v| replace(v, n, with)),
        Value::Object(o) => o.values_mut().any(|v| replace(v, n, with)),
        _ => false,
    }
}

fn mutate(seed: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    let json_end = 20 + u32::from_le_bytes([seed[12], seed[13], seed[14], seed[15]]) as usize;
    match random.below(8) {
        0 => {
            bytes.truncate(random.below(seed.len()));
            if random.below(2) == 0 && bytes.len() >= 12 {
                let length = bytes.len() as u32;
                bytes[8..12].copy_from_slice(&length.to_le_bytes());
            }
        }
        1 | 2 => {
            for _ in 0..=random.below(4) {
                let at = random.below(bytes.len());
                bytes[at] ^= 1 << random.below(8);
            }
        }
        3 if json_end + 8 < bytes.len() => {
            for _ in 0..=random.below(8) {
                let at = json_end + 8 + random.below(bytes.len() - json_end - 8);
                bytes[at] = random.below(256) as u8;
            }
        }
        _ => {
            let mut json = json_of(seed);
            for _ in 0..=random.below(2) {
                let with = [
                    json!(null),
                    json!(-1),
                    json!(0),
                    json!(1),
                    json!(2),
                    json!(3),
                    json!(255),
                    json!(65535),
                    json!(65536),
                    json!(4294967295_u64),
                    json!(u64::MAX),
                    json!(1e300),
                    json!(-0.5),
                    json!("x"),
                    json!([]),
                    json!({}),
                    json!(true),
                    json!([0]),
                    json!([1e38, 1e38, 1e38]),
                    json!("MASK"),
                    json!(5120),
                    json!(5126),
                    json!("VEC3"),
                    json!("data:,abc"),
                    json!("../x"),
                    json!(16),
                    json!(1 << 20),
                ];
                let mut n = random.below(count(&json));
                replace(&mut json, &mut n, &with[random.below(with.len())]);
            }
            let bin = if json_end + 8 <= seed.len() { &seed[json_end + 8..] } else { &[] };
            bytes = glb(&serde_json::to_vec(&json).unwrap(), bin);
        }
    }
    bytes
}

fn exercise(bytes: &[u8], folder: &Folder, deep: bool) -> bool {
    let plain = ReadOptions { max_triangles: 1 << 18, ..ReadOptions::default() };
    let variant = bytes.len().is_multiple_of(2).then(|| "b".to_owned());
    let lit = ReadOptions { surfaces: true, variant, ..plain.clone() };
    // Files that have no such variant are read as well.
    let options = if deep || Scene::read_bytes(bytes, &lit).is_err() { plain } else { lit };
    let Ok(scene) = Scene::read_bytes(bytes, &options) else { return false };
    for (p, part) in scene.parts.iter().enumerate() {
        for t in (0..part.triangles.len()).take(8) {
            let opacity = scene.triangle_opacity(p, t, [0.25, 0.5]);
            assert!((0.0..=1.0).contains(&opacity), "{opacity}");
            let _ = scene.triangle_flags(p, t);
            let passes = scene.triangle_transmission(p, t, [0.25, 0.5]);
            assert!(passes.iter().all(|x| (0.0..=1.0001 - opacity).contains(x)), "{passes:?} {opacity}");
            let albedo = scene.triangle_albedo(p, t, [0.25, 0.5]);
            assert!(albedo.iter().all(|x| (0.0..=1.0).contains(x)), "{albedo:?}");
            let emission = scene.triangle_emission(p, t, [0.25, 0.5]);
            assert!(emission.iter().all(|x| x.is_finite() && *x >= 0.0), "{emission:?}");
        }
        assert!(part.positions.iter().chain(&part.normals).all(|v| v.is_finite()));
        assert!(part.triangles.iter().flatten().all(|&v| (v as usize) < part.positions.len()));
    }
    assert_eq!(scene.moving_parts().len(), scene.parts.len());
    assert!(scene.emissive_triangles().iter().all(|t| t.mean_emission.iter().all(|x| x.is_finite())));
    assert!(scene.lights.iter().all(|l| l.position.is_finite() && l.direction.is_finite()));
    let _ = scene.select(&["*".to_owned()], &[]);
    let _ = scene.read_lightmap();
    let _ = scene.read_fallback();
    if deep {
        let out = folder.0.join("out.glb");
        let remove = vec![Slot::Lightmap, Slot::Occlusion];
        if write(&scene, &BakedLight { remove, ..light(&scene, true) }, &out).is_ok() {
            let again = Scene::read(&out, &options).expect("what was written can be read");
            assert_eq!(again.parts.len(), scene.parts.len());
        }
    }
    true
}

/// The rich file with all that a path tracer asks for.
fn lit() -> Gltf {
    let mut g = rich();
    g.json["extensions"] = json!({
        "KHR_lights_punctual": {"lights": [
            {"type": "spot", "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.5}, "range": 3},
            {"type": "directional", "intensity": 2, "color": [1, 0.5, 0.25]}]},
        "KHR_materials_variants": {"variants": [{"name": "a"}, {"name": "b"}]}});
    g.json["nodes"][2]["extensions"] = json!({"KHR_lights_punctual": {"light": 0}});
    g.json["nodes"][3]["extensions"] = json!({"KHR_lights_punctual": {"light": 1}});
    g.json["nodes"][0]["extras"] = json!({"lightkiln": {"cast": false}});
    g.json["materials"][0]["emissiveFactor"] = json!([1, 0.5, 0.25]);
    g.json["materials"][0]["emissiveTexture"] = json!({"index": 0, "texCoord": 0});
    g.json["materials"][1]["extensions"]["KHR_materials_transmission"]["transmissionTexture"] =
        json!({"index": 0});
    g.json["materials"][1]["extensions"]["KHR_materials_emissive_strength"] = json!({"emissiveStrength": 10});
    g.json["materials"][1]["extensions"]["KHR_materials_pbrSpecularGlossiness"] =
        json!({"diffuseFactor": [1, 0.5, 1, 0.5], "diffuseTexture": {"index": 0}});
    g.json["meshes"][0]["primitives"][0]["extensions"]["KHR_materials_variants"]["mappings"] =
        json!([{"material": 1, "variants": [0, 1]}]);
    g
}

fn seeds() -> Vec<Vec<u8>> {
    let mut out = vec![Gltf::quad().glb(), rich().glb(), lit().glb()];
    // Baked files: undoing them is code too.
    let folder = Folder::new("fuzz-seed");
    let scene = rich().read().unwrap();
    let baked = folder.0.join("baked.glb");
    for light in [light(&scene, true), three_layers(&scene)] {
        write(&scene, &light, &baked).unwrap();
        out.push(std::fs::read(&baked).unwrap());
    }
    let scenes = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes");
    for name in ["duck.draco.glb", "cornell_box_original.glb", "sunglasses.glb"] {
        match std::fs::read(scenes.join(name)) {
            Ok(bytes) => out.push(bytes),
            Err(_) => println!("no {name}: its damage is not tried"),
        }
    }
    out
}

#[test]
fn fuzz_damaged_files_never_panic() {
    let rounds = std::env::var("LIGHTKILN_FUZZ_ROUNDS").ok().and_then(|r| r.parse().ok()).unwrap_or(4000_u64);
    let first = std::env::var("LIGHTKILN_FUZZ_FIRST").ok().and_then(|r| r.parse().ok()).unwrap_or(0_u64);
    let seeds = seeds();
    let folder = Folder::new("fuzz");
    let mut read = 0;
    for round in first..first + rounds {
        let mut random = Random(round.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x1234);
        let bytes = mutate(&seeds[(round % seeds.len() as u64) as usize], &mut random);
        let start = std::time::Instant::now();
        match catch_unwind(AssertUnwindSafe(|| exercise(&bytes, &folder, round % 40 < 2))) {
            Ok(ok) => read += usize::from(ok),
            Err(_) => {
                if let Some(keep) = std::env::var_os("LIGHTKILN_KEEP") {
                    std::fs::write(std::path::Path::new(&keep).join(format!("crash-{round}.glb")), &bytes)
                        .unwrap();
                }
                panic!("round {round} panicked");
            }
        }
        assert!(start.elapsed().as_secs() < 10, "round {round} took {:?}", start.elapsed());
    }
    println!("{read} of {rounds} damaged files could still be read");
}
