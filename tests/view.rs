//! The report as a page, and `lightkiln view`, as a user calls them.

mod harness;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::Stdio;

use harness::{Folder, command, data, draft, fail, glb_parts, succeed, unpacked};
use serde_json::Value;

/// A folder with a small baked scene, `b.glb`, and its report.
fn baked(name: &str) -> Folder {
    let folder = Folder::new(name);
    let (output, report) = (folder.path("b.glb"), folder.path("r.json"));
    let report = report.to_string_lossy().into_owned();
    succeed(draft(&data("contact.glb"), &output, &["--samples", "4000", "--report", &report]));
    folder
}

#[test]
fn report_is_a_page_or_json_by_its_name_and_may_be_both() {
    let folder = Folder::new("two-reports");
    let [json, html, depfile] =
        ["r.json", "r.HTML", "d"].map(|n| folder.path(n).to_string_lossy().into_owned());
    let output = folder.path("b.glb");
    let extra = ["--samples", "4000", "--report", &json, "--report", &html, "--depfile", &depfile];
    succeed(draft(&data("contact.glb"), &output, &extra));
    let report: Value = serde_json::from_slice(&std::fs::read(&json).expect("written")).expect("JSON");
    assert!(report["errors"]["hybrid"]["histogram"].as_array().expect("a histogram").len() == 20);
    let page = std::fs::read_to_string(&html).expect("written");
    assert!(page.starts_with("<!doctype html>") && page.len() < 2_000_000, "{} bytes", page.len());
    assert_eq!(page.matches("src=\"data:image/png;base64,").count(), 5);
    let rule = std::fs::read_to_string(&depfile).expect("written");
    assert!(rule.contains("r.HTML") && rule.contains("r.json"), "{rule}");
}

#[test]
fn report_page_over_another_output_is_refused() {
    let folder = Folder::new("same-report");
    let output = folder.path("b.glb");
    let same = folder.path("r.html").to_string_lossy().into_owned();
    let said = fail(1, draft(&data("contact.glb"), &output, &["--report", &same, "--report", &same]));
    assert!(said.contains("same file"), "{said}");
    assert!(!output.exists());
}

#[test]
fn view_export_is_a_site_of_the_baked_scene() {
    let folder = baked("view-export");
    let [file, site, report] = ["b.glb", "site", "r.json"].map(|n| folder.path(n));
    let arguments =
        ["view".as_ref(), file.as_os_str(), "--export".as_ref(), site.as_os_str(), "--quiet".as_ref()];
    let traced = ["--trace".as_ref(), "2000".as_ref(), "--report".as_ref(), report.as_os_str()];
    succeed(arguments.into_iter().chain(traced));
    let description = std::fs::read(site.join("model.json")).expect("written");
    let model: Value = serde_json::from_slice(&description).expect("JSON");
    // As many triangles as the file has.
    let (gltf, _) = glb_parts(&std::fs::read(&file).expect("written"));
    let drawn: u64 = gltf["meshes"]
        .as_array()
        .expect("meshes")
        .iter()
        .map(|mesh| {
            let primitives = mesh["primitives"].as_array().expect("primitives").iter();
            primitives
                .map(|p| {
                    gltf["accessors"][p["indices"].as_u64().expect("indexed") as usize]["count"]
                        .as_u64()
                        .expect("a count")
                        / 3
                })
                .sum::<u64>()
        })
        .sum();
    assert_eq!(model["triangles"], drawn);
    let classes = ["texture", "mixed", "color"].map(|c| model["classes"][c].as_u64().expect("a count"));
    assert_eq!(classes.iter().sum::<u64>(), drawn);
    for section in ["positions", "codes0", "vertexCodes0", "fallback", "errors", "errorNormals"] {
        assert!(model["sections"][section]["bytes"].as_u64().expect("a section") > 0, "{section}");
    }
    for (number, name) in ["geometry.bin", "light.bin"].into_iter().enumerate() {
        assert_eq!(model["blocks"][number], name);
        let sections = model["sections"].as_object().expect("sections").values();
        let end = sections
            .filter(|section| section["block"] == number)
            .map(|s| s["offset"].as_u64().expect("") + s["bytes"].as_u64().expect(""))
            .max();
        let length = unpacked(&site.join(name)).len() as u64;
        assert!(end.is_some_and(|end| end <= length && length < end + 4));
    }
    assert!(model["figures"]["lines"].to_string().contains("RMSE"));
}

#[test]
fn view_of_what_is_not_baked_or_no_report_says_so() {
    let said = fail(3, ["view".as_ref(), data("contact.glb").as_os_str(), "--quiet".as_ref()]);
    assert!(said.contains("carries no LIGHTKILN_lightmap") && said.contains("help: bake it first"), "{said}");
    let folder = baked("view-refuses");
    let (file, none) = (folder.path("b.glb"), folder.write("none.json", "{}"));
    let arguments =
        ["view".as_ref(), file.as_os_str(), "--quiet".as_ref(), "--report".as_ref(), none.as_os_str()];
    let said = fail(3, arguments);
    assert!(said.contains("no report of a bake"), "{said}");
}

#[test]
fn view_prints_where_it_is_and_answers_there() {
    let folder = baked("view-serves");
    let file = folder.path("b.glb");
    let mut server = command(["view".as_ref(), file.as_os_str(), "--quiet".as_ref()])
        .stdout(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut line = String::new();
    BufReader::new(server.stdout.take().expect("piped")).read_line(&mut line).expect("a line");
    let address =
        line.trim().strip_prefix("http://").and_then(|l| l.strip_suffix('/')).expect("a URL").to_owned();
    let ask = |host: &str| {
        let mut stream = TcpStream::connect(&address).expect("it listens");
        write!(stream, "GET / HTTP/1.1\r\nHost: {host}\r\n\r\n").expect("sent");
        let mut answer = String::new();
        stream.read_to_string(&mut answer).expect("answered");
        answer
    };
    let (own, other) = (ask(&address), ask("evil.example"));
    // The port is taken now.
    let port = address.rsplit(':').next().expect("a port").to_owned();
    let taken = ["view".as_ref(), file.as_os_str(), "--quiet".as_ref(), "--port".as_ref(), port.as_ref()];
    let said = fail(2, taken);
    server.kill().expect("it runs");
    server.wait().expect("it ends");
    assert!(address.starts_with("127.0.0.1:"));
    assert!(own.starts_with("HTTP/1.1 200") && own.contains("<title>Lightkiln</title>"), "{own}");
    assert!(other.starts_with("HTTP/1.1 403"), "{other}");
    assert!(said.contains("leave --port away"), "{said}");
}
