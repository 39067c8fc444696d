//! The WebSocket server of Foxglove's SDK with two additions: late subscribers of latched topics
//! (`robot_description`) receive the last message immediately, and all its threads end with it.

use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bytes::Bytes;
use foxglove::websocket::{Capability, ChannelView, Client, ServerListener};
use foxglove::{
    Channel, ChannelBuilder, ChannelId, Context, Encode, FoxgloveError, PartialMetadata,
    RawChannel, Schema, WebSocketServer, WebSocketServerHandle,
};
use tokio::runtime::Runtime;

/// A running server; stops when dropped.
pub struct Server {
    address: SocketAddr,
    context: Arc<Context>,
    latched: Arc<Latched>,
    /// `None` only during drop.
    handle: Option<WebSocketServerHandle>,
    /// Its runtime; declared last, so that dropping it ends its thread last.
    _runtime: Runtime,
}

impl Server {
    /// Listens on `address`.
    ///
    /// # Errors
    /// If the address cannot be bound, or the thread cannot be created.
    pub fn start(address: SocketAddr) -> Result<Self, FoxgloveError> {
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("foxglove")
            .enable_all()
            .build()
            .map_err(FoxgloveError::Bind)?;
        let context = Context::new();
        let latched = Arc::new(Latched::default());
        let handle = WebSocketServer::new()
            .name("fuyu")
            .bind(address.ip().to_string(), address.port())
            .capabilities([Capability::Time])
            .listener(Arc::clone(&latched) as _)
            .context(&context)
            .tokio_runtime(runtime.handle())
            .start_blocking()?;
        Ok(Self {
            address: SocketAddr::new(address.ip(), handle.port()),
            context,
            latched,
            handle: Some(handle),
            _runtime: runtime,
        })
    }

    /// Its address.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Number of connected clients.
    pub fn clients(&self) -> usize {
        self.handle.as_ref().map_or(0, |h| h.client_count())
    }

    /// Advertises a topic of CDR-encoded ROS 2 messages.
    ///
    /// # Errors
    /// When the SDK rejects it.
    pub fn advertise(
        &self,
        topic: &str,
        type_name: &str,
        definition: String,
    ) -> Result<Arc<RawChannel>, FoxgloveError> {
        ChannelBuilder::new(topic)
            .context(&self.context)
            .message_encoding("cdr")
            .schema(Schema::new(type_name, "ros2msg", definition.into_bytes()))
            .build_raw()
    }

    /// Advertises a topic of one of Foxglove's types.
    pub fn advertise_own<T: Encode>(&self, topic: &str) -> Channel<T> {
        ChannelBuilder::new(topic).context(&self.context).build()
    }

    /// Keeps a message with its `time` \[ns\] for later subscribers.
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
        if let Some(handle) = &self.handle {
            handle.broadcast_time(time);
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Some(handle) = self.handle.take() {
            handle.stop().wait_blocking();
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
