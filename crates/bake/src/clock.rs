//! Stages: what a bake is doing, for a progress bar, for whoever watches it, and for the report; and the way to stop it.

use std::time::Instant;

use lightkiln_light::{Layer, Signal};
use lightkiln_mesh::SurfacePoint;
use lightkiln_report::Stage;

use crate::BakeError;
use crate::snapshot::Snapshot;

/// Told what a bake is doing, and asked whether it should go on. All methods but [`Progress::is_cancelled`] are called from
/// the thread that bakes only.
pub trait Progress: Sync {
    /// A stage begins.
    fn stage(&self, name: &str);

    /// A share of the stage is done, `0..=1`.
    fn share(&self, done: f32);

    /// Whether the bake should stop with [`BakeError::Cancelled`]. Any thread may ask, before every few rays. Once the
    /// output is being written the bake goes on to its end all the same.
    fn is_cancelled(&self) -> bool {
        false
    }

    /// Whether a snapshot is welcome now.
    fn wants_snapshot(&self) -> bool {
        false
    }

    /// What the file would show if the bake ended now; only after [`Self::wants_snapshot`] has said yes. It changes nothing
    /// about the result.
    fn snapshot(&self, _: &Snapshot<'_>) {}
}

/// Says nothing, and never stops anything.
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
    committed: bool,
}

impl<'a> Clock<'a> {
    /// A clock that tells `progress`.
    pub fn new(progress: &'a dyn Progress) -> Self {
        Self { progress, stages: Vec::new(), running: None, committed: false }
    }

    /// Ends the running stage and begins another.
    ///
    /// # Errors
    /// As [`Self::go_on`].
    pub fn stage(&mut self, name: &str) -> Result<(), BakeError> {
        self.go_on()?;
        self.stop();
        self.progress.stage(name);
        let at = self.stages.iter().position(|s| s.name == name).unwrap_or_else(|| {
            self.stages.push(Stage { name: name.to_owned(), seconds: 0.0 });
            self.stages.len() - 1
        });
        self.running = Some((at, Instant::now()));
        Ok(())
    }

    /// Tells how much of the running stage is done.
    pub fn share(&self, done: f32) {
        self.progress.share(done);
    }

    /// Asks whether to go on.
    ///
    /// # Errors
    /// [`BakeError::Cancelled`] when the bake is to stop and nothing is being written yet.
    pub fn go_on(&self) -> Result<(), BakeError> {
        if self.is_cancelled() { Err(BakeError::Cancelled) } else { Ok(()) }
    }

    fn is_cancelled(&self) -> bool {
        !self.committed && self.progress.is_cancelled()
    }

    /// From here on files appear, and the bake is no longer stopped.
    pub fn commit(&mut self) {
        self.committed = true;
    }

    /// Whether a snapshot is welcome now.
    pub fn wants_snapshot(&self) -> bool {
        self.progress.wants_snapshot()
    }

    /// Shows a snapshot to those who want one.
    pub fn show(&self, snapshot: &Snapshot<'_>) {
        if self.wants_snapshot() {
            self.progress.snapshot(snapshot);
        }
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

/// A signal that traces no more rays once the bake is to stop, so that nobody waits for the rest of a million points. What
/// it gives then is worthless, and [`Clock::go_on`] says so.
pub(crate) struct Stoppable<'a> {
    pub signal: &'a dyn Signal,
    pub clock: &'a Clock<'a>,
}

impl Signal for Stoppable<'_> {
    fn layers(&self) -> &[Layer] {
        self.signal.layers()
    }

    fn rays_per_batch(&self) -> u32 {
        self.signal.rays_per_batch()
    }

    fn batch(&self, point: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32 {
        if self.clock.is_cancelled() {
            out.fill(0.0);
            return 0.0;
        }
        self.signal.batch(point, key, batch, out)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use lightkiln_light::Estimates;
    use lightkiln_mesh::TriangleId;

    use super::*;
    use crate::shade::refine;

    /// Is to stop after some questions.
    struct Patience(AtomicUsize);

    impl Progress for Patience {
        fn stage(&self, _: &str) {}
        fn share(&self, _: f32) {}
        fn is_cancelled(&self) -> bool {
            self.0.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |left| left.checked_sub(1)).is_err()
        }
    }

    /// Counts its batches.
    struct Counted(Vec<Layer>, AtomicUsize);

    impl Signal for Counted {
        fn layers(&self) -> &[Layer] {
            &self.0
        }
        fn rays_per_batch(&self) -> u32 {
            16
        }
        fn batch(&self, _: SurfacePoint, _: u64, _: u32, out: &mut [f32]) -> f32 {
            self.1.fetch_add(1, Ordering::SeqCst);
            out.fill(1.0);
            0.0
        }
    }

    #[test]
    fn clock_stops_between_stages_and_no_more_once_it_is_committed() {
        let progress = Patience(AtomicUsize::new(1));
        let mut clock = Clock::new(&progress);
        assert!(clock.stage("one").is_ok());
        assert!(matches!(clock.stage("two"), Err(BakeError::Cancelled)));
        clock.commit();
        assert!(clock.stage("three").is_ok() && clock.go_on().is_ok());
        let stages: Vec<String> = clock.finish().into_iter().map(|s| s.name).collect();
        assert_eq!(stages, ["one", "three"]);
    }

    #[test]
    fn refine_that_is_stopped_traces_no_more_rays_and_says_so() {
        let points = vec![SurfacePoint { triangle: TriangleId(0), barycentric: [0.2, 0.2] }; 1000];
        let keys: Vec<u64> = (0..1000).collect();
        let trace = |patience: usize| {
            let progress = Patience(AtomicUsize::new(patience));
            let signal = Counted(vec![Layer::scalar("occlusion")], AtomicUsize::new(0));
            let mut estimates = Estimates::new(1000, 1);
            let refined =
                refine(&mut estimates, &signal, &points, &keys, &vec![3; 1000], &Clock::new(&progress));
            (refined, signal.1.into_inner())
        };
        assert!(matches!(trace(500), (Err(BakeError::Cancelled), 500)));
        assert!(matches!(trace(usize::MAX), (Ok(()), 3000)));
    }
}
