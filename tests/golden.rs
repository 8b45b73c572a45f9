//! Pictures of the small scenes, compared with those in tests/golden/<topic>/.
//!
//! A mismatch writes expected, difference and actual side by side, and a JSON summary, into target/golden. `BLESS=1`
//! writes the expected pictures anew and fails all the same, so that somebody looks at them.

mod harness;

use std::io::Cursor;
use std::path::{Path, PathBuf};

use harness::{Folder, data, draft, root, succeed};
use lightkiln_texel::{Image, PngDepth, read_png, write_png};
use serde_json::{Value, json};

/// Bakes a scene of data/ into a folder.
fn baked(folder: &Folder, scene: &str, options: &[&str]) -> PathBuf {
    let path = folder.path(&format!("{scene}.glb"));
    // A bound that a draft does not keep is no matter here.
    let ran = harness::lightkiln(draft(&data(&format!("{scene}.glb")), &path, options));
    assert!(matches!(ran.status.code(), Some(0 | 6)), "{}", String::from_utf8_lossy(&ran.stderr));
    path
}

/// What may differ, from tests/golden/tolerances.json, which says why.
struct Tolerance {
    /// Steps of 8 bits by which a channel may be off without counting.
    step: f32,
    /// Share of the pixels that may be off by more.
    share: f64,
}

impl Tolerance {
    fn read() -> Self {
        let path = root().join("tests/golden/tolerances.json");
        let text = std::fs::read_to_string(path).expect("the tolerances are there");
        let json: Value = serde_json::from_str(&text).expect("JSON");
        let number = |key: &str| json[key].as_f64().expect("a number");
        Self { step: number("step") as f32, share: number("share") }
    }
}

/// Renders a picture of `--size` 96 and compares it with the expected one. Says what is wrong.
fn compare(topic: &str, name: &str, file: &Path, arguments: &[&str]) -> Result<(), String> {
    let folder = Folder::new(&format!("golden-{topic}-{name}"));
    let output = folder.path("actual.png");
    let common = ["render".as_ref(), file.as_os_str(), "-o".as_ref(), output.as_os_str()];
    let plain = ["--quiet", "--size", "96"].iter().chain(arguments).map(AsRef::as_ref);
    succeed(common.into_iter().chain(plain));
    let bytes = std::fs::read(&output).expect("written");
    let expected_path = root().join("tests/golden").join(topic).join(format!("{name}.png"));
    if std::env::var_os("BLESS").is_some_and(|value| value == "1") {
        std::fs::create_dir_all(expected_path.parent().expect("a folder")).expect("writable");
        std::fs::write(&expected_path, &bytes).expect("writable");
        let path = expected_path.display();
        return Err(format!("{path} is written anew: look at it, and run the test without BLESS"));
    }
    let expected = std::fs::read(&expected_path)
        .map_err(|error| format!("{}: {error}; BLESS=1 writes it", expected_path.display()))?;
    let [expected, actual] = [expected, bytes].map(|bytes| read_png(&bytes).expect("a PNG"));
    let found = Differences::between(&expected, &actual);
    let tolerance = Tolerance::read();
    let beyond = found.beyond(tolerance.step);
    if found.same_shape && beyond <= tolerance.share {
        return Ok(());
    }
    let report = root().join("target/golden").join(topic);
    std::fs::create_dir_all(&report).expect("writable");
    let picture = report.join(format!("{name}.png"));
    let [width, height] = expected.size;
    let parts = [&expected.values, &found.shown(), &actual.values].map(|values| fit(values, &expected));
    let rows = (0..height as usize).flat_map(|row| {
        parts
            .iter()
            .flat_map(move |part| part.chunks_exact(width as usize * 3).nth(row).unwrap_or(&[]).to_vec())
    });
    let mut png = Cursor::new(Vec::new());
    write_png(&mut png, [3 * width, height], 3, PngDepth::Eight, &rows.collect::<Vec<f32>>()).expect("fits");
    std::fs::write(&picture, png.into_inner()).expect("writable");
    let summary = json!({
        "topic": topic, "name": name, "expected": expected_path, "arguments": arguments,
        "size": {"expected": expected.size, "actual": actual.size},
        "pixelsBeyond": beyond, "pixelsAllowed": tolerance.share, "step": tolerance.step,
        "largestStep": found.largest(),
    });
    let text = serde_json::to_string_pretty(&summary).expect("JSON");
    std::fs::write(report.join(format!("{name}.json")), text).expect("writable");
    Err(format!(
        "{topic}/{name}: {:.2} % of the pixels are off by more than {} steps of 255, {:.2} % may be; \
         expected, difference and actual stand in {}, BLESS=1 takes the new one",
        100.0 * beyond,
        tolerance.step,
        100.0 * tolerance.share,
        picture.display()
    ))
}

