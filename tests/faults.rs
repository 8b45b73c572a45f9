//! What users complain of in bakers, baked from a scene that has the fault and nothing else, with no option against it:
//! what the written file shows does not have it. docs/FAULTS.md has the pictures.
#![allow(clippy::unwrap_used)] // helpers of tests are tests

mod harness;

use std::path::Path;

use glam::Vec3;
use harness::shown::{Shown, mean, shown_at};
use harness::{Folder, bake_anyhow, data, glb, glb_parts};
use lightkiln_light::analytic::polygon_occlusion;

/// Occlusion without an end and the shadow of the sun, as the file of a fault shows them at points of every triangle.
fn baked(fault: &str, points: u32, extra: &[&str]) -> Vec<Shown> {
    let folder = Folder::new(fault);
    let scene = lightkiln_props::scene(fault, None).unwrap();
    let (input, out) = (folder.write("in.glb", scene), folder.path("out.glb"));
    let usual = ["--signal", "ao+shadow", "--ao-distance", "inf"];
    bake_anyhow(&input, &out, &[&usual[..], extra].concat());
    shown_at(&out, points)
}

fn open(point: &Shown) -> f32 {
    point.values[0]
}

fn lit(point: &Shown) -> f32 {
    point.values[1]
}

/// The points of a place, of which there must be some.
fn those(points: &[Shown], choose: impl Fn(&Shown) -> bool) -> Vec<&Shown> {
    let chosen: Vec<&Shown> = points.iter().filter(|p| choose(p)).collect();
    assert!(chosen.len() >= 5, "{} points only", chosen.len());
    chosen
}

/// How much of the hemisphere over a point a box leaves open.
fn beside_box(place: Vec3, normal: Vec3, low: Vec3, high: Vec3) -> f32 {
    let mut hidden = 0.0;
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for (at, seen) in [(low[axis], place[axis] < low[axis]), (high[axis], place[axis] > high[axis])] {
            let corner = |a: f32, b: f32| {
                let mut corner = Vec3::ZERO;
                (corner[axis], corner[u], corner[v]) = (at, a, b);
                corner
            };
            if seen {
                let face = [
                    corner(low[u], low[v]),
                    corner(high[u], low[v]),
                    corner(high[u], high[v]),
                    corner(low[u], high[v]),
                ];
                hidden += polygon_occlusion(place, normal, &face);
            }
        }
    }
    1.0 - hidden as f32
}

#[test]
fn fault_of_fronts_inside_leaves_no_black_part() {
    let points = baked("fault_back_faces", 2, &["--samples", "2500"]);
    let sun = Vec3::new(0.2, 1.0, 0.7).normalize();
    let upper = |node: &str, x: f32| {
        let out = move |p: &Shown| (p.place - Vec3::new(x, 0.32, 0.0)).normalize();
        let ball: Vec<&Shown> = points.iter().filter(|p| p.node == node).collect();
        for p in &ball {
            let facing = out(p).dot(sun);
            assert!(facing < 0.2 || lit(p) > 0.8, "{node} at {}: {:?}", p.place, p.values);
            assert!(facing > -0.2 || lit(p) < 0.2, "{node} at {}: {:?}", p.place, p.values);
            assert!(out(p).y < 0.2 || open(p) > 0.5, "{node} at {}: {:?}", p.place, p.values);
        }
        mean(ball.iter().map(|p| open(p)))
    };
    let (turned, usual) = (upper("inside_out", -0.45), upper("outside_out", 0.45));
    assert!((turned - usual).abs() < 0.02, "{turned} and {usual}");
}

#[test]
fn fault_of_points_inside_leaves_no_dark_star() {
    let points = baked("fault_inside", 12, &["--samples", "4000"]);
    let (low, high) = (Vec3::new(-0.02, 0.0, -0.02), Vec3::new(0.02, 0.6, 0.02));
    let around = those(&points, |p| {
        let beside = p.place.x.abs().max(p.place.z.abs());
        p.node == "slab" && p.facing.y > 0.9 && (0.045..0.9).contains(&beside)
    });
    let error = |p: &&Shown| (open(p) - beside_box(p.place, Vec3::Y, low, high)).abs();
    let worst = around.iter().map(error).fold(0.0, f32::max);
    let average = mean(around.iter().map(error));
    assert!(worst < 0.1 && average < 0.012, "{worst} at worst, {average} in the mean");
    // The sun comes from +x and +z: there is no shadow on that side.
    for p in those(&points, |p| p.node == "slab" && p.facing.y > 0.9 && p.place.x.min(p.place.z) > 0.04) {
        assert!(lit(p) > 0.9, "{}: {:?}", p.place, p.values);
    }
    // The leg sees the floor; its triangles have a sample or two each.
    let leg = those(&points, |p| p.node == "leg" && p.place.y > 0.02 && p.facing.y < 0.1);
    assert!(leg.iter().all(|p| open(p) > 0.3), "a dark spot on the leg");
    let floor = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, z]| Vec3::new(x, 0.0, z));
    let expected = mean(leg.iter().map(|p| 1.0 - polygon_occlusion(p.place, p.facing, &floor) as f32));
    let average = mean(leg.iter().map(|p| open(p)));
    assert!((average - expected).abs() < 0.03, "{average} for {expected}");
}

