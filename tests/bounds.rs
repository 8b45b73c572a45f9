//! `lightkiln bake --bounds`, as a user runs it.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // helpers of tests are tests

mod harness;

use harness::{Folder, bake, data, draft, fail, glb_parts, succeed};
use serde_json::Value;

/// The extension's first layer.
fn layer(path: &std::path::Path) -> Value {
    let (json, _) = glb_parts(&std::fs::read(path).unwrap());
    json["extensions"]["LIGHTKILN_lightmap"]["layers"][0].clone()
}

#[test]
fn bounds_of_all_kinds_keep_the_bound_and_verify_agrees() {
    let folder = Folder::new("bounds");
    let out = folder.path("out.glb");
    for (scene, signal) in [("l_shape.glb", "ao"), ("column.glb", "ao"), ("column.glb", "bent-normal")] {
        for bounds in ["clamp", "clamp-after", "optimum"] {
            let report = bake(&data(scene), &out, &["--bounds", bounds, "--signal", signal]);
            let bound = &report["errors"]["bound"];
            assert_eq!(bound["samplesBeyond"], 0, "{scene}, {bounds}: {bound}");
            let beyond = bound["colorPointsBeyond"].as_f64().unwrap();
            assert!(beyond <= 0.01 * bound["colorPoints"].as_f64().unwrap(), "{scene}, {bounds}: {bound}");
            let verify = ["verify".as_ref(), out.as_os_str(), "--points".as_ref(), "4000".as_ref()];
            let text = succeed(verify.into_iter().chain(["--json".as_ref()]));
            let errors: Value = serde_json::from_str(&text).unwrap();
            let [ours, theirs] = [&report["errors"], &errors].map(|e| e["hybrid"]["rmse"].as_f64().unwrap());
            assert!((ours - theirs).abs() < 0.2 * ours + 1e-3, "{scene}, {bounds}: {ours} and {theirs}");
        }
    }
}

#[test]
fn bounds_clamp_after_says_so_in_the_file_and_others_do_not() {
    let folder = Folder::new("clamp");
    let [free, clamped] = ["clamp-after", "clamp"].map(|bounds| {
        let out = folder.path(&format!("{bounds}.glb"));
        bake(&data("column.glb"), &out, &["--bounds", bounds]);
        layer(&out)
    });
    assert_eq!(free["clamp"], serde_json::json!([0.0, 1.0]));
    let [low, high] = [0, 1].map(|end| free["range"][end].as_f64().unwrap());
    assert!(low < 0.0 && high > 1.0, "{low} {high}");
    assert_eq!((&clamped["clamp"], &clamped["range"]), (&Value::Null, &serde_json::json!([0.0, 1.0])));
    let said = fail(1, draft(&data("column.glb"), &folder.path("no.glb"), &["--bounds", "none"]));
    assert!(said.contains("clamp-after"), "{said}");
}

#[test]
fn bounds_do_not_touch_light() {
    let folder = Folder::new("light");
    let files = ["clamp", "clamp-after", "optimum"].map(|bounds| {
        let out = folder.path(&format!("{bounds}.glb"));
        bake(&data("l_shape.glb"), &out, &["--bounds", bounds, "--signal", "irradiance", "--sky", "1000"]);
        std::fs::read(out).unwrap()
    });
    assert!(files[0] == files[1] && files[0] == files[2]);
}

#[test]
fn bounds_clamp_after_with_one_and_two_threads_writes_the_same_bytes() {
    let folder = Folder::new("bound_threads");
    let files = ["1", "2"].map(|threads| {
        let out = folder.path(&format!("{threads}.glb"));
        bake(&data("column.glb"), &out, &["--threads", threads, "--bounds", "clamp-after"]);
        std::fs::read(out).unwrap()
    });
    assert!(files[0] == files[1], "{} and {} bytes differ", files[0].len(), files[1].len());
}

#[test]
fn bounds_stand_in_configuration_files() {
    let folder = Folder::new("bound_config");
    let out = folder.path("out.glb");
    let config = folder.write("bake.toml", "bounds = \"clamp-after\"\n");
    bake(&data("l_shape.glb"), &out, &["--config", config.to_str().unwrap()]);
    assert_eq!(layer(&out)["clamp"], serde_json::json!([0.0, 1.0]));
}
