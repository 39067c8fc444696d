//! Quality of service in liveliness tokens: fields separated by colons; a field is empty if it has rmw_zenoh's default
//! value.
//!
//! `reliability:durability:history,depth:deadline:lifespan:liveliness,lease`, with the numbers of `rmw/types.h`;
//! durations are seconds and nanoseconds, separated by a comma.

use std::time::Duration;

use crate::ros::{
    Qos,
    qos::{Durability, History, Liveliness, Reliability},
};

/// Default depth.
const DEFAULT_DEPTH: usize = 42;
/// `RMW_DURATION_INFINITE`: 2^63 - 1 nanoseconds.
const INFINITE: (u64, u32) = (9_223_372_036, 854_775_807);

/// Encodes a quality of service as the last part of a token.
pub(super) fn encode(qos: &Qos) -> String {
    let reliability = match qos.reliability {
        Reliability::Reliable => "",
        Reliability::BestEffort => "2",
    };
    let durability = match qos.durability {
        Durability::TransientLocal => "1",
        Durability::Volatile => "",
    };
    let history = match qos.history {
        History::KeepLast => "",
        History::KeepAll => "2",
    };
    let depth = match qos.depth {
        0 | DEFAULT_DEPTH => String::new(),
        depth => depth.to_string(),
    };
    let liveliness = match qos.liveliness {
        Liveliness::Automatic => "",
        Liveliness::ManualByTopic => "3",
    };
    let [deadline, lifespan, lease] =
        [qos.deadline, qos.lifespan, qos.liveliness_lease_duration].map(duration);
    format!(
        "{reliability}:{durability}:{history},{depth}:{deadline}:{lifespan}:{liveliness},{lease}"
    )
}

fn duration(duration: Option<Duration>) -> String {
    let (seconds, nanos) = duration.map_or(INFINITE, |d| (d.as_secs(), d.subsec_nanos()));
    let unless = |is_default: bool, number: String| match is_default {
        true => String::new(),
        false => number,
    };
    format!(
        "{},{}",
        unless(seconds == INFINITE.0, seconds.to_string()),
        unless(nanos == INFINITE.1, nanos.to_string())
    )
}

/// Decodes a quality of service; `None` if the text is not one.
pub(super) fn decode(text: &str) -> Option<Qos> {
    let parts: Vec<&str> = text.split(':').collect();
    let [
        reliability,
        durability,
        history,
        deadline,
        lifespan,
        liveliness,
        ..,
    ] = parts[..]
    else {
        return None;
    };
    let (history, depth) = history.split_once(',')?;
    let (liveliness, lease) = liveliness.split_once(',')?;
    Some(Qos {
        reliability: match reliability {
            "" | "0" | "1" => Reliability::Reliable,
            "2" => Reliability::BestEffort,
            _ => return None,
        },
        durability: match durability {
            "1" => Durability::TransientLocal,
            "" | "0" | "2" => Durability::Volatile,
            _ => return None,
        },
        history: match history {
            "" | "0" | "1" => History::KeepLast,
            "2" => History::KeepAll,
            _ => return None,
        },
        depth: match depth {
            "" => DEFAULT_DEPTH,
            depth => depth.parse().ok()?,
        },
        liveliness: match liveliness {
            "3" => Liveliness::ManualByTopic,
            _ => Liveliness::Automatic,
        },
        deadline: parse_duration(deadline)?,
        lifespan: parse_duration(lifespan)?,
        liveliness_lease_duration: parse_duration(lease)?,
    })
}

/// Parses a duration. The inner `None` means infinite.
fn parse_duration(text: &str) -> Option<Option<Duration>> {
    let (seconds, nanos) = text.split_once(',')?;
    let seconds = match seconds {
        "" => INFINITE.0,
        number => number.parse().ok()?,
    };
    let nanos = match nanos {
        "" => INFINITE.1,
        number => number.parse().ok()?,
    };
    match (seconds, nanos) {
        INFINITE => Some(None),
        (_, 1_000_000_000..) => None,
        (seconds, nanos) => Some(Some(Duration::new(seconds, nanos))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // The first two are from the design document of rmw_zenoh.
    #[test]
    fn profiles_are_written_as_rmw_zenoh_does_and_read_back() {
        let deadline = Qos {
            deadline: Some(Duration::from_millis(2_500)),
            ..Qos::RELIABLE.depth(DEFAULT_DEPTH)
        };
        for (qos, text) in [
            (Qos::RELIABLE, "::,10:,:,:,,"),
            (Qos::RELIABLE.depth(7), "::,7:,:,:,,"),
            (Qos::SENSOR_DATA, "2::,5:,:,:,,"),
            (Qos::LATCHED, ":1:,1:,:,:,,"),
            (deadline, "::,:2,500000000:,:,,"),
        ] {
            assert_eq!(encode(&qos), text);
            assert_eq!(decode(text), Some(qos));
        }
    }

    #[test]
    fn what_is_no_quality_of_service_is_refused() {
        for text in [
            "",
            "::",
            "7::,10:,:,:,,",
            "::,x:,:,:,,",
            "::,1:,2000000000:,:,,",
        ] {
            assert_eq!(decode(text), None, "{text}");
        }
    }
}
