//! Health of the topics of a bag: regular rate, increasing stamps, decodable messages, finite values.

use serde::Serialize;
use std::collections::BTreeMap;

use crate::bag::{Durability, Message};
use crate::msg::{self, scan::scan};

/// Health of one topic.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TopicHealth {
    /// Full name.
    pub name: String,
    /// Number of messages.
    pub count: u64,
    /// Whether times are header stamps; otherwise they are recording times.
    pub by_stamp: bool,
    /// Median time between messages \[s\].
    pub median_period: Option<f64>,
    /// Largest time between messages \[s\].
    pub largest_gap: Option<f64>,
    /// Start of the largest gap, relative to the start of the bag \[s\].
    pub largest_gap_at: Option<f64>,
    /// Whether the rate is constant, so that a gap means a loss.
    pub periodic: bool,
    /// Number of stamps that are earlier than the previous one, except after a restart of time.
    pub backwards: u64,
    /// The first field with a non-finite value, and the number of messages with one.
    pub not_finite: Option<(String, u64)>,
    /// Messages that cannot be decoded.
    pub malformed: u64,
    /// Whether the type is known, so that messages were decoded.
    pub known_type: bool,
}

#[derive(Default)]
struct Track {
    times: Vec<i64>,
    stamps: Vec<i64>,
    /// The run of each stamp.
    runs: Vec<usize>,
    not_finite: Option<(String, u64)>,
    malformed: u64,
    known_type: bool,
    latched: bool,
}

/// Watches all topics of a bag.
#[derive(Default)]
pub struct TopicWatch {
    tracks: BTreeMap<String, Track>,
    start: Option<i64>,
}

impl TopicWatch {
    /// Adds a message; `run` is from [`RunCounter`](super::RunCounter).
    pub fn accept(&mut self, message: &Message, run: usize) {
        let log_time = message.log_time as i64;
        self.start = Some(self.start.map_or(log_time, |s| s.min(log_time)));
        let name = &message.topic.name;
        if !self.tracks.contains_key(name) {
            let transient = |q: &crate::bag::Qos| q.durability == Durability::TransientLocal;
            let track = Track {
                latched: message.topic.qos.iter().any(transient),
                ..Track::default()
            };
            self.tracks.insert(name.clone(), track);
        }
        let Some(track) = self.tracks.get_mut(name) else {
            return;
        };
        track.times.push(log_time);
        let Some(definition) = msg::find(&message.topic.type_name) else {
            return;
        };
        track.known_type = true;
        match scan(definition, &message.data) {
            Ok(found) => {
                // Every node publishes diagnostics at its own times.
                if message.topic.type_name != "diagnostic_msgs/msg/DiagnosticArray" {
                    track.runs.extend(found.stamp.as_ref().map(|_| run));
                    track.stamps.extend(found.stamp.map(|s| s.nanos()));
                }
                if let Some(field) = found.not_finite {
                    track.not_finite.get_or_insert((field, 0)).1 += 1;
                }
            }
            Err(_) => track.malformed += 1,
        }
    }

    /// The results by topic.
    pub fn finish(self) -> Vec<TopicHealth> {
        let start = self.start.unwrap_or(0);
        self.tracks
            .into_iter()
            .map(|(name, track)| track.summarize(name, start))
            .collect()
    }
}

/// Smallest number of periods that determines a rate.
const ENOUGH: usize = 10;

impl Track {
    fn summarize(self, name: String, bag_start: i64) -> TopicHealth {
        // Gaps between stamps are losses; gaps between recording times may also be delays.
        let by_stamp = self.stamps.len() == self.times.len();
        let times = if by_stamp { &self.stamps } else { &self.times };
        let start = if by_stamp {
            times.first().copied().unwrap_or(0)
        } else {
            bag_start
        };
        // A change between runs, also back for a left-over message, is neither a gap nor a backward step.
        let same_run = |i: usize| !by_stamp || self.runs[i] == self.runs[i + 1];
        let gap = |(i, w): (usize, &[i64])| same_run(i).then(|| w[1] - w[0]);
        let gaps: Vec<i64> = times
            .windows(2)
            .enumerate()
            .map(|w| gap(w).unwrap_or(0))
            .collect();
        let backwards = self.stamps.windows(2).zip(self.runs.windows(2));
        let backwards = backwards.filter(|(t, run)| t[1] < t[0] && run[0] == run[1]);
        let backwards = backwards.count() as u64;
        let mut sorted = gaps.clone();
        sorted.sort_unstable();
        let quantile = |q: f64| sorted.get((q * (sorted.len() as f64 - 1.0)).round() as usize);
        let largest = gaps.iter().enumerate().max_by_key(|(_, gap)| **gap);
        let periodic = !self.latched
            && gaps.len() >= ENOUGH
            && matches!((quantile(0.1), quantile(0.5), quantile(0.9)), (Some(&low), Some(&mid), Some(&high))
                if 2 * low > mid && high < 2 * mid);
        TopicHealth {
            name,
            count: times.len() as u64,
            by_stamp,
            median_period: quantile(0.5).map(|&p| p as f64 * 1e-9),
            largest_gap: largest.map(|(_, &gap)| gap as f64 * 1e-9),
            largest_gap_at: largest.map(|(i, _)| (times[i] - start) as f64 * 1e-9),
            periodic,
            backwards,
            not_finite: self.not_finite,
            malformed: self.malformed,
            known_type: self.known_type,
        }
    }
}
