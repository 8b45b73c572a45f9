//! Lights and what they meet, by what the written files show.
#![allow(clippy::unwrap_used)] // helpers of tests are tests

mod harness;

use std::f32::consts::PI;
use std::path::{Path, PathBuf};

use glam::Vec3;
use harness::shown::{Shown, mean, shown};
use harness::{Folder, bake_anyhow, data, glb, glb_parts, verify};
use lightkiln_light::analytic::polygon_occlusion;
use serde_json::{Value, json};

/// A copy of one of our scenes with something else in its JSON.
fn altered(folder: &Folder, name: &str, scene: &str, alter: impl FnOnce(&mut Value)) -> PathBuf {
    let (mut json, binary) = glb_parts(&std::fs::read(data(scene)).unwrap());
    alter(&mut json);
    folder.write(name, glb(&json, &binary))
}

/// Takes a node out of the picture.
fn remove(json: &mut Value, name: &str) {
    let nodes = json["nodes"].as_array_mut().unwrap();
    let node = nodes.iter_mut().find(|n| n["name"] == name).expect("a node of that name");
    node.as_object_mut().unwrap().shift_remove("mesh");
}

/// Bakes with a configuration, and gives back what the file shows.
fn lit(folder: &Folder, input: &Path, config: &str, extra: &[&str]) -> Vec<Shown> {
    let (out, config) = (folder.path("out.glb"), folder.write("bake.toml", config));
    let mut all = vec!["--config", config.to_str().unwrap()];
    all.extend(extra);
    bake_anyhow(input, &out, &all);
    shown(&out)
}

fn red(points: &[Shown], choose: impl Fn(&Shown) -> bool) -> f32 {
    let values: Vec<f32> = points.iter().filter(|p| choose(p)).map(|p| p.values[0]).collect();
    assert!(!values.is_empty(), "no point was chosen");
    mean(values.iter().copied())
}

/// The mean relative difference of two bakes of one scene, where either has light.
fn apart(a: &[Shown], b: &[Shown]) -> f32 {
    assert_eq!(a.len(), b.len());
    let white = mean(a.iter().flat_map(|p| p.values.iter().copied()));
    let each = a.iter().zip(b).flat_map(|(a, b)| a.values.iter().zip(&b.values));
    mean(each.map(|(a, b)| (a - b).abs() / (a.max(*b) + 0.1 * white)))
}

#[test]
fn area_lights_of_all_shapes_have_their_closed_forms() {
    let folder = Folder::new("area");
    let floor = altered(&folder, "floor.glb", "disk_light.glb", |json| remove(json, "disk"));
    let of = |light: &str| {
        let config = format!("signal = \"direct\"\nsamples = 2000\n[[light.area-lights]]\n{light}\n");
        lit(&folder, &floor, &config, &[])
    };
    // A quad of 1 x 0.6 m that shines down, above a corner.
    let quad = of(
        "shape = \"quad\"\ncorner = [0.5, 1, 0.5]\nedges = [[1, 0, 0], [0, 0, 0.6]]\nradiance = [1000, 500, 0]",
    );
    let (corner, x, z) = (Vec3::new(0.5, 1.0, 0.5), Vec3::X, Vec3::Z * 0.6);
    let corners = [corner, corner + x, corner + x + z, corner + z];
    let close = |value: f32, expected: f32| (value - expected).abs() < 0.1 * expected + 12.0;
    for p in &quad {
        let share = polygon_occlusion(p.place, Vec3::Y, &corners) as f32;
        let [red, green, blue] = p.values[..] else { panic!("RGB") };
        assert!(close(red, 1000.0 * PI * share), "{red} at {}", p.place);
        assert!(close(green, 500.0 * PI * share) && blue < 1.0, "{green} and {blue} at {}", p.place);
    }
    // Its other side is dark.
    let up = of(
        "shape = \"quad\"\ncorner = [0.5, 1, 0.5]\nedges = [[0, 0, 0.6], [1, 0, 0]]\nradiance = [1000, 500, 0]\n\
         [[light.area-lights]]\nshape = \"sphere\"\nposition = [-0.5, 1, 0]\nradius = 0.2\nintensity = [300, 300, 300]",
    );
    for p in &up {
        // A sphere is as bright from all sides as a point, while it is wholly above the horizon.
        let way = Vec3::new(-0.5, 1.0, 0.0) - p.place;
        let expected = 300.0 * way.y / way.length().powi(3);
        assert!(close(p.values[0], expected), "{} lux for {expected} at {}", p.values[0], p.place);
    }
}

#[test]
fn shining_mesh_is_as_bright_as_an_area_light_of_its_size() {
    let folder = Folder::new("shining");
    let mesh = lit(
        &folder,
        &data("disk_light.glb"),
        "signal = \"direct\"\nsamples = 2500\n",
        &["--exclude", "disk"],
    );
    let floor = altered(&folder, "floor.glb", "disk_light.glb", |json| remove(json, "disk"));
    let disk = "signal = \"direct\"\nsamples = 2500\n[[light.area-lights]]\nshape = \"disk\"\n\
        position = [0, 1, 0]\ndirection = [0, -1, 0]\nradius = 0.5\nradiance = [1000, 1000, 1000]\n";
    let light = lit(&folder, &floor, disk, &[]);
    assert!(apart(&mesh, &light) < 0.02, "{}", apart(&mesh, &light));
    for points in [&mesh, &light] {
        let middle = red(points, |p| p.place.length() < 0.15);
        // pi L r2 / (r2 + h2), and a little less beside the middle.
        assert!((middle / 628.3 - 0.99).abs() < 0.03, "{middle}");
    }
}

