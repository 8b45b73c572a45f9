//! Punctual lights, what moves, variants, and who casts and receives.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // helpers of tests are tests

mod common;

use common::{Gltf, rich};
use glam::Vec3;
use lightkiln_scene::{ErrorKind, LightKind, ReadOptions, Roles, Scene, SceneError};
use serde_json::{Value, json};

fn surfaces() -> ReadOptions {
    ReadOptions { surfaces: true, ..ReadOptions::default() }
}

/// The quad, and below a node at (1, 2, 3) that is turned and scaled a light.
fn lit(light: Value) -> Gltf {
    let mut g = Gltf::quad();
    g.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [light]}});
    g.json["nodes"] = json!([
        {"mesh": 0, "name": "first"},
        // A quarter turn about x: -z becomes +y.
        {"translation": [1, 2, 3], "rotation": [std::f64::consts::FRAC_1_SQRT_2, 0, 0, std::f64::consts::FRAC_1_SQRT_2],
         "scale": [2, 3, 4], "children": [2]},
        {"name": "lamp", "translation": [0, 0, 1], "extensions": {"KHR_lights_punctual": {"light": 0}}},
    ]);
    g.json["scenes"][0]["nodes"] = json!([0, 1]);
    g
}

#[test]
fn light_stands_and_shines_where_its_node_does() {
    let spot = json!({"type": "spot", "intensity": 30, "color": [1, 0.5, 0.25], "range": 5,
        "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.4}});
    let g = lit(spot);
    let scene = g.read().unwrap();
    let [light] = &scene.lights[..] else { panic!("{:?}", scene.lights) };
    assert_eq!(light.kind, LightKind::Spot { inner: 0.2, outer: 0.4 });
    assert_eq!((light.node, light.name.as_deref()), (2, Some("lamp")));
    assert_eq!((light.color, light.intensity, light.range), ([1.0, 0.5, 0.25], 30.0, Some(5.0)));
    // The rotation takes +z to -y, so 4 units below the node.
    assert!(light.position.distance(Vec3::new(1.0, -2.0, 3.0)) < 1e-5, "{}", light.position);
    assert!(light.direction.distance(Vec3::Y) < 1e-6, "{}", light.direction);
    assert!(!light.moves);
}

#[test]
fn light_defaults_are_those_of_the_extension() {
    let light = &lit(json!({"type": "spot"})).read().unwrap().lights[0];
    assert_eq!(light.kind, LightKind::Spot { inner: 0.0, outer: std::f32::consts::FRAC_PI_4 });
    assert_eq!((light.color, light.intensity, light.range), ([1.0; 3], 1.0, None));
    let light = &lit(json!({"type": "directional", "range": 0})).read().unwrap().lights[0];
    assert_eq!((light.kind, light.range), (LightKind::Directional, None));
    // Equal angles are a sharp edge, which still needs a difference.
    let equal = json!({"type": "spot", "spot": {"innerConeAngle": 1.5707964, "outerConeAngle": 1.5707964}});
    let LightKind::Spot { inner, outer } = lit(equal).read().unwrap().lights[0].kind else { panic!() };
    assert!(inner < outer && outer <= std::f32::consts::FRAC_PI_2);
}

#[test]
fn light_of_undrawn_nodes_is_left_out() {
    let mut g = lit(json!({"type": "point"}));
    g.json["scenes"][0]["nodes"] = json!([0]);
    assert!(g.read().unwrap().lights.is_empty());
    g.json["scenes"][0]["nodes"] = json!([0, 1]);
    g.json["nodes"][1]["extensions"]["KHR_node_visibility"]["visible"] = false.into();
    assert!(g.read().unwrap().lights.is_empty());
}

#[test]
fn light_without_sense_is_an_error_where_light_is_asked_for() {
    for light in [
        json!({"type": "area"}),
        json!({}),
        json!({"type": "point", "intensity": -1}),
        json!({"type": "point", "intensity": "bright"}),
        json!({"type": "point", "intensity": 1e300}),
        json!({"type": "point", "color": [1, 1]}),
        json!({"type": "point", "color": [1, -1, 1]}),
        json!({"type": "point", "range": -1}),
        json!({"type": "spot", "spot": {"outerConeAngle": 2}}),
        json!({"type": "spot", "spot": {"outerConeAngle": 0}}),
        json!({"type": "spot", "spot": {"innerConeAngle": 0.5, "outerConeAngle": 0.25}}),
        json!(null),
    ] {
        let g = lit(light.clone());
        let error = Scene::read_bytes(&g.glb(), &surfaces()).expect_err(&light.to_string());
        assert_eq!(error.place().node_name.as_deref(), Some("lamp"), "{error}");
        let scene = g.read().unwrap();
        assert!(scene.lights.is_empty() && scene.warnings.len() == 1, "{light} {:?}", scene.warnings);
    }
    let mut g = lit(json!({"type": "spot"}));
    g.json["nodes"][2]["scale"] = json!([0, 0, 0]);
    assert!(Scene::read_bytes(&g.glb(), &surfaces()).is_err());
    g.json["nodes"][2]["extensions"]["KHR_lights_punctual"]["light"] = 3.into();
    assert!(matches!(Scene::read_bytes(&g.glb(), &surfaces()), Err(SceneError::Reference { .. })));
}

#[test]
fn light_from_images_is_warned_of() {
    let mut g = Gltf::quad();
    g.json["scenes"][0]["extensions"] = json!({"EXT_lights_image_based": {"light": 0}});
    assert!(g.read().unwrap().warnings.is_empty());
    let scene = Scene::read_bytes(&g.glb(), &surfaces()).unwrap();
    assert!(scene.warnings[0].message.contains("EXT_lights_image_based"));
}

#[test]
fn light_of_the_lamp_is_read() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../../shared/scenes/lights_punctual_lamp.glb");
    if !path.exists() {
        println!("no lamp: skipped");
        return;
    }
    let scene = Scene::read(&path, &surfaces()).unwrap();
    assert_eq!(scene.lights.len(), 5);
    assert!(scene.lights.iter().all(|l| l.kind == LightKind::Point));
    assert_eq!(scene.lights[0].name.as_deref(), Some("Point_Orientation"));
    assert!((scene.lights[0].intensity - 15.0).abs() < 1e-6);
    for light in &scene.lights {
        println!("{light:?}");
    }
}

#[test]
fn moving_parts_follow_nodes_and_skins() {
    let mut g = rich();
    // The animation moves node 1, which stands below node 0; node 0 has a skin, and node 4 stands still.
    let moving = |g: &Gltf| {
        let scene = g.read().unwrap();
        let moving = scene.moving_parts();
        scene.parts.iter().zip(moving).map(|(p, m)| (p.node, m)).collect::<Vec<_>>()
    };
    assert_eq!(moving(&g), [(0, false), (1, true), (4, false), (4, false)]);
    let set = |g: &mut Gltf, target: Value| g.json["animations"][0]["channels"][0]["target"] = target;
    // A skin moves with its joints and not with its node; what hangs below the node does.
    set(&mut g, json!({"node": 0, "path": "rotation"}));
    assert_eq!(moving(&g), [(0, false), (1, true), (4, false), (4, false)]);
    set(&mut g, json!({"node": 2, "path": "rotation"}));
    assert_eq!(moving(&g), [(0, true), (1, false), (4, false), (4, false)]);
    let pointer =
        |p: &str| json!({"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": p}}});
    set(&mut g, pointer("/nodes/4/scale"));
    assert_eq!(moving(&g), [(0, false), (1, false), (4, true), (4, true)]);
    set(&mut g, json!({"node": 4, "path": "weights"}));
    assert!(moving(&g).iter().all(|(_, m)| !m));
    for nothing in ["/materials/0/alphaCutoff", "/nodes/99/scale", "/nodes/x/scale", "", "/nodes/4"] {
        set(&mut g, pointer(nothing));
        assert!(moving(&g).iter().all(|(_, m)| !m), "{nothing}");
    }
}

