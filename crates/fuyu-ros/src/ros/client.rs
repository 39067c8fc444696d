//! Service clients. A reply arrives later and is matched to its request by the identity of the request sample.

use bytes::Bytes;
use std::{
    collections::HashMap,
    marker::PhantomData,
    sync::{Arc, Mutex, MutexGuard, PoisonError, atomic::Ordering::Relaxed},
    time::{Duration, Instant},
};

use super::{
    Gid, NodeError, RawSample, Time,
    endpoint::{Counters, Reader, Writer},
    held_replies::have_common_participant,
    local_delivery::Outgoing,
    node_core::NodeCore,
    sample::SampleIdentity,
    service::{REPLY, REQUEST, service_spec},
};
use crate::msg::{Service, cdr};

/// Period at which a blocking wait checks for a stop request, which does not wake it.
const POLL_PERIOD: Duration = Duration::from_millis(10);

/// Pending calls by the identity of their requests.
type Calls<S> = HashMap<SampleIdentity, Waiting<S>>;

/// A call whose response has not been taken yet.
struct Waiting<S: Service> {
    /// The reply reader that the request states. A server may identify the request by this reader instead of by its
    /// writer.
    reply_reader: Option<Gid>,
    response: Option<S::Response>,
}

/// Why a service call has no response.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CallError {
    /// No server was found, or it did not reply in time.
    #[error("service {service}: no response within {timeout:?}; is its server running?")]
    Timeout {
        /// Full name of the service.
        service: String,
        /// How long the call waited.
        timeout: Duration,
    },
    /// The transport did not accept the request.
    #[error("service {service}: the request could not be sent")]
    NotSent {
        /// Full name of the service.
        service: String,
    },
    /// The node was asked to stop while the call waited.
    #[error("service {service}: no response, the node is stopping")]
    Stopping {
        /// Full name of the service.
        service: String,
    },
}

/// Calls a service of another node. From [`Node::client`](super::Node::client).
///
/// Blocking calls belong in the node's program or its own threads, not in a handler: handlers run on the receiving
/// thread, which also receives the reply.
pub struct ServiceClient<S: Service> {
    core: Arc<NodeCore>,
    requests: Arc<Writer>,
    reader: Arc<Reader>,
    replies: Arc<Mutex<Calls<S>>>,
}

