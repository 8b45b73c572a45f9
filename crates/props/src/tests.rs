use std::collections::HashMap;

use glam::{DVec3, Vec3};

use crate::model::{Assembly, Surface};
use crate::shapes::{Detail, bent, cuboid, lathe, panel, rounded_box, tube, wall};
use crate::*;

const DETAIL: Detail = Detail { per_metre: 20.0, only_count: false };

/// What is wrong with a surface: normals are of unit length and on the side that the triangles face, and no triangle
/// is degenerate.
fn fault(surface: &Surface) -> Option<String> {
    let uvs = surface.uvs.len();
    if surface.positions.len() != surface.normals.len() || (uvs != 0 && uvs != surface.positions.len()) {
        return Some("lengths differ".into());
    }
    if surface.triangles.is_empty() || surface.count != surface.triangles.len() {
        return Some(format!("{} triangles, counted {}", surface.triangles.len(), surface.count));
    }
    let unit = |n: &Vec3| (n.length() - 1.0).abs() < 1e-5;
    if !surface.positions.iter().all(|p| p.is_finite()) || !surface.normals.iter().all(unit) {
        return Some("not finite or no unit normal".into());
    }
    let mut bad = (0, String::new());
    for t in &surface.triangles {
        let [a, b, c] = t.map(|v| surface.positions[v as usize].as_dvec3());
        let n = (b - a).cross(c - a);
        if n.length() == 0.0 {
            return Some(format!("degenerate triangle {a} {b} {c}"));
        }
        let n = n.normalize().as_vec3();
        let least = t.map(|v| surface.normals[v as usize].dot(n)).into_iter().fold(1.0, f32::min);
        if least < 0.05 {
            bad.0 += 1;
            bad.1 = format!("{least} in {a:.3} {b:.3} {c:.3}");
        }
    }
    (bad.0 > 0).then(|| format!("{} of {} face away: {}", bad.0, surface.count, bad.1))
}

fn assert_sound(surface: &Surface, what: &str) {
    assert_eq!(fault(surface), None, "{what}");
}

/// Each edge has a triangle on either side, by position.
fn is_closed(surface: &Surface) -> bool {
    let bits = |v: u32| (surface.positions[v as usize] + Vec3::ZERO).to_array().map(f32::to_bits);
    let mut edges: HashMap<_, i32> = HashMap::new();
    for t in &surface.triangles {
        for e in 0..3 {
            let (a, b) = (bits(t[e]), bits(t[(e + 1) % 3]));
            *edges.entry((a, b)).or_default() += 1;
            *edges.entry((b, a)).or_default() -= 1;
        }
    }
    edges.values().all(|&n| n == 0)
}

fn volume(surface: &Surface) -> f64 {
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| surface.positions[v as usize].as_dvec3());
        a.dot(b.cross(c)) / 6.0
    };
    surface.triangles.iter().map(of).sum()
}

fn assert_scene_is_sound(scene: &Assembly) {
    let of = |m: &model::Mesh| {
        m.primitives.iter().filter_map(|(s, _)| fault(s)).map(|f| format!("{}: {f}", m.name)).next()
    };
    let faults: Vec<String> = scene.meshes.iter().filter_map(of).collect();
    assert!(faults.is_empty(), "{faults:#?}");
}

/// Every mesh but those named is closed and has its outside out.
fn assert_parts_are_solid(scene: &Assembly, open: &[&str]) {
    let is_bad = |m: &&model::Mesh| {
        let surface = &m.primitives[0].0;
        !open.contains(&m.name.as_str()) && (!is_closed(surface) || volume(surface) <= 0.0)
    };
    let bad: Vec<&String> = scene.meshes.iter().filter(is_bad).map(|m| &m.name).collect();
    assert!(bad.is_empty(), "{bad:?}");
}

