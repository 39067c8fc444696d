//! DDS writers as the wires of publishers.

use rustdds::{GUID, RTPSEntity, SequenceNumber, WriteOptionsBuilder, bytes::Bytes};
use std::{
    sync::{
        Arc,
        atomic::{AtomicI64, Ordering::Relaxed},
    },
    time::Duration,
};

use super::{
    raw_endpoints::{RawWriter, to_timestamp},
    rtps_sender::RtpsSender,
};
use crate::ros::{
    Gid, Time, local_delivery::LocalTopic, sample::SampleIdentity, transport::WireWriter,
};

/// Longest request that states its reply reader \[bytes\]: rustdds cannot add this to longer requests
/// (docs/upstream.md).
const STATES_READER: usize = 1_024;

/// Time between the last sample and the end of a writer, in which a subscriber must be scheduled: rustdds does not
/// deliver samples of a writer that has left, even acknowledged ones (docs/upstream.md).
const LINGER: Duration = Duration::from_millis(200);

/// Number of samples after which subscriptions of the same participant acknowledge; rustdds blocks after 8192
/// unacknowledged ones.
const ACKNOWLEDGED: i64 = 1024;

/// A DDS writer, which several publishers may share.
pub(super) struct DdsWriter {
    raw: RawWriter,
    dds_topic: String,
    /// The topic inside the participant.
    local: Arc<LocalTopic>,
    /// Sender of RTPS messages that rustdds does not send.
    rtps: Option<Arc<RtpsSender>>,
    /// Sequence number of the last sample.
    last_number: AtomicI64,
}

impl DdsWriter {
    pub(super) fn new(
        raw: RawWriter,
        (dds_topic, local): (String, Arc<LocalTopic>),
        rtps: Option<Arc<RtpsSender>>,
    ) -> Self {
        Self {
            raw,
            dds_topic,
            local,
            rtps,
            last_number: AtomicI64::new(0),
        }
    }

    /// Sends a reply that is too long for rustdds, with the next sequence number; returns false if rustdds can send it.
    /// Must be called before the sample is written: from then on, rustdds announces to the client that there is nothing
    /// to receive.
    fn send_long_reply(&self, request: SampleIdentity, cdr: &[u8]) -> bool {
        let topic = &self.dds_topic;
        let Some(rtps) = (self.rtps.as_ref()).filter(|r| r.must_send(topic, cdr.len())) else {
            return false;
        };
        let number = SequenceNumber::from(self.last_number.load(Relaxed) + 1);
        rtps.send_reply((self.guid(), number), topic, request.into(), cdr);
        true
    }

    /// Acknowledges all written samples on behalf of the subscriptions of this participant, which receive the messages
    /// in memory; rustdds would wait for them.
    fn acknowledge_for_own_readers(&self) {
        if let Some(rtps) = &self.rtps {
            let readers = self.local.reliable_readers();
            rtps.acknowledge_own(self.guid(), readers, self.last_number.load(Relaxed));
        }
    }

    fn guid(&self) -> GUID {
        self.raw.guid()
    }
}

impl WireWriter for DdsWriter {
    fn gid(&self) -> Gid {
        self.guid().into()
    }

    fn write(
        &self,
        mut cdr: Bytes,
        published: Time,
        related: Option<SampleIdentity>,
    ) -> Option<SampleIdentity> {
        let is_statement = |r: &SampleIdentity| r.sequence_number == SampleIdentity::UNKNOWN_NUMBER;
        let related = related.filter(|r| !is_statement(r) || cdr.len() <= STATES_READER);
        let mut options = WriteOptionsBuilder::new()
            .source_timestamp(to_timestamp(published))
            .related_sample_identity_opt(related.map(Into::into));
        if let Some(request) = related
            && self.send_long_reply(request, &cdr)
        {
            // An empty sample without recipient: it uses up the sequence number, and is announced as irrelevant to all
            // other clients.
            options = options.to_single_reader(self.guid());
            cdr = Bytes::new();
        }
        let Ok(identity) = self.raw.write_with_options(cdr, options.build()) else {
            // The datagrams with the last acknowledgements may have been lost.
            self.acknowledge_for_own_readers();
            return None;
        };
        let identity = SampleIdentity::from(identity);
        let number = identity.sequence_number;
        self.last_number.store(number, Relaxed);
        if number % ACKNOWLEDGED == 0 {
            self.acknowledge_for_own_readers();
        }
        Some(identity)
    }

    fn wait_for_all_acked(&self, timeout: Duration) -> bool {
        self.acknowledge_for_own_readers();
        matches!(self.raw.wait_for_acknowledgments(timeout), Ok(true))
    }

    fn linger(&self) -> Duration {
        LINGER
    }
}