#[test]
fn light_of_separate_bakes_adds_up() {
    let folder = Folder::new("adds");
    let of = |signal: &str, extra: &[&str]| {
        let config = format!("signal = \"{signal}\"\nsamples = 1500\n[light]\nwhite = 2000.0\n");
        lit(&folder, &data("cornell.glb"), &config, extra)
    };
    let (all, direct, indirect) = (of("lightmap", &[]), of("direct", &[]), of("indirect", &[]));
    let mut sum = direct;
    for (point, other) in sum.iter_mut().zip(&indirect) {
        point.values.iter_mut().zip(&other.values).for_each(|(a, b)| *a += b);
    }
    assert!(apart(&all, &sum) < 0.06, "{}", apart(&all, &sum));
    // The parts matter: neither alone is the whole.
    assert!(apart(&all, &indirect) > 0.2);
    // Each bounce adds light, and the first adds most.
    let mean_of = |points: &[Shown]| mean(points.iter().flat_map(|p| p.values.iter().copied()));
    let light = ["0", "1", "2"].map(|bounces| mean_of(&of("lightmap", &["--bounces", bounces])));
    let [none, one, two] = light;
    assert!(none < one && one < two && two < 1.02 * mean_of(&all), "{light:?} {}", mean_of(&all));
    assert!(one - none > two - one, "{light:?}");
}

#[test]
fn light_without_bounces_is_direct() {
    let folder = Folder::new("bounces");
    let of = |signal: &str, extra: &[&str]| {
        let config = format!("signal = \"{signal}\"\nsamples = 1500\n[light]\nwhite = 2000.0\n");
        lit(&folder, &data("cornell.glb"), &config, extra)
    };
    let (none, direct) = (of("lightmap", &["--bounces", "0"]), of("direct", &[]));
    assert!(apart(&none, &direct) < 0.01, "{}", apart(&none, &direct));
}

#[test]
fn glass_lets_the_sun_in_unless_it_is_opaque() {
    let folder = Folder::new("glass");
    let of =
        |glass: &[&str]| lit(&folder, &data("window.glb"), "signal = \"direct\"\nsamples = 6000\n", glass);
    let inside = |p: &Shown| {
        p.node == "floor"
            && p.facing.y > 0.9
            && p.place.y > -0.01
            && p.place.x.abs() < 1.9
            && p.place.z.abs() < 1.4
    };
    let (tinted, opaque) = (red(&of(&[]), inside), red(&of(&["--glass", "opaque"]), inside));
    assert!(opaque < 1.0, "{opaque} lux behind opaque glass");
    assert!(tinted > 100.0, "{tinted} lux behind clear glass");
}

#[test]
fn variant_decides_which_color_bleeds() {
    let folder = Folder::new("variant");
    let painted = altered(&folder, "in.glb", "cornell_box.glb", |json| {
        let number = json["materials"].as_array().unwrap().len();
        for color in [[0.9, 0.0, 0.0, 1.0], [0.0, 0.0, 0.9, 1.0]] {
            let paint = json!({"pbrMetallicRoughness": {"baseColorFactor": color, "metallicFactor": 0}});
            json["materials"].as_array_mut().unwrap().push(paint);
        }
        let nodes = json["nodes"].as_array().unwrap();
        let floor = nodes.iter().find(|n| n["name"] == "floor").unwrap()["mesh"].as_u64().unwrap() as usize;
        json["meshes"][floor]["primitives"][0]["extensions"]["KHR_materials_variants"] = json!({"mappings": [
            {"material": number, "variants": [0]}, {"material": number + 1, "variants": [1]}]});
        json["extensions"]["KHR_materials_variants"] =
            json!({"variants": [{"name": "warm"}, {"name": "cold"}]});
        json["extensionsUsed"] = json!(["KHR_materials_variants"]);
    });
    let of = |name: &str| {
        let config = "signal = \"indirect\"\nsamples = 1500\nmax-error = 0.15\n";
        let points = lit(&folder, &painted, config, &["--sky", "1000", "--variant", name]);
        verify(&folder.path("out.glb"));
        // The ceiling, which the floor is below.
        let ceiling: Vec<&Shown> = points.iter().filter(|p| p.facing.y < -0.9 && p.place.y > 0.4).collect();
        assert!(!ceiling.is_empty());
        [0, 2].map(|channel| mean(ceiling.iter().map(|p| p.values[channel])))
    };
    let ([warm_red, warm_blue], [cold_red, cold_blue]) = (of("warm"), of("cold"));
    assert!(
        warm_red > 1.2 * cold_red && cold_blue > 1.2 * warm_blue,
        "{warm_red} {warm_blue} {cold_red} {cold_blue}"
    );
}

#[test]
fn parts_that_are_not_included_cast_and_get_no_light() {
    let folder = Folder::new("include");
    let (out, all) = (folder.path("out.glb"), folder.path("all.glb"));
    let few = ["--samples", "1500", "--ao-distance", "0.5"];
    bake_anyhow(&data("contact.glb"), &all, &few);
    let choice = ["--include", "*ing", "--include", "plane", "--exclude", "h?vering"];
    bake_anyhow(&data("contact.glb"), &out, &[&few[..], &choice].concat());
    let points = shown(&out);
    let mut nodes: Vec<&str> = points.iter().map(|p| p.node.as_str()).collect();
    nodes.dedup();
    assert_eq!(nodes, ["plane", "standing"]);
    verify(&out);
    // The cube that hovers casts as before.
    let below = |points: &[Shown]| {
        red(points, |p| p.node == "plane" && (p.place.x - 0.2).abs() < 0.3 && (p.place.z + 0.9).abs() < 0.3)
    };
    let (chosen, whole) = (below(&points), below(&shown(&all)));
    assert!((chosen - whole).abs() < 0.06 && whole < 0.8, "{chosen} and {whole}");
}
