//! The player node: publishes the messages of a bag with their topics, types and QoS, at the recorded times.

mod pace;

use std::{
    collections::BTreeMap,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use super::topics;
use crate::{
    bag::{Bag, Damage, Message, Qos, RecordedTopic},
    msg::{
        rosbag2_interfaces::{
            IsPaused, IsPausedResponse, Pause, PauseResponse, Resume, ResumeResponse, TogglePaused,
            TogglePausedResponse,
        },
        rosgraph_msgs::Clock,
    },
    ros::{Node, NodeError, Publisher, RawPublisher, ServiceServer, Time, qos::Durability},
};
use pace::Pace;

/// Node name, the same as that of `ros2 bag play`.
pub const NAME: &str = "rosbag2_player";

/// Total time at the end for busy subscribers to acknowledge the last messages.
const LAST_ACKNOWLEDGEMENT: Duration = Duration::from_secs(5);

/// Options of playback.
#[derive(Debug, Clone)]
pub struct Player {
    /// The bag.
    pub bag: Bag,
    /// Playback rate: recorded seconds per second.
    pub rate: f64,
    /// Whether to repeat from the start at the end.
    pub repeat: bool,
    /// Rate of a generated `/clock` \[Hz\], which replaces the recorded one; `None` to play the recorded one.
    pub clock: Option<f64>,
    /// Topics to play; empty for all.
    pub topics: Vec<String>,
    /// Recorded time to skip at the beginning. The last earlier message of each latched topic is played nevertheless.
    pub start_offset: Duration,
    /// Wait for subscribers before the first message.
    pub delay: Duration,
    /// Whether playback starts paused.
    pub start_paused: bool,
}

/// Result of playback.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Played {
    /// Published messages.
    pub messages: u64,
    /// Of these, messages dropped because subscribers or the network were too slow.
    pub dropped: u64,
    /// Number of topics.
    pub topics: usize,
    /// Omitted topics, each with the reason.
    pub left_out: BTreeMap<String, String>,
    /// Damage found in the bag.
    pub damage: Vec<Damage>,
}

impl Player {
    /// The node's program. Afterwards `played` contains the result.
    ///
    /// # Errors
    /// When the bag does not contain the topics, or DDS fails.
    pub fn run(&self, node: &Node, played: &Mutex<Played>) -> Result<(), NodeError> {
        let info = self
            .bag
            .info()
            .map_err(|e| NodeError::Input(e.to_string()))?;
        for name in &self.topics {
            if !info.topics.iter().any(|t| t.name == *name) {
                let there: Vec<_> = info.topics.iter().map(|t| t.name.as_str()).collect();
                return Err(NodeError::Input(format!(
                    "bag {}: no topic {name} in it; it has {}",
                    self.bag.path().display(),
                    there.join(", ")
                )));
            }
        }
        let Some(start) = info.start_ns else {
            return Ok(());
        };
        let paused = Arc::new(AtomicBool::new(self.start_paused));
        let _services = serve(node, &paused)?;
        let clock = match self.clock {
            Some(_) => Some(topics::CLOCK.advertise(node)?),
            None => None,
        };
        let mut playback = Playback {
            player: self,
            node,
            publishers: BTreeMap::new(),
            played,
        };
        // Announce all topics before publishing any message.
        for topic in &info.topics {
            let kind = (topic.type_name.as_str(), topic.type_hash.as_deref());
            playback.announce(&topic.name, kind, &topic.encoding, &topic.qos)?;
        }
        let begin = start.saturating_add(self.start_offset.as_nanos() as u64);
        let mut pace = Pace::new(node, begin, self.rate, self.clock, clock, paused);
        pace.wait(self.delay);
        loop {
            playback.once(begin, &mut pace)?;
            if !self.repeat || !node.ok() {
                break;
            }
            pace.restart();
        }
        playback.finish();
        Ok(())
    }

    fn takes(&self, topic: &str) -> bool {
        let named = self.topics.is_empty() || self.topics.iter().any(|t| t == topic);
        named && !(self.clock.is_some() && topic == topics::CLOCK.name)
    }
}

/// The publishers during playback.
struct Playback<'a> {
    player: &'a Player,
    node: &'a Node,
    /// Publishers by topic name in the bag; `None` for a topic that cannot be played.
    publishers: BTreeMap<String, Option<RawPublisher>>,
    played: &'a Mutex<Played>,
}