#[test]
fn shapes_that_claim_it_are_closed_and_have_volume() {
    let bump = |u: f64, v: f64| DVec3::new(u, 0.6 * v, 0.1 * (3.0 * u).sin() * v);
    let ring = |t: f64| {
        let a = t * std::f64::consts::TAU;
        DVec3::new(a.cos(), a.sin(), 0.2 * (2.0 * a).sin())
    };
    let drop: &[(f64, f64)] = &[(0.0, -0.5), (0.4, -0.2), (0.2, 0.3), (0.0, 0.6)];
    let cushion = rounded_box(&DETAIL, DVec3::new(0.5, 0.3, 0.2), 0.1, 3);
    for (name, shape) in [
        ("panel", panel(&DETAIL, [2, 2], 0.01, &bump)),
        ("open tube", tube(&DETAIL, [4, 8], 0.05, false, &|t| DVec3::new(t, t * t, 0.3 * t))),
        ("closed tube", tube(&DETAIL, [24, 8], 0.05, true, &ring)),
        ("drop", lathe(&DETAIL, 12, &[drop])),
        (
            "cylinder",
            lathe(
                &DETAIL,
                12,
                &[&[(0.0, 0.0), (0.2, 0.0)], &[(0.2, 0.0), (0.2, 1.0)], &[(0.2, 1.0), (0.0, 1.0)]],
            ),
        ),
        ("cuboid", cuboid(DVec3::ZERO, DVec3::ONE, [2, 3, 4])),
        ("bent box", bent(cushion.clone(), |p, n| p + 0.01 * n + DVec3::Z * p.x * p.x)),
        ("rounded box", cushion),
    ] {
        assert_sound(&shape, name);
        assert!(is_closed(&shape), "{name}");
        assert!(volume(&shape) > 0.0, "{name}");
    }
}

#[test]
fn small_scenes_have_the_counts_they_promise() {
    let counts = |name: &str, size: Option<usize>| {
        let scene = recipe(name).unwrap().assembly(size, Diagonal::Corner).unwrap();
        assert_scene_is_sound(&scene);
        let vertices: usize =
            scene.meshes.iter().flat_map(|m| &m.primitives).map(|(s, _)| s.positions.len()).sum();
        (vertices, scene.triangle_count())
    };
    assert_eq!(counts("half_box", None), (12, 6));
    assert_eq!(counts("column", None), (200, 246));
    assert_eq!(counts("l_shape", Some(16)), (2 * 17 * 17, 4 * 16 * 16));
    for name in ["cornell_box", "instances", "fence", "thin_wall", "contact", "millimetres"] {
        assert!(counts(name, None).1 > 100);
    }
}

#[test]
fn half_box_diagonals_differ_and_face_the_corner() {
    for diagonal in [Diagonal::Corner, Diagonal::Other] {
        let scene = small::half_box(diagonal);
        assert_scene_is_sound(&scene);
        let (surface, _) = &scene.meshes[0].primitives[0];
        let with_origin = surface
            .triangles
            .iter()
            .filter(|t| t.iter().any(|&v| surface.positions[v as usize] == Vec3::ZERO))
            .count();
        assert_eq!(with_origin, if diagonal == Diagonal::Corner { 6 } else { 3 });
        assert!(surface.normals.iter().all(|n| n.min_element() >= 0.0));
    }
}

#[test]
fn picture_is_one_sheet_of_about_as_many_triangles() {
    let scene = picture::picture(2000).unwrap();
    assert_scene_is_sound(&scene);
    let surface = &scene.meshes[0].primitives[0].0;
    assert!(surface.count.abs_diff(2000) < 10, "{}", surface.count);
    // A disk of one sheet: faces - edges + vertices = 1, and the area is the square's.
    let mut edges = HashMap::new();
    for t in &surface.triangles {
        for e in 0..3 {
            let (a, b) = (t[e].min(t[(e + 1) % 3]), t[e].max(t[(e + 1) % 3]));
            *edges.entry((a, b)).or_insert(0) += 1;
        }
    }
    assert!(edges.values().all(|&n| n <= 2));
    assert_eq!(surface.count + surface.positions.len() - edges.len(), 1);
}

#[test]
fn thin_wall_is_closed() {
    let scene = small::thin_wall(8);
    assert!(is_closed(&scene.meshes[1].primitives[0].0));
}

#[test]
fn lit_scenes_are_sound() {
    for name in ["cornell", "furnace", "disk_light", "window", "leaks", "punctual", "room"] {
        let scene = recipe(name).unwrap().assembly(None, Diagonal::Corner).unwrap();
        assert_scene_is_sound(&scene);
        assert!(scene.triangle_count() > 300, "{name}");
    }
}

#[test]
fn scenes_of_faults_are_sound_but_for_their_fault() {
    let faults: Vec<_> = RECIPES.iter().filter(|r| r.name.starts_with("fault_")).collect();
    assert_eq!(faults.len(), 8);
    for recipe in faults {
        let scene = recipe.assembly(None, Diagonal::Corner).unwrap();
        assert_scene_is_sound(&scene);
        assert_eq!(scene_lights(&scene), ["Sun"], "{}", recipe.name);
    }
    let half = &faults::open_shell().meshes[1].primitives[0].0;
    assert!(!is_closed(half) && half.positions.iter().all(|p| p.y < 1e-6));
}

