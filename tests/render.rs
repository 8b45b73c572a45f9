//! The command `render`, as a user calls it.

mod harness;

use std::path::{Path, PathBuf};

use harness::{Folder, bake, data, fail, glb, glb_parts, succeed};
use lightkiln_texel::{Image, read_exr, read_png};
use serde_json::json;

/// The arguments of a small picture.
fn picture<'a>(file: &'a Path, output: &'a Path, extra: &[&'a str]) -> Vec<&'a std::ffi::OsStr> {
    let mut all = vec!["render".as_ref(), file.as_os_str(), "-o".as_ref(), output.as_os_str()];
    all.push("--quiet".as_ref());
    for usual in [["--size", "48"], ["--mode", "clay"]].iter().filter(|usual| !extra.contains(&usual[0])) {
        all.extend(usual.iter().map(std::ffi::OsStr::new));
    }
    all.extend(extra.iter().map(|&argument| std::ffi::OsStr::new(argument)));
    all
}

/// Renders a PNG and reads it.
fn png(folder: &Folder, file: &Path, extra: &[&str]) -> Image {
    let output = folder.path("p.png");
    succeed(picture(file, &output, extra));
    read_png(&std::fs::read(output).expect("written")).expect("a PNG")
}

/// A column, with three cameras.
fn with_cameras(folder: &Folder) -> PathBuf {
    let (mut gltf, binary) = glb_parts(&std::fs::read(data("column.glb")).expect("there"));
    gltf["cameras"] = json!([
        {"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.01}},
        {"type": "perspective", "perspective": {"yfov": 0.5, "aspectRatio": 2.0, "znear": 0.01}},
        {"type": "orthographic", "name": "Plan", "orthographic": {"xmag": 4, "ymag": 2, "znear": 0, "zfar": 100}}
    ]);
    let nodes = gltf["nodes"].as_array_mut().expect("nodes");
    let first = nodes.len();
    // Half a right angle down: the direction (0, -1, -1).
    let turned = json!([-0.382_683_43, 0, 0, 0.923_879_53]);
    nodes.push(json!({"camera": 0, "name": "Door", "translation": [0, 5, 5], "rotation": turned}));
    nodes.push(json!({"camera": 1, "name": "Wide", "translation": [0, 1, 8]}));
    nodes.push(json!({"camera": 2, "translation": [0, 1, 8]}));
    let roots = gltf["scenes"][0]["nodes"].as_array_mut().expect("roots");
    roots.extend((first..first + 3).map(|node| json!(node)));
    folder.write("cameras.glb", glb(&gltf, &binary))
}

#[test]
fn render_camera_of_the_file_is_an_eye_at_its_place() {
    let folder = Folder::new("render-camera");
    let file = with_cameras(&folder);
    let camera = png(&folder, &file, &["--camera", "Door"]);
    let fov = format!("{}", 0.8_f32.to_degrees());
    let eye = png(&folder, &file, &["--eye", "0,5,5", "--look", "0,3,3", "--fov", &fov]);
    let far = camera.values.iter().zip(&eye.values).filter(|(a, b)| (**a - **b).abs() > 0.02).count();
    assert!(far < camera.values.len() / 200, "{far} of {}", camera.values.len());
    assert_eq!(camera.size, [48, 48]);
    // The file says the shape of the picture unless the command line does.
    assert_eq!(png(&folder, &file, &["--camera", "Wide"]).size, [48, 24]);
    assert_eq!(png(&folder, &file, &["--camera", "2"]).size, [48, 24]);
    assert_eq!(png(&folder, &file, &["--camera", "Plan", "--size", "20x30"]).size, [20, 30]);
    assert_eq!(png(&folder, &file, &["--camera", "Plan"]), png(&folder, &file, &["--camera", "2"]));
}

#[test]
fn render_from_an_unknown_camera_names_those_that_there_are() {
    let folder = Folder::new("render-unknown");
    let (file, output) = (with_cameras(&folder), folder.path("p.png"));
    let said = fail(1, picture(&file, &output, &["--camera", "Window"]));
    assert!(said.contains("0 \"Door\", 1 \"Wide\", 2 \"Plan\""), "{said}");
    let said = fail(1, picture(&data("column.glb"), &output, &["--camera", "0"]));
    assert!(said.contains("none at all") && said.contains("column.glb"), "{said}");
    assert!(!output.exists());
}

#[test]
fn render_with_arguments_that_make_no_sense_is_one_clear_error() {
    let folder = Folder::new("render-bad");
    let (file, output) = (data("column.glb"), folder.path("p.png"));
    for (extra, word) in [
        (&["--eye", "1,2,3", "--look", "1,2,3"][..], "its own place"),
        (&["--eye", "1,2"], "three numbers"),
        (&["--look", "1,2,3"], "--eye"),
        (&["--size", "12"], "16 to 8192"),
        (&["--size", "100x"], "WIDTHxHEIGHT"),
        (&["--fov", "180"], "below 180"),
        (&["--view", "sideways"], "three-quarter"),
        (&["--zoom", "0"], "above 0"),
        (&["--background", "2,0,0"], "transparent"),
        (&["--mode", "light"], "bake"),
        (&["--layer", "3"], "--layer"),
    ] {
        let output = harness::lightkiln(picture(&file, &output, extra));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && said.contains(word), "{extra:?}: {said}");
        assert_eq!(said.matches("error:").count(), 1, "{said}");
    }
    let said = fail(1, picture(&file, &folder.path("p.jpg"), &[]));
    assert!(said.contains(".png") && said.contains(".exr"), "{said}");
    assert_eq!(folder.names(), [""; 0]);
}

