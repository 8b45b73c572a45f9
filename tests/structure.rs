//! The structure that ARCHITECTURE.md promises, read from the workspace itself.

mod harness;

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

/// Our crates, in the order of the pipeline, with those of ours that they depend on.
fn members() -> Vec<(String, BTreeSet<String>)> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(harness::root())
        .output()
        .expect("cargo runs");
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).expect("metadata is JSON");
    let mut depends = BTreeMap::new();
    for package in metadata["packages"].as_array().expect("packages") {
        let own = package["dependencies"].as_array().expect("dependencies").iter();
        let names: BTreeSet<String> = own
            .filter(|d| d["kind"].is_null())
            .filter_map(|d| d["name"].as_str()?.strip_prefix("lightkiln-").map(str::to_owned))
            .collect();
        let name = package["name"].as_str().expect("a name").trim_start_matches("lightkiln-").to_owned();
        depends.insert(name, names);
    }
    let manifest = std::fs::read_to_string(harness::root().join("Cargo.toml")).expect("the manifest");
    manifest
        .lines()
        .filter_map(|line| line.trim().strip_prefix("\"crates/")?.strip_suffix("\",").map(str::to_owned))
        .map(|name| (name.clone(), depends.remove(&name).unwrap_or_else(|| panic!("{name} is no package"))))
        .collect()
}

#[test]
fn crates_depend_on_earlier_stages_only() {
    let mut earlier = BTreeSet::new();
    for (name, depends) in members() {
        let late: Vec<_> = depends.difference(&earlier).collect();
        assert!(late.is_empty(), "{name} depends on {late:?}, which come later in the pipeline");
        earlier.insert(name);
    }
}

#[test]
fn stages_do_not_know_the_file_format() {
    for (name, depends) in members() {
        let allowed = ["scene", "bake", "cli", "render"].contains(&name.as_str());
        assert!(allowed || !depends.contains("scene"), "{name} knows glTF");
    }
}

#[test]
fn crates_have_no_names_without_meaning() {
    for (name, _) in members() {
        assert!(!["utils", "util", "common", "core", "misc", "helpers"].contains(&name.as_str()), "{name}");
    }
}