#[test]
fn walls_with_openings_are_closed() {
    let shape = wall(&DETAIL, [3.0, 2.0], 0.2, &[[0.5, 0.0, 1.2, 1.5], [1.7, 0.6, 2.4, 1.5]]);
    assert_sound(&shape, "wall");
    assert!(is_closed(&shape));
    let solid = 3.0 * 2.0 - 0.7 * 1.5 - 0.7 * 0.9;
    assert!((volume(&shape) - 0.2 * solid).abs() < 1e-6, "{}", volume(&shape));
}

#[test]
fn lit_scenes_have_the_light_they_promise() {
    let json = |name: &str| -> serde_json::Value {
        let bytes = scene(name, None).unwrap();
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        serde_json::from_slice(&bytes[20..20 + length]).unwrap()
    };
    let strength = |name: &str, material: usize| {
        json(name)["materials"][material]["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
            .as_f64()
    };
    assert_eq!(strength("cornell", 3), Some(17_000.0));
    assert_eq!(strength("disk_light", 1), Some(1000.0));
    let disk = lit::disk_light(4);
    let (surface, _) = &disk.meshes[1].primitives[0];
    let area: f32 = surface
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|v| surface.positions[v as usize]);
            0.5 * (b - a).cross(c - a).length()
        })
        .sum();
    assert!((area - 0.25 * std::f32::consts::PI).abs() < 1e-5, "{area}");
    let kinds: Vec<String> = scene_lights(&lit::punctual(4));
    assert_eq!(kinds, ["Sun", "Point", "Spot { inner: 0.25, outer: 0.4 }"]);
    // A light shines along -z of its node.
    let sun = lit::punctual(4).nodes.into_iter().find(|n| n.name == "sun").unwrap();
    let way = sun.place.rotation * Vec3::NEG_Z;
    assert!(way.dot(Vec3::new(0.6, -1.0, -0.3).normalize()) > 0.9999, "{way}");
}

fn scene_lights(scene: &Assembly) -> Vec<String> {
    scene.lights.iter().map(|l| format!("{:?}", l.kind)).collect()
}

#[test]
fn furnace_is_closed() {
    for mesh in &lit::furnace(4).meshes {
        assert!(is_closed(&mesh.primitives[0].0), "{}", mesh.name);
    }
}

#[test]
fn house_is_sound_and_has_the_size_asked_for() {
    for size in [80_000, 199_000] {
        let scene = house::house(size);
        assert_scene_is_sound(&scene);
        let count = scene.triangle_count();
        assert!(count.abs_diff(size) * 20 < size, "{count}");
        let open = ["ground", "oak_leaves", "apple_leaves", "fern"];
        assert_parts_are_solid(&scene, &open);
    }
}

#[test]
fn stages_have_the_size_asked_for() {
    for (made, size) in [(lit::car_studio(105_000), 105_000), (lit::seat_room(60_000), 60_000_usize)] {
        assert_scene_is_sound(&made);
        assert!(made.triangle_count().abs_diff(size) * 20 < size, "{}", made.triangle_count());
    }
}

#[test]
fn scene_bytes_are_deterministic_and_valid_gltf() {
    for r in RECIPES {
        let size = (r.sizes.1 > 0).then_some(r.sizes.0.max(2));
        let bytes = scene(r.name, size).unwrap();
        assert_eq!(bytes, scene(r.name, size).unwrap(), "{}", r.name);
        let gltf = gltf::Gltf::from_slice(&bytes).unwrap();
        assert_eq!(gltf.blob.as_ref().unwrap().len() % 4, 0);
        assert!(gltf.nodes().count() > 0);
    }
}

#[test]
fn scene_unknown_name_and_size_are_errors() {
    assert!(matches!(scene("teapot", None), Err(PropsError::Unknown { .. })));
    assert!(matches!(scene("l_shape", Some(0)), Err(PropsError::Size { size: 0, .. })));
    assert!(matches!(scene("column", Some(7)), Err(PropsError::Size { .. })));
}

#[test]
fn seat_is_sound_and_has_the_size_asked_for() {
    for size in [40_000, 160_000] {
        let scene = seat::seat(size);
        assert_scene_is_sound(&scene);
        let count = scene.triangle_count();
        assert!(count.abs_diff(size) * 25 < size, "{count}");
        assert_parts_are_solid(&scene, &[]);
    }
}

#[test]
fn car_is_sound_and_has_the_size_asked_for() {
    for size in [100_000, 400_000, 1_000_000] {
        let scene = car::car(size);
        assert_scene_is_sound(&scene);
        let count = scene.triangle_count();
        assert!(count.abs_diff(size) * 25 < size, "{count}");
        let drawn = scene.nodes.iter().filter(|n| n.mesh.is_some()).count();
        assert!(drawn > 250, "{drawn}");
        assert_parts_are_solid(&scene, &["headliner"]);
    }
}
