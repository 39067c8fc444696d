//! The Foxglove node: serves every topic, unchanged, through the WebSocket server of Foxglove's SDK, and adds
//! annotations of the camera's image. With a [`Cockpit`], clients that know its access token also publish commands, set
//! parameters and call services; one client at a time has control, all others watch.

mod advertisements;
mod annotations;
mod assets;
mod client_topics;
mod control;
mod gate;
mod page;
mod parameters;
mod server;
mod services;

use std::{
    collections::{BTreeMap, BTreeSet},
    net::SocketAddr,
    sync::{Arc, Mutex, OnceLock, PoisonError},
    time::Duration,
};

use foxglove::{Channel, PartialMetadata, RawChannel, messages::ImageAnnotations};

use super::topics;
use crate::{
    msg::{
        self, Interface, cdr,
        fuyu_msgs::FeatureTracks,
        geometry_msgs::PoseStamped,
        rcl_interfaces::ParameterEvent,
        rosgraph_msgs::Clock,
        sensor_msgs::{CameraInfo, Image},
        std_msgs::String as Text,
        tf2_msgs::TFMessage,
    },
    ros::{Node, NodeError, Qos, RawSample, RawSubscription, Time, qos::Durability},
};
use annotations::Overlay;
use client_topics::ClientTopics;
use control::Control;
use gate::Origins;
pub use page::Page;
use parameters::Parameters;
use server::{Operation, Server};

/// Maximum number of nodes whose parameters and services are offered.
const MOST_NODES: usize = 256;

/// Period of the search for new topics.
const LOOK: Duration = Duration::from_millis(200);

/// Prefix of the annotation topics; a viewer draws the last message of each.
const ANNOTATIONS: &str = "camera/annotations";

/// Name of the background image below that prefix: a viewer needs an image to draw on if the camera renders none.
const BACKGROUND: &str = "background";

/// The operator's page and its access token.
pub struct Cockpit {
    /// The page.
    pub page: Page,
    /// The secret that clients need in order to operate.
    pub token: String,
}

impl Cockpit {
    /// A cockpit with a new random token of 128 bits.
    pub fn new(page: Page) -> Self {
        Self {
            page,
            token: format!("{:032x}", rand::random::<u128>()),
        }
    }
}

