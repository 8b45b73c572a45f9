//! Files in and out of the program: names, folders, external buffers, make, and runs that end early.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // helpers of tests are tests

mod harness;

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use harness::room::room;
use harness::{Folder, bake, command, data, draft, fail, glb, lightkiln, shared_scene, succeed};
use serde_json::{Value, json};

fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn write_room(folder: &Folder) -> std::path::PathBuf {
    let (json, binary) = room("geometry.bin");
    folder.write("geometry.bin", binary);
    folder.write("room.gltf", serde_json::to_vec(&json).unwrap())
}

/// The bytes of an accessor of a `.gltf`, whose buffers are files.
fn accessor_bytes(root: &Value, number: usize, folder: &Folder) -> Vec<u8> {
    let accessor = &root["accessors"][number];
    let view = &root["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let uri = root["buffers"][view["buffer"].as_u64().unwrap() as usize]["uri"].as_str().unwrap();
    let buffer = std::fs::read(folder.path(uri)).unwrap();
    let offset = |v: &Value| v["byteOffset"].as_u64().unwrap_or(0) as usize;
    let width = if accessor["type"] == "VEC4" { 16 } else { 4 };
    let start = offset(view) + offset(accessor);
    buffer[start..start + width * accessor["count"].as_u64().unwrap() as usize].to_vec()
}

#[test]
fn bake_leaves_alone_what_is_not_light() {
    let folder = Folder::new("kept");
    let (input, out) = (write_room(&folder), folder.path("out.gltf"));
    bake(&input, &out, &["--ao-distance", "1"]);
    let (mut before, mut after) = (read_json(&input), read_json(&out));
    let sampler = &after["animations"][0]["samplers"][0];
    for (key, number) in [("input", 4), ("output", 5)] {
        let now = sampler[key].as_u64().unwrap() as usize;
        assert_eq!(accessor_bytes(&before, number, &folder), accessor_bytes(&after, now, &folder), "{key}");
    }
    assert_eq!(after["extensionsUsed"], json!(["ACME_notes", "KHR_materials_ior", "LIGHTKILN_lightmap"]));
    assert!(after["extensions"].as_object_mut().unwrap().shift_remove("LIGHTKILN_lightmap").is_some());
    let lit = &mut after["meshes"][0]["primitives"][0];
    assert!(lit["attributes"]["_LIGHTUV"].is_u64() && lit["attributes"]["COLOR_0"].is_u64(), "{lit}");
    assert_eq!(
        lit.as_object_mut().unwrap().shift_remove("extensions").unwrap().as_object().unwrap().len(),
        1
    );
    // Geometry may move where vertices were split, and numbers of accessors with it; the atlas is new.
    for root in [&mut before, &mut after] {
        for key in ["accessors", "bufferViews", "buffers", "extensionsUsed", "textures", "images", "samplers"]
        {
            root.as_object_mut().unwrap().shift_remove(key);
        }
        let lit = root["meshes"][0]["primitives"][0].as_object_mut().unwrap();
        lit.shift_remove("attributes");
        lit.shift_remove("indices");
    }
    // As text: the order of keys and the digits of numbers stay, too.
    assert_eq!(before.to_string(), after.to_string());
}

#[test]
fn bake_from_external_buffers_into_another_folder_is_complete() {
    let (here, there) = (Folder::new("here"), Folder::new("there"));
    let input = write_room(&here);
    let out = there.path("baked.gltf");
    bake(&input, &out, &["--ao-distance", "1"]);
    assert_eq!(here.names(), ["geometry.bin", "room.gltf"]);
    std::fs::remove_file(here.path("geometry.bin")).unwrap();
    let root = read_json(&out);
    assert_eq!(root["buffers"][0]["uri"], "baked.bin");
    assert!(root["images"].as_array().is_some_and(|images| !images.is_empty()), "a corner needs texels");
    for image in root["images"].as_array().unwrap() {
        assert!(there.names().contains(&image["uri"].as_str().unwrap().to_owned()), "{image}");
    }
    // The atlas lies in a file of its own and is found again.
    succeed(["verify".as_ref(), out.as_os_str(), "--points".as_ref(), "2000".as_ref()]);
    std::fs::remove_file(there.path("baked.lightkiln.0.png")).unwrap();
    let said = fail(2, ["verify".as_ref(), out.as_os_str(), "--quiet".as_ref()]);
    assert!(said.contains("baked.lightkiln.0.png"), "{said}");
}

#[test]
fn bake_beside_the_input_spares_its_buffer() {
    let folder = Folder::new("beside");
    let input = write_room(&folder);
    let before = std::fs::read(folder.path("geometry.bin")).unwrap();
    bake(&input, &folder.path("geometry.gltf"), &["--ao-distance", "1"]);
    assert!(std::fs::read(folder.path("geometry.bin")).unwrap() == before, "the input's buffer was replaced");
    bake(&input, &folder.path("again.glb"), &["--ao-distance", "1"]);
}

#[test]
fn bake_names_with_spaces_and_letters_of_all_kinds() {
    let folder = Folder::new("names");
    let (json, binary) = room("grüne%20Wiese%20%23%31.bin");
    folder.write("grüne Wiese #1.bin", binary);
    let input = folder.write("Szene Ø 場面.gltf", serde_json::to_vec(&json).unwrap());
    for name in ["gebacken Ø #2 場面.gltf", "gebacken % 場面.glb"] {
        let out = folder.path(name);
        let report = bake(&input, &out, &["--ao-distance", "1"]);
        assert_eq!(report["output"], name);
        succeed(["verify".as_ref(), out.as_os_str(), "--points".as_ref(), "2000".as_ref()]);
    }
}

#[test]
fn bake_one_of_two_scenes() {
    let folder = Folder::new("scenes");
    let (input, out) = (write_room(&folder), folder.path("out.glb"));
    assert_eq!(bake(&input, &out, &["--scene", "1"])["scene"]["triangles"], 2);
    succeed([
        "verify".as_ref(),
        out.as_os_str(),
        "--scene".as_ref(),
        "1".as_ref(),
        "--points".as_ref(),
        "500".as_ref(),
    ]);
    assert_eq!(bake(&input, &out, &["--scene", "0", "--ao-distance", "1"])["scene"]["triangles"], 4);
    let said = fail(1, draft(&input, &out, &["--scene", "2"]));
    assert!(said.contains("scene 2") && said.contains("has 2"), "{said}");
}

#[test]
fn bake_mirrored_scene_is_lit_like_the_scene() {
    let folder = Folder::new("mirrored");
    let (mut json, binary) = room("geometry.bin");
    folder.write("geometry.bin", &binary);
    json["materials"][0]["doubleSided"] = false.into();
    let mut error = |name: &str, scale: [i32; 3]| {
        json["nodes"][0]["scale"] = json!(scale);
        let input = folder.write(name, serde_json::to_vec(&json).unwrap());
        let report = bake(&input, &folder.path("out.glb"), &["--ao-distance", "1"]);
        assert_eq!(report["rays"]["invalidSamples"], 0, "{name}: fronts became backs");
        report["errors"]["pointSampling"]["rmse"].as_f64().unwrap()
    };
    let (plain, mirrored) = (error("plain.gltf", [1, 1, 1]), error("mirrored.gltf", [-1, 1, 1]));
    assert!((plain - mirrored).abs() < 0.02, "{plain}, mirrored {mirrored}");
}

#[test]
fn bake_gpu_instances_become_nodes_with_light_of_their_own() {
    let folder = Folder::new("instancing");
    let (mut json, mut binary) = room("geometry.bin");
    let offset = binary.len();
    for v in [0.0, 0.0, 0.0, 0.0, 0.0, 1.5_f32] {
        binary.extend(v.to_le_bytes());
    }
    json["buffers"][0] = json!({"byteLength": binary.len()});
    json["bufferViews"]
        .as_array_mut()
        .unwrap()
        .push(json!({"buffer": 0, "byteOffset": offset, "byteLength": 24}));
    json["accessors"]
        .as_array_mut()
        .unwrap()
        .push(json!({"bufferView": 4, "componentType": 5126, "count": 2, "type": "VEC3"}));
    json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"] = json!({"attributes": {"TRANSLATION": 6}});
    for key in ["extensionsUsed", "extensionsRequired"] {
        let list = json.as_object_mut().unwrap().entry(key).or_insert(json!([]));
        list.as_array_mut().unwrap().push("EXT_mesh_gpu_instancing".into());
    }
    let (input, out) = (folder.write("in.glb", glb(&json, &binary)), folder.path("out.glb"));
    let report = bake(&input, &out, &["--ao-distance", "1"]);
    assert_eq!(
        (report["scene"]["instances"].as_u64(), report["scene"]["triangles"].as_u64()),
        (Some(2), Some(8))
    );
    let (after, _) = harness::glb_parts(&std::fs::read(&out).unwrap());
    assert_eq!(after["nodes"][0]["children"].as_array().map(Vec::len), Some(2), "{}", after["nodes"]);
    assert!(after["extensionsRequired"].is_null(), "{}", after["extensionsRequired"]);
}

#[test]
fn bake_that_is_killed_leaves_no_output() {
    let folder = Folder::new("killed");
    let (scene, extra) = match shared_scene("toy_car.glb") {
        Some(scene) => (scene, vec![]),
        None => (data("thin_wall.glb"), vec!["--quality", "final"]),
    };
    let out = folder.path("out.glb");
    let report = folder.path("r.json");
    let mut arguments = draft(&scene, &out, &[]);
    if !extra.is_empty() {
        arguments.truncate(4);
        arguments.extend(extra.iter().map(std::ffi::OsStr::new));
    }
    arguments.extend(["--report".as_ref(), report.as_os_str()]);
    let mut child = command(arguments).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
    std::thread::sleep(Duration::from_millis(200));
    child.kill().unwrap();
    assert!(!child.wait().unwrap().success(), "the bake was done before it could be killed");
    assert_eq!(folder.names(), [""; 0]);
    // What a run leaves that is killed while it writes does not matter to the next one.
    let stale = folder.write(&format!(".out.glb.{}.tmp", child.id()), "half a file");
    bake(&data("contact.glb"), &out, &[]);
    let fresh = folder.path("fresh.glb");
    bake(&data("contact.glb"), &fresh, &[]);
    assert!(std::fs::read(out).unwrap() == std::fs::read(fresh).unwrap());
    assert!(stale.exists(), "a file that another run may be writing was removed");
}

/// Runs the program in a shell that allows files of so many blocks of 512 bytes only: a disk that is full.
fn with_full_disk(blocks: u32, arguments: &[&std::ffi::OsStr]) -> std::process::Output {
    Command::new("sh")
        .args(["-c", &format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$@\""), "sh"])
        .arg(env!("CARGO_BIN_EXE_lightkiln"))
        .args(arguments)
        .output()
        .unwrap()
}

