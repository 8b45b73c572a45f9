//! Parts that animations move, baked as a user bakes them.
#![allow(clippy::unwrap_used)] // helpers of tests are tests

mod harness;

use std::path::{Path, PathBuf};

use harness::shown::{mean, shown};
use harness::{Folder, bake, data, fail, glb, glb_parts, verify};
use serde_json::{Value, json};

/// Quick, and with a bound that so few samples keep.
const FEW: [&str; 4] = ["--samples", "1500", "--max-error", "0.1"];

/// What an animation does to a node.
struct Channel {
    node: &'static str,
    path: &'static str,
    interpolation: &'static str,
    /// Numbers of all keys, one after the other.
    keys: Vec<f32>,
}

impl Channel {
    /// Lifts a node by a metre and puts it back.
    fn lift(node: &'static str) -> Self {
        Self::of(node, "translation", &[0.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    }

    fn of(node: &'static str, path: &'static str, keys: &[f32]) -> Self {
        Self { node, path, interpolation: "LINEAR", keys: keys.to_vec() }
    }
}

/// The scene `contact`, a plane and five cubes below one node, with an animation.
fn animated(folder: &Folder, name: &str, channels: &[Channel]) -> PathBuf {
    let (mut json, mut binary) = glb_parts(&std::fs::read(data("contact.glb")).unwrap());
    let mut accessor = |kind: &str, values: &[f32]| {
        let width = match kind {
            "SCALAR" => 1,
            "VEC3" => 3,
            _ => 4,
        };
        let (offset, bytes) = (binary.len(), values.len() * 4);
        values.iter().for_each(|v| binary.extend(v.to_le_bytes()));
        let views = json["bufferViews"].as_array_mut().unwrap();
        views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes}));
        let view = views.len() - 1;
        let accessors = json["accessors"].as_array_mut().unwrap();
        let count = values.len() / width;
        accessors.push(json!({"bufferView": view, "componentType": 5126, "count": count, "type": kind}));
        accessors.len() - 1
    };
    let times = accessor("SCALAR", &[0.0, 1.0]);
    let outputs: Vec<usize> = channels
        .iter()
        .map(|c| {
            let kind = match c.path {
                "weights" => "SCALAR",
                "rotation" => "VEC4",
                _ => "VEC3",
            };
            accessor(kind, &c.keys)
        })
        .collect();
    let number = |name: &str| {
        json["nodes"].as_array().unwrap().iter().position(|n| n["name"] == name).expect("a node of that name")
    };
    let targets: Vec<Value> = channels
        .iter()
        .enumerate()
        .map(|(i, c)| json!({"sampler": i, "target": {"node": number(c.node), "path": c.path}}))
        .collect();
    let samplers: Vec<Value> = channels
        .iter()
        .zip(outputs)
        .map(|(c, output)| json!({"input": times, "output": output, "interpolation": c.interpolation}))
        .collect();
    json["animations"] = json!([{"channels": targets, "samplers": samplers}]);
    json["buffers"][0]["byteLength"] = binary.len().into();
    folder.write(name, glb(&json, &binary))
}

/// The nodes whose meshes carry light.
fn lit(path: &Path) -> Vec<String> {
    let (json, _) = glb_parts(&std::fs::read(path).unwrap());
    let is_lit = |node: &&Value| {
        let Some(mesh) = node["mesh"].as_u64() else { return false };
        let primitive = &json["meshes"][mesh as usize]["primitives"][0];
        let marked = primitive["extensions"].get("LIGHTKILN_lightmap").is_some();
        assert_eq!(marked, primitive["attributes"].get("_LIGHTUV").is_some(), "{node}");
        marked
    };
    let nodes = json["nodes"].as_array().unwrap();
    nodes.iter().filter(is_lit).map(|n| n["name"].as_str().unwrap().to_owned()).collect()
}

fn recipe(path: &Path) -> Value {
    let (json, _) = glb_parts(&std::fs::read(path).unwrap());
    json["extensions"]["LIGHTKILN_lightmap"]["bake"]["light"].clone()
}

/// The warning that speaks of animations, if there is one.
fn warning(report: &Value) -> Option<&str> {
    let warnings = report["warnings"].as_array().unwrap();
    warnings.iter().filter_map(Value::as_str).find(|w| w.contains("animations"))
}

const CUBES: [&str; 5] = ["standing", "hovering", "sunk", "first_of_two", "second_of_two"];

