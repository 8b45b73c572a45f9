//! `lightkiln bake` on our own scenes, as a user runs it.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // helpers of tests are tests

mod harness;

use harness::{Folder, bake, data, draft, fail, shared_scene, succeed};
use serde_json::Value;

#[test]
fn bake_small_scenes_keep_the_bound() {
    let folder = Folder::new("bound");
    for name in ["half_box", "cornell_box", "l_shape", "column", "contact", "instances", "fence", "thin_wall"]
    {
        let report = bake(&data(&format!("{name}.glb")), &folder.path("out.glb"), &[]);
        let bound = &report["errors"]["bound"];
        assert_eq!(bound["samplesBeyond"], 0, "{name}: {bound}");
        let beyond = bound["colorPointsBeyond"].as_f64().unwrap();
        let points = bound["colorPoints"].as_f64().unwrap();
        assert!(beyond <= 0.01 * points, "{name}: {beyond} of {points}");
    }
}

#[test]
fn bake_with_one_and_two_threads_writes_the_same_bytes() {
    let folder = Folder::new("threads");
    let scene = data("column.glb");
    let mut files = Vec::new();
    for threads in ["1", "2"] {
        let out = folder.path(&format!("{threads}.glb"));
        bake(&scene, &out, &["--threads", threads]);
        files.push(std::fs::read(out).unwrap());
    }
    assert!(files[0] == files[1], "{} and {} bytes differ", files[0].len(), files[1].len());
}

#[test]
fn bake_in_millimetres_is_the_bake_in_metres() {
    let folder = Folder::new("units");
    let share = |name: &str| {
        let report = bake(&data(name), &folder.path("out.glb"), &[]);
        report["classes"]["texture"]["areaShare"].as_f64().unwrap()
    };
    let (metres, millimetres) = (share("contact.glb"), share("millimetres.glb"));
    assert!((metres - millimetres).abs() < 0.02, "{metres} in metres, {millimetres} in millimetres");
}

#[test]
fn bake_writes_report_and_depfile() {
    let folder = Folder::new("depfile");
    let (out, report, rule) = (folder.path("a b.glb"), folder.path("r.json"), folder.path("d"));
    let [to_report, to_rule] = [&report, &rule].map(|p| p.to_str().unwrap());
    succeed(draft(&data("half_box.glb"), &out, &["--report", to_report, "--depfile", to_rule]));
    assert_eq!(folder.names(), ["a b.glb", "d", "r.json"]);
    let rule = std::fs::read_to_string(rule).unwrap();
    let (outputs, inputs) = rule.split_once(": ").unwrap();
    assert!(outputs.contains("a\\ b.glb") && outputs.contains("r.json"), "{rule}");
    assert!(inputs.contains("half_box.glb"), "{rule}");
    let report: Value = serde_json::from_slice(&std::fs::read(report).unwrap()).unwrap();
    assert_eq!(report["version"], 1);
}

#[test]
fn bake_again_replaces_the_light() {
    let folder = Folder::new("again");
    let (once, twice) = (folder.path("once.glb"), folder.path("twice.glb"));
    bake(&data("column.glb"), &once, &[]);
    let report = bake(&once, &twice, &[]);
    assert_eq!(report["errors"]["bound"]["samplesBeyond"], 0);
    let sizes = [once, twice].map(|p| std::fs::metadata(p).unwrap().len());
    assert!(sizes[1] < sizes[0] * 12 / 10, "light piles up: {sizes:?} bytes");
}

#[test]
fn bake_over_budget_has_its_own_exit_code() {
    let folder = Folder::new("budget");
    let said = fail(7, draft(&data("contact.glb"), &folder.path("out.glb"), &["--max-bytes", "100B"]));
    assert!(said.contains("more than allowed") && said.contains("largest:"), "{said}");
}

#[test]
fn verify_of_a_bake_confirms_the_bound() {
    let folder = Folder::new("verify");
    let out = folder.path("out.glb");
    bake(&data("column.glb"), &out, &[]);
    let text = succeed([
        "verify".as_ref(),
        out.as_os_str(),
        "--points".as_ref(),
        "4000".as_ref(),
        "--json".as_ref(),
    ]);
    let errors: Value = serde_json::from_str(&text).unwrap();
    assert!(errors["hybrid"]["rmse"].as_f64().unwrap() < 0.03, "{errors}");
}

#[test]
fn inspect_before_and_after_names_the_bytes() {
    let folder = Folder::new("inspect");
    let out = folder.path("out.glb");
    let report = bake(&data("column.glb"), &out, &[]);
    let inspection: Value =
        serde_json::from_str(&succeed(["inspect".as_ref(), out.as_os_str(), "--json".as_ref()])).unwrap();
    assert_eq!(inspection["light"]["attribute"], report["bytes"]["light"]["attribute"]);
    assert_eq!(inspection["light"]["atlas"], report["bytes"]["light"]["atlas"]);
    let before = succeed(["inspect".as_ref(), data("column.glb").as_os_str()]);
    assert!(before.contains("no light"), "{before}");
}

#[test]
fn bake_real_scenes_in_draft() {
    let folder = Folder::new("real");
    for name in
        ["cornell_box_original.glb", "duck.glb", "duck.draco.glb", "glass_vase_flowers.glb", "suzanne.glb"]
    {
        let Some(scene) = shared_scene(name) else { continue };
        let report = bake(&scene, &folder.path("out.glb"), &[]);
        assert_eq!(report["errors"]["bound"]["samplesBeyond"], 0, "{name}");
    }
}
