//! The WebSocket server of Foxglove's SDK with additions: late subscribers of latched topics (`robot_description`)
//! receive the last message immediately, a gate refuses foreign web pages, clients that know the access token may
//! operate, and dropping the server ends all its threads.
//!
//! Clients that may operate have a separate server, since the SDK's listener cannot see a client's request. Both
//! servers offer the same topics.

use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use bytes::Bytes;
use foxglove::websocket::service::Service;
use foxglove::websocket::{
    Capability, ChannelView, Client, ClientChannel, Parameter, ParameterHandler, ServerListener,
};
use foxglove::{
    Channel, ChannelBuilder, ChannelId, Context, Encode, FoxgloveError, PartialMetadata,
    RawChannel, Schema, WebSocketServer, WebSocketServerHandle,
};
use tokio::runtime::Runtime;

use super::advertisements::Advertisements;
use super::assets::Assets;
use super::client_topics::ClientTopics;
use super::gate::{self, Entry, Origins, Routes};
use super::page::Page;

/// A running server; stops when dropped.
pub struct Server {
    address: SocketAddr,
    context: Arc<Context>,
    advertisements: Advertisements,
    latched: Arc<Latched>,
    /// Meshes that clients may fetch.
    pub assets: Arc<Assets>,
    /// The SDK's server for watchers, and the one for operators if there is one; empty only during drop.
    handles: Vec<WebSocketServerHandle>,
    /// Its runtime; declared last, so that its thread ends last.
    runtime: Runtime,
}

/// Time for clients to close their connections when the server stops: a client behind a stalled network never does.
const FAREWELL: Duration = Duration::from_secs(1);

/// Access of clients that know the token.
pub struct Operation {
    /// The access token.
    pub token: String,
    /// The cockpit's page.
    pub page: Page,
    /// Topics on which they may publish.
    pub topics: Arc<ClientTopics>,
    /// Parameters that they may read and set.
    pub parameters: Arc<dyn ParameterHandler>,
}

impl Server {
    /// Listens on `address`; web pages from `origins` may connect. Without `operation`, clients only watch.
    ///
    /// # Errors
    /// If the address cannot be bound, or the thread cannot be created.
    pub fn start(
        address: SocketAddr,
        origins: Origins,
        operation: Option<Operation>,
    ) -> Result<Self, FoxgloveError> {
        let listener = gate::listen(address).map_err(FoxgloveError::Bind)?;
        let address = listener.local_addr().map_err(FoxgloveError::Bind)?;
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("foxglove")
            .enable_all()
            .build()
            .map_err(FoxgloveError::Bind)?;
        let context = Context::new();
        let advertisements = Advertisements::new();
        let latched = Arc::new(Latched::default());
        let assets = Arc::new(Assets::default());
        let builder = |hidden: SocketAddr| {
            let assets = Arc::clone(&assets);
            WebSocketServer::new()
                .name("fuyu")
                .bind(hidden.ip().to_string(), hidden.port())
                .context(&context)
                .tokio_runtime(runtime.handle())
                .fetch_asset_handler_blocking_fn(move |_, name| assets.fetch(&name))
        };
        let hidden = gate::hidden_address();
        let watching = builder(hidden)
            .capabilities([Capability::Time])
            .listener(Arc::clone(&latched) as _)
            .start_blocking()?;
        let watchers = SocketAddr::new(hidden.ip(), watching.port());
        let mut handles = vec![watching];
        let mut operators = None;
        if let Some(operation) = operation {
            let hidden = gate::hidden_address();
            let listener = OperatorListener {
                latched: Arc::clone(&latched),
                topics: operation.topics,
            };
            let operating = builder(hidden)
                .capabilities([
                    Capability::Time,
                    Capability::ClientPublish,
                    Capability::Parameters,
                    Capability::Services,
                ])
                .supported_encodings(["cdr"])
                .parameter_handler(operation.parameters)
                .listener(Arc::new(listener))
                .start_blocking()?;
            operators = Some(Entry {
                server: SocketAddr::new(hidden.ip(), operating.port()),
                token: operation.token,
                page: operation.page,
            });
            handles.push(operating);
        }
        let routes = Routes {
            watchers,
            operators,
            origins,
            advertisements: advertisements.clone(),
        };
        runtime.spawn(gate::pass(listener, routes));
        Ok(Self {
            address,
            context,
            advertisements,
            latched,
            assets,
            handles,
            runtime,
        })
    }

    /// Its address.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Number of connected clients.
    pub fn clients(&self) -> usize {
        self.handles.iter().map(|h| h.client_count()).sum()
    }

    /// Offers services to clients that may operate.
    ///
    /// # Errors
    /// If the SDK rejects a service.
    pub fn serve(&self, services: Vec<Service>) -> Result<(), FoxgloveError> {
        match self.handles.get(1) {
            Some(operating) => operating.add_services(services),
            None => Ok(()),
        }
    }

    /// Sends parameter values to the clients that have subscribed to them.
    pub fn show_parameters(&self, parameters: Vec<Parameter>) {
        if let Some(operating) = self.handles.get(1) {
            operating.publish_parameter_values(parameters);
        }
    }

    /// Advertises a topic of CDR-encoded ROS 2 messages.
    ///
    /// # Errors
    /// If the SDK rejects the topic.
    pub fn advertise(
        &self,
        topic: &str,
        type_name: &str,
        definition: String,
    ) -> Result<Arc<RawChannel>, FoxgloveError> {
        let channel = ChannelBuilder::new(topic)
            .context(&self.context)
            .message_encoding("cdr")
            .schema(Schema::new(type_name, "ros2msg", definition.into_bytes()));
        self.advertisements.during(|| channel.build_raw())
    }