#[test]
fn moving_part_is_left_out_and_named() {
    let folder = Folder::new("moving-part");
    let input = animated(&folder, "in.glb", &[Channel::lift("standing")]);
    let [auto, told, kept] = ["auto.glb", "told.glb", "kept.glb"].map(|name| folder.path(name));
    let report = bake(&input, &auto, &FEW);
    let said = warning(&report).expect("a warning");
    assert!(
        said.contains("1 node is moved") && said.contains("standing") && said.contains("--moving keep"),
        "{said}"
    );
    assert_eq!(lit(&auto), ["plane", "hovering", "sunk", "first_of_two", "second_of_two"]);
    assert_eq!(recipe(&auto)["leaveOutMoving"], true);
    verify(&auto);

    // The file says the same as one for which it was asked.
    bake(&input, &told, &[&FEW[..], &["--moving", "leave-out"]].concat());
    assert!(std::fs::read(&auto).unwrap() == std::fs::read(&told).unwrap());

    let report = bake(&input, &kept, &[&FEW[..], &["--moving", "keep"]].concat());
    let said = warning(&report).expect("a warning");
    assert!(said.contains("standing") && said.contains("leave-out"), "{said}");
    assert_eq!(lit(&kept).len(), 6);
    assert!(recipe(&kept).get("leaveOutMoving").is_none());
    verify(&kept);

    // Its shadow goes with it: the cube stands on the plane from -1.25 to -0.75 and from -1.05 to -0.55.
    let beneath = |path: &Path| {
        let shown = shown(path);
        let inside = shown
            .iter()
            .filter(|p| p.node == "plane" && (p.place.x + 1.0).abs() < 0.4 && (p.place.z + 0.8).abs() < 0.4);
        mean(inside.map(|p| p.values[0]))
    };
    let (left, stays) = (beneath(&auto), beneath(&kept));
    assert!(left > 0.99 && stays < 0.9, "{left} without, {stays} with the cube");
}

#[test]
fn moving_assembly_is_kept_whole() {
    let folder = Folder::new("moving-assembly");
    let [auto, kept] = ["auto.glb", "kept.glb"].map(|name| folder.path(name));
    // All hang below this node.
    let input = animated(&folder, "all.glb", &[Channel::lift("contact")]);
    let report = bake(&input, &auto, &FEW);
    let said = warning(&report).expect("a warning");
    assert!(said.contains("6 nodes") && said.contains("more than half"), "{said}");
    assert!(said.contains("and 3 more") && said.contains("--moving leave-out"), "{said}");
    assert_eq!(lit(&auto).len(), 6);
    bake(&input, &kept, &[&FEW[..], &["--moving", "keep"]].concat());
    assert!(std::fs::read(&auto).unwrap() == std::fs::read(&kept).unwrap());
    let arguments = harness::draft(&input, &auto, &["--moving", "leave-out"]);
    let said = fail(1, arguments);
    assert!(said.contains("left out") && said.contains("--moving keep"), "{said}");
}

#[test]
fn moving_share_is_that_of_what_gets_light() {
    let folder = Folder::new("moving-share");
    let out = folder.path("out.glb");
    // Three of five equal cubes, which are a fifth of the area with the plane.
    let moving = CUBES[..3].iter().map(|name| Channel::lift(name)).collect::<Vec<_>>();
    let input = animated(&folder, "three.glb", &moving);
    assert!(warning(&bake(&input, &out, &FEW)).unwrap().contains("nobody's way"));
    assert_eq!(lit(&out), ["plane", "first_of_two", "second_of_two"]);
    let report = bake(&input, &out, &[&FEW[..], &["--exclude", "plane"]].concat());
    assert!(warning(&report).unwrap().contains("more than half"), "{report}");
    assert_eq!(lit(&out), CUBES);
    let two = CUBES[..2].iter().map(|name| Channel::lift(name)).collect::<Vec<_>>();
    let input = animated(&folder, "two.glb", &two);
    bake(&input, &out, &[&FEW[..], &["--exclude", "plane"]].concat());
    assert_eq!(lit(&out), CUBES[2..]);
    verify(&out);
}

#[test]
fn moving_channels_that_change_nothing_do_not_count() {
    let folder = Folder::new("moving-still");
    let out = folder.path("out.glb");
    let still = [
        Channel::of("standing", "translation", &[0.0; 6]),
        Channel::of("hovering", "rotation", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0]),
        Channel::of("sunk", "scale", &[1.0; 6]),
        Channel::of("first_of_two", "weights", &[0.0, 1.0]),
        Channel { interpolation: "CUBICSPLINE", ..Channel::of("second_of_two", "translation", &[0.0; 18]) },
    ];
    let report = bake(&animated(&folder, "still.glb", &still), &out, &FEW);
    assert_eq!(warning(&report), None);
    assert_eq!(lit(&out).len(), 6);
    // A tangent is a way out and back.
    let mut bent = Channel { interpolation: "CUBICSPLINE", ..Channel::of("sunk", "translation", &[0.0; 18]) };
    bent.keys[6] = 1.0;
    let elsewhere = Channel::of("standing", "translation", &[0.0, 0.5, 0.0, 0.0, 0.5, 0.0]);
    let report = bake(&animated(&folder, "bent.glb", &[bent, elsewhere]), &out, &FEW);
    assert!(
        warning(&report).is_some_and(|w| w.contains("2 nodes") && w.contains("standing, sunk")),
        "{report}"
    );
}

#[test]
fn moving_of_a_configuration_gives_way_to_the_command_line() {
    let folder = Folder::new("moving-config");
    let (input, out) = (animated(&folder, "in.glb", &[Channel::lift("sunk")]), folder.path("out.glb"));
    let config = folder.write("bake.toml", "samples = 1500\n[light]\nmoving = \"keep\"\n");
    let config = config.to_str().unwrap();
    bake(&input, &out, &["--config", config]);
    assert_eq!(lit(&out).len(), 6);
    bake(&input, &out, &["--config", config, "--moving", "auto"]);
    assert_eq!(lit(&out).len(), 5);
}
