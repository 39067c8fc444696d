//! Contents of a bag: topics, counts, times, sizes, damage.

use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::mcap_file::{self, McapFile};
use super::{Bag, BagError, Damage, Qos, RecordedTopic};

/// Contents of a bag.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Info {
    /// Path of the bag.
    pub path: PathBuf,
    /// Its files, relative to the folder.
    pub files: Vec<String>,
    /// Size of the files \[bytes\].
    pub size: u64,
    /// Number of messages.
    pub messages: u64,
    /// First log time \[ns\].
    pub start_ns: Option<u64>,
    /// Last log time \[ns\].
    pub end_ns: Option<u64>,
    /// Topics by name.
    pub topics: Vec<TopicSummary>,
    /// Compression of chunks, `zstd`, `lz4` or `none`; several if files differ.
    pub compression: String,
    /// The ROS distribution that `metadata.yaml` names.
    pub ros_distro: Option<String>,
    /// Whether there is a `metadata.yaml`.
    pub has_metadata: bool,
    /// Whether every file was closed and no damage was found.
    pub complete: bool,
    /// Damage found.
    pub damage: Vec<Damage>,
}

/// A topic of a bag.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TopicSummary {
    /// Full name.
    pub name: String,
    /// ROS type.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Number of messages.
    pub count: u64,
    /// Message encoding, such as `cdr`.
    pub encoding: String,
    /// RIHS01 hash of the type.
    pub type_hash: Option<String>,
    /// QoS that the recorded publishers offered.
    pub qos: Vec<Qos>,
}

impl Info {
    /// Time from the first to the last message \[ns\].
    pub fn duration_ns(&self) -> u64 {
        match (self.start_ns, self.end_ns) {
            (Some(start), Some(end)) => end.saturating_sub(start),
            _ => 0,
        }
    }
}

/// Accumulates the contents of several files.
#[derive(Default)]
struct Tally {
    bounds: Option<(u64, u64)>,
    topics: BTreeMap<String, TopicSummary>,
    compression: Vec<String>,
    damage: Vec<Damage>,
}

pub(super) fn collect(bag: &Bag) -> Result<Info, BagError> {
    let mut tally = Tally::default();
    let mut size = 0;
    for file in bag.files() {
        size += std::fs::metadata(file).map_err(BagError::io(file))?.len();
        match mcap_file::summary(file)? {
            Some(summary) if summary.stats.is_some() => tally.add_summary(&summary),
            _ => tally.read_through(file)?,
        }
    }
    let topics: Vec<_> = tally.topics.into_values().collect();
    if tally.compression.is_empty() {
        tally.compression.push("none".into());
    }
    Ok(Info {
        path: bag.path().to_owned(),
        files: bag.files().iter().map(|f| file_name(f)).collect(),
        size,
        messages: topics.iter().map(|t| t.count).sum(),
        start_ns: tally.bounds.map(|b| b.0),
        end_ns: tally.bounds.map(|b| b.1),
        topics,
        compression: tally.compression.join(", "),
        ros_distro: bag.ros_distro().map(str::to_owned),
        has_metadata: bag.has_metadata(),
        complete: tally.damage.is_empty(),
        damage: tally.damage,
    })
}

fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

impl Tally {
    fn add_summary(&mut self, summary: &mcap::Summary) {
        let Some(stats) = &summary.stats else { return };
        if stats.message_count > 0 {
            self.add_times(stats.message_start_time, stats.message_end_time);
        }
        for (id, channel) in &summary.channels {
            let count = stats.channel_message_counts.get(id).copied().unwrap_or(0);
            self.add_topic(&RecordedTopic::from(&**channel), count);
        }
        for chunk in &summary.chunk_indexes {
            self.add_compression(&chunk.compression);
        }
    }

    fn read_through(&mut self, path: &Path) -> Result<(), BagError> {
        let mut file = McapFile::open(path)?;
        let mut counts: Vec<(Arc<RecordedTopic>, u64)> = Vec::new();
        while let Some(message) = file.next_message() {
            self.add_times(message.log_time, message.log_time);
            match counts
                .iter_mut()
                .find(|(t, _)| Arc::ptr_eq(t, &message.topic))
            {
                Some((_, count)) => *count += 1,
                None => counts.push((message.topic, 1)),
            }
        }
        for topic in file.topics() {
            self.add_topic(topic, 0);
        }
        for (topic, count) in counts {
            self.add_topic(&topic, count);
        }
        for compression in file.compressions() {
            self.add_compression(compression);
        }
        self.damage.extend_from_slice(file.damage());
        Ok(())
    }

    fn add_times(&mut self, first: u64, last: u64) {
        let (start, end) = self.bounds.unwrap_or((first, last));
        self.bounds = Some((start.min(first), end.max(last)));
    }

    fn add_topic(&mut self, topic: &RecordedTopic, count: u64) {
        self.topics
            .entry(topic.name.clone())
            .or_insert_with(|| TopicSummary {
                name: topic.name.clone(),
                type_name: topic.type_name.clone(),
                count: 0,
                encoding: topic.encoding.clone(),
                type_hash: topic.type_hash.clone(),
                qos: topic.qos.clone(),
            })
            .count += count;
    }

    fn add_compression(&mut self, name: &str) {
        let name = if name.is_empty() { "none" } else { name };
        if !self.compression.iter().any(|c| c == name) {
            self.compression.push(name.to_owned());
        }
    }
}
