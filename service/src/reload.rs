//! Another model for a running service: opened beside the old one on a thread of its own, taken into use between two frames.
//!
//! The loop starts that thread and looks once per tick whether it is done. What takes long (reading, checking, warming,
//! and letting go of the old model) happens on the thread; the loop only exchanges two values. While both models are there,
//! both take memory.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};

use kinds_messages::{ReloadAnswer, ReloadDesk, SensorName};
use kinds_model::SensorLayout;

use crate::Classify;
use crate::refusal::is_same_sensor;

/// Opens a model by its path and makes it ready for the first frame, or says in words why it cannot. Called on a thread of
/// its own, beside the service's loop.
pub type OpenModel<C> = dyn Fn(&Path) -> Result<C, String> + Send + Sync;

/// Where a running service gets its next models from.
pub(crate) struct Reloads<C> {
    desk: ReloadDesk,
    /// Set to ask for the model in use to be read again.
    asked: Arc<AtomicBool>,
    /// The file of the model in use.
    path: PathBuf,
    start: Box<StartThread<C>>,
    opening: Option<Opening<C>>,
}

/// Starts a thread that opens a model.
type StartThread<C> = dyn Fn(&Path) -> io::Result<Thread<C>>;

/// A model that is being opened.
struct Opening<C> {
    /// Number of the request, if it was one.
    request: Option<u64>,
    path: PathBuf,
    thread: Thread<C>,
}

/// The loop's ends of what a thread opens and lets go.
struct Thread<C> {
    opened: Receiver<Result<C, String>>,
    replaced: SyncSender<C>,
}

/// A model that was asked for, or why it cannot be had.
pub(crate) struct Opened<C> {
    /// Number of the request, if it was one.
    pub(crate) request: Option<u64>,
    pub(crate) path: PathBuf,
    /// The classifier, and where the old one goes.
    pub(crate) result: Result<(C, Replaced<C>), String>,
}

/// Where a classifier goes that is no longer in use, so that the loop need not let go of all its memory.
pub(crate) struct Replaced<C>(SyncSender<C>);

impl<C> Replaced<C> {
    pub(crate) fn take(self, old: C) {
        // The thread waits for it. If it does not, the old one goes here and now.
        let _ = self.0.try_send(old);
    }
}

impl<C: Classify + Send + 'static> Reloads<C> {
    /// * `layout` — the sensor that is served: models of others are refused
    pub(crate) fn new(
        desk: ReloadDesk,
        path: &Path,
        layout: SensorLayout,
        open: Arc<OpenModel<C>>,
        asked: Arc<AtomicBool>,
    ) -> Self {
        let start = move |path: &Path| start(Arc::clone(&open), path.to_path_buf(), layout);
        Self { desk, asked, path: path.to_path_buf(), start: Box::new(start), opening: None }
    }
}

fn start<C: Classify + Send + 'static>(
    open: Arc<OpenModel<C>>,
    path: PathBuf,
    layout: SensorLayout,
) -> io::Result<Thread<C>> {
    let (opened_here, opened) = sync_channel(1);
    let (replaced, replaced_here) = sync_channel(1);
    let thread = std::thread::Builder::new().name("kinds-reload".to_string());
    thread.spawn(move || {
        let checked = open(&path).and_then(|classifier| {
            let found = classifier.layout();
            match is_same_sensor(found, layout) {
                true => Ok(classifier),
                false => Err(format!(
                    "model {} is for {found}, this service is for {layout}; give it a model that was trained on this sensor",
                    path.display()
                )),
            }
        });
        // The loop may have ended meanwhile, and then takes nothing and gives nothing back.
        let _ = opened_here.send(checked);
        drop(replaced_here.recv());
    })?;
    Ok(Thread { opened, replaced })
}

impl<C> Reloads<C> {
    /// Starts to open a model if one is asked for, and hands out the one that is ready. One at a time: who asks meanwhile
    /// waits.
    pub(crate) fn look(&mut self, sensor: &SensorName) -> Option<Opened<C>> {
        match self.opening.take() {
            Some(opening) => match opening.thread.opened.try_recv() {
                Err(TryRecvError::Empty) => {
                    self.opening = Some(opening);
                    None
                }
                received => {
                    let Opening { request, path, thread } = opening;
                    let result = received.unwrap_or_else(|_| Err(gave_up(&path)));
                    let result = result.map(|classifier| (classifier, Replaced(thread.replaced)));
                    Some(Opened { request, path, result })
                }
            },
            None => {
                let (request, path) = self.next_request(sensor)?;
                match (self.start)(&path) {
                    Ok(thread) => {
                        self.opening = Some(Opening { request, path, thread });
                        None
                    }
                    Err(error) => {
                        let result =
                            Err(format!("cannot start a thread to open {}: {error}", path.display()));
                        Some(Opened { request, path, result })
                    }
                }
            }
        }
    }

    /// The file that is asked for, and the number of the request if it was one.
    fn next_request(&self, sensor: &SensorName) -> Option<(Option<u64>, PathBuf)> {
        if self.asked.swap(false, Ordering::Relaxed) {
            return Some((None, self.path.clone()));
        }
        match self.desk.receive() {
            Ok(request) => {
                let request = request?;
                Some((Some(request.id), request.path().unwrap_or(&self.path).to_path_buf()))
            }
            // Whoever asks in another way than ours gets no answer, and is no reason to stop serving.
            Err(error) => {
                tracing::warn!(%sensor, "cannot take a request for another model: {error}");
                None
            }
        }
    }

    /// Tells whoever asked, and the log, what came of it.
    ///
    /// * `exchanged` — the models' identities, before and now, or why there is no exchange
    pub(crate) fn answer(
        &mut self,
        sensor: &SensorName,
        request: Option<u64>,
        path: PathBuf,
        exchanged: Result<[String; 2], String>,
    ) {
        let (is_taken, words) = match exchanged {
            Ok([before, now]) if before == now => (
                true,
                format!("{sensor} is served by model {now} as before, read again from {}", path.display()),
            ),
            Ok([before, now]) => (
                true,
                format!("{sensor} is now served by model {now} of {}, before by {before}", path.display()),
            ),
            Err(why) => (false, format!("{why}; {sensor} is served by the model that it has")),
        };
        if is_taken {
            self.path = path;
            tracing::info!(%sensor, "{words}");
        } else {
            tracing::warn!(%sensor, "{words}");
        }
        if let Some(id) = request
            && let Err(error) = self.desk.answer(&ReloadAnswer::new(id, is_taken, &words))
        {
            tracing::warn!(%sensor, "cannot answer who asked for another model: {error}");
        }
    }
}

/// The thread ended without a word: its panic has been told on standard error.
fn gave_up(path: &Path) -> String {
    format!("opening {} failed inside this program", path.display())
}
