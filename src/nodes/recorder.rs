//! The recorder node: writes topics to a rosbag2 bag.

use std::{
    collections::HashMap,
    path::PathBuf,
    sync::{Arc, Mutex, OnceLock, PoisonError},
    time::Duration,
};

use super::{choice, topics};
use crate::{
    bag::{self, Compression, RecorderHandle, RecorderTopic, Writer, WriterOptions},
    msg::{cdr, rosgraph_msgs},
    ros::{Clock, Declare, Node, NodeError, Qos, RawSample, RawSubscription, Status, Time},
};

/// Plumbing of ROS, which a bag of everything leaves out.
const LEFT_OUT: [&str; 2] = ["/parameter_events", "/rosout"];

/// How often new topics are looked for.
const LOOK: Duration = Duration::from_millis(200);

/// What the recorder node is told at its start.
#[derive(Debug, Clone)]
pub struct RecorderParams {
    /// Folder to write, which must not exist; `None` is a new one in `bags/`.
    pub bag: Option<PathBuf>,
    /// Topics to record; empty is all.
    pub topics: Vec<String>,
    /// How chunks are compressed.
    pub compression: Compression,
}

impl RecorderParams {
    /// Declares the parameters and reads them. `finish` of `declare` is the caller's.
    pub fn declare(declare: &mut Declare) -> Self {
        let bag = declare
            .param(
                "bag",
                "",
                "Folder of the bag, which must not exist; empty is bags/ and the time",
            )
            .read_only()
            .value();
        let topics = declare
            .param(
                "topics",
                Vec::<String>::new(),
                "Topics to record; empty is all",
            )
            .read_only()
            .value();
        let compression = choice::declare(
            declare,
            "compression",
            &COMPRESSIONS,
            "Compression of the chunks",
        )
        .read_only()
        .value();
        Self {
            bag: (!bag.is_empty()).then(|| PathBuf::from(bag)),
            topics,
            // Any other text has been refused by the declaration.
            compression: choice::find(&COMPRESSIONS, &compression).unwrap_or_default(),
        }
    }
}

const COMPRESSIONS: [(&str, Compression); 3] = [
    ("zstd", Compression::Zstd),
    ("lz4", Compression::Lz4),
    ("none", Compression::None),
];

/// `bags/`, `prefix` and the time, as `ros2 bag record` names its folders.
pub fn new_folder(prefix: &str) -> PathBuf {
    let time = chrono::Local::now().format("%Y_%m_%d-%H_%M_%S");
    PathBuf::from(format!("bags/{prefix}-{time}"))
}

/// The node's program.
///
/// # Errors
/// When the folder exists or cannot be written, for wrong parameters, or when DDS refuses.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let params = RecorderParams::declare(&mut declare);
    declare.finish()?;
    let options = WriterOptions {
        compression: params.compression,
        ..WriterOptions::default()
    };
    let refuse = |e: bag::BagError| NodeError::Input(format!("node {}: {e}", node.name()));
    let folder = params.bag.unwrap_or_else(|| new_folder("rosbag2"));
    let writer = Writer::create(&folder, options).map_err(refuse)?;
    let recorder = bag::Recorder::start(writer).map_err(refuse)?;
    tracing::info!("recording to {}", folder.display());
    let mut session = Session {
        node,
        handle: recorder.handle(),
        subscriptions: HashMap::new(),
        status: node.diagnostics().status("bag"),
        times: Arc::new(Times::new(node.clock().clone())),
        failed: false,
        wanted: params
            .topics
            .iter()
            .map(|topic| node.resolve_topic(topic))
            .collect::<Result<_, _>>()?,
    };
    session.subscribe_known()?;
    while node.ok() {
        session.subscribe_discovered()?;
        session.report();
        // The receiving thread hands messages over; here nothing is urgent.
        std::thread::sleep(LOOK);
    }
    session.subscriptions.clear();
    session.times.begin(node.now());
    let recording = recorder
        .finish()
        .map_err(|e| NodeError::Failed(e.to_string()))?;
    tracing::info!(
        "{}: {} messages",
        recording.path.display(),
        recording.messages
    );
    if recording.dropped > 0 {
        tracing::warn!(
            "{} messages were dropped: the disk was too slow",
            recording.dropped
        );
    }
    Ok(())
}

struct Session<'a> {
    node: &'a Node,
    handle: RecorderHandle,
    /// By full name of the topic.
    subscriptions: HashMap<String, RawSubscription>,
    status: Status,
    /// Full names; empty is all.
    wanted: Vec<String>,
    times: Arc<Times>,
    /// Whether it was said that nothing is recorded any more.
    failed: bool,
}

