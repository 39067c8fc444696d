//! `metadata.yaml`, version 9 (ROS 2 Jazzy).

use serde::{Deserialize, Serialize};
use std::path::Path;

use super::{BagError, Qos};
use crate::input_file::{self, LARGEST_YAML};

/// Name of the file within a bag's folder.
pub(super) const FILE: &str = "metadata.yaml";

#[derive(Debug, Serialize)]
pub(super) struct Metadata {
    pub version: u32,
    pub storage_identifier: &'static str,
    pub duration: Nanoseconds,
    pub starting_time: SinceEpoch,
    pub message_count: u64,
    pub topics_with_message_count: Vec<TopicCount>,
    pub compression_format: &'static str,
    pub compression_mode: &'static str,
    pub relative_file_paths: Vec<String>,
    pub files: Vec<FileInformation>,
    pub custom_data: Option<()>,
    pub ros_distro: &'static str,
}

#[derive(Debug, Clone, Serialize)]
pub(super) struct Nanoseconds {
    pub nanoseconds: u64,
}

#[derive(Debug, Clone, Serialize)]
pub(super) struct SinceEpoch {
    pub nanoseconds_since_epoch: u64,
}

#[derive(Debug, Serialize)]
pub(super) struct TopicCount {
    pub topic_metadata: TopicMetadata,
    pub message_count: u64,
}

#[derive(Debug, Serialize)]
pub(super) struct TopicMetadata {
    pub name: String,
    #[serde(rename = "type")]
    pub type_name: String,
    pub serialization_format: String,
    pub offered_qos_profiles: Vec<Qos>,
    pub type_description_hash: String,
}

#[derive(Debug, Clone, Serialize)]
pub(super) struct FileInformation {
    pub path: String,
    pub starting_time: SinceEpoch,
    pub duration: Nanoseconds,
    pub message_count: u64,
}

/// Start and duration of a recording in the form of `metadata.yaml`.
pub(super) fn span(bounds: Option<(u64, u64)>) -> (SinceEpoch, Nanoseconds) {
    // rosbag2 gives an empty bag the largest possible start time.
    let (start, end) = bounds.unwrap_or((i64::MAX as u64, i64::MAX as u64));
    (
        SinceEpoch {
            nanoseconds_since_epoch: start,
        },
        Nanoseconds {
            nanoseconds: end - start,
        },
    )
}

/// `bounds` extended to include `time` \[ns\].
pub(super) fn extend(bounds: Option<(u64, u64)>, time: u64) -> Option<(u64, u64)> {
    let (start, end) = bounds.unwrap_or((time, time));
    Some((start.min(time), end.max(time)))
}

impl Metadata {
    /// The metadata of an empty bag.
    pub fn empty() -> Self {
        let (starting_time, duration) = span(None);
        Self {
            version: 9,
            storage_identifier: "mcap",
            duration,
            starting_time,
            message_count: 0,
            topics_with_message_count: Vec::new(),
            // Chunk compression is part of MCAP and independent of rosbag2's file and message compression.
            compression_format: "",
            compression_mode: "",
            relative_file_paths: Vec::new(),
            files: Vec::new(),
            custom_data: None,
            ros_distro: "jazzy",
        }
    }

    /// The metadata as stored in the MCAP file.
    pub fn to_yaml(&self) -> String {
        serde_saphyr::to_string(self).expect("metadata have a YAML form")
    }

    /// The text of `metadata.yaml`.
    pub fn file_text(&self) -> String {
        #[derive(Serialize)]
        struct Document<'a> {
            rosbag2_bagfile_information: &'a Metadata,
        }
        serde_saphyr::to_string(&Document {
            rosbag2_bagfile_information: self,
        })
        .expect("metadata have a YAML form")
    }
}

/// The fields of `metadata.yaml` that are needed to read a bag; all else is in the MCAP files.
#[derive(Debug, Deserialize)]
pub(super) struct Found {
    pub storage_identifier: String,
    pub relative_file_paths: Vec<String>,
    #[serde(default)]
    pub compression_format: String,
    #[serde(default)]
    pub compression_mode: String,
    #[serde(default)]
    pub ros_distro: String,
}

impl Found {
    /// Whether each message is compressed individually.
    pub fn is_packed(&self) -> bool {
        self.compression_mode.eq_ignore_ascii_case("message")
    }

    /// Reads `metadata.yaml` in a bag's folder; `None` if there is none.
    pub fn read(folder: &Path) -> Result<Option<Self>, BagError> {
        #[derive(Deserialize)]
        struct Document {
            rosbag2_bagfile_information: Found,
        }
        let path = folder.join(FILE);
        let text = match input_file::read_text(&path, LARGEST_YAML) {
            Ok(text) => text,
            Err(e) if e.is_missing() => return Ok(None),
            Err(e) => {
                let what = e.problem();
                return Err(BagError::NotABag { path, what });
            }
        };
        match serde_saphyr::from_str::<Document>(&text) {
            Ok(d) => Ok(Some(d.rosbag2_bagfile_information)),
            Err(e) => Err(BagError::NotABag {
                path,
                what: format!(
                    "not the metadata of a bag: {e}; without this file fuyu reads every .mcap file in the folder"
                ),
            }),
        }
    }
}
