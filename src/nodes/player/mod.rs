//! Publishes a bag again: its topics, types and quality of service, at the times at which they were
//! recorded.

mod pace;

use std::{
    collections::BTreeMap,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
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

/// The name that the node of `ros2 bag play` has.
pub const NAME: &str = "rosbag2_player";

/// What is played, and how.
#[derive(Debug, Clone)]
pub struct Player {
    /// The recording.
    pub bag: Bag,
    /// Recorded seconds that pass in one second.
    pub rate: f64,
    /// Whether it begins anew at its end.
    pub repeat: bool,
    /// How often `/clock` is published \[Hz\], instead of the one in the bag.
    pub clock: Option<f64>,
    /// Topics to play; empty is all.
    pub topics: Vec<String>,
    /// Recorded time to leave out at the beginning. Of latched topics the last message before is played.
    pub start_offset: Duration,
    /// How long subscribers have to find the topics before the first message.
    pub delay: Duration,
    /// Whether it waits for a call of `resume`.
    pub start_paused: bool,
}

/// What was played.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Played {
    /// Messages that were published.
    pub messages: u64,
    /// Of these, messages that subscribers or the network were too slow for.
    pub dropped: u64,
    /// Topics.
    pub topics: usize,
    /// Topics that cannot be played, each with the reason.
    pub left_out: BTreeMap<String, String>,
    /// Where the bag is not whole.
    pub damage: Vec<Damage>,
}

impl Player {
    /// The node's program; `played` has at the end what there is to say.
    ///
    /// # Errors
    /// When the bag has no such topics, or DDS refuses.
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
        let mut stage = Stage {
            player: self,
            node,
            publishers: BTreeMap::new(),
            played,
        };
        // Everything is announced before anything is said.
        for topic in &info.topics {
            stage.announce(&topic.name, &topic.type_name, &topic.encoding, &topic.qos)?;
        }
        let begin = start.saturating_add(self.start_offset.as_nanos() as u64);
        let mut pace = Pace::new(node, begin, self.rate, self.clock, clock, paused);
        pace.wait(self.delay);
        loop {
            stage.once(begin, &mut pace)?;
            if !self.repeat || !node.ok() {
                break;
            }
            pace.restart();
        }
        stage.finish();
        Ok(())
    }

    fn takes(&self, topic: &str) -> bool {
        let named = self.topics.is_empty() || self.topics.iter().any(|t| t == topic);
        named && !(self.clock.is_some() && topic == topics::CLOCK.name)
    }
}

/// The topics while they are played.
struct Stage<'a> {
    player: &'a Player,
    node: &'a Node,
    /// By name in the bag; `None` for one that cannot be played.
    publishers: BTreeMap<String, Option<RawPublisher>>,
    played: &'a Mutex<Played>,
}

impl Stage<'_> {
    fn announce(
        &mut self,
        name: &str,
        type_name: &str,
        encoding: &str,
        qos: &[Qos],
    ) -> Result<(), NodeError> {
        if self.publishers.contains_key(name) || !self.player.takes(name) {
            return Ok(());
        }
        let publisher = match encoding {
            "cdr" => match self.node.advertise_raw(name, type_name, Qos::offer(qos)) {
                Ok(publisher) => Ok(publisher),
                Err(e @ (NodeError::Input(_) | NodeError::Name(_))) => Err(e.to_string()),
                Err(e) => return Err(e),
            },
            other => Err(format!("its messages are encoded as {other}, not cdr")),
        };
        if let Err(why) = &publisher {
            tracing::warn!("topic {name} is not played: {why}");
            self.tell(|played| played.left_out.insert(name.to_owned(), why.clone()));
        }
        self.publishers.insert(name.to_owned(), publisher.ok());
        Ok(())
    }

    /// Plays the bag from `begin` to its end.
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
        // Latched topics are there even if nothing comes after `begin`.
        for (_, early) in latched {
            self.publish(early)?;
        }
        let damage = messages.damage();
        self.tell(|played| played.damage = damage);
        Ok(())
    }

    fn publish(&mut self, message: Message) -> Result<(), NodeError> {
        let topic = Arc::clone(&message.topic);
        self.announce(&topic.name, &topic.type_name, &topic.encoding, &topic.qos)?;
        if let Some(Some(publisher)) = self.publishers.get(&topic.name) {
            publisher.publish(message.data);
            self.tell(|played| played.messages += 1);
        }
        Ok(())
    }

    fn finish(self) {
        let publishers: Vec<_> = self.publishers.into_values().flatten().collect();
        let dropped = publishers.iter().map(RawPublisher::dropped).sum();
        let mut played = self.played.lock().unwrap_or_else(PoisonError::into_inner);
        played.topics = publishers.len();
        played.dropped = dropped;
    }

    fn tell<T>(&self, change: impl FnOnce(&mut Played) -> T) {
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