impl Session<'_> {
    fn wants(&self, topic: &str) -> bool {
        if self.wanted.is_empty() {
            !LEFT_OUT.contains(&topic)
        } else {
            self.wanted.iter().any(|wanted| wanted == topic)
        }
    }

    /// Subscribes to the topics of the graph before anybody publishes them, so that not even their first
    /// message is missed.
    fn subscribe_known(&mut self) -> Result<(), NodeError> {
        for topic in topics::all() {
            let name = self.node.resolve_topic(topic.name)?;
            if self.wants(&name) {
                let sink = self.sink(&name, &topic.type_name, topic.qos);
                let subscription = self.node.subscribe_raw(
                    topic.name,
                    &topic.type_name,
                    reading(topic.qos),
                    move |sample| sink.take(sample),
                )?;
                self.subscriptions.insert(name, subscription);
            }
        }
        Ok(())
    }

    fn subscribe_discovered(&mut self) -> Result<(), NodeError> {
        for publisher in self.node.discovered_publishers() {
            let new = !self.subscriptions.contains_key(&publisher.topic);
            if new && self.wants(&publisher.topic) {
                let sink = self.sink(&publisher.topic, &publisher.type_name, publisher.qos);
                let take = move |sample| sink.take(sample);
                let subscription =
                    self.node
                        .subscribe_discovered(&publisher, reading(publisher.qos), take)?;
                self.subscriptions.insert(publisher.topic, subscription);
            }
        }
        Ok(())
    }

    fn sink(&self, topic: &str, type_name: &str, qos: Qos) -> Sink {
        Sink {
            handle: self.handle.clone(),
            times: Arc::clone(&self.times),
            is_clock: topic == topics::CLOCK.name,
            topic: bag::Topic::named(topic, type_name, qos),
            entry: OnceLock::new(),
        }
    }

    fn report(&mut self) {
        let recorded = self.handle.status();
        self.status.set("bag", self.handle.folder().display());
        self.status.set("messages", recorded.accepted);
        self.status.set("dropped", recorded.dropped);
        self.status.set("queued [bytes]", recorded.queued_bytes);
        match recorded.failure {
            Some(problem) => {
                if !self.failed {
                    tracing::error!("nothing is recorded any more: {problem}");
                    self.failed = true;
                }
                self.status.error(problem);
            }
            None if recorded.dropped > 0 => {
                self.status.warn(format!(
                    "{} messages were dropped: the disk is too slow",
                    recorded.dropped
                ));
            }
            None => self.status.ok("recording"),
        }
    }
}

/// What is offered, with a queue deep enough for what arrives while the receiving thread is busy.
fn reading(offered: Qos) -> Qos {
    offered.depth(offered.depth.max(100))
}

/// The time of the log: the computer's, or with use_sim_time that of `/clock`, as with
/// `ros2 bag record --use-sim-time`.
struct Times {
    clock: Clock,
    /// What came before the first `/clock`, and so has no time yet; `None` once that has come.
    early: Mutex<Option<Vec<Early>>>,
}

/// A sample that has no time yet, and where it goes.
struct Early {
    handle: RecorderHandle,
    topic: Arc<RecorderTopic>,
    sample: RawSample,
}

/// Samples that may wait for the first `/clock`.
const EARLY: usize = 10_000;

impl Times {
    fn new(clock: Clock) -> Self {
        Self {
            clock,
            early: Mutex::new(Some(Vec::new())),
        }
    }

    /// Writes a sample, now or as soon as there is a time.
    fn write(&self, handle: &RecorderHandle, topic: &Arc<RecorderTopic>, sample: RawSample) {
        let mut early = self.early.lock().unwrap_or_else(PoisonError::into_inner);
        match early.as_mut() {
            Some(waiting) if self.clock.is_simulated() && waiting.len() < EARLY => {
                let (handle, topic) = (handle.clone(), Arc::clone(topic));
                waiting.push(Early {
                    handle,
                    topic,
                    sample,
                });
            }
            _ => self.write_now(handle, topic, sample),
        }
    }

    /// The first `/clock` has come: `now`.
    fn begin(&self, now: Time) {
        let early = self
            .early
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        for Early {
            handle,
            topic,
            sample,
        } in early.into_iter().flatten()
        {
            let nanos = nanos(now);
            handle.write(&topic, nanos, nanos, sample.cdr);
        }
    }

    fn write_now(&self, handle: &RecorderHandle, topic: &RecorderTopic, sample: RawSample) {
        let simulated = self.clock.is_simulated();
        let received = if simulated {
            self.clock.now()
        } else {
            sample.received_time
        };
        let sent = if simulated {
            received
        } else {
            sample.source_time.unwrap_or(received)
        };
        handle.write(topic, nanos(received), nanos(sent), sample.cdr);
    }
}

fn nanos(time: Time) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(0)
}

/// Where the samples of one topic go.
struct Sink {
    handle: RecorderHandle,
    times: Arc<Times>,
    is_clock: bool,
    topic: bag::Topic,
    /// Entered in the bag with the first message, so that a bag lists no topic that never spoke.
    entry: OnceLock<Option<Arc<RecorderTopic>>>,
}

impl Sink {
    fn take(&self, sample: RawSample) {
        let entry = self.entry.get_or_init(|| {
            let added = self.handle.add_topic(self.topic.clone());
            added.map_err(|e| tracing::error!("{e}")).ok()
        });
        let Some(entry) = entry else { return };
        if self.is_clock
            && let Ok(clock) = cdr::decode::<rosgraph_msgs::Clock>(&sample.cdr)
        {
            self.times.begin(clock.clock.into());
        }
        self.times.write(&self.handle, entry, sample);
    }
}
