//! Stages: what a bake is doing, for a progress bar and for the report.

use std::time::Instant;

use lightkiln_report::Stage;

/// Told what a bake is doing. All methods may be called from the thread that bakes only.
pub trait Progress: Sync {
    /// A stage begins.
    fn stage(&self, name: &str);
    /// A share of the stage is done, `0..=1`.
    fn share(&self, done: f32);
}

/// Says nothing.
pub struct Silent;

impl Progress for Silent {
    fn stage(&self, _: &str) {}
    fn share(&self, _: f32) {}
}

/// Times stages; a stage that comes up again adds to its time.
pub struct Clock<'a> {
    progress: &'a dyn Progress,
    stages: Vec<Stage>,
    running: Option<(usize, Instant)>,
}

impl<'a> Clock<'a> {
    /// A clock that tells `progress`.
    pub fn new(progress: &'a dyn Progress) -> Self {
        Self { progress, stages: Vec::new(), running: None }
    }

    /// Ends the running stage and begins another.
    pub fn stage(&mut self, name: &str) {
        self.stop();
        self.progress.stage(name);
        let at = self.stages.iter().position(|s| s.name == name).unwrap_or_else(|| {
            self.stages.push(Stage { name: name.to_owned(), seconds: 0.0 });
            self.stages.len() - 1
        });
        self.running = Some((at, Instant::now()));
    }

    /// Tells how much of the running stage is done.
    pub fn share(&self, done: f32) {
        self.progress.share(done);
    }

    fn stop(&mut self) {
        if let Some((at, since)) = self.running.take() {
            self.stages[at].seconds += since.elapsed().as_secs_f64();
        }
    }

    /// Ends the running stage and returns all of them, in the order in which they first began.
    pub fn finish(mut self) -> Vec<Stage> {
        self.stop();
        self.stages
    }
}
