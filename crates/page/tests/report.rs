//! The page of a report: its structure, and that nothing in it comes from a stranger as markup.

use lightkiln_page::advice::{WORTH_SAYING, advice};
use lightkiln_page::{Figure, report_page};
use lightkiln_report::Report;
use serde_json::{Value, json};

/// A report as a bake writes it, with two layers, a warning and a coarse node.
fn report() -> Value {
    let summary = |rmse: f64| {
        let histogram: Vec<u32> = (0..20).map(|bin| if bin < 12 { 100 - 8 * bin } else { 2 }).collect();
        let points: u32 = histogram.iter().sum();
        json!({ "points": points, "rmse": rmse, "median": 0.004, "p99": 0.05, "p999": 0.09, "max": 0.2, "noise": 0.003,
                "histogram": histogram })
    };
    let bytes = |a: u64, b: u64| json!({ "attribute": a, "addedVertices": 3000, "atlas": b, "mips": b / 3, "tables": 0 });
    json!({
        "version": 1, "generator": "lightkiln 0.1.0", "input": "car.glb", "output": "car.baked.glb",
        "settings": { "signal": "ao", "maxError": 0.005, "detail": 0.02, "radius": 0.01, "quality": "draft",
                      "aoDistance": null, "seed": 0 },
        "scene": { "instances": 2, "triangles": 5000, "degenerateTriangles": 3, "gltfVertices": 9000, "lightVertices": 2600,
                   "sheets": 4, "area": 12.5, "diagonal": 3.0 },
        "classes": { "texture": { "triangles": 900, "areaShare": 0.2 }, "mixed": { "triangles": 300, "areaShare": 0.1 },
                     "color": { "triangles": 3800, "areaShare": 0.7 },
                     "textureBeforeClosing": { "triangles": 700, "areaShare": 0.15 },
                     "decisionBound": 0.005, "rounds": 2, "promoted": 3, "promotedForBytes": 1 },
        "rays": { "poissonSamples": 75000, "supportSamples": 10, "invalidSamples": 3, "shadedTexels": 9000,
                  "sampleRays": 9000000, "texelRays": 2000000, "verifyRays": 1000000, "sampleNoiseMedian": 0.01,
                  "sampleNoiseP99": 0.02 },
        "atlas": { "charts": 40, "width": 256, "height": 128, "pages": 1, "bits": 16, "texels": 32768, "shownTexels": 16000,
                   "seamBefore": 0.1, "seamAfter": 0.001 },
        "errors": { "points": 1000, "raysPerPoint": 256, "hiddenPoints": 4, "pointSampling": summary(0.03),
                    "leastSquares": summary(0.02), "hybrid": summary(0.01), "color": summary(0.01),
                    "texture": summary(0.01),
                    "layers": [{ "signal": "ambientOcclusion", "hybrid": summary(0.01) },
                               { "signal": "irradiance", "hybrid": summary(0.02) }],
                    "bound": { "limit": 0.005, "confidence": 3.0, "samplesBeyond": 0, "samplesChecked": 70000,
                               "colorPointsBeyond": 2, "colorPoints": 800, "texturePointsBeyond": 20, "texturePoints": 200 },
                    "coarse": [{ "name": "wheel", "points": 20 }] },
        "bytes": { "light": bytes(36000, 65536), "total": 126381, "atlasWaste": 33536, "fallback": 36000, "addedVertices": 80,
                   "verticesOnly": 36000, "fullLightmap": { "bytes": bytes(40000, 300000), "texels": 150000, "fill": 0.49,
                   "vertexRatio": 1.2, "measured": true }, "geometry": 400000, "files": 900000,
                   "largest": [{ "name": "body", "bytes": 90000, "texelBytes": 60000 },
                               { "name": "wheel", "bytes": 20000, "texelBytes": 9000 }],
                   "instancesUnshared": 0 },
        "stages": [{ "name": "read", "seconds": 0.1 }, { "name": "light", "seconds": 2.5 }],
        "peakMemoryBytes": 90000000, "warnings": ["2 x skins are baked at rest"]
    })
}

fn read(json: Value) -> Report {
    serde_json::from_value(json).expect("a report")
}

fn figure() -> Figure {
    Figure { title: "The light".into(), caption: "as it is".into(), png: b"\x89PNG".to_vec() }
}

/// What stands in the page, tag by tag, attributes and text left away.
fn tags(page: &str) -> Vec<String> {
    let body = &page[page.find("<body>").expect("a body")..page.find("</html>").expect("an end")];
    let names = body.split('<').skip(1).map(|tag| {
        let end = tag.find(|c: char| !(c.is_ascii_alphanumeric() || c == '/')).unwrap_or(tag.len());
        tag[..end].to_owned()
    });
    names.collect()
}

