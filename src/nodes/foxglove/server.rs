//! The WebSocket server of Foxglove's SDK with three additions: late subscribers of latched topics
//! (`robot_description`) receive the last message immediately, a gate refuses foreign web pages, and all its threads end
//! with it.

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

use super::gate::{self, Origins};

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
    /// Listens on `address`; web pages may connect if `origins` allows them.
    ///
    /// # Errors
    /// If the address cannot be bound, or the thread cannot be created.
    pub fn start(address: SocketAddr, origins: Origins) -> Result<Self, FoxgloveError> {
        let listener = gate::listen(address).map_err(FoxgloveError::Bind)?;
        let address = listener.local_addr().map_err(FoxgloveError::Bind)?;
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("foxglove")
            .enable_all()
            .build()
            .map_err(FoxgloveError::Bind)?;
        let hidden = gate::hidden_address();
        let context = Context::new();
        let latched = Arc::new(Latched::default());
        let handle = WebSocketServer::new()
            .name("fuyu")
            .bind(hidden.ip().to_string(), hidden.port())
            .capabilities([Capability::Time])
            .listener(Arc::clone(&latched) as _)
            .context(&context)
            .tokio_runtime(runtime.handle())
            .start_blocking()?;
        let server = SocketAddr::new(hidden.ip(), handle.port());
        runtime.spawn(gate::pass(listener, server, origins));
        Ok(Self {
            address,
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};
    use std::net::TcpStream;

    #[test]
    fn a_handshake_succeeds_from_programs_and_allowed_pages_only() {
        let origins = Origins::new(&["https://app.foxglove.dev".to_owned()]);
        let server = Server::start(SocketAddr::from(([127, 0, 0, 1], 0)), origins).unwrap();
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
}
