//! Topics that the operator's client publishes: those with subscribers but no publishers among the nodes, such as `joy`
//! and `goal_pose`.
//!
//! Only commands of the client that has control are accepted. Steering commands (`joy`, `cmd_vel`) that arrive much
//! later than usual were delayed in the network and are dropped. When control ends, for whatever reason, the last
//! steering command is repeated with all axes and buttons released, so that the arm stops at once instead of after the
//! timeout of the teleop node.

use std::{
    collections::BTreeMap,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

use foxglove::websocket::{Client, ClientChannel, ClientId, Status};

use super::control::Control;
use crate::{
    msg::{
        builtin_interfaces, cdr,
        geometry_msgs::{Twist, TwistStamped},
        sensor_msgs::Joy,
    },
    nodes::topics::{self, Declaration},
    ros::{Node, RawPublisher, Time},
};

/// Largest message of a client \[bytes\].
const LARGEST: usize = 1 << 20;
/// Maximum number of topics on which clients publish at a time: each is an endpoint in the graph.
const MOST_TOPICS: usize = 64;

/// Publishers for clients, with control and lateness checks.
pub struct ClientTopics {
    node: Node,
    control: Arc<Mutex<Control<ClientId>>>,
    /// Lateness above which steering commands are dropped.
    max_lateness: Duration,
    allowed: Vec<Declaration>,
    publishers: Mutex<BTreeMap<String, RawPublisher>>,
    /// The last steering command on each topic, since control was taken.
    steering: Mutex<BTreeMap<String, Steering>>,
    late: AtomicU64,
    refused: AtomicU64,
}

/// A steering command: it moves the arm until it is replaced or times out.
enum Steering {
    Joy(Joy),
    Twist(TwistStamped),
}

impl Steering {
    /// Decodes a steering command; `None` if `type_name` is not a type of steering commands.
    fn read(type_name: &str, data: &[u8]) -> Option<Result<Self, cdr::CdrError>> {
        match type_name {
            "sensor_msgs/msg/Joy" => Some(cdr::decode(data).map(Self::Joy)),
            "geometry_msgs/msg/TwistStamped" => Some(cdr::decode(data).map(Self::Twist)),
            _ => None,
        }
    }

    /// Stamp by the client's clock \[s\]; `None` if it is zero.
    fn sent(&self) -> Option<f64> {
        let stamp = match self {
            Self::Joy(joy) => &joy.header.stamp,
            Self::Twist(twist) => &twist.header.stamp,
        };
        let stated = *stamp != builtin_interfaces::Time::default();
        stated.then(|| Time::from(stamp).as_secs_f64())
    }

    /// The same message with all axes and buttons released, or a zero twist.
    fn released(self) -> Vec<u8> {
        match self {
            Self::Joy(mut joy) => {
                joy.axes.fill(0.0);
                joy.buttons.fill(0);
                cdr::encode(&joy)
            }
            Self::Twist(mut twist) => {
                twist.twist = Twist::default();
                cdr::encode(&twist)
            }
        }
    }
}

impl ClientTopics {
    /// No publishers yet.
    pub fn new(
        node: &Node,
        control: Arc<Mutex<Control<ClientId>>>,
        max_lateness: Duration,
    ) -> Self {
        let mut allowed = topics::all();
        allowed.retain(|topic| topic.writers == ["you"]);
        Self {
            node: node.clone(),
            control,
            max_lateness,
            allowed,
            publishers: Mutex::default(),
            steering: Mutex::default(),
            late: AtomicU64::new(0),
            refused: AtomicU64::new(0),
        }
    }

    /// Number of commands dropped because they were late, and number of refused messages.
    pub fn dropped(&self) -> [u64; 2] {
        [self.late.load(Relaxed), self.refused.load(Relaxed)]
    }

    /// The declaration of the topic of a client's channel.
    ///
    /// # Errors
    /// The reason why clients may not publish there.
    fn declared(&self, channel: &ClientChannel) -> Result<&Declaration, String> {
        let ClientChannel {
            topic, encoding, ..
        } = channel;
        let declared = self.allowed.iter().find(|declared| {
            let name = topic.strip_suffix(declared.name);
            name.is_some_and(|namespace| namespace.starts_with('/') && namespace.ends_with('/'))
        });
        let Some(declared) = declared else {
            let names: Vec<_> = self.allowed.iter().map(|t| t.name).collect();
            return Err(format!(
                "{topic}: clients may publish on {}, with a namespace before it",
                names.join(", ")
            ));
        };
        let given = &channel.schema_name;
        let short = declared.type_name.replacen("/msg/", "/", 1);
        if ![&declared.type_name, &short].contains(&given) {
            return Err(format!(
                "{topic}: the schema is {given}; expected {}",
                declared.type_name
            ));
        }
        if encoding != "cdr" {
            return Err(format!("{topic}: the encoding is {encoding}; expected cdr"));
        }
        Ok(declared)
    }

    /// Warns a client that advertises a channel on which it may not publish.
    pub fn advertised(&self, client: &Client, channel: &ClientChannel) {
        if let Err(problem) = self.declared(channel) {
            client.send_status(Status::warning(problem));
        }
    }

    /// Publishes a message of a client.
    pub fn take(&self, client: &Client, channel: &ClientChannel, data: &[u8]) {
        if let Err(problem) = self.publish(client.id(), channel, data) {
            self.refused.fetch_add(1, Relaxed);
            // Clients show statuses with the same id once.
            let status = Status::warning(problem).with_id(format!("refused {}", channel.topic));
            client.send_status(status);
        }
    }

    fn publish(
        &self,
        client: ClientId,
        channel: &ClientChannel,
        data: &[u8],
    ) -> Result<(), String> {
        let declared = self.declared(channel)?;
        let topic = &channel.topic;
        if data.len() > LARGEST {
            return Err(format!(
                "{topic}: a message of {} bytes; at most {LARGEST} are allowed",
                data.len()
            ));
        }
        let steering = match Steering::read(&declared.type_name, data) {
            Some(read) => Some(read.map_err(|e| format!("{topic}: {e}"))?),
            None => None,
        };
        // Locked from the check of control until publishing: another thread must not end control in between.
        let mut publishers = lock(&self.publishers);
        if !lock(&self.control).command(client, Instant::now()) {
            return Err(format!(
                "{topic}: another client has control, or this one has been silent and must take it again"
            ));
        }
        if let Some(sent) = steering.as_ref().and_then(Steering::sent) {
            let lateness = lock(&self.control).lateness(sent, Time::wall().as_secs_f64());
            if lateness > self.max_lateness.as_secs_f64() {
                self.late.fetch_add(1, Relaxed);
                return Ok(());
            }
        }
        if !publishers.contains_key(topic) {
            if publishers.len() >= MOST_TOPICS {
                return Err(format!(
                    "{topic}: clients publish on {MOST_TOPICS} topics already"
                ));
            }
            let publisher = (self.node)
                .advertise_raw(topic, &declared.type_name, declared.qos)
                .map_err(|e| format!("{topic}: {e}"))?;
            publishers.insert(topic.clone(), publisher);
        }
        if let Some(steering) = steering {
            lock(&self.steering).insert(topic.clone(), steering);
        }
        publishers[topic].publish(data.to_vec());
        Ok(())
    }

    /// Ends the control of a client that stops publishing on a steering topic, or disconnects.
    pub fn withdrawn(&self, client: &Client, channel: &ClientChannel) {
        let steers = lock(&self.steering).contains_key(&channel.topic);
        if steers {
            self.release(client.id());
        }
    }

    /// Ends the control of `client`, if it has control.
    pub fn release(&self, client: ClientId) {
        if lock(&self.control).release(client) {
            self.stop();
        }
    }

    /// Ends the control of a client that was silent for too long. Returns whether there was one.
    pub fn expire(&self) -> bool {
        let expired = lock(&self.control).expire(Instant::now()).is_some();
        if expired {
            self.stop();
        }
        expired
    }

    /// Publishes released commands on the steering topics.
    fn stop(&self) {
        let publishers = lock(&self.publishers);
        for (topic, last) in std::mem::take(&mut *lock(&self.steering)) {
            if let Some(publisher) = publishers.get(&topic) {
                publisher.publish(last.released());
            }
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_released_command_has_the_shape_of_the_last_one() {
        let mut joy = Joy {
            axes: vec![0.5, -1.0, 0.0],
            buttons: vec![1, 0],
            ..Joy::default()
        };
        joy.header.stamp.sec = 7;
        let steering = Steering::read("sensor_msgs/msg/Joy", &cdr::encode(&joy));
        let steering = steering.unwrap().unwrap();
        assert_eq!(steering.sent(), Some(7.0));
        let released: Joy = cdr::decode(&steering.released()).unwrap();
        assert_eq!(
            (released.axes, released.buttons),
            (vec![0.0; 3], vec![0; 2])
        );
        let mut twist = TwistStamped::default();
        twist.header.frame_id = "tool0".to_owned();
        twist.twist.linear.x = 0.1;
        let steering = Steering::read("geometry_msgs/msg/TwistStamped", &cdr::encode(&twist));
        let steering = steering.unwrap().unwrap();
        assert_eq!(steering.sent(), None);
        let released: TwistStamped = cdr::decode(&steering.released()).unwrap();
        assert_eq!(released.header.frame_id, "tool0");
        assert_eq!(released.twist, Twist::default());
        assert!(Steering::read("geometry_msgs/msg/PoseStamped", &[]).is_none());
        assert!(
            Steering::read("sensor_msgs/msg/Joy", &[0, 1, 0])
                .unwrap()
                .is_err()
        );
    }
}