#[test]
fn fault_of_coarse_balls_leaves_a_round_terminator() {
    let points = baked("fault_terminator", 12, &["--samples", "5000"]);
    let sun = Vec3::new(0.5, 1.0, 0.9).normalize();
    let sure = those(&points, |p| !(-0.12..0.15).contains(&p.normal.dot(sun)));
    let wrong = sure.iter().filter(|p| (lit(p) - f32::from(u8::from(p.normal.dot(sun) > 0.0))).abs() > 0.1);
    let wrong = wrong.count() as f32 / sure.len() as f32;
    assert!(wrong < 0.01, "{wrong} of the points");
    // What looks away from the other ball is open, however few its triangles are.
    for p in those(&points, |p| p.normal.x * p.place.x.signum() > 0.05) {
        assert!(open(p) > 0.96, "{} {}: {:?}", p.node, p.place, p.values);
    }
}

#[test]
fn fault_of_contact_leaves_no_gap_of_light() {
    let points = baked("fault_contact", 40, &["--detail", "0.025"]);
    for x in [-0.6, 0.0, 0.6] {
        let floor = |near: f32, far: f32| {
            those(&points, |p| {
                p.node == "floor" && (p.place.x - x).abs() < 0.09 && (near..far).contains(&p.place.z)
            })
        };
        // The sun comes from -z: behind the cube it is dark from the very contact on.
        for p in floor(0.15, 0.2) {
            assert!(lit(p) < 0.1, "{}: {:?}", p.place, p.values);
        }
        for p in floor(-0.25, -0.175) {
            assert!(lit(p) > 0.9, "{}: {:?}", p.place, p.values);
        }
        let [low, high] = [-1.0, 1.0].map(|s| Vec3::new(x + 0.15 * s, 0.15 + 0.15 * s, 0.15 * s));
        for p in floor(0.16, 0.3) {
            let expected = beside_box(p.place, Vec3::Y, low, high);
            assert!((open(p) - expected).abs() < 0.12, "{}: {:?} {expected}", p.place, p.values);
        }
    }
}

#[test]
fn fault_of_thin_walls_leaves_no_leak() {
    let points = baked("fault_thin_wall", 12, &["--detail", "0.03"]);
    let (low, high) = (Vec3::new(0.0, 0.0, -0.8), Vec3::new(0.002, 0.5, 0.8));
    let floor = |near: f32, far: f32| {
        those(&points, |p| p.node == "floor" && p.place.z.abs() < 0.75 && (near..far).contains(&p.place.x))
    };
    // Two texels from the wall; the shadow is half a metre wide.
    for p in floor(0.032, 0.47) {
        assert!(lit(p) < 0.05, "a leak at {}: {:?}", p.place, p.values);
    }
    for p in floor(-0.5, -0.03) {
        assert!(lit(p) > 0.95, "a shadow at {}: {:?}", p.place, p.values);
    }
    for p in floor(0.032, 0.47).into_iter().chain(floor(-0.5, -0.03)) {
        let expected = beside_box(p.place, Vec3::Y, low, high);
        assert!((open(p) - expected).abs() < 0.1, "{}: {:?} {expected}", p.place, p.values);
    }
    for (side, light) in [(1.0, 0.0), (-1.0, 1.0)] {
        for p in those(&points, |p| p.node == "wall" && p.facing.x * side > 0.9 && p.place.y < 0.45) {
            assert!((lit(p) - light).abs() < 0.05, "{}: {:?}", p.place, p.values);
        }
    }
}

#[test]
fn fault_of_coincident_faces_leaves_no_stripes() {
    let points = baked("fault_coincident", 6, &["--samples", "5000"]);
    for p in those(&points, |p| p.node.ends_with("box") && p.facing.y > 0.9) {
        assert!(open(p) > 0.9 && lit(p) > 0.95, "{} at {}: {:?}", p.node, p.place, p.values);
    }
    let here = |node: &str| {
        let in_it = |p: &Shown| (-0.8..-0.3).contains(&p.place.x) && (0.45..0.85).contains(&p.place.z);
        let some = those(&points, |p| p.node == node && in_it(p));
        assert!(some.iter().all(|p| lit(p) > 0.95), "{node} is not lit");
        mean(some.iter().map(|p| open(p)))
    };
    let (floor, sheet) = (here("floor"), here("in_the_floor"));
    assert!((floor - sheet).abs() < 0.02 && sheet > 0.9, "{floor} and {sheet}");
    for (side, light) in [(1.0, 1.0), (-1.0, 0.0)] {
        for p in those(&points, |p| p.node == "back_to_back" && p.facing.z * side > 0.9) {
            assert!((lit(p) - light).abs() < 0.1 && open(p) > 0.3, "{}: {:?}", p.place, p.values);
        }
    }
}

