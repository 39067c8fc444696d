//! Requests for samples that new writers sent before they were matched with the local reader.
//!
//! A ROS client or `ros2 topic pub --once` sends as soon as it knows the reader. If the reader does not know the writer
//! yet, the sample is discarded. rustdds requests the sample when the writer is matched, but Fast DDS ignores this
//! ACKNACK because its count is 0 (docs/upstream.md), and repeats the sample only after its next heartbeat, three
//! seconds later.

use rustdds::GUID;
use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use super::rtps_sender::RtpsSender;

/// Times after the match at which the first sample of a service client is requested. On a busy computer Fast DDS does
/// not answer about one in 25 requests.
const CLIENT: [Duration; 3] = [
    Duration::ZERO,
    Duration::from_millis(15),
    Duration::from_millis(50),
];
/// As [`CLIENT`], for other topics: only once, since Fast DDS afterwards ignores as many requests of rustdds.
const TOPIC: [Duration; 1] = [Duration::ZERO];

struct NewWriter {
    reader: GUID,
    writer: GUID,
    matched: Instant,
    requests: &'static [Duration],
    sent: usize,
}

impl NewWriter {
    fn due(&self) -> Option<Instant> {
        Some(self.matched + *self.requests.get(self.sent)?)
    }
}

/// Pending requests of reliable readers to new writers.
pub(super) struct FirstSamples {
    rtps: Option<Arc<RtpsSender>>,
    writers: Vec<NewWriter>,
}

impl FirstSamples {
    /// `rtps` sends the requests.
    pub(super) fn new(rtps: Option<Arc<RtpsSender>>) -> Self {
        Self {
            rtps,
            writers: Vec::new(),
        }
    }

    /// Schedules the requests after a reliable reader of this DDS topic has been matched with a writer. `is_new` is
    /// false for a writer that existed before the reader.
    pub(super) fn writer_matched(
        &mut self,
        dds_topic: &str,
        (reader, writer): (GUID, GUID),
        is_new: bool,
    ) {
        let requests = match dds_topic.starts_with("rq/") {
            true => &CLIENT[..],
            // The first sample is not available. A request would only make Fast DDS ignore the answer of rustdds to the
            // next heartbeat, without which no sample is received.
            false if !is_new => return,
            false => &TOPIC[..],
        };
        if RtpsSender::must_request_from(writer) {
            self.writers.push(NewWriter {
                reader,
                writer,
                matched: Instant::now(),
                requests,
                sent: 0,
            });
        }
    }

    /// Time until the next request.
    pub(super) fn timeout(&self) -> Option<Duration> {
        let next = self.writers.iter().filter_map(NewWriter::due).min()?;
        Some(next.saturating_duration_since(Instant::now()))
    }

    /// Sends the due requests to writers from which no sample has arrived. The caller must not hold a lock, since a
    /// deadlocked participant does not respond.
    pub(super) fn request(&mut self, has_sample: impl Fn(GUID, GUID) -> bool) {
        let now = Instant::now();
        for new in &mut self.writers {
            if new.due().is_some_and(|due| due <= now) {
                if has_sample(new.reader, new.writer) {
                    new.sent = new.requests.len();
                    continue;
                }
                new.sent += 1;
                if let Some(rtps) = &self.rtps {
                    rtps.request_first_sample(new.reader, new.writer, new.sent as u32);
                }
            }
        }
        self.writers.retain(|new| new.due().is_some());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guid(vendor: [u8; 2], entity: u8) -> GUID {
        let mut bytes = [entity; 16];
        bytes[..2].copy_from_slice(&vendor);
        GUID::from_bytes(bytes)
    }

    // Fails if requests continue after a sample has arrived, or never end.
    #[test]
    fn requests_end_with_the_first_sample() {
        let mut first = FirstSamples::new(None);
        let (reader, fast, rust) = (guid([1, 0x12], 1), guid([1, 0x0f], 2), guid([1, 0x12], 3));
        first.writer_matched("rq/serviceRequest", (reader, rust), true);
        first.writer_matched("rt/topic", (reader, fast), false);
        assert_eq!(first.timeout(), None);
        first.writer_matched("rt/topic", (reader, fast), true);
        assert_eq!(first.timeout(), Some(Duration::ZERO));
        first.request(|_, _| false);
        assert_eq!(first.timeout(), None);
        first.writer_matched("rq/serviceRequest", (reader, fast), false);
        first.request(|_, _| false);
        assert!(first.timeout().is_some_and(|t| t <= CLIENT[1]));
        std::thread::sleep(CLIENT[1]);
        first.request(|_, writer| writer == fast);
        assert_eq!(first.timeout(), None);
    }
}
