//! Bad files and bad arguments: one clear message, the right exit code, nothing left behind.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // helpers of tests are tests

mod harness;

use std::path::Path;

use harness::{Folder, data, draft, fail, glb, glb_parts, lightkiln, shared_scene};
use serde_json::{Value, json};

/// Bakes a file that is expected to fail, checks that nothing was written, and gives back the message.
fn refuse(folder: &Folder, code: i32, input: &Path) -> String {
    let before = folder.names();
    let said = fail(code, draft(input, &folder.path("out.glb"), &[]));
    assert_eq!(folder.names(), before, "something was left behind");
    assert!(said.contains("help: "), "no remedy: {said}");
    said
}

fn refuse_json(name: &str, code: i32, json: &str) -> String {
    let folder = Folder::new(name);
    refuse(&folder, code, &folder.write("in.gltf", json))
}

/// A file of one of ours with something wrong in its JSON or its bytes.
fn refuse_altered(name: &str, code: i32, scene: &Path, alter: impl Fn(&mut Value, &mut Vec<u8>)) -> String {
    let folder = Folder::new(name);
    let (mut json, mut binary) = glb_parts(&std::fs::read(scene).unwrap());
    alter(&mut json, &mut binary);
    refuse(&folder, code, &folder.write("in.glb", glb(&json, &binary)))
}

/// A triangle as data URI: 36 bytes of positions.
const TRIANGLE: &str =
    "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";

fn triangle(accessor: &str, rest: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},
        "buffers":[{{"uri":"{TRIANGLE}","byteLength":36}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}}],
        "accessors":[{accessor}],{rest}}}"#
    )
}

const POSITIONS: &str = r#"{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}"#;
const ONE_NODE: &str = r#""meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
    "nodes":[{"mesh":0,"name":"column_07"}],"scenes":[{"nodes":[0]}]"#;

#[test]
fn missing_file_is_named() {
    let folder = Folder::new("missing");
    let said = refuse(&folder, 2, &folder.path("nowhere.glb"));
    assert!(said.contains("nowhere.glb"), "{said}");
}

#[test]
fn truncated_glb_is_refused() {
    let folder = Folder::new("truncated");
    let whole = std::fs::read(data("contact.glb")).unwrap();
    for length in [0, 3, 11, 19, 100, whole.len() / 2, whole.len() - 1] {
        refuse(&folder, 3, &folder.write("cut.glb", &whole[..length]));
    }
}

#[test]
fn garbage_is_refused() {
    refuse_json("garbage", 3, "not a scene");
    refuse_json("empty-object", 3, "{}");
}

#[test]
fn nan_position_is_named() {
    // The second vertex's x is NaN.
    let uri = "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAADAfwAAAAAAAAAAAAAAAAAAgD8AAAAA";
    let json = triangle(POSITIONS, ONE_NODE).replace(TRIANGLE, uri);
    let said = refuse_json("nan", 3, &json);
    assert!(said.contains("column_07") && said.to_lowercase().contains("finite"), "{said}");
    let said = refuse_altered("nan-glb", 3, &data("contact.glb"), |json, binary| {
        let accessor = &json["accessors"]
            [json["meshes"][0]["primitives"][0]["attributes"]["POSITION"].as_u64().unwrap() as usize];
        let view = &json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let start = (view["byteOffset"].as_u64().unwrap_or(0) + accessor["byteOffset"].as_u64().unwrap_or(0))
            as usize;
        binary[start + 16..start + 20].copy_from_slice(&f32::NAN.to_le_bytes());
    });
    assert!(said.contains("element 1 is not finite") && said.contains("POSITION"), "{said}");
}

