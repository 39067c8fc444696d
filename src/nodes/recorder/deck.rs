//! The recording that goes on, if one does: begun, paused, split and ended from any thread.

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

/// What records, and what it was told.
pub struct Deck {
    node: Node,
    options: WriterOptions,
    queue: usize,
    times: Times,
    paused: AtomicBool,
    /// How many recordings were begun.
    begun: AtomicU64,
    current: RwLock<Option<Recorder>>,
}

impl Deck {
    /// Nothing is recorded yet.
    pub fn new(node: &Node, options: WriterOptions, queue: usize, paused: bool) -> Self {
        Self {
            node: node.clone(),
            options,
            queue,
            times: Times::new(node.clock().clone()),
            paused: AtomicBool::new(paused),
            begun: AtomicU64::new(0),
            current: RwLock::new(None),
        }
    }

    /// Begins a recording in `folder`, or in a new one in `bags/`.
    ///
    /// # Errors
    /// A line that says why not: one goes on already, or the folder cannot be made.
    pub fn begin(&self, folder: Option<PathBuf>) -> Result<(), String> {
        let mut current = self.current.write().unwrap_or_else(PoisonError::into_inner);
        if let Some(recorder) = current.as_ref() {
            return Err(format!(
                "a recording goes on already, to {}; stop it first",
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

    /// Ends the recording and says what it holds; `false` if there was none.
    ///
    /// # Errors
    /// What made writing fail, now or earlier.
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

    /// How many recordings were begun.
    pub fn begun(&self) -> u64 {
        self.begun.load(Ordering::Acquire)
    }

    /// What hands messages over, if a recording goes on.
    pub fn handle(&self) -> Option<RecorderHandle> {
        let current = self.current.read().unwrap_or_else(PoisonError::into_inner);
        current.as_ref().map(Recorder::handle)
    }

    /// Whether there is a pause.
    pub fn is_paused(&self) -> bool {
        self.paused.load(Ordering::Acquire)
    }

    /// Begins or ends a pause.
    pub fn pause(&self, paused: bool) {
        let before = self.paused.swap(paused, Ordering::AcqRel);
        if before != paused {
            tracing::info!(
                "{}",
                if paused {
                    "paused"
                } else {
                    "recording goes on"
                }
            );
        }
    }

    /// Where the samples of a topic go.
    pub fn sink(self: &Arc<Self>, topic: bag::Topic) -> Sink {
        Sink {
            deck: Arc::clone(self),
            is_clock: topic.name == topics::CLOCK.name,
            topic,
            entry: Mutex::default(),
        }
    }
}

/// Where the samples of one topic go.
pub struct Sink {
    deck: Arc<Deck>,
    is_clock: bool,
    topic: bag::Topic,
    /// Its place in the bag of the recording with this number. Entered with the first message, so that a
    /// bag lists no topic that never spoke; `None` if the bag has another type for it.
    entry: Mutex<(u64, Option<Arc<RecorderTopic>>)>,
}

impl Sink {
    /// Takes a sample in, or leaves it if nothing is recorded.
    pub fn take(&self, sample: RawSample) {
        if self.deck.is_paused() {
            return;
        }
        let Some(handle) = self.deck.handle() else {
            return;
        };
        let mut entry = self.entry.lock().unwrap_or_else(PoisonError::into_inner);
        let begun = self.deck.begun();
        if entry.0 != begun {
            let added = handle.add_topic(self.topic.clone());
            *entry = (begun, added.map_err(|e| tracing::error!("{e}")).ok());
        }
        let Some(topic) = &entry.1 else { return };
        if self.is_clock
            && let Ok(clock) = cdr::decode::<rosgraph_msgs::Clock>(&sample.cdr)
        {
            self.deck.times.begin(clock.clock.into());
        }
        self.deck.times.write(&handle, topic, sample);
    }
}
