//! DDS writers as wires of publishers.

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

/// Requests up to this length state where the reply is expected \[bytes\]: rustdds cannot send this with longer ones
/// (docs/upstream.md).
const STATES_READER: usize = 1_024;

/// rustdds does not deliver samples of a writer that has left, even if it has acknowledged them, so a subscriber must have been
/// scheduled between the two (docs/upstream.md).
const LINGER: Duration = Duration::from_millis(200);

/// After how many samples subscriptions of the same participant acknowledge: well below the 8192 after which rustdds waits.
const ACKNOWLEDGED: i64 = 1024;

/// A DDS writer, which several publishers may share.
pub(super) struct DdsWriter {
    raw: RawWriter,
    dds_topic: String,
    /// The topic in this process.
    local: Arc<LocalTopic>,
    /// Sends RTPS messages that rustdds does not send.
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

    /// Sends a reply that is too long for rustdds with the next sequence number; false if it is not too long. Before
    /// the sample is written: from then on rustdds says that there is nothing for the client to receive.
    fn send_long_reply(&self, request: SampleIdentity, cdr: &[u8]) -> bool {
        let topic = &self.dds_topic;
        let Some(rtps) = (self.rtps.as_ref()).filter(|r| r.must_send(topic, cdr.len())) else {
            return false;
        };
        let number = SequenceNumber::from(self.last_number.load(Relaxed) + 1);
        rtps.send_reply((self.guid(), number), topic, request.into(), cdr);
        true
    }

    /// Acknowledges what was written so far, for the subscriptions of this participant: they get messages in memory, and
    /// rustdds would wait for them.
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
            // A sample to nobody: it takes the sequence number, and is announced to all other clients as irrelevant.
            options = options.to_single_reader(self.guid());
            cdr = Bytes::new();
        }
        let Ok(identity) = self.raw.write_with_options(cdr, options.build()) else {
            // The datagrams of the last acknowledgements may have been lost.
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