#[test]
fn moving_parts_are_not_those_whose_channels_repeat_the_rest_pose() {
    let turn = [0.0, 0.6, 0.0, 0.8_f32];
    let back = turn.map(|v| -v);
    let near = [0.0, 0.6004, 0.0, 0.7997];
    let at = [1.0, 20.0, -3.0_f32];
    let moves = |path: &str, interpolation: &str, keys: &[&[f32]]| {
        let mut g = rich();
        g.json["nodes"][1] = json!({"mesh": 0, "translation": at, "rotation": turn});
        let kind = if path == "rotation" { "VEC4" } else { "VEC3" };
        let output = g.floats(kind, &keys.concat());
        let sampler = &mut g.json["animations"][0]["samplers"][0];
        (sampler["output"], sampler["interpolation"]) = (output.into(), interpolation.into());
        g.json["animations"][0]["channels"][0]["target"] = json!({"node": 1, "path": path});
        let scene = g.read().unwrap();
        assert!(scene.warnings.iter().all(|w| !w.message.contains("animated")), "{:?}", scene.warnings);
        scene.parts.iter().zip(scene.moving_parts()).any(|(p, moves)| p.node == 1 && moves)
    };
    let none = [0.0; 3];
    assert!(!moves("translation", "LINEAR", &[&at, &[1.0, 20.0001, -3.0]]));
    assert!(!moves("translation", "STEP", &[&at]));
    assert!(!moves("translation", "CUBICSPLINE", &[&none, &at, &none, &none, &at, &none]));
    assert!(!moves("rotation", "LINEAR", &[&turn, &back, &near]));
    assert!(!moves("scale", "LINEAR", &[&[1.0; 3]]));

    assert!(moves("translation", "LINEAR", &[&at, &[1.0, 20.01, -3.0]]));
    assert!(moves("translation", "LINEAR", &[&none]));
    assert!(moves("translation", "CUBICSPLINE", &[&none, &at, &[0.0, 1.0, 0.0], &none, &at, &none]));
    assert!(moves("rotation", "LINEAR", &[&turn, &[0.0, 0.0, 0.0, 1.0]]));
    assert!(moves("scale", "LINEAR", &[&[1.0; 3], &[1.0, 1.0, -1.0]]));
    assert!(moves("translation", "LINEAR", &[&[1.0, f32::NAN, 0.0]]));
}

