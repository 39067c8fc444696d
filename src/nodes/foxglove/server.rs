//! The WebSocket server of Foxglove's SDK, with two things added: who subscribes to what is said once
//! (`robot_description`) gets the last message at once, and all its threads end with it.

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

/// A running server; ends when dropped.
pub struct Server {
    address: SocketAddr,
    context: Arc<Context>,
    latched: Arc<Latched>,
    /// `None` only while it is dropped.
    handle: Option<WebSocketServerHandle>,
    /// Where it runs: what drops last ends its thread.
    _runtime: Runtime,
}

impl Server {
    /// Listens on `address`.
    ///
    /// # Errors
    /// If the address cannot be listened on, or there is no thread to be had.
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

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Clients at the moment.
    pub fn clients(&self) -> usize {
        self.handle.as_ref().map_or(0, |h| h.client_count())
    }

    /// Advertises a topic of ROS 2 messages as they are on the wire.
    ///
    /// # Errors
    /// When the SDK refuses it.
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

    /// Advertises a topic of one of Foxglove's own types.
    pub fn advertise_own<T: Encode>(&self, topic: &str) -> Channel<T> {
        ChannelBuilder::new(topic).context(&self.context).build()
    }

    /// Keeps a message of `time` \[ns\] for those who subscribe later.
    pub fn keep(&self, channel: &Arc<RawChannel>, time: u64, data: Bytes) {
        let channel = Arc::clone(channel);
        let kept = Kept {
            channel,
            time,
            data,
        };
        self.latched.lock().insert(kept.channel.id(), kept);
    }

    /// Tells all clients what time it is \[ns\].
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

/// The last message of each channel that has one for late joiners.
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