fn lock<S: Service>(replies: &Mutex<Calls<S>>) -> MutexGuard<'_, Calls<S>> {
    replies.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<S: Service> ServiceClient<S> {
    pub(super) fn new(core: &Arc<NodeCore>, full_name: &str) -> Result<Self, NodeError> {
        let replies: Arc<Mutex<Calls<S>>> = Arc::default();
        let (received, events) = (Arc::clone(&replies), Arc::clone(&core.events));
        let sink = move |sample: RawSample, _: &Counters| {
            // All clients of a service receive all replies, also those to other clients.
            let Some(request) = sample.related else {
                return true;
            };
            let mut replies = lock::<S>(&received);
            let call = replies.iter_mut().find(|(sent, call)| {
                sent.sequence_number == request.sequence_number
                    && [Some(sent.writer), call.reply_reader].contains(&Some(request.writer))
            });
            let Some((_, call)) = call else {
                return true;
            };
            let Ok(response) = cdr::decode(&sample.cdr) else {
                return false;
            };
            call.response = Some(response);
            drop(replies);
            events.notify();
            true
        };
        // The reader is created first, so that no reply is missed.
        let reader = core.add_reader(service_spec::<S>(full_name, REPLY), Box::new(sink))?;
        let requests = match core.add_writer(service_spec::<S>(full_name, REQUEST)) {
            Ok(writer) => writer,
            Err(e) => {
                core.remove_reader(&reader);
                return Err(e);
            }
        };
        Ok(Self {
            core: Arc::clone(core),
            requests,
            reader,
            replies,
        })
    }

    /// Full name of the service.
    pub fn name(&self) -> &str {
        &self.reader.spec.name
    }

    /// Whether both endpoints of a server have been discovered.
    pub fn is_available(&self) -> bool {
        if self.requests.counters.local.load(Relaxed) > 0 {
            return true;
        }
        let peers = |counters: &Counters| {
            let peers = counters.peers.lock();
            peers.unwrap_or_else(PoisonError::into_inner).clone()
        };
        let servers = peers(&self.requests.counters);
        have_common_participant(&servers, &peers(&self.reader.counters))
    }

    /// Waits until a server has been discovered, at most `timeout` (wall time). Returns [`Self::is_available`]. A
    /// server that discovers this client later holds its reply until then.
    pub fn wait_for_service(&self, timeout: Duration) -> bool {
        let deadline = Instant::now() + timeout;
        while !self.is_available()
            && Instant::now() < deadline
            && !self.core.stop_state.is_stopping()
        {
            std::thread::sleep(POLL_PERIOD);
        }
        self.is_available()
    }

    /// Sends a request without waiting for the response, which wakes the node's program.
    ///
    /// # Errors
    /// [`CallError::NotSent`] if the transport does not accept the request.
    pub fn send(&self, request: &S::Request) -> Result<PendingCall<S>, CallError> {
        // Locked while the request is written, since the reply may arrive before the write returns.
        let mut replies = lock::<S>(&self.replies);
        let cdr: Bytes = cdr::encode(request).into();
        // The server sends its reply only after it has discovered this reader.
        let reply_reader = self.reader.gid();
        let stated = reply_reader.map(|writer| SampleIdentity {
            writer,
            sequence_number: SampleIdentity::UNKNOWN_NUMBER,
        });
        let sent = self.requests.write(cdr.clone(), Time::wall(), stated);
        let identity = sent.unwrap_or_else(|| self.requests.unwritten_identity());
        let outgoing = Outgoing {
            cdr,
            message: None,
            related: stated,
            identity: Some(identity),
        };
        let servers = self.requests.local.deliver(&self.requests, outgoing);
        if sent.is_none() && servers == 0 {
            let service = self.name().to_owned();
            return Err(CallError::NotSent { service });
        }
        let waiting = Waiting {
            reply_reader,
            response: None,
        };
        replies.insert(identity, waiting);
        Ok(PendingCall {
            replies: Arc::clone(&self.replies),
            identity,
            service: PhantomData,
        })
    }

    /// Sends a request and waits for the response, at most `timeout` in total (wall time). If no server has been
    /// discovered yet, it waits for one first.
    ///
    /// # Errors
    /// [`CallError`] if no response arrives.
    pub fn call(&self, request: &S::Request, timeout: Duration) -> Result<S::Response, CallError> {
        let deadline = Instant::now() + timeout;
        if self.wait_for_service(timeout) {
            let pending = self.send(request)?;
            while Instant::now() < deadline && !self.core.stop_state.is_stopping() {
                if let Some(response) = pending.take() {
                    return Ok(response);
                }
                let (seen, limit) = (self.core.events.count(), Instant::now() + POLL_PERIOD);
                if !pending.is_ready() {
                    self.core.events.wait(seen, Some(limit.min(deadline)));
                }
            }
        }
        let service = self.name().to_owned();
        match self.core.stop_state.is_stopping() {
            true => Err(CallError::Stopping { service }),
            false => Err(CallError::Timeout { service, timeout }),
        }
    }
}

impl<S: Service> Drop for ServiceClient<S> {
    fn drop(&mut self) {
        self.core.remove_writer(&self.requests);
        self.core.remove_reader(&self.reader);
    }
}

/// A request whose response has not been taken yet. Dropping it discards the response.
pub struct PendingCall<S: Service> {
    replies: Arc<Mutex<Calls<S>>>,
    identity: SampleIdentity,
    service: PhantomData<fn(S)>,
}

impl<S: Service> PendingCall<S> {
    /// Whether the response has arrived.
    pub fn is_ready(&self) -> bool {
        let replies = lock::<S>(&self.replies);
        (replies.get(&self.identity)).is_some_and(|call| call.response.is_some())
    }

    /// The response if it has arrived; only the first call returns it.
    pub fn take(&self) -> Option<S::Response> {
        let mut replies = lock::<S>(&self.replies);
        replies.get_mut(&self.identity)?.response.take()
    }
}

impl<S: Service> Drop for PendingCall<S> {
    fn drop(&mut self) {
        lock::<S>(&self.replies).remove(&self.identity);
    }
}
