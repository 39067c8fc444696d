//! Recording live topics: a bounded queue and a thread that writes.

use bytes::Bytes;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::{BagError, Recording, Topic, Writer};

/// How long a message may wait in an open chunk, which a killed process would lose.
const CHUNK_AGE: Duration = Duration::from_secs(1);

/// Bytes that wait for the disk before messages are dropped: more than three seconds at 20 MB/s.
pub const QUEUE_BYTES: usize = 64 << 20;

/// Memory of a message that waits [B], with what the queue itself needs for it.
fn weight(cdr: &Bytes) -> usize {
    cdr.len() + 128
}

/// A [`Writer`] on a thread of its own. Callers hand messages over and never wait for the disk.
///
/// If the disk cannot keep up for long, the queue fills and further messages are dropped; they are
/// counted, by topic, and the count is part of the result.
pub struct Recorder {
    handle: RecorderHandle,
    thread: JoinHandle<Result<Recording, BagError>>,
}

/// Hands messages to a [`Recorder`]; cheap to clone and to share between threads.
#[derive(Clone)]
pub struct RecorderHandle {
    sender: Sender<Entry>,
    shared: Arc<Shared>,
}

/// A topic of a [`Recorder`], with its counts.
#[derive(Debug)]
pub struct RecorderTopic {
    index: usize,
    name: String,
    accepted: AtomicU64,
    dropped: AtomicU64,
}

struct Shared {
    folder: PathBuf,
    capacity: usize,
    queued: AtomicUsize,
    written: AtomicU64,
    files: AtomicUsize,
    topics: Mutex<HashMap<String, (Topic, Arc<RecorderTopic>)>>,
    failure: Mutex<Option<String>>,
}

enum Entry {
    Topic(Topic),
    Message {
        topic: usize,
        log_time: u64,
        publish_time: u64,
        cdr: Bytes,
    },
    Flush(Sender<()>),
    Split(Sender<()>),
    Finish,
}

/// How a recording fares.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecorderStatus {
    /// Messages taken into the queue.
    pub accepted: u64,
    /// Messages that are in the file.
    pub written: u64,
    /// Messages dropped since the queue was full or the disk refused.
    pub dropped: u64,
    /// The same by topic, as far as there are any.
    pub dropped_topics: Vec<(String, u64)>,
    /// Files that the bag has.
    pub files: usize,
    /// Bytes that wait in the queue.
    pub queued_bytes: usize,
    /// Bytes that the queue can hold.
    pub queue_capacity: usize,
    /// Why nothing is written any more.
    pub failure: Option<String>,
}

impl Recorder {
    /// Starts the thread that writes to `writer`.
    ///
    /// # Errors
    /// [`BagError::Io`] if the system gives no thread.
    pub fn start(writer: Writer) -> Result<Self, BagError> {
        Self::with_queue(writer, QUEUE_BYTES)
    }

    /// As [`Recorder::start`], with a queue of `capacity` bytes.
    ///
    /// # Errors
    /// As [`Recorder::start`].
    pub fn with_queue(writer: Writer, capacity: usize) -> Result<Self, BagError> {
        let (sender, receiver) = mpsc::channel();
        let folder = writer.folder().to_owned();
        let shared = Arc::new(Shared {
            folder: folder.clone(),
            capacity,
            queued: AtomicUsize::new(0),
            written: AtomicU64::new(0),
            files: AtomicUsize::new(1),
            topics: Mutex::default(),
            failure: Mutex::default(),
        });
        let for_thread = shared.clone();
        let thread = std::thread::Builder::new()
            .name("bag".into())
            .spawn(move || {
                let result = run(writer, &receiver, &for_thread);
                if let Err(e) = &result {
                    *lock(&for_thread.failure) = Some(e.to_string());
                }
                result
            })
            .map_err(BagError::io(&folder))?;
        Ok(Self {
            handle: RecorderHandle { sender, shared },
            thread,
        })
    }

    /// What hands messages over.
    pub fn handle(&self) -> RecorderHandle {
        self.handle.clone()
    }

    /// Writes what is queued, closes the bag and says what it holds. Messages handed over from now on
    /// are dropped.
    ///
    /// # Errors
    /// What made writing fail, now or earlier.
    pub fn finish(self) -> Result<Recording, BagError> {
        // An error here means that the thread has ended already; it says why.
        let _ = self.handle.sender.send(Entry::Finish);
        let mut recording = self
            .thread
            .join()
            .map_err(|_| BagError::ThreadGone(self.handle.shared.folder.clone()))??;
        recording.dropped = self.handle.status().dropped;
        Ok(recording)
    }
}

impl RecorderHandle {
    /// The bag's folder.
    pub fn folder(&self) -> &Path {
        &self.shared.folder
    }

    /// Declares a topic. Declaring it again gives the same one.
    ///
    /// # Errors
    /// [`BagError::TopicConflict`] if it was declared with another type.
    pub fn add_topic(&self, topic: Topic) -> Result<Arc<RecorderTopic>, BagError> {
        let mut topics = lock(&self.shared.topics);
        if let Some((first, known)) = topics.get(&topic.name) {
            if first.type_name != topic.type_name {
                return Err(BagError::TopicConflict {
                    topic: topic.name,
                    first: first.type_name.clone(),
                    second: topic.type_name,
                });
            }
            return Ok(known.clone());
        }
        let new = Arc::new(RecorderTopic {
            index: topics.len(),
            name: topic.name.clone(),
            accepted: AtomicU64::new(0),
            dropped: AtomicU64::new(0),
        });
        // Under the lock, so that the thread meets topics in the order of their indices. If it has
        // ended, messages of the topic are counted as dropped.
        let _ = self.sender.send(Entry::Topic(topic.clone()));
        topics.insert(topic.name.clone(), (topic, new.clone()));
        Ok(new)
    }