/// The node's program: serves the graph on `address`. `started` is called with the server's address, and with a cockpit
/// also with the page's address including the token, which must not be logged: the log is a topic.
///
/// # Errors
/// When the address cannot be bound, or DDS fails.
pub fn program(
    node: &Node,
    address: SocketAddr,
    cockpit: Option<Cockpit>,
    started: impl Fn(&str),
) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let origins = declare
        .param(
            "allowed_origins",
            ["https://app.foxglove.dev", "file://"].map(str::to_owned).to_vec(),
            "Origins of web pages that may connect, in addition to those on localhost; * allows all",
        )
        .read_only()
        .value();
    let mut seconds = |name: &str, default: f64, text: &str| {
        let declared = declare.param(name, default, text).range(0.05, 60.0);
        Duration::from_secs_f64(declared.read_only().value())
    };
    let control_timeout = seconds(
        "control_timeout",
        1.0,
        "Silence of the client that has control after which it loses it, and the arm stops [s]",
    );
    let max_lateness = seconds(
        "max_lateness",
        0.5,
        "Commands of a client that arrive so much later than its fastest are dropped [s]",
    );
    declare.finish()?;
    let control = Arc::new(Mutex::new(Control::new(control_timeout)));
    let topics = Arc::new(ClientTopics::new(node, Arc::clone(&control), max_lateness));
    let parameters = Parameters::new(node, Arc::clone(&control));
    let token = cockpit.as_ref().map(|c| c.token.clone());
    let operation = cockpit.map(|cockpit| Operation {
        token: cockpit.token,
        page: cockpit.page,
        topics: Arc::clone(&topics),
        parameters: parameters.handler(),
    });
    let server = Server::start(address, Origins::new(&origins), operation).map_err(|e| {
        NodeError::Input(format!(
            "--foxglove={address}: cannot listen there: {e}; give another ADDR:PORT"
        ))
    })?;
    tracing::info!("Foxglove: open ws://{}", server.address());
    if let Some(token) = &token {
        // In the fragment, which is not sent in requests: a proxy would log it.
        started(&format!("http://{}/#token={token}", server.address()));
        let name = format!("{}/control", node.name().full());
        let service = services::control(&name, &control, &topics);
        server.serve(vec![service]).map_err(refused)?;
    }
    let server = Arc::new(server);
    let camera = Arc::new(Camera {
        channels: Mutex::default(),
        background: OnceLock::new(),
        topic: node.resolve_topic(ANNOTATIONS)?,
        overlay: Mutex::default(),
        server: Arc::clone(&server),
    });
    let mut subscriptions: BTreeMap<String, Option<RawSubscription>> = BTreeMap::new();
    let status = node.diagnostics().status("foxglove");
    // Known nodes, whose parameters and services operators see; `None` without a cockpit.
    let mut nodes = token.as_ref().map(|_| BTreeSet::new());
    let _events = match &nodes {
        Some(_) => Some(watch_parameters(node, &server)?),
        None => None,
    };
    for topic in topics::all() {
        let name = node.resolve_topic(topic.name)?;
        let sink = Sink::new(node, &server, &camera, &name, &topic.type_name, topic.qos);
        let Some(sink) = sink else { continue };
        let take = move |sample| sink.take(sample);
        let subscription =
            node.subscribe_raw(topic.name, &topic.type_name, reading(topic.qos), take)?;
        subscriptions.insert(name, Some(subscription));
    }
    while node.ok() {
        for publisher in node.discovered_publishers() {
            if let Some(known) = &mut nodes
                && let Some(name) = node.node_of(publisher.gid)
                && name != node.name().full()
                && known.len() < MOST_NODES
                && known.insert(name.clone())
            {
                parameters.add_node(&name);
                // Names of other nodes may be invalid.
                let offered = services::of_node(node, &name, &control).map_err(|e| e.to_string());
                let served =
                    offered.and_then(|offered| server.serve(offered).map_err(|e| e.to_string()));
                if let Err(e) = served {
                    tracing::warn!("{name}: its services are not offered: {e}");
                }
            }
            if subscriptions.contains_key(&publisher.topic) {
                continue;
            }
            let (name, kind) = (&publisher.topic, &publisher.type_name);
            let sink = Sink::new(node, &server, &camera, name, kind, publisher.qos);
            let subscription = match sink {
                Some(sink) => {
                    let take = move |sample| sink.take(sample);
                    Some(node.subscribe_discovered(&publisher, reading(publisher.qos), take)?)
                }
                None => {
                    tracing::info!("{name} is not served: fuyu has no definition of {kind}");
                    None
                }
            };
            subscriptions.insert(publisher.topic, subscription);
        }
        status.set("address", server.address());
        status.set("clients", server.clients());
        if token.is_some() {
            if topics.expire() {
                tracing::warn!("the operator's client is silent: it has lost control");
            }
            let held = (control.lock())
                .unwrap_or_else(PoisonError::into_inner)
                .is_held();
            let [late, refused] = topics.dropped();
            status.set(
                "operator",
                if held { "a client has control" } else { "none" },
            );
            status.set("late commands", late);
            status.set("refused messages", refused);
        }
        status.ok("serving");
        std::thread::sleep(LOOK);
    }
    Ok(())
}

fn refused(error: foxglove::FoxgloveError) -> NodeError {
    NodeError::Input(format!("the Foxglove server: {error}"))
}

/// Sends changes of parameters to the operators' clients.
fn watch_parameters(node: &Node, server: &Arc<Server>) -> Result<RawSubscription, NodeError> {
    let server = Arc::clone(server);
    let kind = ParameterEvent::DEFINITION.type_name();
    node.subscribe_raw(
        "/parameter_events",
        &kind,
        Qos::RELIABLE.depth(1000),
        move |sample| {
            if let Ok(event) = cdr::decode(&sample.cdr) {
                let changed = parameters::changed(event);
                if !changed.is_empty() {
                    server.show_parameters(changed);
                }
            }
        },
    )
}

/// The strictest QoS compatible with the offered one.
fn reading(offered: Qos) -> Qos {
    offered.depth(offered.depth.max(100))
}

/// Forwards the samples of one topic.
struct Sink {
    node: Node,
    server: Arc<Server>,
    camera: Arc<Camera>,
    topic: String,
    type_name: String,
    definition: String,
    /// Whether later subscribers also receive the last message.
    latched: bool,
    /// Created with the first message; `None` if advertising failed.
    channel: OnceLock<Option<Arc<RawChannel>>>,
}

