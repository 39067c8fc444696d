//! Recording session: the current recording, if any. It can be started, paused, split and stopped from any thread.

use std::{
    path::PathBuf,
    sync::{
        Arc, Mutex, PoisonError, RwLock,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
};

use super::{new_folder, times::Times};
use crate::{
    bag::{self, BagError, Recorder, RecorderHandle, RecorderTopic, Writer, WriterOptions},
    msg::{cdr, rosgraph_msgs},
    nodes::topics,
    ros::{Node, RawSample},
};

/// The current recording and the options for new ones.
pub struct RecordingSession {
    node: Node,
    options: WriterOptions,
    queue: usize,
    times: Times,
    /// Full name of `/clock` after remapping; `None` if that name is invalid.
    clock_topic: Option<String>,
    paused: AtomicBool,
    /// Number of recordings started so far.
    begun: AtomicU64,
    current: RwLock<Option<Recorder>>,
}

impl RecordingSession {
    /// A session without a recording.
    pub fn new(node: &Node, options: WriterOptions, queue: usize, paused: bool) -> Self {
        Self {
            node: node.clone(),
            options,
            queue,
            times: Times::new(node.clock().clone()),
            clock_topic: node.resolve_topic(topics::CLOCK.name).ok(),
            paused: AtomicBool::new(paused),
            begun: AtomicU64::new(0),
            current: RwLock::new(None),
        }
    }

    /// Starts a recording in `folder`, or, without a folder, in a new folder in `bags/`.
    ///
    /// # Errors
    /// If a recording is in progress, or the folder cannot be created.
    pub fn begin(&self, folder: Option<PathBuf>) -> Result<(), String> {
        let mut current = self.current.write().unwrap_or_else(PoisonError::into_inner);
        if let Some(recorder) = current.as_ref() {
            return Err(format!(
                "a recording to {} is in progress; stop it first",
                recorder.handle().folder().display()
            ));
        }
        let folder = folder.unwrap_or_else(|| new_folder("rosbag2"));
        let start = |writer| Recorder::with_queue(writer, self.queue);
        let recorder = Writer::create(&folder, self.options).and_then(start);
        *current = Some(recorder.map_err(|e: BagError| e.to_string())?);
        self.begun.fetch_add(1, Ordering::Release);
        tracing::info!("recording to {}", folder.display());
        Ok(())
    }

    /// Stops the recording and logs its contents. Returns `false` if there was none.
    ///
    /// # Errors
    /// The error that made writing fail, if any.
    pub fn end(&self) -> Result<bool, BagError> {
        let mut current = self.current.write().unwrap_or_else(PoisonError::into_inner);
        let Some(recorder) = current.take() else {
            return Ok(false);
        };
        drop(current);
        self.times.begin(self.node.now());
        let handle = recorder.handle();
        let finished = recorder.finish();
        for (topic, dropped) in handle.status().dropped_topics {
            tracing::warn!(
                "{topic}: {dropped} messages were dropped: the disk was too slow or full"
            );
        }
        let recording = finished?;
        let path = recording.path.display();
        tracing::info!("{path}: {} messages", recording.messages);
        Ok(true)
    }

    /// Number of recordings started so far.
    pub fn begun(&self) -> u64 {
        self.begun.load(Ordering::Acquire)
    }

    /// A handle for enqueuing messages, if a recording is in progress.
    pub fn handle(&self) -> Option<RecorderHandle> {
        let current = self.current.read().unwrap_or_else(PoisonError::into_inner);
        current.as_ref().map(Recorder::handle)
    }

    /// Whether recording is paused.
    pub fn is_paused(&self) -> bool {
        self.paused.load(Ordering::Acquire)
    }

    /// Pauses or resumes recording.
    pub fn pause(&self, paused: bool) {
        let before = self.paused.swap(paused, Ordering::AcqRel);
        if before != paused {
            tracing::info!(
                "{}",
                if paused {
                    "paused"
                } else {
                    "recording resumed"
                }
            );
        }
    }

    /// A sink for the samples of a topic.
    pub fn sink(self: &Arc<Self>, topic: bag::Topic) -> Sink {
        Sink {
            session: Arc::clone(self),
            is_clock: self.clock_topic.as_ref() == Some(&topic.name),
            topic,
            entry: Mutex::default(),
        }
    }
}

/// Records the samples of one topic.
pub struct Sink {
    session: Arc<RecordingSession>,
    is_clock: bool,
    topic: bag::Topic,
    /// Number of the recording, and the topic's entry in its bag. Added with the first message, so that a bag does not
    /// list topics without messages; `None` if the bag has another type for the topic.
    entry: Mutex<(u64, Option<Arc<RecorderTopic>>)>,
}

impl Sink {
    /// Records a sample; ignores it if no recording is in progress.
    pub fn take(&self, sample: RawSample) {
        if self.session.is_paused() {
            return;
        }
        let Some(handle) = self.session.handle() else {
            return;
        };
        let mut entry = self.entry.lock().unwrap_or_else(PoisonError::into_inner);
        let begun = self.session.begun();
        if entry.0 != begun {
            let added = handle.add_topic(self.topic.clone());
            *entry = (begun, added.map_err(|e| tracing::error!("{e}")).ok());
        }
        let Some(topic) = &entry.1 else { return };
        if self.is_clock
            && let Ok(clock) = cdr::decode::<rosgraph_msgs::Clock>(&sample.cdr)
        {
            let times = &self.session.times;
            times.advance(clock.clock.into(), sample.publisher);
        }
        self.session.times.write(&handle, topic, sample);
    }
}