    /// Hands over CDR bytes (with their encapsulation header) that were received at `log_time` and sent
    /// at `publish_time` \[ns\]. Never waits; `false` means that the message was dropped and counted.
    pub fn write(
        &self,
        topic: &RecorderTopic,
        log_time: u64,
        publish_time: u64,
        cdr: impl Into<Bytes>,
    ) -> bool {
        let cdr = cdr.into();
        let len = weight(&cdr);
        let queued = self.shared.queued.fetch_add(len, Ordering::Relaxed);
        // One message may exceed the capacity if it has the queue for itself.
        let fits = queued == 0 || queued + len <= self.shared.capacity;
        let sent = fits
            && self
                .sender
                .send(Entry::Message {
                    topic: topic.index,
                    log_time,
                    publish_time,
                    cdr,
                })
                .is_ok();
        if sent {
            topic.accepted.fetch_add(1, Ordering::Relaxed);
        } else {
            self.shared.queued.fetch_sub(len, Ordering::Relaxed);
            topic.dropped.fetch_add(1, Ordering::Relaxed);
        }
        sent
    }

    /// Waits until everything handed over so far is in the operating system's hands.
    ///
    /// # Errors
    /// [`BagError::ThreadGone`] if nothing is written any more; [`RecorderHandle::status`] says why.
    pub fn flush(&self) -> Result<(), BagError> {
        let (done, wait) = mpsc::channel();
        let gone = || BagError::ThreadGone(self.shared.folder.clone());
        self.sender.send(Entry::Flush(done)).map_err(|_| gone())?;
        wait.recv().map_err(|_| gone())
    }

    /// Begins another file of the bag and waits until that is done.
    ///
    /// # Errors
    /// As [`Self::flush`].
    pub fn split(&self) -> Result<(), BagError> {
        let (done, wait) = mpsc::channel();
        let gone = || BagError::ThreadGone(self.shared.folder.clone());
        self.sender.send(Entry::Split(done)).map_err(|_| gone())?;
        wait.recv().map_err(|_| gone())
    }

    /// How the recording fares.
    pub fn status(&self) -> RecorderStatus {
        let topics = lock(&self.shared.topics);
        let total = |count: fn(&RecorderTopic) -> u64| topics.values().map(|(_, t)| count(t)).sum();
        let mut dropped_topics: Vec<_> = topics
            .values()
            .map(|(_, t)| (t.name.clone(), t.dropped()))
            .filter(|(_, dropped)| *dropped > 0)
            .collect();
        dropped_topics.sort();
        RecorderStatus {
            dropped_topics,
            accepted: total(RecorderTopic::accepted),
            dropped: total(RecorderTopic::dropped),
            written: self.shared.written.load(Ordering::Relaxed),
            files: self.shared.files.load(Ordering::Relaxed),
            queued_bytes: self.shared.queued.load(Ordering::Relaxed),
            queue_capacity: self.shared.capacity,
            failure: lock(&self.shared.failure).clone(),
        }
    }
}

impl RecorderTopic {
    /// Full name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Messages taken into the queue.
    pub fn accepted(&self) -> u64 {
        self.accepted.load(Ordering::Relaxed)
    }

    /// Messages dropped.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

fn run(
    mut writer: Writer,
    receiver: &Receiver<Entry>,
    shared: &Shared,
) -> Result<Recording, BagError> {
    let mut topics = Vec::new();
    // When the open chunk must be closed.
    let mut due: Option<Instant> = None;
    loop {
        let entry = match due {
            None => receiver.recv().map_err(RecvTimeoutError::from),
            Some(t) => receiver.recv_timeout(t.saturating_duration_since(Instant::now())),
        };
        match entry {
            Ok(Entry::Message {
                topic,
                log_time,
                publish_time,
                cdr,
            }) => {
                let result = writer.write_cdr(topics[topic], log_time, publish_time, &cdr);
                shared.queued.fetch_sub(weight(&cdr), Ordering::Relaxed);
                result?;
                shared.written.fetch_add(1, Ordering::Relaxed);
                shared.files.store(writer.files(), Ordering::Relaxed);
                due.get_or_insert_with(|| Instant::now() + CHUNK_AGE);
            }
            Ok(Entry::Topic(topic)) => topics.push(writer.add_topic(topic)?),
            Ok(Entry::Flush(done)) => {
                writer.flush()?;
                due = None;
                // Nobody waits any more: nothing to tell.
                let _ = done.send(());
            }
            Ok(Entry::Split(done)) => {
                writer.split()?;
                shared.files.store(writer.files(), Ordering::Relaxed);
                due = None;
                let _ = done.send(());
            }
            Err(RecvTimeoutError::Timeout) => {}
            Ok(Entry::Finish) | Err(RecvTimeoutError::Disconnected) => return writer.finish(),
        }
        if due.is_some_and(|t| Instant::now() >= t) {
            writer.flush()?;
            due = None;
        }
    }
}

// A panic elsewhere leaves counts and names as they are: still good.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
