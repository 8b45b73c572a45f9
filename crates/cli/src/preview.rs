//! `bake --preview`: the page of `view` while the bake goes on, and what stops a bake before its end.
//!
//! The page is served from the first moment, and shows the scene once it is welded, its light as soon as there is any, and
//! at the end the file that was written. Snapshots are taken on the thread that bakes, but only while a page has seen the last
//! one, and so seldom that they take no more than [`MOST_TIME`] of the bake.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use lightkiln_bake::file_light::LayerInfo;
use lightkiln_bake::stored::Encoding;
use lightkiln_bake::{Progress, Snapshot};
use lightkiln_encode::LightCode;
use lightkiln_page::{LayerModel, Live, Model, Phase};

use crate::messages::{Exit, Failure, note};
use crate::progress::Stages;
use crate::shape::{CodeSet, Shape, layer, unlit};
use crate::view::{address_of, open_in_browser, serve};

/// The largest share of a bake's time that snapshots take, about.
const MOST_TIME: f64 = 0.03;

/// Snapshots that are taken before any page is open: the welded scene and the first coarse fit, for whoever comes late.
const FIRST_SNAPSHOTS: u32 = 2;

/// How long a page may take to appear after the bake, and how long one that was closed may take to come back: a page that is
/// loaded again is away for a moment.
const FIRST_PAGE: Duration = Duration::from_secs(10);
const NEXT_PAGE: Duration = Duration::from_secs(2);

/// How long the end waits for pages to learn of it.
const LAST_WORD: Duration = Duration::from_secs(2);

/// The page of a running bake.
pub struct Preview {
    live: Arc<Live>,
    /// Of the file that will be written.
    name: String,
    pace: Mutex<Pace>,
}

/// What snapshots have cost, and what they have in common.
#[derive(Default)]
struct Pace {
    taken: u32,
    last: Option<Instant>,
    cost: Duration,
    shape: Option<Shape>,
}

impl Pace {
    /// Whether another snapshot keeps within the share of time.
    fn allows(&self) -> bool {
        self.last.is_none_or(|last| last.elapsed().as_secs_f64() * MOST_TIME >= self.cost.as_secs_f64())
    }
}

impl Preview {
    /// Serves the page, says where, and opens it where somebody sits at a screen.
    ///
    /// - `name`: of the file that will be written
    ///
    /// # Errors
    /// A port that is taken.
    pub fn open(port: u16, name: String) -> Result<Self, Failure> {
        let live = Arc::new(Live::of_bake());
        let server = serve(Arc::clone(&live), port, "the number of --preview")?;
        let address = address_of(&server)?;
        note(&format!("preview at {address}"));
        open_in_browser(&address);
        std::thread::spawn(move || server.run());
        Ok(Self { live, name, pace: Mutex::default() })
    }

    fn wants_snapshot(&self) -> bool {
        let pace = self.pace.lock().unwrap_or_else(PoisonError::into_inner);
        pace.taken < FIRST_SNAPSHOTS || self.live.wants_model() && pace.allows()
    }

    fn take(&self, snapshot: &Snapshot<'_>) {
        let mut pace = self.pace.lock().unwrap_or_else(PoisonError::into_inner);
        let begun = Instant::now();
        if pace.shape.is_none() {
            // A scene that was welded has sound attributes; looks that are faulty all the same leave no picture.
            pace.shape = Shape::new(snapshot.surface.scene, &self.name).ok();
        }
        if let Some(shape) = &pace.shape {
            self.live.publish(&model(shape, snapshot));
        }
        pace.taken += 1;
        pace.cost = begun.elapsed();
        pace.last = Some(Instant::now());
    }

