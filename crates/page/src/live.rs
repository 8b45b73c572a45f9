//! A site that changes while somebody looks at it: the preview of a bake.
//!
//! A page asks for [`EVENTS`] once and is told from then on what the bake is doing, as server-sent events; with every new
//! version of the model it fetches `model.json` again, and the blocks that it names. Who is so slow that a block is gone
//! meanwhile is told so, and begins again. While events flow the page counts as open. [`CANCEL`] asks the bake to stop.

use std::io::Write;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde::Serialize;

use crate::model::Model;
use crate::site::{File, Laid, Site, version_of};

/// Path of the stream of events.
pub const EVENTS: &str = "/events";

/// Path that takes the wish to stop.
pub const CANCEL: &str = "/cancel";

/// How a bake stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// It can be cancelled.
    #[default]
    Baking,
    /// The file is there and its errors are being measured.
    Verifying,
    /// The page shows the file as it was written.
    Done,
    /// It was stopped, and nothing was written.
    Cancelled,
    /// It ended with an error.
    Failed,
}

/// What a page is told.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Status {
    /// How the bake stands.
    pub phase: Phase,
    /// The running stage.
    pub stage: String,
    /// How much of it is done, `0..=1`.
    pub share: f32,
    /// Number of the model, 0 before the first.
    pub version: u32,
    /// More about the phase, in words.
    pub message: String,
}

/// A site, and what pages of it are told.
pub struct Live {
    state: Mutex<State>,
    changed: Condvar,
    /// Whether there is anything to tell.
    follows: bool,
}

#[derive(Default)]
struct State {
    site: Site,
    status: Status,
    /// Counts changes of the status.
    change: u64,
    /// Open pages.
    pages: usize,
    /// Of these, those that do not know the last change yet.
    behind: usize,
    /// Whether any page has asked for the light of the last version.
    seen: bool,
    /// When the last page was closed.
    closed: Option<Instant>,
    /// Answers that are on their way.
    answering: usize,
    cancelled: bool,
}

/// Silence after which a stream says something, so that a page that went away is noticed.
const PULSE: Duration = Duration::from_millis(500);

impl Live {
    /// A site that stays as it is.
    pub fn still(site: Site) -> Self {
        Self {
            state: Mutex::new(State { site, ..State::default() }),
            changed: Condvar::new(),
            follows: false,
        }
    }

    /// The page of a bake that has only begun.
    pub fn of_bake() -> Self {
        let state = State { site: Site::of_bake(), ..State::default() };
        Self { state: Mutex::new(state), changed: Condvar::new(), follows: true }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // Whoever panicked meanwhile left nothing half done.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn change(&self, change: impl FnOnce(&mut State)) {
        let mut state = self.state();
        let before = state.status.clone();
        change(&mut state);
        if state.status != before {
            state.change += 1;
            state.behind = state.pages;
            self.changed.notify_all();
        }
    }

    /// Changes what pages are told, but for the version.
    pub fn tell(&self, tell: impl FnOnce(&mut Status)) {
        self.change(|state| {
            let version = state.status.version;
            tell(&mut state.status);
            state.status.version = version;
        });
    }

    /// Shows another model from now on. A geometry that is shown already is neither packed nor sent again.
    pub fn publish(&self, model: &Model) {
        let (version, shown) = {
            let state = self.state();
            (state.status.version + 1, state.site.shown(&model.geometry))
        };
        let geometry = shown.unwrap_or_else(|| Laid::new(&model.geometry, false, version));
        let light = model.pack();
        self.change(|state| {
            state.site.put_model(geometry, light, version);
            state.seen = false;
            state.status.version = version;
        });
    }

    /// Whether a page has asked the bake to stop.
    pub fn is_cancelled(&self) -> bool {
        self.state().cancelled
    }

    /// How many pages are open.
    pub fn pages(&self) -> usize {
        self.state().pages
    }