impl Sink {
    /// `None` if fuyu does not know the type, since no client could decode it.
    fn new(
        node: &Node,
        server: &Arc<Server>,
        camera: &Arc<Camera>,
        topic: &str,
        type_name: &str,
        qos: Qos,
    ) -> Option<Self> {
        Some(Self {
            node: node.clone(),
            server: Arc::clone(server),
            camera: Arc::clone(camera),
            topic: topic.to_owned(),
            type_name: type_name.to_owned(),
            definition: msg::find(type_name)?.schema_text(),
            latched: qos.durability == Durability::TransientLocal,
            channel: OnceLock::new(),
        })
    }

    fn take(&self, sample: RawSample) {
        let channel = self.channel.get_or_init(|| {
            let definition = self.definition.clone();
            (self.server)
                .advertise(&self.topic, &self.type_name, definition)
                .inspect_err(|e| tracing::warn!("{} is not served: {e}", self.topic))
                .ok()
        });
        let Some(channel) = channel else { return };
        let simulated = self.node.clock().is_simulated();
        let time = nanos(match simulated {
            true => self.node.now(),
            false => sample.received_time,
        });
        if self.topic == topics::CLOCK.name
            && let Ok(clock) = cdr::decode::<Clock>(&sample.cdr)
        {
            self.server.tell_time(nanos(clock.clock.into()));
        }
        if self.type_name == Text::DEFINITION.type_name() && self.latched {
            self.server.assets.add(&sample.cdr);
        }
        self.camera.see(&self.topic, &sample, time);
        channel.log_with_meta(&sample.cdr, PartialMetadata::with_log_time(time));
        if self.latched {
            self.server.keep(channel, time, sample.cdr);
        }
    }
}

fn nanos(time: Time) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(0)
}

/// Annotations for the images of the node's camera.
struct Camera {
    /// Channels by annotation name.
    channels: Mutex<BTreeMap<&'static str, Channel<ImageAnnotations>>>,
    /// `None` if advertising failed.
    background: OnceLock<Option<Arc<RawChannel>>>,
    topic: String,
    overlay: Mutex<Overlay>,
    server: Arc<Server>,
}

impl Camera {
    /// Publishes the annotation that a message gives, if any.
    fn see(&self, topic: &str, sample: &RawSample, time: u64) {
        let mut overlay = self.overlay.lock().unwrap_or_else(PoisonError::into_inner);
        if topic == topics::TF_STATIC.name {
            if let Some(message) = decode::<TFMessage>(sample) {
                overlay.set_transforms(message);
            }
            return;
        }
        let prefix = self.topic.trim_end_matches(ANNOTATIONS);
        let Some(own) = topic.strip_prefix(prefix) else {
            return;
        };
        let place = |name: &'static str, overlay: &Overlay| {
            let drawn = overlay.place(name, &decode::<PoseStamped>(sample)?)?;
            Some((name, drawn))
        };
        let drawn = if own == topics::CAMERA_INFO.name {
            if let Some(info) = decode::<CameraInfo>(sample) {
                self.show_background(&info, time);
                overlay.set_info(info);
            }
            None
        } else if own == topics::FEATURES.name {
            decode::<FeatureTracks>(sample).map(|m| ("features", overlay.features(&m)))
        } else if own == topics::TIP_POSE.name {
            place("tip", &overlay)
        } else if own == topics::MEASURED_GOAL.name {
            place("goal", &overlay)
        } else {
            None
        };
        drop(overlay);
        if let Some((name, drawn)) = drawn {
            let mut channels = self.channels.lock().unwrap_or_else(PoisonError::into_inner);
            let channel = channels
                .entry(name)
                .or_insert_with(|| self.server.advertise_own(&self.below(name)));
            channel.log_with_meta(&drawn, PartialMetadata::with_log_time(time));
        }
    }

    /// The topic of the annotation called `name`.
    fn below(&self, name: &str) -> String {
        format!("{}/{name}", self.topic)
    }

    /// Sends the background image.
    fn show_background(&self, info: &CameraInfo, time: u64) {
        let Some(image) = annotations::background(info) else {
            return;
        };
        let channel = self.background.get_or_init(|| {
            let (kind, definition) = (Image::DEFINITION.type_name(), Image::DEFINITION);
            (self.server)
                .advertise(&self.below(BACKGROUND), &kind, definition.schema_text())
                .inspect_err(|e| tracing::warn!("{BACKGROUND} is not served: {e}"))
                .ok()
        });
        if let Some(channel) = channel {
            let image = cdr::encode(&image);
            channel.log_with_meta(&image, PartialMetadata::with_log_time(time));
            self.server.keep(channel, time, image.into());
        }
    }
}

fn decode<M: Interface>(sample: &RawSample) -> Option<M> {
    cdr::decode(&sample.cdr).ok()
}
