//! Each signal as it stands in the written file, against what it must be.
#![allow(clippy::unwrap_used)] // helpers of tests are tests

mod harness;

use std::path::Path;

use glam::Vec3;
use harness::shown::{Shown, mean, shown};
use harness::{Folder, bake, bake_anyhow, data, glb, glb_parts, verify};
use lightkiln_light::harmonics::irradiance;
use lightkiln_texel::{PngDepth, write_png};
use serde_json::{Value, json};

/// Name and channels of each layer of a file.
fn layers(path: &Path) -> Vec<(String, u64)> {
    let (json, _) = glb_parts(&std::fs::read(path).unwrap());
    let layers = json["extensions"]["LIGHTKILN_lightmap"]["layers"].as_array().unwrap().clone();
    let of = |l: &Value| (l["signal"].as_str().unwrap().to_owned(), l["channels"].as_u64().unwrap());
    layers.iter().map(of).collect()
}

/// Whether the block or the ball of the scene `punctual` stands between two points.
fn is_hidden(from: Vec3, to: Vec3) -> bool {
    let (low, high) = (Vec3::new(-0.7, 0.0, -0.4), Vec3::new(-0.2, 0.5, 0.1));
    let way = to - from;
    let (near, far) = ((low - from) / way, (high - from) / way);
    let (enter, leave) = (near.min(far).max_element(), near.max(far).min_element());
    let in_block = enter < leave && leave > 0.0 && enter < 1.0;
    let (centre, radius) = (Vec3::new(0.6, 0.3, 0.2), 0.3);
    let nearest = ((centre - from).dot(way) / way.length_squared()).clamp(0.0, 1.0);
    in_block || (from + way * nearest).distance(centre) < radius
}

#[test]
fn shadow_has_a_channel_for_each_light_in_their_order() {
    let folder = Folder::new("shadows");
    let out = folder.path("out.glb");
    bake_anyhow(&data("punctual.glb"), &out, &["--signal", "shadow", "--sun", "90,45", "--samples", "3000"]);
    assert_eq!(layers(&out), [("shadow".to_owned(), 3), ("shadow1".to_owned(), 3)]);
    let all = shown(&out);
    let sun = Vec3::new(-0.6, 1.0, 0.3) * 100.0;
    let (point, spot) = (Vec3::new(0.1, 1.0, 0.9), Vec3::new(1.5, 1.8, -1.2));
    let axis = (Vec3::new(0.4, 0.0, 0.0) - spot).normalize();
    let floor: Vec<&Shown> = all.iter().filter(|p| p.node == "floor").collect();
    let seen = |p: Vec3| {
        let lit = |light: Vec3| f32::from(u8::from(!is_hidden(p, light)));
        let cone = f32::from(u8::from((p - spot).angle_between(axis) < 0.4));
        [lit(p + sun), lit(point), lit(spot) * cone, lit(p + Vec3::new(1.0, 1.0, 0.0) * 100.0)]
    };
    for channel in 0..4 {
        let right =
            floor.iter().filter(|s| (s.values[channel] - seen(s.place)[channel]).abs() < 0.25).count();
        let dark = floor.iter().filter(|s| seen(s.place)[channel] == 0.0).count();
        // Middles of triangles that an edge passes are in between.
        assert!(right * 100 > floor.len() * 93, "light {channel}: {right} of {}", floor.len());
        assert!(dark * 100 > floor.len() * 2, "light {channel} has no shadow: {dark}");
    }
    // Light that is not there is not hidden.
    assert!(all.iter().all(|s| s.values[4] > 0.99 && s.values[5] > 0.99));
}

#[test]
fn bent_normal_leans_to_where_it_is_open() {
    let folder = Folder::new("bent");
    let out = folder.path("out.glb");
    bake_anyhow(
        &data("l_shape.glb"),
        &out,
        &["--signal", "bent-normal+ao", "--ao-distance", "inf", "--samples", "3000"],
    );
    assert_eq!(layers(&out), [("bentNormal".to_owned(), 3), ("ambientOcclusion".to_owned(), 1)]);
    let all = shown(&out);
    for point in &all {
        let bent = Vec3::new(point.values[0], point.values[1], point.values[2]);
        // Both squares see each other: what is open lies between their normals.
        let other = all.iter().map(|p| p.facing).find(|n| n.dot(point.facing) < 0.5).unwrap();
        assert!(bent.length() < 1.05, "{bent}");
        assert!(bent.dot(point.facing) > 0.3 && bent.dot(other) > -0.06, "{bent} at {}", point.place);
        // Where more is hidden it leans more, and is shorter.
        assert!(bent.length() < point.values[3] + 0.3, "{bent} {}", point.values[3]);
    }
    let lean = |near: bool| {
        let some = all.iter().filter(|p| (p.values[3] < 0.6) == near);
        mean(some.map(|p| {
            let bent = Vec3::new(p.values[0], p.values[1], p.values[2]);
            bent.normalize().dot(p.facing)
        }))
    };
    // In the corner a quarter is open, around 45 degrees; far from it all is.
    assert!(lean(true) < 0.9 && lean(false) > 0.95, "{} and {}", lean(true), lean(false));
}