    /// Whether a page is open and has asked for the last version, so that another one has somebody to see it.
    pub fn wants_model(&self) -> bool {
        let state = self.state();
        state.pages > 0 && state.seen
    }

    /// For how long no page has been open; none while one is, or if there was none ever.
    pub fn closed_for(&self) -> Option<Duration> {
        let state = self.state();
        state.closed.filter(|_| state.pages == 0).map(|since| since.elapsed())
    }

    /// Waits until all open pages know the last change and no answer is cut off, or for that long.
    pub fn wait_until_told(&self, patience: Duration) {
        let until = Instant::now() + patience;
        let mut state = self.state();
        while state.behind > 0 && state.pages > 0 || state.answering > 0 {
            let Some(left) = until.checked_duration_since(Instant::now()) else { return };
            state = self.changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// The file at a path, which a page asks for.
    pub(crate) fn file(&self, path: &str) -> Option<Arc<File>> {
        let mut state = self.state();
        state.seen |= state.site.shows(path);
        state.site.at(path).cloned()
    }

    /// Whether a path names a block that later versions have taken the place of.
    pub(crate) fn is_past(&self, path: &str) -> bool {
        let state = self.state();
        version_of(path).is_some_and(|version| version <= state.status.version)
            && state.site.at(path).is_none()
    }

    /// Whether a path takes events or wishes here.
    pub(crate) fn takes(&self, path: &str, own: &str) -> bool {
        self.follows && path == own
    }

    /// A page has asked the bake to stop.
    pub(crate) fn cancel(&self) {
        self.state().cancelled = true;
    }

    /// Sends an answer that has an end.
    pub(crate) fn answer<T>(&self, send: impl FnOnce() -> T) -> T {
        self.state().answering += 1;
        let sent = send();
        self.state().answering -= 1;
        self.changed.notify_all();
        sent
    }

    /// Tells one page everything, until it goes away.
    pub(crate) fn stream(&self, mut page: impl Write) -> std::io::Result<()> {
        {
            let mut state = self.state();
            state.pages += 1;
            state.behind += 1;
        }
        let ended = self.tell_page(&mut page);
        let mut state = self.state();
        state.pages -= 1;
        state.behind = state.behind.min(state.pages);
        state.closed = Some(Instant::now());
        self.changed.notify_all();
        ended
    }

    fn tell_page(&self, page: &mut impl Write) -> std::io::Result<()> {
        let mut known = None;
        loop {
            let (change, status) = {
                let state = self.state();
                let is_known = |s: &mut State| known == Some(s.change);
                let waited = self.changed.wait_timeout_while(state, PULSE, is_known);
                let state = waited.unwrap_or_else(PoisonError::into_inner).0;
                (state.change, state.status.clone())
            };
            if known == Some(change) {
                page.write_all(b":\n\n")?;
                page.flush()?;
                continue;
            }
            let json = serde_json::to_string(&status).expect("plain numbers and strings");
            write!(page, "data: {json}\n\n")?;
            page.flush()?;
            let mut state = self.state();
            if state.change == change {
                state.behind = state.behind.saturating_sub(1);
                self.changed.notify_all();
            }
            known = Some(change);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, Sender, channel};

    use super::*;
    use crate::model::testing::model;

    /// A page whose connection breaks once nobody listens.
    struct Page(Sender<String>);

    impl Write for Page {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            let text = String::from_utf8_lossy(bytes).into_owned();
            self.0.send(text).map_err(|_| std::io::ErrorKind::BrokenPipe)?;
            Ok(bytes.len())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    fn open(live: &Arc<Live>) -> Receiver<String> {
        let (sender, receiver) = channel();
        let live = Arc::clone(live);
        std::thread::spawn(move || live.stream(Page(sender)));
        receiver
    }

    /// The next event with some text in it.
    fn wait_for(page: &Receiver<String>, text: &str) {
        let mut said = String::new();
        while !said.contains(text) {
            said += &page.recv_timeout(Duration::from_secs(20)).expect("an event in time");
        }
    }

    #[test]
    fn live_tells_stages_versions_and_the_end() {
        let live = Arc::new(Live::of_bake());
        assert!(live.file("/model.json").is_none() && live.file("/").is_some());
        live.tell(|status| status.stage = "weld".to_owned());
        let page = open(&live);
        wait_for(&page, r#""phase":"baking","stage":"weld","share":0.0,"version":0"#);
        assert_eq!(live.pages(), 1);
        live.publish(&model());
        wait_for(&page, r#""version":1"#);
        live.tell(|status| status.phase = Phase::Cancelled);
        live.wait_until_told(Duration::from_secs(20));
        wait_for(&page, r#""phase":"cancelled""#);
        assert!(live.closed_for().is_none());
        drop(page);
        let since = Instant::now();
        while live.closed_for().is_none() {
            assert!(since.elapsed() < Duration::from_secs(20), "a closed page is noticed");
            std::thread::sleep(Duration::from_millis(10));
        }
        assert_eq!(live.pages(), 0);
        live.wait_until_told(Duration::from_secs(20));
    }

    #[test]
    fn live_wants_the_next_model_when_the_last_one_is_asked_for() {
        let live = Arc::new(Live::of_bake());
        let page = open(&live);
        wait_for(&page, r#""version":0"#);
        for version in 1..=3 {
            live.publish(&model());
            assert!(!live.wants_model(), "nobody has seen version {version}");
            assert!(live.file("/model.json").is_some() && !live.wants_model());
            assert!(live.file(&format!("/light-{version}.bin")).is_some() && live.wants_model());
        }
        assert!(live.file("/light-2.bin").is_some(), "for whoever has read its name already");
        let past = [
            "/light-1.bin",
            "/light-2.bin",
            "/light-4.bin",
            "/light-0.bin",
            "/light-.bin",
            "/light-1",
            "/index.html",
        ];
        assert_eq!(past.map(|path| live.is_past(path)), [true, false, false, false, false, false, false]);
    }

    #[test]
    fn live_cuts_no_answer_off_at_the_end() {
        let live = Arc::new(Live::of_bake());
        let (begun, is_begun) = channel();
        let (go_on, goes_on) = channel::<()>();
        let answers = Arc::clone(&live);
        let answer = std::thread::spawn(move || {
            answers.answer(|| {
                begun.send(()).expect("heard");
                goes_on.recv().expect("told to go on");
            });
        });
        is_begun.recv().expect("an answer");
        let since = Instant::now();
        live.wait_until_told(Duration::from_millis(50));
        assert!(since.elapsed() >= Duration::from_millis(50), "it is waited for, and not for ever");
        go_on.send(()).expect("heard");
        live.wait_until_told(Duration::from_secs(20));
        answer.join().expect("sent");
        assert!(since.elapsed() < Duration::from_secs(20), "its end is noticed");
    }

    #[test]
    fn live_keeps_the_blocks_of_the_version_before() {
        let live = Live::of_bake();
        let blocks = || -> Vec<String> {
            let json: serde_json::Value =
                serde_json::from_slice(&live.file("/model.json").expect("there").bytes).expect("JSON");
            let names = json["blocks"].as_array().expect("blocks").iter();
            names.map(|name| format!("/{}", name.as_str().expect("a name"))).collect()
        };
        let there =
            |blocks: &[String]| -> Vec<bool> { blocks.iter().map(|b| live.file(b).is_some()).collect() };
        // The same geometry twice, and another one twice.
        let (first, second) = (model(), model());
        let [a, b, c, d] = [&first, &first, &second, &second].map(|model| {
            live.publish(model);
            blocks()
        });
        assert!(a[0] == b[0] && b[0] != c[0] && c[0] == d[0] && a[1] != b[1]);
        assert_eq!([&a, &b, &c, &d].map(|blocks| there(blocks)[1]), [false, false, true, true]);
        assert_eq!((there(&b)[0], there(&d)), (false, vec![true, true]));
    }
}
