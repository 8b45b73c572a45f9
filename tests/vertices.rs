//! The commands `compare` and `fit` from outside.

mod harness;

use harness::{Folder, data, fail, shared_scene, succeed};
use serde_json::Value;

#[test]
fn compare_prints_table_1_and_names_the_noise() {
    let scene = data("half_box.glb");
    let scene = scene.to_str().expect("UTF-8");
    let arguments = ["compare", scene, "--samples", "3000", "--rays", "64", "--ao-distance", "inf", "-q"];
    let json: Value = serde_json::from_str(&succeed(arguments.iter().chain(&["--json"]))).expect("JSON");
    let number = |key: &str| json[key].as_f64().expect("a number");
    assert!(number("error_least_squares") < number("error_point"), "{json}");
    assert!(number("noise") > 0.0 && number("noise") < number("error_least_squares"), "{json}");
    assert_eq!(json["rows"].as_array().map(Vec::len), Some(6));
    let text = succeed(arguments);
    assert!(text.contains("12 vertices, 6 triangles") && text.contains("noise of the samples"), "{text}");
}

#[test]
fn fit_sweeps_alpha_and_draws_each() {
    let folder = Folder::new("fit-sweep");
    let scene = data("half_box.glb");
    let (scene, pictures) = (scene.to_str().expect("UTF-8"), folder.path("pictures"));
    let arguments = [
        "fit",
        scene,
        "--samples=2000",
        "--rays=16",
        "--size=16",
        "--sweep=alpha=0,1",
        "--method=average,ours",
        "--json",
        "-q",
        "-o",
        pictures.to_str().expect("UTF-8"),
    ];
    let rows: Value = serde_json::from_str(&succeed(arguments)).expect("JSON");
    let jump = |row: usize| rows[row]["gradient_jump"].as_f64().expect("a number");
    assert_eq!(rows.as_array().map(Vec::len), Some(3));
    assert!(jump(2) < jump(1), "{rows}");
    let mut names: Vec<_> = std::fs::read_dir(&pictures)
        .expect("a folder")
        .map(|entry| entry.expect("readable").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert_eq!(names, ["average.png", "ours-0.png", "ours-edge-1.png", "truth.png"]);
}

#[test]
fn fit_says_how_far_values_were_outside() {
    let scene = data("l_shape.glb");
    let scene = scene.to_str().expect("UTF-8");
    let with = |bounds: &str, json: bool| {
        let mut arguments = vec![
            "fit",
            scene,
            "--signal=shadow:-0.5,2.2,-0.8,0.08",
            "--samples=5000",
            "--rays=16",
            "--sweep=alpha=0",
        ];
        arguments.extend(["-q", "--bounds", bounds]);
        arguments.extend(json.then_some("--json"));
        succeed(arguments)
    };
    let outside = ["none", "clamp", "clamp-after", "optimum"].map(|bounds| {
        let rows: Value = serde_json::from_str(&with(bounds, true)).expect("JSON");
        rows[0]["outside"].clone()
    });
    assert!(outside[0]["count"].as_u64() > Some(0), "{outside:?}");
    assert!(outside[0]["mean"].as_f64() < outside[0]["largest"].as_f64(), "{outside:?}");
    assert!(outside.iter().all(|o| o["count"] == outside[0]["count"]), "{outside:?}");
    assert!(with("clamp", false).contains("then they were clamped"));
    assert!(fail(1, ["fit", scene, "--bounds", "tight", "-q"]).contains("clamp-after"));
}

#[test]
fn compare_takes_light_that_the_file_carries() {
    let Some(scene) = shared_scene("sheen_chair.glb") else { return };
    let scene = scene.to_str().expect("UTF-8");
    let arguments = ["compare", scene, "--signal", "occlusion", "--samples", "60000", "--json", "-q"];
    let json: Value = serde_json::from_str(&succeed(arguments)).expect("JSON");
    assert_eq!((json["noise"].as_f64(), json["rays_per_sample"].as_u64()), (Some(0.0), Some(0)));
    assert!(json["error_least_squares"].as_f64() < json["error_point"].as_f64(), "{json}");
}

#[test]
fn signals_that_are_not_there_are_named() {
    let scene = data("half_box.glb");
    let scene = scene.to_str().expect("UTF-8");
    assert!(fail(3, ["compare", scene, "--signal", "occlusion", "-q"]).contains("no occlusion texture"));
    assert!(fail(2, ["fit", scene, "--signal", "texture:missing.png", "-q"]).contains("missing.png"));
    assert!(fail(1, ["fit", scene, "--signal", "sunshine", "-q"]).contains("sunshine"));
    assert!(fail(1, ["fit", scene, "--sweep", "beta=1", "-q"]).contains("alpha"));
    assert!(fail(1, ["compare", scene, "--alpha=-1", "-q"]).contains("--alpha"));
}