/// Fails with all that is wrong.
fn all(found: impl IntoIterator<Item = Result<(), String>>) {
    let wrong: Vec<String> = found.into_iter().filter_map(Result::err).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The values of a picture as RGB of the shape of another; what does not fit is black.
fn fit(values: &[f32], shape: &Image) -> Vec<f32> {
    let mut out = values.to_vec();
    out.resize((shape.size[0] * shape.size[1]) as usize * 3, 0.0);
    out
}

/// The largest difference over the channels of each pixel, in steps of 255.
struct Differences {
    same_shape: bool,
    steps: Vec<f32>,
}

impl Differences {
    fn between(expected: &Image, actual: &Image) -> Self {
        let same_shape = expected.size == actual.size && expected.channels == actual.channels;
        let pixels = expected.values.chunks_exact(3).zip(actual.values.chunks_exact(3));
        let worst = |(a, b): (&[f32], &[f32])| {
            a.iter().zip(b).map(|(a, b)| (a - b).abs() * 255.0).fold(0.0, f32::max)
        };
        Self { same_shape, steps: pixels.map(worst).collect() }
    }

    fn beyond(&self, step: f32) -> f64 {
        // Values are multiples of a step, up to rounding.
        let count = self.steps.iter().filter(|&&s| s > step + 0.01).count();
        count as f64 / self.steps.len().max(1) as f64
    }

    fn largest(&self) -> f32 {
        self.steps.iter().copied().fold(0.0, f32::max)
    }

    /// Ten times as large, gray.
    fn shown(&self) -> Vec<f32> {
        self.steps.iter().flat_map(|s| [(s / 25.5).min(1.0); 3]).collect()
    }
}

const AO: [&str; 2] = ["--samples", "4000"];
const LIGHTMAP: [&str; 4] = ["--samples", "4000", "--signal", "lightmap"];

#[test]
fn golden_pictures_of_occlusion_at_a_crease() {
    let folder = Folder::new("golden-crease");
    let file = baked(&folder, "l_shape", &AO);
    all([
        compare("light", "l_shape", &file, &[]),
        compare("error", "l_shape", &file, &["--mode", "error", "--rays", "64", "--captions"]),
    ]);
}

#[test]
fn golden_pictures_of_irradiance_in_a_box() {
    let folder = Folder::new("golden-box");
    let file = baked(&folder, "cornell", &LIGHTMAP);
    let inside = ["--view", "front", "--zoom", "1.2"];
    all([
        compare("classes", "cornell", &file, &[&inside[..], &["--mode", "classes", "--captions"]].concat()),
        compare("light", "cornell", &file, &inside),
        compare("shaded", "cornell", &file, &[&inside[..], &["--mode", "shaded"]].concat()),
    ]);
}

#[test]
fn golden_shaded_in_ambient_light_with_holes() {
    let folder = Folder::new("golden-holes");
    let file = baked(&folder, "fence", &AO);
    all([compare("shaded", "fence", &file, &["--mode", "shaded", "--view", "25,10", "--zoom", "2.5"])]);
}

#[test]
fn golden_shaded_without_a_bake() {
    let arguments = ["--mode", "shaded", "--view", "160,20"];
    all([compare("shaded", "window_unbaked", &data("window.glb"), &arguments)]);
}

#[test]
fn golden_comparison_finds_a_difference() {
    let image = |value: f32| Image {
        size: [10, 10],
        channels: 3,
        names: Vec::new(),
        bits: 8,
        values: vec![value; 300],
    };
    let mut other = image(0.5);
    other.values[7] += 5.0 / 255.0;
    let found = Differences::between(&image(0.5), &other);
    assert_eq!((found.beyond(4.0), found.beyond(5.0), found.same_shape), (0.01, 0.0, true));
    assert!(found.beyond(4.0) > Tolerance::read().share);
}
