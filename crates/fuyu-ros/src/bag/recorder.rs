//! Recording live topics: a bounded queue and a thread that writes.

use bytes::Bytes;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender, TryRecvError};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::{self, JoinHandle, Thread};
use std::time::{Duration, Instant};

use super::disk_space::DiskSpace;
use super::{BagError, Recording, Topic, Writer};

/// Longest time that a message stays in an open chunk. A killed process loses the open chunk and the messages that wait
/// for the thread: at most one second of messages, including a wait of [`BATCHING_DELAY`] before they are enqueued.
const CHUNK_AGE: Duration = Duration::from_millis(900);

/// How long messages may wait for the writing thread, which then writes several at once instead of waking for each.
pub const BATCHING_DELAY: Duration = Duration::from_millis(50);

/// Queue capacity in bytes before messages are dropped: more than three seconds at 20 MB/s.
pub const QUEUE_BYTES: usize = 64 << 20;

/// Longest wait for space on a full disk after the end of the recording.
const LAST_WAIT: Duration = Duration::from_secs(2);

/// Memory of a queued message [B], including the queue's overhead.
fn weight(cdr: &Bytes) -> usize {
    cdr.len() + 128
}

/// A [`Writer`] on a separate thread. Callers enqueue messages and never wait for the disk.
///
/// If the disk cannot keep up for long, the queue fills and further messages are dropped. They are counted by topic,
/// and the counts are part of the result. If the disk is full, writing waits for space and then continues where it
/// stopped; [`RecorderStatus::waiting`] has the error.
pub struct Recorder {
    handle: RecorderHandle,
    thread: JoinHandle<Result<Recording, BagError>>,
}

/// Enqueues messages for a [`Recorder`]; cheap to clone and to share between threads.
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
    space: Arc<DiskSpace>,
    /// The thread that writes.
    thread: OnceLock<Thread>,
}

impl Shared {
    /// Ends the thread's wait for further messages.
    fn hurry(&self) {
        if let Some(thread) = self.thread.get() {
            thread.unpark();
        }
    }
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

/// Status of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecorderStatus {
    /// Messages accepted into the queue.
    pub accepted: u64,
    /// Messages written to the file.
    pub written: u64,
    /// Messages dropped because the queue was full or writing failed.
    pub dropped: u64,
    /// Dropped messages by topic; only topics with drops.
    pub dropped_topics: Vec<(String, u64)>,
    /// Number of files of the bag.
    pub files: usize,
    /// Bytes in the queue.
    pub queued_bytes: usize,
    /// Capacity of the queue in bytes.
    pub queue_capacity: usize,
    /// The error because of which writing waits: the disk is full.
    pub waiting: Option<String>,
    /// The error because of which writing has stopped.
    pub failure: Option<String>,
}

impl Recorder {
    /// Starts the thread that writes to `writer`.
    ///
    /// # Errors
    /// [`BagError::Io`] if the thread cannot be created.
    pub fn start(writer: Writer) -> Result<Self, BagError> {
        Self::with_queue(writer, QUEUE_BYTES)
    }