#[test]
fn harmonics_of_both_orders_show_the_light_of_the_normal() {
    let folder = Folder::new("harmonics");
    let [first, second] = ["sh1", "sh2"].map(|signal| {
        let out = folder.path(&format!("{signal}.glb"));
        let signal = format!("{signal}+lightmap");
        bake_anyhow(&data("contact.glb"), &out, &["--signal", &signal, "--samples", "1500", "--sky", "500"]);
        out
    });
    for (path, count) in [(&first, 4), (&second, 9)] {
        let names = layers(path);
        let expected: Vec<_> = (0..count).map(|k| (format!("irradianceSh{k}"), 3)).collect();
        assert_eq!(names[..count], expected);
        assert_eq!(names[count..], [("irradiance".to_owned(), 3)]);
        let open = 500.0 * std::f32::consts::PI;
        let apart = |p: &Shown| {
            let coefficients: Vec<Vec3> =
                p.values.chunks_exact(3).take(count).map(Vec3::from_slice).collect();
            let light = Vec3::from_slice(&p.values[3 * count..]);
            (irradiance(&coefficients, p.normal) - light).length() / (3.0_f32.sqrt() * open)
        };
        let apart = mean(shown(path).iter().map(apart));
        // What the cut-off leaves out of light from one half of the sphere: an eighth of the mean in the first band.
        assert!(apart < if count == 4 { 0.12 } else { 0.05 }, "{count}: {apart} of the open sky");
    }
    let (first, second) = (shown(&first), shown(&second));
    let middle = second.iter().flat_map(|p| &p.values[..12]).map(|v| v.abs()).fold(0.0, f32::max);
    let apart = first.iter().zip(&second).flat_map(|(a, b)| a.values[..12].iter().zip(&b.values[..12]));
    let apart = mean(apart.map(|(a, b)| (a - b).abs()));
    assert!(apart < 0.02 * middle, "{apart} of {middle}");
}

#[test]
fn several_signals_share_codes_and_each_keeps_its_range() {
    let folder = Folder::new("several");
    let out = folder.path("out.glb");
    let signal = "ao+bent-normal+shadow+direct";
    bake_anyhow(&data("contact.glb"), &out, &["--signal", signal, "--sun", "120,50", "--samples", "1500"]);
    let names: Vec<String> = layers(&out).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["ambientOcclusion", "bentNormal", "shadow", "direct"]);
    let (json, _) = glb_parts(&std::fs::read(&out).unwrap());
    for mesh in json["meshes"].as_array().unwrap() {
        let attributes = &mesh["primitives"][0]["attributes"];
        for name in ["_LIGHTUV", "_LIGHTUV_1", "_LIGHTUV_2", "_LIGHTUV_3"] {
            assert!(attributes[name].is_u64(), "{attributes}");
        }
    }
    for point in shown(&out) {
        let [ao, x, y, z, shadow, red, ..] = point.values[..] else { panic!("8 channels") };
        assert!((0.0..=1.0).contains(&ao) && (0.0..=1.0).contains(&shadow));
        assert!(Vec3::new(x, y, z).length() < 1.1);
        // What the sun brings is what is seen of it: 100000 lux times the cosine. At edges values lie between, and on
        // scales of their own.
        if (0.02..0.98).contains(&shadow) {
            continue;
        }
        let (azimuth, elevation) = (120.0_f32.to_radians(), 50.0_f32.to_radians());
        let to_sun =
            Vec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), -azimuth.cos() * elevation.cos());
        let expected = 100_000.0 * point.normal.dot(to_sun).max(0.0) * shadow;
        assert!((red - expected).abs() < 0.25 * expected + 6000.0, "{red} lux for {expected}: {point:?}");
    }
}

