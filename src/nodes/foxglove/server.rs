//! A WebSocket server of the protocol that Foxglove speaks (`foxglove.websocket.v1`, and `foxglove.sdk.v1`,
//! which is the same as far as it goes here): it advertises channels, and sends the messages of those that a
//! client subscribes to.

use std::collections::{HashMap, VecDeque};
use std::io;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{
    Arc, Mutex, MutexGuard, PoisonError,
    atomic::{AtomicBool, AtomicU64, Ordering},
};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tungstenite::handshake::server::{ErrorResponse, Request, Response};
use tungstenite::{Bytes, Error, Message, WebSocket};

/// Subprotocols that are understood, the preferred one first.
const SUBPROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// How long a client's thread waits for words of its client before it looks for messages to send.
const TICK: Duration = Duration::from_millis(10);
/// How long a client may take to shake hands or to take what it is sent.
const PATIENCE: Duration = Duration::from_secs(5);
/// Bytes that may wait for a client before the oldest messages are dropped.
const QUEUE: usize = 32 << 20;
/// Clients at a time.
const CLIENTS: usize = 16;

/// A stream of messages of one type, as it is advertised.
#[derive(Debug, Clone, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct Channel {
    /// Topic.
    pub topic: String,
    /// How messages are encoded.
    pub encoding: String,
    /// Type.
    pub schema_name: String,
    /// Its definition.
    pub schema: String,
    /// How that is written.
    pub schema_encoding: String,
    /// Whether who subscribes gets the last message at once.
    #[serde(skip)]
    pub latched: bool,
}

/// Number of a channel.
pub type ChannelId = u32;

/// A running server; ends when dropped.
pub struct Server {
    address: SocketAddr,
    shared: Arc<Shared>,
    listener: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Shared {
    stopping: AtomicBool,
    state: Mutex<State>,
    dropped: AtomicU64,
}

#[derive(Default)]
struct State {
    channels: Vec<(Channel, Option<Sample>)>,
    clients: Vec<Arc<Mutex<Client>>>,
}

/// A message and its time \[ns\].
#[derive(Clone)]
struct Sample {
    time: u64,
    data: bytes::Bytes,
}

/// What is to be sent to a client.
#[derive(Default)]
struct Client {
    /// The client's own number of its subscription, by channel.
    subscriptions: HashMap<ChannelId, u32>,
    queue: VecDeque<Message>,
    queued: usize,
}

#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
enum Wish {
    Subscribe {
        subscriptions: Vec<Subscription>,
    },
    #[serde(rename_all = "camelCase")]
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
    #[serde(other)]
    Other,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Subscription {
    id: u32,
    channel_id: ChannelId,
}

impl Server {
    /// Listens on `address`.
    ///
    /// # Errors
    /// If the address cannot be listened on.
    pub fn start(address: SocketAddr) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        let address = listener.local_addr()?;
        listener.set_nonblocking(true)?;
        let shared = Arc::new(Shared::default());
        let accepting = Arc::clone(&shared);
        let listener = thread::Builder::new()
            .name("foxglove".into())
            .spawn(move || accept(&listener, &accepting))?;
        Ok(Self {
            address,
            shared,
            listener: Some(listener),
        })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Clients at the moment.
    pub fn clients(&self) -> usize {
        self.shared.lock().clients.len()
    }

    /// Messages that clients were too slow for.
    pub fn dropped(&self) -> u64 {
        self.shared.dropped.load(Ordering::Relaxed)
    }

    /// Advertises a channel to all clients, now and later.
    pub fn add_channel(&self, channel: Channel) -> ChannelId {
        let mut state = self.shared.lock();
        let id = state.channels.len() as ChannelId;
        let text = advertisement([(id, &channel)]);
        state.channels.push((channel, None));
        for client in &state.clients {
            lock(client).push(Message::text(text.clone()), &self.shared.dropped);
        }
        id
    }