#[test]
fn bake_onto_a_full_disk_leaves_nothing() {
    let folder = Folder::new("full");
    let (input, glb, gltf) = (data("contact.glb"), folder.path("out.glb"), folder.path("out.gltf"));
    let report = folder.path("r.json");
    for out in [&glb, &gltf] {
        let output = with_full_disk(8, &draft(&input, out, &["--exr", "--report", report.to_str().unwrap()]));
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("cannot write") && said.contains("room"), "{said}");
        assert_eq!(folder.names(), [""; 0], "{said}");
    }
}

#[test]
fn report_onto_a_full_device_is_an_error_and_the_device_stays() {
    let folder = Folder::new("device");
    let (input, out) = (data("half_box.glb"), folder.path("out.glb"));
    let said = fail(2, draft(&input, &out, &["--report", "/dev/full"]));
    assert!(said.contains("/dev/full"), "{said}");
    use std::os::unix::fs::FileTypeExt as _;
    assert!(std::fs::metadata("/dev/full").unwrap().file_type().is_char_device());
    let said = succeed(draft(&input, &out, &["--report", "/dev/stdout"]));
    assert!(said.starts_with('{') && said.ends_with("}\n"), "{said}");
}

#[test]
fn output_over_any_other_file_of_the_bake_is_refused() {
    let folder = Folder::new("over");
    let scene = folder.write("a.glb", std::fs::read(data("half_box.glb")).unwrap());
    let config = folder.write("c.toml", "seed = 1\n");
    let (out, same) = (folder.path("out.glb"), folder.path("./out.glb"));
    let [scene, config, same] = [&scene, &config, &same].map(|p| p.to_str().unwrap());
    let before = folder.names();
    for extra in [
        ["--report", scene, "--seed", "1"],
        ["--report", same, "--seed", "1"],
        ["--config", config, "--depfile", config],
        ["--report", "r", "--depfile", "r"],
    ] {
        let output =
            command(draft(Path::new(scene), &out, &extra)).current_dir(folder.path("")).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{extra:?}: {said}");
        assert!(said.contains("same file"), "{extra:?}: {said}");
        assert_eq!(folder.names(), before, "{extra:?}");
    }
    fail(1, draft(Path::new(scene), Path::new(scene), &[]));
}