impl Playback<'_> {
    fn announce(
        &mut self,
        name: &str,
        (type_name, type_hash): (&str, Option<&str>),
        encoding: &str,
        qos: &[Qos],
    ) -> Result<(), NodeError> {
        if self.publishers.contains_key(name) || !self.player.takes(name) {
            return Ok(());
        }
        let publisher = match encoding {
            "cdr" => {
                let qos = Qos::offer(qos);
                match (self.node).advertise_recorded(name, type_name, type_hash, qos) {
                    Ok(publisher) => Ok(publisher),
                    Err(e @ (NodeError::Input(_) | NodeError::Name(_))) => Err(e.to_string()),
                    Err(e) => return Err(e),
                }
            }
            other => Err(format!("its messages are encoded as {other}, not cdr")),
        };
        if let Err(why) = &publisher {
            tracing::warn!("topic {name} is not played: {why}");
            self.update_played(|played| played.left_out.insert(name.to_owned(), why.clone()));
        }
        self.publishers.insert(name.to_owned(), publisher.ok());
        Ok(())
    }

    /// Plays the bag from time `begin` to its end.
    fn once(&mut self, begin: u64, pace: &mut Pace<'_>) -> Result<(), NodeError> {
        let mut latched: BTreeMap<String, Message> = BTreeMap::new();
        let mut messages = self.player.bag.messages();
        for message in messages.by_ref() {
            if !self.player.takes(&message.topic.name) {
                continue;
            }
            if message.log_time < begin {
                if is_latched(&message.topic) {
                    latched.insert(message.topic.name.clone(), message);
                }
                continue;
            }
            for (_, early) in std::mem::take(&mut latched) {
                self.publish(early)?;
            }
            if !pace.reach(message.log_time) {
                return Ok(());
            }
            self.publish(message)?;
        }
        // Latched messages are published even if none follows `begin`.
        for (_, early) in latched {
            self.publish(early)?;
        }
        let damage = messages.damage();
        self.update_played(|played| played.damage = damage);
        Ok(())
    }

    fn publish(&mut self, message: Message) -> Result<(), NodeError> {
        let topic = Arc::clone(&message.topic);
        let kind = (topic.type_name.as_str(), topic.type_hash.as_deref());
        self.announce(&topic.name, kind, &topic.encoding, &topic.qos)?;
        if let Some(Some(publisher)) = self.publishers.get(&topic.name) {
            publisher.publish(message.data);
            self.update_played(|played| played.messages += 1);
        }
        Ok(())
    }

    /// Waits until subscribers have received the last messages, then drops the publishers.
    fn finish(self) {
        let publishers: Vec<_> = self.publishers.into_values().flatten().collect();
        let deadline = Instant::now() + LAST_ACKNOWLEDGEMENT;
        for publisher in &publishers {
            let left = deadline.saturating_duration_since(Instant::now());
            if self.node.ok() && !publisher.wait_for_all_acked(left) {
                let topic = publisher.topic();
                tracing::warn!(
                    "topic {topic}: subscribers have not acknowledged its last messages"
                );
            }
        }
        let dropped = publishers.iter().map(RawPublisher::dropped).sum();
        let mut played = self.played.lock().unwrap_or_else(PoisonError::into_inner);
        played.topics = publishers.len();
        played.dropped = dropped;
    }

    fn update_played<T>(&self, change: impl FnOnce(&mut Played) -> T) {
        change(&mut self.played.lock().unwrap_or_else(PoisonError::into_inner));
    }
}

fn is_latched(topic: &RecordedTopic) -> bool {
    Qos::offer(&topic.qos).durability == Durability::TransientLocal
}

fn serve(node: &Node, paused: &Arc<AtomicBool>) -> Result<[ServiceServer; 4], NodeError> {
    let with = || Arc::clone(paused);
    let (pause, resume, toggle, is_paused) = (with(), with(), with(), with());
    Ok([
        node.serve::<Pause>("~/pause", move |_| {
            pause.store(true, Ordering::Release);
            PauseResponse::default()
        })?,
        node.serve::<Resume>("~/resume", move |_| {
            resume.store(false, Ordering::Release);
            ResumeResponse::default()
        })?,
        node.serve::<TogglePaused>("~/toggle_paused", move |_| {
            toggle.fetch_xor(true, Ordering::AcqRel);
            TogglePausedResponse::default()
        })?,
        node.serve::<IsPaused>("~/is_paused", move |_| IsPausedResponse {
            paused: is_paused.load(Ordering::Acquire),
        })?,
    ])
}

/// Publishes `/clock`.
fn tell_time(clock: &Publisher<Clock>, nanos: u64) {
    let time = Time::from_nanos(i64::try_from(nanos).unwrap_or(i64::MAX));
    clock.publish(&Clock { clock: time.into() });
}
