//! A bake that is watched, and one that is stopped: as a library, and as users call the program.
#![allow(clippy::unwrap_used)] // helpers of tests are tests

mod harness;

use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use harness::{Folder, command, data, draft, succeed, unpacked};
use lightkiln_bake::{BakeError, BakeOptions, Progress, Quality, Silent, Snapshot, bake};
use serde_json::Value;

const SAMPLES: usize = 4000;

fn options() -> BakeOptions {
    BakeOptions { samples: Some(SAMPLES), quality: Quality::Draft, ..BakeOptions::default() }
}

/// Looks at everything, and notes what it saw.
#[derive(Default)]
struct Watcher(Mutex<Vec<&'static str>>);

impl Progress for Watcher {
    fn stage(&self, _: &str) {}
    fn share(&self, _: f32) {}
    fn wants_snapshot(&self) -> bool {
        true
    }
    fn snapshot(&self, snapshot: &Snapshot<'_>) {
        let triangles = || snapshot.surface.mesh.triangle_ids();
        let seen = match (&snapshot.light, snapshot.stored()) {
            (None, _) => {
                assert!(triangles().all(|t| snapshot.vertex_codes(0, t).is_none()));
                "geometry"
            }
            (Some(_), None) => {
                let mut values = triangles().flat_map(|t| snapshot.vertex_codes(0, t).unwrap());
                assert!(values.any(|code| code.value().unwrap() < 0.9), "some vertex is dark");
                assert!(triangles().all(|t| snapshot.codes(0, t).is_none()));
                "vertices"
            }
            (Some(_), Some(stored)) => {
                let mut codes = triangles().flat_map(|t| snapshot.codes(0, t).unwrap());
                assert!(codes.any(|code| !code.is_color()) && !stored.layers[0].pages.is_empty());
                "texels"
            }
        };
        self.0.lock().unwrap().push(seen);
    }
}

#[test]
fn snapshots_go_from_geometry_over_vertices_to_texels_and_change_no_byte() {
    let folder = Folder::new("snapshots");
    let (input, [plain, watched]) =
        (data("contact.glb"), ["plain.glb", "watched.glb"].map(|n| folder.path(n)));
    let watcher = Watcher::default();
    bake(&input, &plain, &options(), &Silent).unwrap();
    let baked = bake(&input, &watched, &options(), &watcher).unwrap();
    let seen = watcher.0.into_inner().unwrap();
    assert_eq!(seen[0], "geometry");
    // The coarse fit and that of at least one round of rays, and as many atlases as rounds.
    assert!(seen.iter().filter(|s| **s == "vertices").count() >= 2, "{seen:?}");
    assert_eq!(seen.iter().filter(|s| **s == "texels").count(), baked.report.classes.rounds, "{seen:?}");
    assert!(
        seen.is_sorted_by_key(|s| ["geometry", "vertices", "texels"].iter().position(|n| n == s)),
        "{seen:?}"
    );
    assert_eq!(std::fs::read(plain).unwrap(), std::fs::read(watched).unwrap());
}

/// Wishes to stop when a stage begins.
struct Stopper {
    at: String,
    stages: Mutex<Vec<String>>,
    stopped: AtomicBool,
}

impl Progress for Stopper {
    fn stage(&self, name: &str) {
        self.stages.lock().unwrap().push(name.to_owned());
        self.stopped.fetch_or(name == self.at, Ordering::SeqCst);
    }
    fn share(&self, _: f32) {}
    fn is_cancelled(&self) -> bool {
        self.stopped.load(Ordering::SeqCst)
    }
}

#[test]
fn bake_that_is_stopped_at_any_stage_before_the_last_leaves_nothing() {
    let folder = Folder::new("stopped");
    let output = folder.path("out.glb");
    let run = |at: &str| {
        let stopper =
            Stopper { at: at.to_owned(), stages: Mutex::default(), stopped: AtomicBool::new(false) };
        let baked = bake(&data("contact.glb"), &output, &options(), &stopper);
        (baked.map(|_| ()), stopper.stages.into_inner().unwrap())
    };
    let (baked, mut all) = run("none of them");
    baked.unwrap();
    std::fs::remove_file(&output).unwrap();
    all.dedup();
    let before: Vec<&String> = all.iter().take_while(|stage| *stage != "write").collect();
    assert!(before.len() >= 10, "{all:?}");
    for stage in before {
        let (baked, stages) = run(stage);
        assert!(matches!(baked, Err(BakeError::Cancelled)), "{stage}");
        assert_eq!((stages.last().unwrap(), folder.names().len()), (stage, 0), "{:?}", folder.names());
    }
    // What is being written is written to the end.
    for stage in ["write", "verify"] {
        assert!(run(stage).0.is_ok(), "{stage}");
        assert_eq!(folder.names(), ["out.glb"]);
        std::fs::remove_file(&output).unwrap();
    }
}

/// A bake with a preview, and where its page is.
struct Previewed {
    child: Child,
    errors: BufReader<std::process::ChildStderr>,
    address: String,
}

impl Previewed {
    fn start(arguments: Vec<&OsStr>) -> Self {
        let mut child = command(arguments)
            .arg("--preview")
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut errors = BufReader::new(child.stderr.take().unwrap());
        let mut line = String::new();
        errors.read_line(&mut line).unwrap();
        let address = line.trim().strip_prefix("lightkiln: preview at http://").expect(&line);
        let address = address.trim_end_matches('/').to_owned();
        Self { child, errors, address }
    }

    fn ask(&self, request: &str) -> BufReader<TcpStream> {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        write!(stream, "{request} HTTP/1.1\r\nHost: {0}\r\nOrigin: http://{0}\r\n\r\n", self.address)
            .unwrap();
        BufReader::new(stream)
    }

    fn get(&self, path: &str) -> Vec<u8> {
        let mut answer = Vec::new();
        self.ask(&format!("GET {path}")).read_to_end(&mut answer).unwrap();
        let head = answer.windows(4).position(|w| w == b"\r\n\r\n").unwrap();
        assert!(answer.starts_with(b"HTTP/1.1 200"), "{path}");
        answer.split_off(head + 4)
    }

    /// The exit code, and what was said after the address.
    fn end(mut self) -> (Option<i32>, String) {
        let mut said = String::new();
        self.errors.read_to_string(&mut said).unwrap();
        (self.child.wait().unwrap().code(), said)
    }
}

/// What a page is told, until it is closed.
fn events(stream: BufReader<TcpStream>) -> impl Iterator<Item = Value> {
    let lines = stream.lines().map_while(Result::ok);
    lines.filter_map(|line| Some(serde_json::from_str(line.strip_prefix("data: ")?).unwrap()))
}

#[test]
fn preview_shows_states_and_at_the_end_what_view_shows_of_the_same_bytes() {
    let folder = Folder::new("preview");
    let (input, [plain, watched]) =
        (data("contact.glb"), ["plain.glb", "watched.glb"].map(|n| folder.path(n)));
    let extra = ["--samples", "4000"];
    succeed(draft(&input, &plain, &extra));
    let preview = Previewed::start(draft(&input, &watched, &extra));
    let mut told = events(preview.ask("GET /events"));
    let mut states = Vec::new();
    loop {
        let event = told.next().expect("an event");
        states.push((event["phase"].as_str().unwrap().to_owned(), event["version"].as_u64().unwrap()));
        if event["phase"] == "done" {
            break;
        }
    }
    assert!(states.is_sorted_by_key(|(_, version)| *version), "{states:?}");
    assert!(states.last().unwrap().1 >= 3, "geometry, a coarse fit, the file: {states:?}");
    // The page of the finished file, but for the figures of its report.
    let site = folder.path("site");
    succeed([
        "view".as_ref(),
        watched.as_os_str(),
        "--export".as_ref(),
        site.as_os_str(),
        "--quiet".as_ref(),
    ]);
    let mut shown: Value = serde_json::from_slice(&preview.get("/model.json")).unwrap();
    let name = |block: &Value| format!("/{}", block.as_str().unwrap());
    let blocks: Vec<Vec<u8>> =
        shown["blocks"].as_array().unwrap().iter().map(|block| preview.get(&name(block))).collect();
    let mut expected: Value =
        serde_json::from_slice(&std::fs::read(site.join("model.json")).unwrap()).unwrap();
    assert!(shown["figures"].to_string().contains("RMSE"));
    for model in [&mut shown, &mut expected] {
        let model = model.as_object_mut().unwrap();
        model.remove("figures");
        model.remove("blocks");
    }
    assert_eq!(shown, expected);
    assert!(blocks == ["geometry.bin", "light.bin"].map(|name| unpacked(&site.join(name))));
    // A page that is closed ends it.
    drop(told);
    let since = Instant::now();
    let (code, said) = preview.end();
    assert_eq!((code, said.as_str()), (Some(0), ""));
    assert!(since.elapsed() < Duration::from_secs(30));
    assert_eq!(std::fs::read(plain).unwrap(), std::fs::read(watched).unwrap());
}

#[test]
fn preview_that_nobody_looks_at_ends_by_itself() {
    let folder = Folder::new("preview-alone");
    let (input, [plain, alone]) = (data("contact.glb"), ["plain.glb", "alone.glb"].map(|n| folder.path(n)));
    succeed(draft(&input, &plain, &["--samples", "4000"]));
    let (code, said) = Previewed::start(draft(&input, &alone, &["--samples", "4000"])).end();
    assert_eq!((code, said.as_str()), (Some(0), ""));
    assert_eq!(std::fs::read(plain).unwrap(), std::fs::read(alone).unwrap());
}

/// A bake that takes minutes, over an output of before.
fn long_bake(folder: &Folder) -> Previewed {
    let output = folder.write("out.glb", "the file of before");
    let input = data("cornell.glb");
    let [bake, to] = ["bake", "-o"].map(OsStr::new);
    let rays =
        ["--quality", "final", "--signal", "lightmap", "--samples", "200000", "--quiet"].map(OsStr::new);
    let files = [bake, input.as_os_str(), to, output.as_os_str()];
    Previewed::start(files.into_iter().chain(rays).collect())
}

/// Until the samples are being traced.
fn wait_for_rays(told: &mut impl Iterator<Item = Value>) {
    for stage in ["sample", "light"] {
        assert!(told.any(|event| event["stage"] == stage), "it gets as far as {stage}");
    }
}

fn expect_cancelled(folder: &Folder, preview: Previewed) {
    let since = Instant::now();
    let (code, said) = preview.end();
    assert_eq!(code, Some(130), "{said}");
    assert!(since.elapsed() < Duration::from_secs(30), "it stops within a moment");
    let messages: Vec<&str> = said.lines().filter(|line| line.starts_with("error: ")).collect();
    assert_eq!(messages, ["error: the bake was cancelled, and nothing was written"], "{said}");
    assert_eq!(folder.names(), ["out.glb"], "no temporary file");
    assert_eq!(std::fs::read(folder.path("out.glb")).unwrap(), b"the file of before");
}

#[test]
fn cancel_from_the_page_leaves_nothing_and_tells_the_page() {
    let folder = Folder::new("preview-cancel");
    let preview = long_bake(&folder);
    let mut told = events(preview.ask("GET /events"));
    wait_for_rays(&mut told);
    let mut answer = String::new();
    preview.ask("POST /cancel").read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 202"), "{answer}");
    assert!(told.any(|event| event["phase"] == "cancelled"), "the page learns of it");
    expect_cancelled(&folder, preview);
}

#[cfg(unix)]
#[test]
fn cancel_by_interrupt_leaves_nothing() {
    let folder = Folder::new("preview-interrupt");
    let preview = long_bake(&folder);
    let mut told = events(preview.ask("GET /events"));
    wait_for_rays(&mut told);
    let pid = preview.child.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    assert!(told.any(|event| event["phase"] == "cancelled"));
    expect_cancelled(&folder, preview);
}