/// A floor of one metre, 8 squares a side, whose first texture coordinates are x and z, and whose second are z and x.
fn textured_floor() -> Vec<u8> {
    const N: usize = 8;
    let at = |i: usize| [(i % (N + 1)) as f32 / N as f32, (i / (N + 1)) as f32 / N as f32];
    let count = (N + 1) * (N + 1);
    let mut binary = Vec::new();
    let mut views = Vec::new();
    let mut floats = |values: Vec<f32>, binary: &mut Vec<u8>| {
        views.push(json!({"buffer": 0, "byteOffset": binary.len(), "byteLength": values.len() * 4}));
        values.iter().for_each(|v| binary.extend(v.to_le_bytes()));
    };
    floats((0..count).flat_map(|i| [at(i)[0], 0.0, at(i)[1]]).collect(), &mut binary);
    floats((0..count).flat_map(|_| [0.0, 1.0, 0.0]).collect(), &mut binary);
    floats((0..count).flat_map(at).collect(), &mut binary);
    floats((0..count).flat_map(|i| [at(i)[1], at(i)[0]]).collect(), &mut binary);
    let start = binary.len();
    let cell = |k: usize| (k / N) * (N + 1) + k % N;
    let corners = (0..N * N).map(cell).flat_map(|a| [a, a + N + 1, a + 1, a + 1, a + N + 1, a + N + 2]);
    corners.for_each(|v| binary.extend((v as u16).to_le_bytes()));
    views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": binary.len() - start}));
    let json = json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "floor"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2, "TEXCOORD_1": 3},
            "indices": 4}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3", "min": [0, 0, 0], "max": [1, 0, 1]},
            {"bufferView": 1, "componentType": 5126, "count": count, "type": "VEC3"},
            {"bufferView": 2, "componentType": 5126, "count": count, "type": "VEC2"},
            {"bufferView": 3, "componentType": 5126, "count": count, "type": "VEC2"},
            {"bufferView": 4, "componentType": 5123, "count": 6 * N * N, "type": "SCALAR"},
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": binary.len()}],
    });
    glb(&json, &binary)
}

#[test]
fn texture_and_lightmap_files_are_read_by_their_own_coordinates() {
    let folder = Folder::new("images");
    let (input, out) = (folder.write("in.glb", textured_floor()), folder.path("out.glb"));
    // Even slopes to the right; the second to the left in green.
    const SIZE: usize = 64;
    let slope = |i: usize| ((i % SIZE) as f32 + 0.5) / SIZE as f32;
    for (name, value) in [("right.png", [1.0, 0.0]), ("left.png", [0.0, 1.0])] {
        let [red, green] = value;
        let pixels: Vec<f32> =
            (0..SIZE * SIZE).flat_map(|i| [red * slope(i), green * (1.0 - slope(i)), 0.5]).collect();
        let mut bytes = Vec::new();
        write_png(&mut bytes, [SIZE as u32; 2], 3, PngDepth::Eight, &pixels).unwrap();
        folder.write(name, bytes);
    }
    let path = |name: &str| folder.path(name).display().to_string();
    let signal = format!("texture:{}+lightmap:{}", path("right.png"), path("left.png"));
    bake(&input, &out, &["--signal", &signal, "--samples", "1500"]);
    assert_eq!(layers(&out), [("texture".to_owned(), 3), ("lightmap".to_owned(), 3)]);
    // Stored values are sRGB.
    let linear = |v: f32| if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
    for point in shown(&out) {
        let Vec3 { x, z, .. } = point.place;
        let expected = [linear(x), 0.0, linear(0.5), 0.0, linear(1.0 - z), linear(0.5)];
        for (channel, (value, expected)) in point.values.iter().zip(expected).enumerate() {
            assert!((value - expected).abs() < 0.04, "{channel} at {x} {z}: {value} for {expected}");
        }
    }
    // The file knows its images by where they lie beside it.
    let (json, _) = glb_parts(&std::fs::read(&out).unwrap());
    let signals = &json["extensions"]["LIGHTKILN_lightmap"]["bake"]["signals"];
    assert_eq!(signals, "texture:right.png+lightmap:left.png");
    verify(&out);
}

#[test]
fn texture_beside_traced_light_has_no_noise_of_its_own() {
    let folder = Folder::new("beside");
    let (input, alone, beside) =
        (folder.write("in.glb", textured_floor()), folder.path("alone.glb"), folder.path("beside.glb"));
    let pixels: Vec<f32> = (0..64 * 64).map(|i| f32::from(u8::from(i % 64 > 20))).collect();
    let mut bytes = Vec::new();
    write_png(&mut bytes, [64; 2], 1, PngDepth::Eight, &pixels).unwrap();
    let image = folder.write("edge.png", bytes);
    let signal = format!("texture:{}", image.display());
    let few = ["--samples", "3000"];
    let report = bake_anyhow(&input, &alone, &[&few[..], &["--signal", &signal]].concat());
    let both = format!("{signal}+ao");
    let report_beside = bake_anyhow(&input, &beside, &[&few[..], &["--signal", &both]].concat());
    // Occlusion is 1 everywhere: the edge alone decides.
    let area = |report: &Value| report["classes"]["texture"]["areaShare"].as_f64();
    let (alone, beside) = (area(&report), area(&report_beside));
    assert!(alone.is_some_and(|a| a > 0.05) && alone == beside, "{alone:?} {beside:?}");
}