#[test]
fn page_has_its_sections_in_order() {
    let page = report_page(&read(report()), &[figure()]);
    let sections =
        ["pictures", "classes", "bytes", "errors", "advice", "meshes", "times", "settings", "warnings"];
    let places: Vec<usize> = sections
        .iter()
        .map(|id| page.find(&format!("<section id=\"{id}\"")).unwrap_or_else(|| panic!("{id}")))
        .collect();
    assert!(places.is_sorted(), "{places:?}");
    let count = |tag: &str| tags(&page).iter().filter(|t| *t == tag).count();
    assert_eq!((count("section"), count("svg"), count("table"), count("img")), (9, 4, 5, 1));
    // Every element that has an end has one, and in the right order.
    let mut open = Vec::new();
    for tag in tags(&page) {
        match tag.strip_prefix('/') {
            Some(name) => assert_eq!(open.pop().as_deref(), Some(name), "in {tag}"),
            None if ["img", "br", "path"].contains(&tag.as_str()) => {}
            None => open.push(tag),
        }
    }
    assert!(open.is_empty(), "{open:?}");
}

#[test]
fn page_of_little_has_no_empty_sections() {
    let mut json = report();
    json["warnings"] = json!([]);
    json["bytes"]["largest"] = json!([]);
    json["errors"]["leastSquares"] = Value::Null;
    json["errors"]["hybrid"]["histogram"] = Value::Null;
    let page = report_page(&read(json), &[]);
    for id in ["pictures", "meshes", "warnings"] {
        assert!(!page.contains(&format!("<section id=\"{id}\"")), "{id}");
    }
    assert!(!page.contains("NaN") && !page.contains("inf "));
}

#[test]
fn page_of_an_empty_scene_has_no_numbers_that_are_none() {
    let mut json = report();
    json["bytes"]["light"] =
        json!({ "attribute": 0, "addedVertices": 0, "atlas": 0, "mips": 0, "tables": 0 });
    for (at, key) in
        [("bytes", "total"), ("bytes", "verticesOnly"), ("scene", "gltfVertices"), ("atlas", "charts")]
    {
        json[at][key] = json!(0);
    }
    json["stages"] = json!([]);
    json["errors"]["hybrid"]["points"] = json!(0);
    let page = report_page(&read(json), &[]);
    assert!(!page.contains("NaN") && !page.contains(">inf"), "{page}");
}

#[test]
fn page_escapes_everything_that_strangers_name() {
    let evil = "</style><script>alert(1)</script><img src=x onerror=alert(2)>\"'&";
    let mut json = report();
    for pointer in [
        "/input",
        "/output",
        "/generator",
        "/settings/signal",
        "/settings/quality",
        "/warnings/0",
        "/stages/0/name",
        "/errors/coarse/0/name",
        "/errors/layers/0/signal",
        "/bytes/largest/0/name",
    ] {
        *json.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer}")) = json!(evil);
    }
    let named = Figure { title: evil.into(), caption: evil.into(), ..figure() };
    let page = report_page(&read(json), &[named]);
    assert!(
        !page.contains("<script") && !page.contains("<img src=x") && !page.contains("onerror=alert(2)>\"")
    );
    assert_eq!(page.matches("</style>").count(), 1);
    assert!(page.matches("&lt;script&gt;").count() >= 11);
}

#[test]
fn page_asks_for_nothing_from_anywhere() {
    let page = report_page(&read(report()), &[figure()]);
    for reach in ["http:", "https:", "//", "src=\"/", "url(", "@import", "<link", "<script", "<iframe"] {
        assert!(!page.replace("<!doctype html>", "").contains(reach), "{reach}");
    }
    assert!(page.contains("src=\"data:image/png;base64,iVBORw==\"") && page.contains("default-src 'none'"));
    assert!(page.contains("@media print") && page.contains("prefers-color-scheme: dark"));
}

#[test]
fn advice_is_ordered_by_what_it_saves_and_has_numbers() {
    let report = read(report());
    let all = advice(&report);
    assert!(all.len() >= 6, "{all:#?}");
    assert!(all.is_sorted_by_key(|a| std::cmp::Reverse(a.saves)));
    for one in &all {
        assert!(one.why.chars().any(|c| c.is_ascii_digit()), "{one:?}");
        assert!(
            one.saves.is_none_or(|s| s as f64 >= WORTH_SAYING * report.bytes.total as f64 - 1.0),
            "{one:?}"
        );
    }
    let saved = |start: &str| all.iter().find(|a| a.what.starts_with(start)).and_then(|a| a.saves);
    // Half of the atlas with its mips.
    assert_eq!(saved("keep less detail"), Some((65536 + 21845) / 2));
    assert_eq!(saved("allow an error of 1 %"), Some((65536 + 21845) / 2));
    assert_eq!(saved("leave the fallback away"), Some(36000));
    assert_eq!(saved("weld"), Some(25600));
}

#[test]
fn advice_without_texels_does_not_speak_of_them() {
    let mut json = report();
    json["bytes"]["light"] =
        json!({ "attribute": 36000, "addedVertices": 0, "atlas": 0, "mips": 0, "tables": 0 });
    json["bytes"]["total"] = json!(36000);
    json["bytes"]["fallback"] = json!(0);
    json["bytes"]["atlasWaste"] = json!(0);
    json["errors"]["bound"]["texturePointsBeyond"] = json!(0);
    json["atlas"]["charts"] = json!(0);
    json["bytes"]["largest"] = json!([]);
    let all = advice(&read(json));
    assert!(all.iter().all(|a| !a.why.contains("texel") || a.saves.is_none_or(|s| s == 0)), "{all:#?}");
}
