//! Progress: a bar with an estimate of the time left on a terminal; elsewhere, in logs of bakes that nobody watches, a plain line now and
//! then.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use lightkiln_bake::Progress;

use crate::messages::note;

/// Time between lines of a log, and before the first one.
const PATIENCE: Duration = Duration::from_secs(5);

/// Shows the stages of a bake on the error stream.
pub struct Stages {
    bar: Option<ProgressBar>,
    log: Option<Mutex<Log>>,
}

/// What a log was told.
struct Log {
    start: Instant,
    /// When the last line came, from `start` on.
    last: Duration,
    stage: String,
}

/// Whether a log is due a line: never sooner than `PATIENCE` after the last one, and the later the rarer, so that a night
/// takes a few dozen lines.
fn is_due(now: Duration, last: Duration) -> bool {
    now.saturating_sub(last) >= PATIENCE.max(last / 10)
}

impl Log {
    fn say(&mut self, done: f32) {
        let now = self.start.elapsed();
        if is_due(now, self.last) {
            self.last = now;
            note(&format!("{} s: {}, {:.0} %", now.as_secs(), self.stage, 100.0 * done));
        }
    }
}

impl Stages {
    /// A bar on a terminal, lines elsewhere, nothing when quiet.
    pub fn new(quiet: bool) -> Self {
        let has_terminal = std::io::stderr().is_terminal();
        let bar = (!quiet && has_terminal).then(|| {
            let bar = ProgressBar::new(1000);
            if let Ok(style) =
                ProgressStyle::with_template("{msg:>10} {wide_bar} {percent:>3} % {elapsed} left {eta}")
            {
                bar.set_style(style);
            }
            bar
        });
        let log = (!quiet && !has_terminal)
            .then(|| Mutex::new(Log { start: Instant::now(), last: Duration::ZERO, stage: String::new() }));
        Self { bar, log }
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
        }
        if let Some(Ok(mut log)) = self.log.as_ref().map(Mutex::lock) {
            name.clone_into(&mut log.stage);
            log.say(0.0);
        }
    }

    fn share(&self, done: f32) {
        if let Some(bar) = &self.bar {
            bar.set_position((done * 1000.0) as u64);
        }
        if let Some(Ok(mut log)) = self.log.as_ref().map(Mutex::lock) {
            log.say(done);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_a_log_come_late_and_grow_rarer() {
        let mut lines = Vec::new();
        let mut last = Duration::ZERO;
        for now in (0..8 * 3600 * 10).map(|tenths| Duration::from_millis(100 * tenths)) {
            if is_due(now, last) {
                last = now;
                lines.push(now.as_secs());
            }
        }
        assert_eq!(lines[..3], [5, 10, 15]);
        assert!(lines.contains(&55) && lines.len() < 100, "{} lines in eight hours", lines.len());
    }
}