    /// Sends a message of `time` \[ns\] to who has subscribed to its channel. Never waits.
    pub fn publish(&self, channel: ChannelId, time: u64, data: bytes::Bytes) {
        let mut state = self.shared.lock();
        let sample = Sample { time, data };
        for client in &state.clients {
            let mut client = lock(client);
            if let Some(&subscription) = client.subscriptions.get(&channel) {
                client.push(sample.message(subscription), &self.shared.dropped);
            }
        }
        if let Some((channel, last)) = state.channels.get_mut(channel as usize)
            && channel.latched
        {
            *last = Some(sample);
        }
    }

    /// Tells all clients what time it is \[ns\].
    pub fn tell_time(&self, time: u64) {
        let mut data = vec![2];
        data.extend(time.to_le_bytes());
        let data = Bytes::from(data);
        for client in &self.shared.lock().clients {
            lock(client).push(Message::Binary(data.clone()), &self.shared.dropped);
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.shared.stopping.store(true, Ordering::Release);
        if let Some(listener) = self.listener.take() {
            // A panic in it has been told.
            let _ = listener.join();
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Acquire)
    }
}

fn lock(client: &Mutex<Client>) -> MutexGuard<'_, Client> {
    client.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Sample {
    fn message(&self, subscription: u32) -> Message {
        let mut data = Vec::with_capacity(13 + self.data.len());
        data.push(1);
        data.extend(subscription.to_le_bytes());
        data.extend(self.time.to_le_bytes());
        data.extend(&self.data);
        Message::Binary(data.into())
    }
}

impl Client {
    fn push(&mut self, message: Message, dropped: &AtomicU64) {
        self.queued += message.len();
        self.queue.push_back(message);
        while self.queued > QUEUE && self.queue.len() > 1 {
            // What was advertised must arrive; messages need not.
            let oldest = self.queue.iter().position(Message::is_binary);
            let Some(gone) = oldest.and_then(|at| self.queue.remove(at)) else {
                break;
            };
            self.queued -= gone.len();
            dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn pop(&mut self) -> Option<Message> {
        let message = self.queue.pop_front()?;
        self.queued -= message.len();
        Some(message)
    }
}

fn advertisement<'a>(channels: impl IntoIterator<Item = (ChannelId, &'a Channel)>) -> String {
    #[derive(Serialize)]
    struct Advertised<'a> {
        id: ChannelId,
        #[serde(flatten)]
        channel: &'a Channel,
    }
    let channels: Vec<_> = channels
        .into_iter()
        .map(|(id, channel)| Advertised { id, channel })
        .collect();
    serde_json::json!({ "op": "advertise", "channels": channels }).to_string()
}

fn accept(listener: &TcpListener, shared: &Arc<Shared>) {
    let mut threads: Vec<JoinHandle<()>> = Vec::new();
    while !shared.is_stopping() {
        threads.retain(|t| !t.is_finished());
        match listener.accept() {
            Ok((stream, peer)) if threads.len() < CLIENTS => {
                let shared = Arc::clone(shared);
                let serve = move || match serve(stream, &shared) {
                    Ok(()) | Err(Error::ConnectionClosed | Error::AlreadyClosed) => {}
                    Err(e) => tracing::debug!("foxglove client {peer}: {e}"),
                };
                let spawned = thread::Builder::new().name("foxglove".into()).spawn(serve);
                match spawned {
                    Ok(thread) => threads.push(thread),
                    Err(e) => tracing::warn!("foxglove client {peer}: no thread: {e}"),
                }
            }
            Ok((_, peer)) => {
                tracing::warn!("foxglove client {peer} is refused: there are {CLIENTS} already");
            }
            // Nobody comes, or who came has gone at once.
            Err(_) => thread::sleep(5 * TICK),
        }
    }
    for thread in threads {
        let _ = thread.join();
    }
}

/// Chooses the subprotocol: clients refuse an answer without.
#[expect(
    clippy::result_large_err,
    reason = "the type that tungstenite asks for"
)]
fn choose(request: &Request, mut response: Response) -> Result<Response, ErrorResponse> {
    let offered = request
        .headers()
        .get_all("Sec-WebSocket-Protocol")
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(',').map(str::trim))
        .collect::<Vec<_>>();
    match SUBPROTOCOLS.into_iter().find(|p| offered.contains(p)) {
        Some(chosen) => {
            let header = tungstenite::http::HeaderValue::from_static(chosen);
            response
                .headers_mut()
                .insert("Sec-WebSocket-Protocol", header);
            Ok(response)
        }
        None => {
            let text = format!("a client must offer one of {}\n", SUBPROTOCOLS.join(", "));
            let mut refusal = ErrorResponse::new(Some(text));
            *refusal.status_mut() = tungstenite::http::StatusCode::BAD_REQUEST;
            Err(refusal)
        }
    }
}