#[test]
fn fault_of_mirrored_parts_leaves_no_difference() {
    let points = baked("fault_mirrored", 1, &["--samples", "5000"]);
    let of = |node: &str| points.iter().filter(|p| p.node == node).collect::<Vec<_>>();
    let (part, image) = (of("as_it_is"), of("mirrored"));
    assert_eq!(part.len(), image.len());
    for channel in 0..2 {
        let apart = part.iter().zip(&image).map(|(a, b)| {
            let mirrored = Vec3::new(-b.place.x, b.place.y, b.place.z);
            assert!(a.place.distance(mirrored) < 1e-5, "{} and {}", a.place, b.place);
            (a.values[channel] - b.values[channel]).abs()
        });
        let apart: Vec<f32> = apart.collect();
        let far = apart.iter().filter(|d| **d > 0.1).count();
        // Edges of shadows pass some middles, and each part has samples of its own.
        let average = mean(apart.iter().copied());
        assert!(average < 0.015 && far * 20 < apart.len(), "{channel}: {average}, {far} of {}", apart.len());
    }
}

#[test]
fn fault_of_open_shells_leaves_light_on_their_fronts() {
    let points = baked("fault_open_shell", 3, &["--samples", "4000"]);
    let sun = Vec3::new(0.4, 1.0, 0.5).normalize();
    // Form factors between points of a ball are all alike: half of a half ball is open from everywhere within.
    let inside = those(&points, |p| p.node == "fronts_inside");
    let average = mean(inside.iter().map(|p| open(p)));
    assert!((average - 0.5).abs() < 0.01, "{average}");
    for p in inside {
        assert!((open(p) - 0.5).abs() < 0.07, "{}: {:?}", p.place, p.values);
        let from = p.place + Vec3::X * 0.5;
        let leaves = from - 2.0 * from.dot(sun) * sun;
        let expected = f32::from(u8::from(leaves.y > 0.0));
        assert!(leaves.y.abs() < 0.08 || (lit(p) - expected).abs() < 0.15, "{}: {:?}", p.place, p.values);
    }
    for p in those(&points, |p| p.node == "fronts_outside" && p.normal.x > 0.05) {
        assert!(open(p) > 0.95, "{}: {:?}", p.place, p.values);
        assert!(p.normal.dot(sun) > -0.1 || lit(p) < 0.1, "{}: {:?}", p.place, p.values);
    }
}

/// A closed room of double-sided walls that face its inside: only where it is empty and dark is its outside what is seen.
#[test]
fn fault_of_fronts_inside_is_not_seen_in_rooms() {
    let folder = Folder::new("fault-room");
    let (mut json, binary) = glb_parts(&std::fs::read(data("furnace.glb")).unwrap());
    let material = json["materials"][0].as_object_mut().unwrap();
    material.shift_remove("emissiveFactor");
    material.shift_remove("extensions");
    material.insert("doubleSided".into(), true.into());
    let furnished = folder.write("furnished.glb", glb(&json, &binary));
    for node in json["nodes"].as_array_mut().unwrap().iter_mut().filter(|n| n["name"] != "room") {
        node.as_object_mut().unwrap().shift_remove("mesh");
    }
    let empty = folder.write("empty.glb", glb(&json, &binary));
    let lamp = "[[light.area-lights]]\nshape = \"sphere\"\nposition = [0, 1.4, 0]\nradius = 0.1\n\
        intensity = [100, 100, 100]\n";
    let lamp = folder.write("lamp.toml", lamp).display().to_string();
    let out = folder.path("out.glb");
    let of = |input: &Path, signal: &str, distance: &str, extra: &[&str]| {
        let usual = ["--signal", signal, "--ao-distance", distance, "--samples", "1500"];
        bake_anyhow(input, &out, &[&usual[..], extra].concat());
        let points = shown_at(&out, 1);
        mean(those(&points, |p| p.node == "room").iter().map(|p| p.values[0]))
    };
    // A lamp of 100 cd in a room of 24 m2 sends 400 pi lm.
    let expected = 400.0 * std::f32::consts::PI / 24.0;
    for input in [&furnished, &empty] {
        let lux = of(input, "direct", "inf", &["--config", &lamp]);
        assert!((lux / expected - 1.0).abs() < 0.12, "{lux} lux for {expected}");
    }
    let open = [of(&furnished, "ao", "inf", &[]), of(&empty, "ao", "inf", &[]), of(&empty, "ao", "0.6", &[])];
    assert!(open[0] < 0.01 && open[1] > 0.99, "{open:?}");
    assert!(open[2] > 0.5 && open[2] < 0.97, "the corners of an empty room are darker: {open:?}");
}