    /// Shows the file that was written, and goes on until the page is closed, or for a while if there is none.
    ///
    /// - `message`: what there is to say about the file
    /// - `interrupt`: whether to end at once
    pub fn show_file(&self, model: &Model, message: &str, interrupt: &Interrupt) {
        self.live.publish(model);
        self.end(Phase::Done, message);
        let since = Instant::now();
        let is_over = || {
            interrupt.is_raised()
                || match self.live.closed_for() {
                    Some(closed) => closed > NEXT_PAGE,
                    None => self.live.pages() == 0 && since.elapsed() > FIRST_PAGE,
                }
        };
        while !is_over() {
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Tells the page why there will be no file.
    pub fn show_failure(&self, failure: &Failure) {
        let phase = if failure.exit() == Exit::Cancelled { Phase::Cancelled } else { Phase::Failed };
        self.end(phase, failure.what());
    }

    fn end(&self, phase: Phase, message: &str) {
        self.live.tell(|status| {
            status.phase = phase;
            status.share = 1.0;
            message.clone_into(&mut status.message);
        });
        self.live.wait_until_told(LAST_WORD);
    }
}

/// A model of what a bake has so far.
fn model(shape: &Shape, snapshot: &Snapshot<'_>) -> Model {
    let surface = snapshot.surface;
    let mut layers: Vec<LayerModel> = match &snapshot.light {
        Some(light) => {
            light.layers.layers.iter().map(|baked| layer(LayerInfo::new(baked, Encoding::Unit))).collect()
        }
        None => vec![LayerModel {
            channels: 1,
            range: [0.0, 1.0],
            scale: [0.0, 1.0, 0.0],
            ..LayerModel::default()
        }],
    };
    let mut sets = Vec::new();
    for (number, own) in layers.iter().enumerate() {
        let dark = [LightCode::color(1.0); 3];
        sets.push(CodeSet::of(surface, unlit(own), |t| {
            snapshot.codes(number, t).or_else(|| snapshot.vertex_codes(number, t)).unwrap_or(dark)
        }));
    }
    if snapshot.stored().is_some() {
        for (number, own) in layers.iter().enumerate() {
            sets.push(CodeSet::of(surface, unlit(own), |t| {
                snapshot.vertex_codes(number, t).unwrap_or_default()
            }));
        }
    }
    let (model, codes) = shape.lit(&sets, &[]);
    let count = layers.len();
    for (number, codes) in codes.into_iter().enumerate() {
        let own = &mut layers[number % count];
        if number < count { own.codes = codes } else { own.vertex_codes = codes }
    }
    let mut page_size = [0; 2];
    if let Some(stored) = snapshot.stored() {
        page_size = stored.size;
        for (own, stored) in layers.iter_mut().zip(&stored.layers) {
            // As the page takes them from a file: its shader knows unit values alone.
            own.bits = if stored.encoding == Encoding::Unit { stored.bits() } else { 16 };
            let unit = |page: &Vec<f32>| page.iter().map(|&texel| stored.encoding.unit(texel)).collect();
            own.pages = stored.pages.iter().map(unit).collect();
            let texels = |table: &lightkiln_encode::Table| {
                table.image().1.iter().map(|&t| f32::from(t) / 255.0).collect()
            };
            own.table = stored.table.as_ref().map(texels);
        }
    }
    Model {
        layers,
        page_size,
        texel_size: snapshot.plan.radius,
        max_error: snapshot.plan.max_error,
        is_lit: snapshot.light.is_some(),
        ..model
    }
}

/// The wish to stop, from the keyboard.
#[derive(Clone, Default)]
pub struct Interrupt {
    raised: Arc<AtomicBool>,
    /// Whether files are being written, which the first wish no longer stops.
    writing: Arc<AtomicBool>,
}

impl Interrupt {
    /// Listens to Ctrl-C from now on: the first one asks the bake to stop, the second ends the program at once.
    pub fn listen() -> Self {
        let interrupt = Self::default();
        let heard = interrupt.clone();
        // Where the system does not let us listen, Ctrl-C ends the program as it always does.
        let _ = ctrlc::set_handler(move || {
            if heard.raised.swap(true, Ordering::SeqCst) {
                std::process::exit(Exit::Cancelled as i32);
            }
            note(if heard.writing.load(Ordering::SeqCst) {
                "the file is written already; once more to end without its report"
            } else {
                "stopping; once more to end at once"
            });
        });
        interrupt
    }

    /// Whether it was wished.
    pub fn is_raised(&self) -> bool {
        self.raised.load(Ordering::SeqCst)
    }
}

/// Whoever follows a bake: the terminal, the keyboard, and a page.
pub struct Followers<'a> {
    /// Shows stages.
    pub stages: &'a Stages,
    /// Stops.
    pub interrupt: &'a Interrupt,
    /// Does both.
    pub preview: Option<&'a Preview>,
}

impl Progress for Followers<'_> {
    fn stage(&self, name: &str) {
        self.stages.stage(name);
        if name == "write" {
            self.interrupt.writing.store(true, Ordering::SeqCst);
        }
        if let Some(preview) = self.preview {
            preview.live.tell(|status| {
                name.clone_into(&mut status.stage);
                status.share = 0.0;
                if name == "write" {
                    status.phase = Phase::Verifying;
                }
            });
        }
    }

    fn share(&self, done: f32) {
        self.stages.share(done);
        if let Some(preview) = self.preview {
            preview.live.tell(|status| status.share = done);
        }
    }

    fn is_cancelled(&self) -> bool {
        self.interrupt.is_raised() || self.preview.is_some_and(|preview| preview.live.is_cancelled())
    }

    fn wants_snapshot(&self) -> bool {
        self.preview.is_some_and(Preview::wants_snapshot)
    }

    fn snapshot(&self, snapshot: &Snapshot<'_>) {
        if let Some(preview) = self.preview {
            preview.take(snapshot);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pace_keeps_snapshots_within_their_share_of_time() {
        let mut pace = Pace::default();
        assert!(pace.allows());
        let ago = |seconds| Instant::now().checked_sub(Duration::from_secs(seconds));
        pace.cost = Duration::from_secs(1);
        for (seconds, allowed) in [(0, false), (30, false), (40, true)] {
            pace.last = ago(seconds);
            assert_eq!(pace.allows(), allowed, "after {seconds} s");
        }
    }
}