#[test]
fn render_to_exr_has_a_layer_for_each_picture_in_the_unit_of_the_light() {
    let folder = Folder::new("render-exr");
    let (file, output) = (folder.path("b.glb"), folder.path("p.exr"));
    bake(&data("furnace.glb"), &file, &["--samples", "3000", "--signal", "lightmap", "--max-error", "0.1"]);
    let modes = ["--mode", "light,reference", "--view", "front,top", "--rays", "64", "--size", "32x24"];
    succeed(picture(&file, &output, &modes));
    let image = read_exr(&std::fs::read(&output).expect("written")).expect("an EXR");
    let names = ["front.light", "front.reference", "top.light", "top.reference"];
    let channels = names.iter().flat_map(|name| ["R", "G", "B", "A"].map(|c| format!("{name}.{c}")));
    assert_eq!((image.size, image.names.clone()), ([32, 24], channels.collect::<Vec<_>>()));
    // 628.3 lux everywhere, which no screen shows.
    let middle = &image.values[(12 * 32 + 16) * 16..][..16];
    for (value, name) in middle.iter().zip(&image.names) {
        let expected = if name.ends_with('A') { 1.0 } else { 628.3 };
        // What is traced has the noise of 64 rays.
        let off = if name.contains("reference") { 0.3 } else { 0.1 };
        assert!((value - expected).abs() < off * expected, "{name}: {value}");
    }
    let output = folder.path("single.exr");
    succeed(picture(&file, &output, &["--mode", "error", "--rays", "64"]));
    let image = read_exr(&std::fs::read(&output).expect("written")).expect("an EXR");
    assert_eq!(image.names, ["R", "G", "B", "A"]);
    // The corner of the picture sees nothing.
    assert_eq!(image.values[..4], [0.0; 4]);
}

#[test]
fn render_before_nothing_is_transparent() {
    let folder = Folder::new("render-alpha");
    let file = data("column.glb");
    let clear = png(&folder, &file, &["--background", "transparent"]);
    assert_eq!((clear.channels, clear.values[3]), (4, 0.0));
    let red = png(&folder, &file, &["--background", "1,0,0"]);
    assert_eq!((red.channels, &red.values[..3]), (3, &[1.0, 0.0, 0.0][..]));
    let middle = (24 * 48 + 24) * 4;
    assert_eq!(clear.values[middle + 3], 1.0);
}

#[test]
fn render_of_several_files_places_and_modes_is_a_sheet() {
    let folder = Folder::new("render-sheet");
    let [one, two] = ["column.glb", "contact.glb"].map(data);
    let sheet = |extra: &[&str]| {
        let second = two.to_string_lossy().into_owned();
        png(&folder, &one, &[&[second.as_str()], extra].concat()).size
    };
    // Strips of 15 pixels above for the captions; lines of 4 between.
    assert_eq!(sheet(&[]), [2 * 48 + 4, 48 + 15]);
    assert_eq!(sheet(&["--no-captions"]), [2 * 48 + 4, 48]);
    assert_eq!(sheet(&["--no-captions", "--columns", "1"]), [48, 2 * 48 + 4]);
    let all = ["--no-captions", "--view", "front,30,20,top", "--mode", "clay,shaded"];
    // Two modes side by side; below each other two files from three places.
    assert_eq!(sheet(&all), [2 * 48 + 4, 6 * 48 + 5 * 4]);
    let views = ["--no-captions", "--view", "front,back,left,right,top,bottom,three-quarter"];
    // Seven places are more than six: two lines for each file, the second not full.
    assert_eq!(png(&folder, &one, &views).size, [4 * 48 + 3 * 4, 2 * 48 + 4]);
}

#[test]
fn render_shaded_gets_brighter_with_exposure_and_darker_with_white() {
    let folder = Folder::new("render-exposure");
    let file = data("column.glb");
    let mean = |extra: &[&str]| {
        let shaded = ["--mode", "shaded", "--background", "0,0,0"];
        let image = png(&folder, &file, &[&shaded[..], extra].concat());
        image.values.iter().sum::<f32>() / image.values.len() as f32
    };
    let usual = mean(&[]);
    assert!(usual > 0.05, "{usual}");
    assert!(mean(&["--exposure", "-1"]) < 0.85 * usual && mean(&["--exposure", "1"]) > 1.05 * usual);
    assert!(mean(&["--white", "12"]) < 0.7 * usual);
    assert!(mean(&["--tone", "clip", "--exposure", "2"]) >= mean(&["--exposure", "2"]));
}
