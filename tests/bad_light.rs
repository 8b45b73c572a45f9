//! Light that makes no sense: one message that says what, where and what to do, the right exit code, nothing left behind.
#![allow(clippy::unwrap_used)] // helpers of tests are tests

mod harness;

use std::path::{Path, PathBuf};

use harness::{Folder, data, draft, fail, glb, glb_parts};
use serde_json::{Value, json};

/// A refusal: exit code, arguments, and what the message must say; the first of it stands in its first line.
struct Case<'a>(i32, &'a [&'a str], &'a [&'a str]);

/// Bakes what is expected to fail, and reads the message.
fn refused(folder: &Folder, input: &Path, cases: &[Case<'_>]) {
    let before = folder.names();
    for Case(code, extra, words) in cases {
        let said = fail(*code, draft(input, &folder.path("out.glb"), extra));
        assert_eq!(folder.names(), before, "{extra:?}: something was left behind");
        let first = said.lines().next().unwrap();
        assert!(first.contains(words[0]), "{extra:?}: {said}");
        assert!(words.iter().all(|word| said.contains(word)), "{extra:?}: {said}");
    }
}

/// A Radiance file of 4 x 2 texels of one color.
fn sky(folder: &Folder, name: &str, texel: [u8; 4]) -> PathBuf {
    let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n".to_vec();
    (0..8).for_each(|_| bytes.extend(texel));
    folder.write(name, bytes)
}

#[test]
fn environment_that_cannot_be_used_is_named() {
    let folder = Folder::new("bad-environment");
    let good = sky(&folder, "good.hdr", [128, 128, 128, 136]);
    let whole = std::fs::read(&good).unwrap();
    let black = sky(&folder, "black.hdr", [0; 4]);
    let cut = folder.write("cut.hdr", &whole[..whole.len() - 5]);
    let words = folder.write("words.hdr", "not an image");
    let exr = folder.write("damaged.exr", [b"\x76\x2f\x31\x01\x02\0\0\0".as_slice(), &[0xff; 40]].concat());
    let other = folder.write("other.tga", [0; 40]);
    let path = |path: &Path| path.to_str().unwrap().to_owned();
    let paths = [&black, &cut, &words, &exr, &other, &good].map(|p| path(p));
    let [black, cut, words, exr, other, good] = paths.each_ref().map(String::as_str);
    let case = |file| ["--signal", "lightmap", "--environment", file];
    refused(
        &folder,
        &data("cornell.glb"),
        &[
            Case(2, &case("nowhere.hdr"), &["nowhere.hdr", "help: "]),
            Case(2, &case("."), &["read", "help: "]),
            Case(3, &case(black), &["no light", "black.hdr", "help: choose an image that shines"]),
            Case(3, &case(cut), &["", "cut.hdr", "help: "]),
            Case(3, &case(words), &["", "words.hdr", "help: "]),
            Case(3, &case(exr), &["", "damaged.exr", "help: "]),
            Case(3, &case(other), &["", "other.tga", "help: "]),
            Case(1, &["--signal", "lightmap", "--environment", good, "--sky", "5"], &["--sky"]),
            Case(
                1,
                &["--signal", "lightmap", "--environment", good, "--environment-intensity", "0"],
                &["--environment-intensity is 0", "help: "],
            ),
            Case(
                1,
                &["--signal", "lightmap", "--environment", good, "--environment-rotation", "nan"],
                &["--environment-rotation is NaN", "help: "],
            ),
        ],
    );
}

#[test]
fn numbers_of_light_out_of_their_range_are_refused() {
    let folder = Folder::new("bad-numbers");
    let config = |name: &str, text: &str| {
        let text = format!("signal = \"direct\"\n{text}\n");
        folder.write(name, text).to_str().unwrap().to_owned()
    };
    let area = |name: &str, light: &str| config(name, &format!("[[light.area-lights]]\n{light}"));
    let nan_sky = config("sky.toml", "[light]\nsky = [1.0, nan, 1.0]");
    let nan_sun = config("sun.toml", "[light]\nsun = { azimuth = 0.0, elevation = 40.0, illuminance = nan }");
    let nan_disk = area(
        "nan.toml",
        "shape = \"disk\"\nposition = [0, 1, 0]\ndirection = [0, -1, 0]\nradius = 1\nradiance = [1, nan, 1]",
    );
    let no_way = area(
        "way.toml",
        "shape = \"disk\"\nposition = [0, 1, 0]\ndirection = [0, 0, 0]\nradius = 1\nradiance = [1, 1, 1]",
    );
    let flat = area(
        "flat.toml",
        "shape = \"quad\"\ncorner = [0, 1, 0]\nedges = [[1, 0, 0], [2, 0, 0]]\nradiance = [1, 1, 1]",
    );
    let minus =
        area("minus.toml", "shape = \"sphere\"\nposition = [0, 1, 0]\nradius = -1\nintensity = [1, 1, 1]");
    let cone = area("cone.toml", "shape = \"cone\"\nposition = [0, 1, 0]");
    let unknown = config("unknown.toml", "[light]\nmoon = 3");
    refused(
        &folder,
        &data("contact.glb"),
        &[
            Case(1, &["--config", &nan_sky], &["--sky is NaN", "help: "]),
            Case(1, &["--config", &nan_sun], &["--sun is NaN", "help: "]),
            Case(1, &["--config", &nan_disk], &["area light 0", "help: ", "light.area-lights"]),
            Case(1, &["--config", &no_way], &["area light 0", "help: ", "light.area-lights"]),
            Case(1, &["--config", &flat], &["area light 0", "help: ", "light.area-lights"]),
            Case(1, &["--config", &minus], &["area light 0", "help: ", "light.area-lights"]),
            Case(1, &["--config", &cone], &["", "cone"]),
            Case(1, &["--config", &unknown], &["", "moon"]),
            Case(1, &["--sun", "10"], &["--sun", "AZIMUTH,ELEVATION"]),
            Case(1, &["--sun", "10,nan"], &["--sun"]),
            Case(1, &["--sun", "10,95"], &["--sun is 95", "help: "]),
            Case(1, &["--sky=-1"], &["--sky is -1", "help: "]),
            Case(1, &["--sky", "1,2"], &["--sky"]),
            Case(1, &["--light-radius", "nan"], &["--light-radius is NaN", "help: "]),
            Case(1, &["--light-angle", "90"], &["--light-angle is 90", "help: "]),
            Case(1, &["--white", "0"], &["--white is 0", "help: "]),
            Case(1, &["--ao-falloff", "0"], &["--ao-falloff is 0", "help: "]),
            Case(1, &["--ao-ground", "floor"], &["--ao-ground", "lowest"]),
            Case(1, &["--bounces=-1"], &["--bounces"]),
            Case(1, &["--signal", "candles"], &["candles", "bent-normal"]),
            Case(1, &["--signal", "ao+ao"], &["twice"]),
            Case(3, &["--signal", "shadow"], &["no light that casts a shadow", "help: "]),
            Case(3, &["--signal", "file-lightmap"], &["no lightmap texture", "help: "]),
            Case(2, &["--signal", "texture:nowhere.png"], &["nowhere.png", "help: "]),
        ],
    );
}

#[test]
fn lights_of_a_file_that_make_no_sense_are_named() {
    let folder = Folder::new("bad-file-lights");
    let altered = |name: &str, alter: &dyn Fn(&mut Value)| {
        let (mut json, binary) = glb_parts(&std::fs::read(data("punctual.glb")).unwrap());
        alter(&mut json["extensions"]["KHR_lights_punctual"]["lights"][1]);
        folder.write(name, glb(&json, &binary))
    };
    let minus = altered("minus.glb", &|light| light["intensity"] = json!(-4.0));
    let text = altered("text.glb", &|light| light["intensity"] = json!("NaN"));
    let color = altered("color.glb", &|light| light["color"] = json!([1.0, 2.0]));
    let kind = altered("kind.glb", &|light| light["type"] = json!("torch"));
    for (input, word) in [(minus, "intensity"), (text, "intensity"), (color, "color"), (kind, "torch")] {
        refused(&folder, &input, &[Case(3, &["--signal", "direct"], &[word, "point", "help: "])]);
    }
}

#[test]
fn parts_that_are_not_there_are_named() {
    let folder = Folder::new("bad-parts");
    let of = |signal| ["--signal", "lightmap", signal, "nobody*"];
    refused(
        &folder,
        &data("contact.glb"),
        &[
            Case(1, &of("--include"), &["nobody*", "contact.glb", "help: "]),
            Case(1, &of("--exclude"), &["nobody*", "contact.glb", "help: "]),
            Case(1, &["--include", ""], &["\"\"", "help: "]),
            Case(1, &["--exclude", "*"], &["left out", "contact.glb", "help: widen --include"]),
            Case(1, &["--include", "sunk", "--exclude", "sunk"], &["left out", "--exclude"]),
            Case(1, &["--variant", "gold"], &["gold", "help: "]),
            Case(2, &["--occluders", "nowhere.glb"], &["nowhere.glb", "help: "]),
            Case(1, &["--moving", "perhaps"], &["perhaps", "leave-out"]),
            Case(1, &["--glass", "green"], &["green", "tinted"]),
        ],
    );
    let broken = folder.write("broken.glb", "not a scene");
    refused(
        &folder,
        &data("contact.glb"),
        &[Case(3, &["--occluders", broken.to_str().unwrap()], &["", "broken.glb", "help: "])],
    );
}
