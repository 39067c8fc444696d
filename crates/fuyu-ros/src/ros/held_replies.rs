//! Service replies that are held until their client has been matched.
//!
//! A new client calls a service as soon as it has discovered the server's endpoints. The server may then know the
//! client's request writer but not yet its reply reader, and a reply written at that time would be lost. So the reply
//! is held until the reader has been matched.

use std::{
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use super::{Gid, endpoint::Counters};

/// After this time a held reply is sent even if its client has not been matched; checked once a second.
const PATIENCE: Duration = Duration::from_secs(1);
/// Largest number of held replies; beyond it the oldest is sent.
const MOST: usize = 64;

/// Entity kinds of readers in RTPS, without and with key.
const READERS: [u8; 2] = [0x04, 0x07];

/// Where a client expects its reply.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ReplyReader {
    /// The reader that the request states.
    Named(Gid),
    /// Any reader of the participant that this endpoint belongs to.
    In(Gid),
}

impl ReplyReader {
    /// For a request from `publisher` that states the identity `stated`, which may be that of the reply reader.
    pub(super) fn new(stated: Option<Gid>, publisher: Gid) -> Self {
        let is_reader = |gid: &Gid| READERS.contains(&(gid.to_bytes16()[15] & 0x3f));
        match stated.filter(is_reader) {
            Some(reader) => Self::Named(reader),
            None => Self::In(publisher),
        }
    }

    fn is_among(self, matched: &[Gid]) -> bool {
        match self {
            Self::Named(reader) => matched.contains(&reader),
            Self::In(publisher) => matched
                .iter()
                .any(|m| participant(*m) == participant(publisher)),
        }
    }
}

/// GUID prefix: the part of a GUID that names the participant.
fn participant(gid: Gid) -> [u8; 12] {
    let bytes = gid.to_bytes16();
    std::array::from_fn(|i| bytes[i])
}

/// Whether two lists of endpoints have a participant in common.
pub(super) fn have_common_participant(some: &[Gid], others: &[Gid]) -> bool {
    let prefixes = || others.iter().map(|&gid| participant(gid));
    some.iter()
        .any(|&gid| prefixes().any(|other| other == participant(gid)))
}

struct Held {
    client: ReplyReader,
    since: Instant,
    send: Box<dyn FnOnce() + Send>,
}

/// The replies that a writer holds.
#[derive(Default)]
pub(super) struct HeldReplies {
    held: Mutex<Vec<Held>>,
}

impl HeldReplies {
    /// Calls `send` as soon as `client` is among the matched peers in `counters`.
    pub(super) fn send(
        &self,
        client: ReplyReader,
        counters: &Counters,
        send: impl FnOnce() + Send + 'static,
    ) {
        let mut held = self.lock();
        // Checked under the lock: the peers are stored before `release` is called.
        let is_matched = {
            let peers = counters.peers.lock();
            client.is_among(&peers.unwrap_or_else(PoisonError::into_inner))
        };
        if is_matched {
            drop(held);
            return send();
        }
        let oldest = (held.len() >= MOST).then(|| held.remove(0));
        held.push(Held {
            client,
            since: Instant::now(),
            send: Box::new(send),
        });
        drop(held);
        if let Some(oldest) = oldest {
            (oldest.send)();
        }
    }

    /// Sends the replies whose clients have been matched.
    pub(super) fn release(&self, matched: &[Gid]) {
        self.send_those(|held| held.client.is_among(matched));
    }

    /// Sends the replies that have been held for too long.
    pub(super) fn expire(&self) {
        self.send_those(|held| held.since.elapsed() > PATIENCE);
    }

    fn send_those(&self, condition: impl Fn(&Held) -> bool) {
        let due: Vec<_> = self.lock().extract_if(.., |held| condition(held)).collect();
        due.into_iter().for_each(|held| (held.send)());
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Held>> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::{
        Arc,
        atomic::{AtomicU32, Ordering::Relaxed},
    };

    /// GID of an endpoint of a participant; `kind` is the last byte of its entity id.
    fn gid(participant: u8, kind: u8) -> Gid {
        let mut bytes = [participant; 16];
        bytes[15] = kind;
        bytes.into()
    }

    // Fails if a reply is sent to another client's reader, twice, or never.
    #[test]
    fn a_reply_waits_for_the_reader_that_the_request_names() {
        let (held, counters) = (HeldReplies::default(), Counters::default());
        let sent = Arc::new(AtomicU32::new(0));
        let reply = |client| {
            let sent = Arc::clone(&sent);
            held.send(client, &counters, move || {
                sent.fetch_add(1, Relaxed);
            });
        };
        let named = ReplyReader::new(Some(gid(1, 0x04)), gid(1, 0x03));
        assert_eq!(named, ReplyReader::Named(gid(1, 0x04)));
        // The stated identity is a writer, which cannot receive a reply, so any reader of its participant matches.
        let anywhere = ReplyReader::new(Some(gid(2, 0x03)), gid(2, 0x03));
        assert_eq!(anywhere, ReplyReader::In(gid(2, 0x03)));
        reply(named);
        reply(anywhere);
        held.release(&[gid(1, 0x07), gid(3, 0x04)]);
        assert_eq!(sent.load(Relaxed), 0);
        held.release(&[gid(1, 0x07), gid(1, 0x04)]);
        assert_eq!(sent.load(Relaxed), 1);
        held.release(&[gid(1, 0x04), gid(2, 0x07)]);
        assert_eq!(sent.load(Relaxed), 2);
        *counters.peers.lock().unwrap() = vec![gid(1, 0x04)];
        reply(named);
        assert_eq!(sent.load(Relaxed), 3);
    }

    #[test]
    fn what_is_held_is_limited() {
        let (held, counters) = (HeldReplies::default(), Counters::default());
        let sent = Arc::new(Mutex::new(Vec::new()));
        for number in 0..MOST + 2 {
            let sent = Arc::clone(&sent);
            let client = ReplyReader::In(gid(1, 0x03));
            held.send(client, &counters, move || sent.lock().unwrap().push(number));
        }
        assert_eq!(*sent.lock().unwrap(), [0, 1]);
        held.expire();
        assert_eq!(sent.lock().unwrap().len(), 2);
    }
}
