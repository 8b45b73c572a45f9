//! Progress: a bar with an estimate of the time left on a terminal, one plain line a stage elsewhere.

use std::io::IsTerminal;
use std::sync::Mutex;

use indicatif::{ProgressBar, ProgressStyle};
use lightkiln_bake::Progress;

use crate::messages::note;

/// Shows the stages of a bake on the error stream.
pub struct Stages {
    bar: Option<ProgressBar>,
    last: Mutex<String>,
    quiet: bool,
}

impl Stages {
    /// A bar on a terminal, lines elsewhere, nothing when quiet.
    pub fn new(quiet: bool) -> Self {
        let bar = (!quiet && std::io::stderr().is_terminal()).then(|| {
            let bar = ProgressBar::new(1000);
            if let Ok(style) =
                ProgressStyle::with_template("{msg:>10} {wide_bar} {percent:>3} % {elapsed} left {eta}")
            {
                bar.set_style(style);
            }
            bar
        });
        Self { bar, last: Mutex::new(String::new()), quiet }
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl Progress for Stages {
    fn stage(&self, name: &str) {
        if let Some(bar) = &self.bar {
            bar.set_message(name.to_owned());
            bar.reset();
        } else if !self.quiet {
            let Ok(mut last) = self.last.lock() else { return };
            if *last != name {
                note(name);
                name.clone_into(&mut last);
            }
        }
    }

    fn share(&self, done: f32) {
        if let Some(bar) = &self.bar {
            bar.set_position((done * 1000.0) as u64);
        }
    }
}