/// Serves one client until it leaves.
fn serve(stream: TcpStream, shared: &Shared) -> Result<(), Error> {
    stream.set_nonblocking(false)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let Ok(mut socket) = tungstenite::accept_hdr(stream, choose) else {
        return Ok(());
    };
    socket.get_ref().set_read_timeout(Some(TICK))?;
    let client = Arc::new(Mutex::new(Client::default()));
    {
        let mut state = shared.lock();
        let info = serde_json::json!({
            "op": "serverInfo", "name": "fuyu", "capabilities": ["time"],
            "supportedEncodings": [], "metadata": {},
        });
        let channels = (0..).zip(state.channels.iter().map(|(c, _)| c));
        for text in [info.to_string(), advertisement(channels)] {
            lock(&client).push(Message::text(text), &shared.dropped);
        }
        state.clients.push(Arc::clone(&client));
    }
    let outcome = talk(&mut socket, &client, shared);
    shared.lock().clients.retain(|c| !Arc::ptr_eq(c, &client));
    outcome
}

fn talk(
    socket: &mut WebSocket<TcpStream>,
    client: &Mutex<Client>,
    shared: &Shared,
) -> Result<(), Error> {
    while !shared.is_stopping() {
        loop {
            let message = lock(client).pop();
            let Some(message) = message else { break };
            socket.write(message)?;
        }
        socket.flush()?;
        match socket.read() {
            Ok(Message::Text(text)) => obey(text.as_str(), client, shared),
            Ok(_) => {}
            Err(Error::Io(e))
                if matches!(
                    e.kind(),
                    io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut
                ) => {}
            Err(e) => return Err(e),
        }
    }
    // The client may have gone before.
    let _ = socket.close(None);
    let _ = socket.flush();
    Ok(())
}

fn obey(text: &str, client: &Mutex<Client>, shared: &Shared) {
    let request = match serde_json::from_str::<Wish>(text) {
        Ok(request) => request,
        Err(e) => {
            let status = serde_json::json!({
                "op": "status", "level": 1, "message": format!("not understood: {e}"),
            });
            lock(client).push(Message::text(status.to_string()), &shared.dropped);
            return;
        }
    };
    let state = shared.lock();
    let mut client = lock(client);
    match request {
        Wish::Subscribe { subscriptions } => {
            for Subscription { id, channel_id } in subscriptions {
                let Some((_, last)) = state.channels.get(channel_id as usize) else {
                    let status = serde_json::json!({
                        "op": "status", "level": 1,
                        "message": format!("there is no channel {channel_id}"),
                    });
                    client.push(Message::text(status.to_string()), &shared.dropped);
                    continue;
                };
                client.subscriptions.insert(channel_id, id);
                if let Some(last) = last {
                    client.push(last.message(id), &shared.dropped);
                }
            }
        }
        Wish::Unsubscribe { subscription_ids } => {
            client
                .subscriptions
                .retain(|_, id| !subscription_ids.contains(id));
        }
        // Nothing that was offered.
        Wish::Other => {}
    }
}