#[test]
fn index_out_of_range_is_named() {
    // The bytes of the positions read as indices: 0, then 1.0.
    let accessors = format!(
        r#"{POSITIONS},{{"bufferView":0,"byteOffset":12,"componentType":5125,"count":3,"type":"SCALAR"}}"#
    );
    let node = ONE_NODE.replace(r#""POSITION":0}"#, r#""POSITION":0},"indices":1"#);
    let said = refuse_json("index", 3, &triangle(&accessors, &node));
    assert!(said.contains("names vertex 1065353216") && said.contains("only 3"), "{said}");
}

#[test]
fn absurd_count_is_refused_before_it_is_allocated() {
    let absurd = POSITIONS.replace(r#""count":3"#, r#""count":3000000000"#);
    let said = refuse_json("absurd", 3, &triangle(&absurd, ONE_NODE));
    assert!(said.contains("needs 36000000000 bytes, but there are 36"), "{said}");
    for count in ["-3", "1e400", "3.5", "18446744073709551615", "\"3\""] {
        refuse_json("count", 3, &triangle(&POSITIONS.replace(":3,", &format!(":{count},")), ONE_NODE));
    }
}

#[test]
fn node_with_two_parents_is_refused() {
    let said = refuse_altered("parents", 3, &data("contact.glb"), |json, _| {
        let nodes = json["nodes"].as_array_mut().unwrap();
        nodes.push(json!({"children": [0]}));
        nodes.push(json!({"children": [0]}));
        let count = nodes.len();
        json["scenes"][0]["nodes"] = json!([count - 2, count - 1]);
    });
    assert!(said.contains("two parents") && said.contains("nodes["), "{said}");
}

/// The view that holds the compressed data of the file's first compressed primitive or view.
fn shorten_compressed(json: &mut Value) {
    let draco = |json: &Value| {
        json["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]["bufferView"].as_u64()
    };
    let of_view = |view: &Value| view["extensions"]["EXT_meshopt_compression"].is_object();
    match draco(json) {
        Some(view) => {
            let length = &mut json["bufferViews"][view as usize]["byteLength"];
            *length = (length.as_u64().unwrap() / 2).into();
        }
        None => {
            let views = json["bufferViews"].as_array_mut().unwrap().iter_mut();
            for view in views.filter(|v| of_view(v)) {
                let length = &mut view["extensions"]["EXT_meshopt_compression"]["byteLength"];
                *length = (length.as_u64().unwrap() / 2).into();
            }
        }
    }
}

#[test]
fn truncated_compressed_data_is_refused() {
    for (file, codec) in [("duck.draco.glb", "Draco"), ("turbocharger.meshopt_quantized.glb", "meshopt")] {
        let Some(scene) = shared_scene(file) else { continue };
        let said = refuse_altered("shorter", 3, &scene, |json, _| shorten_compressed(json));
        assert!(said.to_lowercase().contains(&codec.to_lowercase()), "{file}: {said}");
        // Cut off in the middle of the file, the container itself tells.
        let folder = Folder::new("cut");
        let whole = std::fs::read(&scene).unwrap();
        refuse(&folder, 3, &folder.write("in.glb", &whole[..whole.len() * 2 / 3]));
    }
}

#[test]
fn cyclic_nodes_are_refused() {
    let nodes = r#""meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
        "nodes":[{"mesh":0,"children":[1]},{"children":[0]}],"scenes":[{"nodes":[0]}]"#;
    refuse_json("cycle", 3, &triangle(POSITIONS, nodes));
}

#[test]
fn missing_buffer_is_named() {
    let said = refuse_json("buffer", 2, &triangle(POSITIONS, ONE_NODE).replace(TRIANGLE, "gone.bin"));
    assert!(said.contains("gone.bin"), "{said}");
}

#[test]
fn path_that_leaves_the_folder_is_refused() {
    for uri in ["../secret.bin", "/etc/hostname", "a/../../b.bin", "http://example.org/x.bin"] {
        let json = triangle(POSITIONS, ONE_NODE).replace(TRIANGLE, uri);
        let folder = Folder::new("escape");
        let said = refuse(&folder, 3, &folder.write("in.gltf", json));
        assert!(said.contains(uri), "{said}");
    }
}

#[test]
fn unknown_required_extension_is_named() {
    let json =
        triangle(POSITIONS, ONE_NODE).replacen('{', r#"{"extensionsRequired":["ACME_secret_geometry"],"#, 1);
    let said = refuse_json("required", 5, &json);
    assert!(said.contains("ACME_secret_geometry"), "{said}");
}

#[test]
fn scene_without_triangles_is_refused() {
    let said = refuse_json("nothing", 3, r#"{"asset":{"version":"2.0"},"scenes":[{"nodes":[]}]}"#);
    assert!(said.contains("no triangles"), "{said}");
}

#[test]
fn output_that_cannot_be_written_is_refused_before_the_work() {
    let folder = Folder::new("no-folder");
    for (name, code) in [("missing/out.glb", 2), ("out.obj", 1), ("out", 1), ("", 1)] {
        let said = fail(code, draft(&data("half_box.glb"), &folder.path(name), &[]));
        assert!(said.contains("help: "), "{name}: {said}");
        assert_eq!(folder.names(), [""; 0], "{name}");
    }
}

#[test]
fn damaged_atlas_is_named() {
    let folder = Folder::new("atlas");
    let out = folder.path("out.glb");
    harness::bake(&data("contact.glb"), &out, &[]);
    let (json, mut binary) = glb_parts(&std::fs::read(&out).unwrap());
    let image = json["images"].as_array().unwrap().last().unwrap();
    let view = &json["bufferViews"][image["bufferView"].as_u64().unwrap() as usize];
    let start = view["byteOffset"].as_u64().unwrap() as usize;
    binary[start + 8..start + 40].fill(0);
    let damaged = folder.write("damaged.glb", glb(&json, &binary));
    let said = fail(3, ["verify".as_ref(), damaged.as_os_str(), "--quiet".as_ref()]);
    assert!(said.contains("damaged.glb") && said.contains("help: "), "{said}");
}

#[test]
fn wrong_arguments_exit_with_one() {
    let (input, folder) = (data("half_box.glb"), Folder::new("arguments"));
    let out = folder.path("out.glb");
    for extra in [
        ["--max-error", "0"],
        ["--max-error", "nan"],
        ["--detail", "-1"],
        ["--samples", "0"],
        ["--threads", "0"],
        ["--quality", "best"],
        ["--ao-distance", "0"],
        ["--config", "/dev/null/x"],
    ] {
        let output = lightkiln([
            "bake".as_ref(),
            input.as_os_str(),
            "-o".as_ref(),
            out.as_os_str(),
            extra[0].as_ref(),
            extra[1].as_ref(),
        ]);
        let code = output.status.code();
        assert!(code == Some(1) || (extra[0] == "--config" && code == Some(2)), "{extra:?}: {code:?}");
        assert!(!out.exists(), "{extra:?}");
    }
}

#[test]
fn verify_of_an_unbaked_file_says_so() {
    let input = data("half_box.glb");
    let said = fail(3, ["verify".as_ref(), input.as_os_str(), "--quiet".as_ref()]);
    assert!(said.contains("LIGHTKILN_lightmap"), "{said}");
}