    /// Like [`Recorder::start`], with a queue of `capacity` bytes.
    ///
    /// # Errors
    /// As [`Recorder::start`].
    pub fn with_queue(writer: Writer, capacity: usize) -> Result<Self, BagError> {
        let (sender, receiver) = mpsc::channel();
        let folder = writer.folder().to_owned();
        writer.space().wait_when_full();
        let shared = Arc::new(Shared {
            folder: folder.clone(),
            capacity,
            queued: AtomicUsize::new(0),
            written: AtomicU64::new(0),
            files: AtomicUsize::new(1),
            topics: Mutex::default(),
            failure: Mutex::default(),
            space: Arc::clone(writer.space()),
            thread: OnceLock::new(),
        });
        let for_thread = shared.clone();
        let thread = thread::Builder::new()
            .name("bag".into())
            .spawn(move || {
                let _ = for_thread.thread.set(thread::current());
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

    /// A handle for enqueuing messages.
    pub fn handle(&self) -> RecorderHandle {
        self.handle.clone()
    }

    /// Writes the queued messages, closes the bag and returns its contents. Messages enqueued later are
    /// dropped. If the disk is full, waits for space for two seconds at most.
    ///
    /// # Errors
    /// The error that made writing fail, now or earlier.
    pub fn finish(self) -> Result<Recording, BagError> {
        self.handle.shared.space.give_up_after(LAST_WAIT);
        // An error here means that the thread has already ended; it reports the reason.
        let _ = self.handle.sender.send(Entry::Finish);
        self.handle.shared.hurry();
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

    /// Declares a topic. A repeated declaration returns the same topic.
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
        // Under the lock, so that the thread receives topics in the order of their indices. If it has ended, messages
        // of the topic are counted as dropped.
        let _ = self.sender.send(Entry::Topic(topic.clone()));
        topics.insert(topic.name.clone(), (topic, new.clone()));
        Ok(new)
    }

    /// Enqueues CDR bytes (with their encapsulation header) that were received at `log_time` and sent at `publish_time`
    /// \[ns\]. Never blocks; `false` means that the message was dropped and counted.
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
        // A message may exceed the capacity if the queue is otherwise empty.
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
            let half = self.shared.capacity / 2;
            if queued <= half && queued + len > half {
                self.shared.hurry();
            }
        } else {
            self.shared.queued.fetch_sub(len, Ordering::Relaxed);
            topic.dropped.fetch_add(1, Ordering::Relaxed);
        }
        sent
    }

    /// Waits until everything enqueued so far has been passed to the operating system.
    ///
    /// # Errors
    /// [`BagError::ThreadGone`] if writing has stopped; [`RecorderHandle::status`] gives the reason.
    /// [`BagError::DiskFull`] if writing waits for space; it is done when there is.
    pub fn flush(&self) -> Result<(), BagError> {
        self.request(Entry::Flush)
    }

    /// Starts a new file of the bag and waits until that is done.
    ///
    /// # Errors
    /// As [`Self::flush`].
    pub fn split(&self) -> Result<(), BagError> {
        self.request(Entry::Split)
    }

    fn request(&self, entry: fn(Sender<()>) -> Entry) -> Result<(), BagError> {
        let (done, wait) = mpsc::channel();
        let folder = &self.shared.folder;
        let gone = || BagError::ThreadGone(folder.clone());
        self.sender.send(entry(done)).map_err(|_| gone())?;
        self.shared.hurry();
        loop {
            match wait.recv_timeout(Duration::from_millis(100)) {
                Ok(()) => return Ok(()),
                Err(RecvTimeoutError::Disconnected) => return Err(gone()),
                Err(RecvTimeoutError::Timeout) => {}
            }
            if let Some(problem) = self.shared.space.problem() {
                return Err(BagError::DiskFull {
                    path: folder.clone(),
                    problem,
                });
            }
        }
    }

    /// Status of the recording.
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
            waiting: self.shared.space.problem(),
            failure: lock(&self.shared.failure).clone(),
        }
    }
}

impl RecorderTopic {
    /// Full name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Messages accepted into the queue.
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
    // Deadline for closing the open chunk.
    let mut due: Option<Instant> = None;
    // After a message, further ones are likely: the thread waits to gather them.
    let mut gathers = false;
    loop {
        let mut waiting = receiver.try_recv();
        if gathers && matches!(waiting, Err(TryRecvError::Empty)) {
            gathers = false;
            thread::park_timeout(BATCHING_DELAY);
            waiting = receiver.try_recv();
        }
        let entry = match (waiting, due) {
            (Ok(entry), _) => Ok(entry),
            (Err(_), None) => receiver.recv().map_err(RecvTimeoutError::from),
            (Err(_), Some(t)) => receiver.recv_timeout(t.saturating_duration_since(Instant::now())),
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
                gathers = true;
            }
            Ok(Entry::Topic(topic)) => topics.push(writer.add_topic(topic)?),
            Ok(Entry::Flush(done)) => {
                writer.flush()?;
                due = None;
                // The caller no longer waits for the reply.
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

// Counts and names stay valid after a panic in another thread.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