#[test]
fn moving_parts_are_those_whose_channels_cannot_be_read() {
    for broken in [json!(null), json!(99), json!("first")] {
        let mut g = rich();
        g.json["animations"][0]["samplers"][0]["output"] = broken.clone();
        let scene = g.read().unwrap();
        let moving = scene.parts.iter().zip(scene.moving_parts()).filter(|(_, m)| *m);
        assert_eq!(moving.map(|(p, _)| p.node).collect::<Vec<_>>(), [1], "{broken}");
    }
}

#[test]
fn moving_light_says_so() {
    let mut g = lit(json!({"type": "point"}));
    g.push(
        "animations",
        json!({"channels": [{"sampler": 0, "target": {"node": 1, "path": "translation"}}], "samplers": []}),
    );
    let scene = g.read().unwrap();
    assert!(scene.lights[0].moves);
    assert!(scene.warnings.iter().any(|w| w.message.contains("animated lights")));
}

#[test]
fn variant_chooses_materials() {
    let mut g = Gltf::quad();
    let pbr = |red: f32| json!({"pbrMetallicRoughness": {"baseColorFactor": [red, 0, 0, 1]}});
    for red in [0.25, 0.5, 0.75] {
        g.push("materials", pbr(red));
    }
    g.json["extensions"] =
        json!({"KHR_materials_variants": {"variants": [{"name": "day"}, {"name": "night"}]}});
    let primitive = &mut g.json["meshes"][0]["primitives"][0];
    primitive["material"] = 0.into();
    primitive["extensions"]["KHR_materials_variants"]["mappings"] =
        json!([{"material": 2, "variants": [1]}, {"material": 1, "variants": [7]}]);
    let read = |g: &Gltf, variant: Option<&str>| {
        let variant = variant.map(str::to_owned);
        Scene::read_bytes(&g.glb(), &ReadOptions { variant, ..surfaces() })
    };
    let red = |variant| read(&g, variant).unwrap().triangle_albedo(0, 0, [0.0, 0.0])[0];
    assert_eq!([red(None), red(Some("day")), red(Some("night"))], [0.25, 0.25, 0.75]);
    assert_eq!(read(&g, None).unwrap().variants(), ["day", "night"]);
    let error = read(&g, Some("dusk")).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Request);
    assert_eq!(error.to_string(), "variant \"dusk\" was asked for, but the file has day, night");
    g.json["meshes"][0]["primitives"][0]["extensions"]["KHR_materials_variants"]["mappings"][0]["material"] =
        99.into();
    assert!(matches!(read(&g, Some("night")), Err(SceneError::Reference { .. })));
    g.json.as_object_mut().unwrap().remove("extensions");
    assert!(read(&g, Some("day")).unwrap_err().to_string().ends_with("the file has none"));
}