#[test]
fn make_rebuilds_what_changed_and_nothing_else() {
    let folder = Folder::new("make");
    write_room(&folder);
    folder.write("bake.toml", "quality = \"draft\"\nao-distance = 1.0\n");
    // Names with spaces need no care of the Makefile's writer: they stand in the dependency file only.
    std::fs::rename(folder.path("geometry.bin"), folder.path("the geometry.bin")).unwrap();
    let (json, _) = room("the%20geometry.bin");
    folder.write("room.gltf", serde_json::to_vec(&json).unwrap());
    folder.write(
        "Makefile",
        "room.baked.glb:\n\
         \techo baked >> log\n\
         \t$(LIGHTKILN) bake room.gltf -o $@ --config bake.toml --report room.json --depfile room.d --quiet\n\
         -include room.d\n",
    );
    let make = || {
        let output = Command::new("make")
            .arg(format!("LIGHTKILN={}", env!("CARGO_BIN_EXE_lightkiln")))
            .current_dir(folder.path(""))
            .env_remove("MAKEFLAGS")
            .env_remove("MAKELEVEL")
            .output()
            .expect("make runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        std::fs::read_to_string(folder.path("log")).unwrap().lines().count()
    };
    assert_eq!((make(), make()), (1, 1), "nothing changed, and yet it was baked again");
    let mut runs = 1;
    for input in ["room.gltf", "the geometry.bin", "bake.toml"] {
        let later = std::time::SystemTime::now() + Duration::from_secs(2);
        std::fs::File::options().append(true).open(folder.path(input)).unwrap().set_modified(later).unwrap();
        // Outputs are older than an input of the near future until they are set to the same time.
        runs += 1;
        assert_eq!(make(), runs, "{input} changed");
        for output in ["room.baked.glb", "room.json"] {
            std::fs::File::options()
                .append(true)
                .open(folder.path(output))
                .unwrap()
                .set_modified(later)
                .unwrap();
        }
        assert_eq!(make(), runs, "after {input}");
    }
}

#[test]
fn inspect_of_a_file_that_is_no_scene_has_one_message() {
    let folder = Folder::new("inspect-bad");
    let input = folder.write("in.glb", "not a scene");
    for arguments in [["inspect"], ["verify"]] {
        let output = lightkiln(arguments.iter().map(std::ffi::OsStr::new).chain([input.as_os_str()]));
        assert_eq!(output.status.code(), Some(3));
    }
}
