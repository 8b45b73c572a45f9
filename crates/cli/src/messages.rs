//! Errors with place and remedy, and the exit codes.

use std::fmt::Write as _;
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::process::ExitCode;

/// How the program ends. The numbers are documented in the README and in `--help`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// Done.
    Done = 0,
    /// Wrong arguments.
    Usage = 1,
    /// A file cannot be read or written.
    Files = 2,
    /// The input is invalid.
    Input = 3,
    /// The bake failed.
    Failed = 4,
    /// The input needs something unsupported.
    Unsupported = 5,
    /// The error bound does not hold.
    Bound = 6,
    /// The byte budget is exceeded.
    Budget = 7,
    /// The bake was stopped before its end; as shells have it for Ctrl-C.
    Cancelled = 130,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

/// One message: what, where, what to do.
#[derive(Debug)]
pub struct Failure {
    exit: Exit,
    what: String,
    place: Option<String>,
    remedy: Option<String>,
}

impl Failure {
    /// A failure that says what is wrong.
    pub fn new(exit: Exit, what: impl Into<String>) -> Self {
        Self { exit, what: what.into(), place: None, remedy: None }
    }

    /// How the program ends.
    pub fn exit(&self) -> Exit {
        self.exit
    }

    /// What is wrong.
    pub fn what(&self) -> &str {
        &self.what
    }

    /// Adds where.
    pub fn place(mut self, place: impl Into<String>) -> Self {
        self.place = Some(place.into());
        self
    }

    /// Names the file, unless a place is known already.
    pub fn or_in(mut self, file: &Path) -> Self {
        self.place.get_or_insert_with(|| file.display().to_string());
        self
    }

    /// Adds what to do.
    pub fn remedy(mut self, remedy: impl Into<String>) -> Self {
        self.remedy = Some(remedy.into());
        self
    }

    /// A file that cannot be read.
    pub fn reading(path: &Path, error: &std::io::Error) -> Self {
        Self::new(Exit::Files, format!("cannot read {}: {error}", path.display()))
            .remedy("check the path and its permissions")
    }

    /// A file that cannot be written.
    pub fn writing(path: &Path, error: &std::io::Error) -> Self {
        Self::new(Exit::Files, format!("cannot write {}: {error}", path.display()))
            .remedy("check that the folder exists, is writable and has room")
    }
}

/// Says something on the error stream. A closed one is no reason to stop.
pub fn note(text: &str) {
    let _ = writeln!(std::io::stderr(), "lightkiln: {text}");
}

/// Prints a failure and gives its exit code.
pub fn fail(failure: &Failure) -> ExitCode {
    let mut text = format!("{} {}\n", label(), failure.what);
    if let Some(place) = &failure.place {
        let _ = writeln!(text, "  in {place}");
    }
    if let Some(remedy) = &failure.remedy {
        let _ = writeln!(text, "  help: {remedy}");
    }
    // Nothing is left to say when even the error stream is closed.
    let _ = std::io::stderr().write_all(text.as_bytes());
    failure.exit.into()
}

fn label() -> &'static str {
    let plain = std::env::var_os("NO_COLOR").is_some_and(|v| !v.is_empty())
        || std::env::var_os("TERM").is_some_and(|v| v == "dumb")
        || !std::io::stderr().is_terminal();
    if plain { "error:" } else { "\x1b[1;31merror:\x1b[0m" }
}

/// Prints what clap has to say about the arguments: help and version are no failure.
pub fn usage(error: &clap::Error) -> ExitCode {
    let _ = error.print();
    if error.use_stderr() { Exit::Usage.into() } else { Exit::Done.into() }
}