#[test]
fn select_goes_by_names_of_nodes_and_those_above() {
    let mut g = Gltf::quad();
    g.json["nodes"] = json!([
        {"name": "car", "children": [1, 2]},
        {"name": "wheel.001", "mesh": 0},
        {"name": "body", "mesh": 0, "children": [3]},
        {"mesh": 0},
        {"name": "ground", "mesh": 0},
        {"name": "empty"},
    ]);
    g.json["scenes"][0]["nodes"] = json!([0, 4, 5]);
    let scene = g.read().unwrap();
    let select = |include: &[&str], exclude: &[&str]| {
        let owned = |l: &[&str]| l.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>();
        scene.select(&owned(include), &owned(exclude))
    };
    assert_eq!(select(&[], &[]).unwrap(), [true; 4]);
    assert_eq!(select(&["car"], &[]).unwrap(), [true, true, true, false]);
    assert_eq!(select(&["car"], &["wheel.*"]).unwrap(), [false, true, true, false]);
    assert_eq!(select(&[], &["ground"]).unwrap(), [true, true, true, false]);
    // The third part's node has no name of its own: the mesh lends one.
    assert_eq!(select(&["quad", "wheel.00?"], &[]).unwrap(), [true, false, true, false]);
    for wrong in [["tyre"], ["empty"], ["Car"]] {
        let error = select(&wrong, &[]).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Request);
        assert!(error.to_string().contains(wrong[0]), "{error}");
        assert!(select(&[], &wrong).is_err());
    }
}

#[test]
fn roles_come_from_nodes_meshes_and_materials() {
    let mut g = Gltf::quad();
    let mut second = g.json["meshes"][0]["primitives"][0].clone();
    second["material"] = 0.into();
    g.primitive(second);
    g.push("materials", json!({}));
    g.json["nodes"] = json!([
        {"mesh": 0, "children": [1, 2]},
        {"mesh": 0},
        {"mesh": 0},
    ]);
    let roles = |casts, receives| Roles { casts, receives };
    let of = |g: &Gltf| {
        let scene = g.read().unwrap();
        (0..3).map(|p| scene.roles(p)).collect::<Vec<_>>()
    };
    assert_eq!(of(&g), [roles(true, true); 3]);
    g.json["nodes"][0]["extras"] = json!({"lightkiln": {"cast": false}});
    g.json["nodes"][2]["extras"] = json!({"lightkiln_cast": 1, "lightkiln_receive": 0, "other": "x"});
    assert_eq!(of(&g), [roles(false, true), roles(false, true), roles(true, false)]);
    g.json["meshes"][0]["extras"] = json!({"lightkiln": {"receive": false}});
    assert_eq!(of(&g), [roles(false, false), roles(false, false), roles(true, false)]);
    // One of two primitives: the part keeps the role, its triangles differ.
    g.json["meshes"][0].as_object_mut().unwrap().remove("extras");
    g.json["materials"][0]["extras"] = json!({"lightkiln": {"cast": false}});
    let scene = g.read().unwrap();
    assert_eq!(scene.roles(2), roles(true, false));
    assert_eq!((scene.triangle_roles(2, 0).casts, scene.triangle_roles(2, 2).casts), (true, false));
    g.json["materials"][0]["extras"] = json!({"lightkiln": {"casts": false}});
    assert!(g.read().unwrap().warnings.iter().any(|w| w.message.contains("casts")));
    for wrong in [json!("no"), json!(2), json!(null), json!([])] {
        g.json["materials"][0]["extras"] = json!({"lightkiln": {"cast": wrong}});
        assert!(matches!(g.read(), Err(SceneError::Value { .. })));
    }
}
