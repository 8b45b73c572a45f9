//! What whole-program tests share: a folder of their own, a way to run the program, and a small scene to alter.
#![allow(dead_code, clippy::print_stdout)] // each test file uses a part of it

pub mod room;
pub mod shown;

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

/// The repository's root.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().expect("the repository is there")
}

/// One of the small scenes that are checked in.
pub fn data(name: &str) -> PathBuf {
    root().join("data").join(name)
}

/// Real scenes beside the repository, where somebody put them.
pub fn shared_scene(name: &str) -> Option<PathBuf> {
    let path = root().join("../shared/scenes").join(name);
    if !path.exists() {
        println!("{name} is not beside the repository: skipped");
        return None;
    }
    Some(path)
}

/// An empty folder that goes away with the value.
pub struct Folder(PathBuf);

impl Folder {
    /// A new folder; `name` tells tests of one process apart.
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("lightkiln-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).expect("the temporary folder is writable");
        Self(path)
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// A new file in the folder.
    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, bytes).expect("the folder is writable");
        path
    }

    /// Names of the files in the folder, sorted.
    pub fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = std::fs::read_dir(&self.0)
            .expect("the folder is there")
            .map(|entry| entry.expect("readable").file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The program, not yet started.
pub fn command<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightkiln"));
    command.args(arguments);
    command
}

/// The arguments of a bake in draft quality, without progress.
pub fn draft<'a>(input: &'a Path, output: &'a Path, extra: &[&'a str]) -> Vec<&'a OsStr> {
    let mut arguments: Vec<&OsStr> =
        ["bake".as_ref(), input.as_os_str(), "-o".as_ref(), output.as_os_str()].into();
    arguments.extend(["--quality", "draft", "--quiet"].map(OsStr::new));
    arguments.extend(extra.iter().map(|&argument| OsStr::new(argument)));
    arguments
}

/// Runs the program.
pub fn lightkiln<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Output {
    command(arguments).output().expect("the program starts")
}

/// Runs the program and expects it to succeed; gives back what it printed.
pub fn succeed<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> String {
    let output = lightkiln(arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

/// Runs the program and expects an exit code; gives back what it said: one message.
pub fn fail<S: AsRef<OsStr>>(code: i32, arguments: impl IntoIterator<Item = S>) -> String {
    let output = lightkiln(arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{said}");
    let messages = said.lines().filter(|line| line.starts_with("error: ")).count();
    assert_eq!(messages, 1, "{said}");
    said
}

/// Bakes a scene in draft quality with extra arguments, and gives back its report.
pub fn bake(input: &Path, output: &Path, extra: &[&str]) -> Value {
    let mut arguments = draft(input, output, extra);
    arguments.push("--json".as_ref());
    serde_json::from_str(&succeed(arguments)).expect("a report")
}

/// Bakes where the bound may not hold (6), because so few samples miss small shadows, which is not what is asked.
pub fn bake_anyhow(input: &Path, output: &Path, extra: &[&str]) -> Value {
    let mut arguments = draft(input, output, extra);
    arguments.push("--json".as_ref());
    let run = lightkiln(arguments);
    let said = String::from_utf8_lossy(&run.stderr);
    assert!(matches!(run.status.code(), Some(0 | 6)), "{said}");
    serde_json::from_slice(&run.stdout).expect("a report")
}

/// Verifies a baked file by its own recipe.
pub fn verify(path: &Path) {
    succeed(["verify".as_ref(), path.as_os_str(), "--points".as_ref(), "500".as_ref(), "--quiet".as_ref()]);
}

/// The JSON and the binary chunk of a `.glb`.
pub fn glb_parts(bytes: &[u8]) -> (Value, Vec<u8>) {
    let length = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("4 bytes")) as usize;
    let json = length(12);
    let value = serde_json::from_slice(&bytes[20..20 + json]).expect("JSON");
    (value, bytes[28 + json..28 + json + length(20 + json)].to_vec())
}

/// A `.glb` of JSON and a binary chunk.
pub fn glb(json: &Value, binary: &[u8]) -> Vec<u8> {
    let mut text = serde_json::to_vec(json).expect("JSON");
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    let padded = binary.len().next_multiple_of(4);
    bytes.extend(((28 + text.len() + padded) as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", text.as_slice()), (b"BIN\0", binary)] {
        bytes.extend((chunk.len().next_multiple_of(4) as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
        bytes.resize(bytes.len().next_multiple_of(4), 0);
    }
    bytes
}

/// What is in a file that is compressed with gzip.
pub fn unpacked(path: &Path) -> Vec<u8> {
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).expect("there");
    std::io::Read::read_to_end(&mut flate2::read::GzDecoder::new(file), &mut bytes).expect("gzip");
    bytes
}