    /// Advertises a topic of a Foxglove type.
    pub fn advertise_own<T: Encode>(&self, topic: &str) -> Channel<T> {
        let channel = ChannelBuilder::new(topic).context(&self.context);
        self.advertisements.during(|| channel.build())
    }

    /// Stores a message with its `time` \[ns\] for later subscribers of a latched topic.
    pub fn keep(&self, channel: &Arc<RawChannel>, time: u64, data: Bytes) {
        let channel = Arc::clone(channel);
        let kept = Kept {
            channel,
            time,
            data,
        };
        self.latched.lock().insert(kept.channel.id(), kept);
    }

    /// Broadcasts the current time \[ns\] to all clients.
    pub fn tell_time(&self, time: u64) {
        for handle in &self.handles {
            handle.broadcast_time(time);
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        for handle in self.handles.drain(..) {
            let stopped = handle.stop().wait();
            let stopped = async { tokio::time::timeout(FAREWELL, stopped).await };
            if self.runtime.block_on(stopped).is_err() {
                tracing::warn!("Foxglove: a client does not answer; its connection is cut");
            }
        }
    }
}

/// A message and its time \[ns\].
#[derive(Clone)]
struct Kept {
    channel: Arc<RawChannel>,
    time: u64,
    data: Bytes,
}

/// The last message of each latched channel, for late subscribers.
#[derive(Default)]
struct Latched(Mutex<HashMap<ChannelId, Kept>>);

impl Latched {
    fn lock(&self) -> MutexGuard<'_, HashMap<ChannelId, Kept>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ServerListener for Latched {
    fn on_subscribe(&self, client: Client, channel: ChannelView) {
        let last = self.lock().get(&channel.id()).cloned();
        if let Some(Kept {
            channel,
            time,
            data,
        }) = last
        {
            let time = PartialMetadata::with_log_time(time);
            channel.log_with_meta_to_sink(&data, time, client.sink_id());
        }
    }
}

/// Listener for clients that may operate.
struct OperatorListener {
    latched: Arc<Latched>,
    topics: Arc<ClientTopics>,
}

impl ServerListener for OperatorListener {
    fn on_subscribe(&self, client: Client, channel: ChannelView) {
        self.latched.on_subscribe(client, channel);
    }

    fn on_client_advertise(&self, client: Client, channel: &ClientChannel) {
        self.topics.advertised(&client, channel);
    }

    fn on_message_data(&self, client: Client, channel: &ClientChannel, payload: &[u8]) {
        self.topics.take(&client, channel, payload);
    }

    fn on_client_unadvertise(&self, client: Client, channel: &ClientChannel) {
        self.topics.withdrawn(&client, channel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use std::io::{Read, Write};
    use std::net::TcpStream;
    use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
    use tungstenite::client::IntoClientRequest;

    #[test]
    fn a_handshake_succeeds_from_programs_and_allowed_pages_only() {
        let origins = Origins::new(&["https://app.foxglove.dev".to_owned()]);
        let server = Server::start(SocketAddr::from(([127, 0, 0, 1], 0)), origins, None).unwrap();
        let status = |origin: &str| {
            let mut client = TcpStream::connect(server.address()).unwrap();
            let request = format!(
                "GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
                 Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\
                 Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n{origin}\r\n"
            );
            client.write_all(request.as_bytes()).unwrap();
            let mut answer = [0; 12];
            client.read_exact(&mut answer).unwrap();
            String::from_utf8_lossy(&answer[9..]).into_owned()
        };
        assert_eq!(status(""), "101");
        assert_eq!(status("Origin: http://localhost:8080\r\n"), "101");
        assert_eq!(status("Origin: https://app.foxglove.dev\r\n"), "101");
        assert_eq!(status("Origin: https://evil.example\r\n"), "403");
    }

    // Fails, in one of a dozen runs on a busy computer, if subscriptions do not wait for the end of an advertisement.
    #[test]
    fn a_client_that_subscribes_at_once_is_subscribed() {
        const TOPICS: usize = 3000;
        let local = SocketAddr::from(([127, 0, 0, 1], 0));
        let server = Server::start(local, Origins::new(&[]), None).unwrap();
        let url = format!("ws://{}", server.address());
        let mut request = url.into_client_request().unwrap();
        let protocol = "foxglove.sdk.v1".parse().unwrap();
        (request.headers_mut()).insert("Sec-WebSocket-Protocol", protocol);
        let (mut client, _) = tungstenite::connect(request).unwrap();
        let seen = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            let subscriber = scope.spawn(|| {
                while seen.load(Relaxed) < TOPICS {
                    let message = client.read().unwrap().into_text().unwrap();
                    let message: serde_json::Value = serde_json::from_str(&message).unwrap();
                    assert_ne!(message["op"], "status", "after {seen:?} topics: {message}");
                    for channel in message["channels"].as_array().into_iter().flatten() {
                        let id = seen.fetch_add(1, Relaxed);
                        let wish = json!({"id": id, "channelId": channel["id"]});
                        let wish = json!({"op": "subscribe", "subscriptions": [wish]});
                        client.send(wish.to_string().into()).unwrap();
                    }
                }
                // The server refuses this unknown operation after answering all earlier requests.
                client.send(r#"{"op": "none"}"#.into()).unwrap();
                let last = client.read().unwrap().into_text().unwrap();
                assert!(!last.contains("Unknown channel"), "{last}");
            });
            for k in 0..TOPICS {
                // The server disconnects clients that are slow.
                while k > seen.load(Relaxed) + 100 && !subscriber.is_finished() {
                    std::thread::yield_now();
                }
                (server.advertise(&format!("/topic{k}"), "a/msg/B", "float64 x".into())).unwrap();
            }
        });
    }
}
