//! Reading bags.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::mcap_file::McapFile;
use super::metadata::Found;
use super::{BagError, Damage, Info, Qos, info, limits, qos};
use crate::msg::{Interface, cdr};

/// A bag opened for reading: a folder in rosbag2's layout, with or without `metadata.yaml`, or a single MCAP file.
#[derive(Debug, Clone)]
pub struct Bag {
    path: PathBuf,
    files: Vec<PathBuf>,
    has_metadata: bool,
    ros_distro: Option<String>,
    /// Whether rosbag2 has compressed each message individually.
    packed: bool,
}

/// A topic of a bag.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedTopic {
    /// Full name.
    pub name: String,
    /// ROS type, `sensor_msgs/msg/JointState`.
    pub type_name: String,
    /// Message encoding: `cdr` from ROS 2.
    pub encoding: String,
    /// Format of the schema: `ros2msg`, `ros2idl`, or empty for an unknown type.
    pub schema_encoding: String,
    /// The schema.
    pub schema: Vec<u8>,
    /// RIHS01 hash of the type.
    pub type_hash: Option<String>,
    /// QoS that the recorded publishers offered.
    pub qos: Vec<Qos>,
}

/// A recorded message, encoded.
#[derive(Debug, Clone, PartialEq)]
pub struct Message {
    /// Its topic.
    pub topic: Arc<RecordedTopic>,
    /// Time of recording \[ns\].
    pub log_time: u64,
    /// Time of sending \[ns\].
    pub publish_time: u64,
    /// CDR bytes with their encapsulation header.
    pub data: Vec<u8>,
}

/// A decoded message with its time of recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Stamped<M> {
    /// Time of recording \[ns\].
    pub log_time: u64,
    /// The message.
    pub message: M,
}

/// The messages of a bag in the order of recording; see [`Bag::messages`].
pub struct Messages {
    files: std::vec::IntoIter<PathBuf>,
    current: Option<McapFile>,
    damage: Vec<Damage>,
    topics: Vec<Arc<RecordedTopic>>,
    packed: bool,
}

impl Bag {
    /// Opens the bag at `path`. A truncated bag opens as well; [`Messages::damage`] reports where it ends.
    ///
    /// # Errors
    /// If there is no MCAP bag at `path`: see [`BagError`].
    pub fn open(path: impl Into<PathBuf>) -> Result<Self, BagError> {
        let path = path.into();
        let found = match path.is_dir() {
            true => Found::read(&path)?,
            false => None,
        };
        let files = match &found {
            Some(metadata) => listed_files(&path, metadata)?,
            None => present_files(&path)?,
        };
        Self::with_files(path, files, found)
    }

    /// Like [`Self::open`], but with all MCAP files in the folder, regardless of `metadata.yaml`.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_files(path: impl Into<PathBuf>) -> Result<Self, BagError> {
        let path = path.into();
        let files = present_files(&path)?;
        let mut bag = Self::with_files(path, files, None)?;
        // Only this field of `metadata.yaml` is used: the files do not contain its information.
        bag.packed = bag.path.is_dir()
            && Found::read(&bag.path).is_ok_and(|found| found.is_some_and(|m| m.is_packed()));
        Ok(bag)
    }

    fn with_files(
        path: PathBuf,
        files: Vec<PathBuf>,
        found: Option<Found>,
    ) -> Result<Self, BagError> {
        for file in &files {
            McapFile::open(file)?;
        }
        Ok(Self {
            path,
            files,
            has_metadata: found.is_some(),
            packed: found.as_ref().is_some_and(Found::is_packed),
            ros_distro: found
                .map(|m| m.ros_distro)
                .filter(|distro| !distro.is_empty()),
        })
    }

    /// Path of the bag.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its MCAP files in the order of recording.
    pub fn files(&self) -> &[PathBuf] {
        &self.files
    }

    /// Whether there is a `metadata.yaml`. A killed recorder leaves none.
    pub fn has_metadata(&self) -> bool {
        self.has_metadata
    }

    /// The ROS distribution that `metadata.yaml` names.
    pub fn ros_distro(&self) -> Option<&str> {
        self.ros_distro.as_deref()
    }

    /// Topics, counts, times and sizes. Fast for files with a summary; other files are read completely.
    ///
    /// # Errors
    /// [`BagError::Io`] if a file cannot be read.
    pub fn info(&self) -> Result<Info, BagError> {
        info::collect(self)
    }

    /// All messages, in the order of recording.
    pub fn messages(&self) -> Messages {
        Messages {
            files: self.files.clone().into_iter(),
            current: None,
            damage: Vec::new(),
            topics: Vec::new(),
            packed: self.packed,
        }
    }

    /// All messages of one topic, decoded; empty if the bag has no such topic.
    ///
    /// # Errors
    /// [`BagError::Type`] if the topic carries another type, [`BagError::Decode`] if a message does not
    /// decode.
    pub fn read<M: Interface>(&self, topic: &str) -> Result<Vec<Stamped<M>>, BagError> {
        self.messages()
            .filter(|m| m.topic.name == topic)
            .map(|m| {
                Ok(Stamped {
                    log_time: m.log_time,
                    message: m.decode()?,
                })
            })
            .collect()
    }
}

fn listed_files(folder: &Path, metadata: &Found) -> Result<Vec<PathBuf>, BagError> {
    let unsupported = |what: String| BagError::Unsupported {
        path: folder.to_owned(),
        what,
    };
    if metadata.storage_identifier != "mcap" {
        return Err(unsupported(format!(
            "its storage is {}; fuyu reads mcap (`ros2 bag convert` makes one of the other)",
            metadata.storage_identifier
        )));
    }
    let mode = metadata.compression_mode.to_ascii_lowercase();
    if !["", "none"].contains(&mode.as_str()) && metadata.compression_format != "zstd" {
        return Err(unsupported(format!(
            "rosbag2 compressed it with {} by {}; fuyu reads zstd and the compression of MCAP chunks (`ros2 bag convert` makes one of the other)",
            metadata.compression_format, metadata.compression_mode
        )));
    }
    metadata
        .relative_file_paths
        .iter()
        .map(|relative| {
            // Old versions write paths relative to the folder's parent; rosbag2 uses only the file name.
            let name = Path::new(relative).file_name().unwrap_or_default();
            let file = folder.join(name);
            // Some writers list the names of the files before compression.
            let compressed = folder.join(format!("{}.zstd", name.to_string_lossy()));
            [file.clone(), compressed]
                .into_iter()
                .find(|f| f.is_file())
                .ok_or(BagError::NotFound(file))
        })
        .collect()
}

/// The file `path`, or the MCAP files in the folder `path`.
fn present_files(path: &Path) -> Result<Vec<PathBuf>, BagError> {
    if path.is_file() {
        return Ok(vec![path.to_owned()]);
    }
    if !path.exists() {
        return Err(BagError::NotFound(path.to_owned()));
    }
    if !path.is_dir() {
        return Err(BagError::NotABag {
            path: path.to_owned(),
            what: "neither a folder nor a regular file".into(),
        });
    }
    let mut files = Vec::new();
    let mut sqlite = false;
    for entry in std::fs::read_dir(path).map_err(BagError::io(path))? {
        let file = entry.map_err(BagError::io(path))?.path();
        let name = file.to_string_lossy();
        sqlite |= name.ends_with(".db3");
        if (name.ends_with(".mcap") || name.ends_with(".mcap.zstd")) && file.is_file() {
            files.push(file);
        }
    }
    if files.is_empty() {
        return Err(BagError::NotABag {
            path: path.to_owned(),
            what: match sqlite {
                false => "no .mcap file in this folder".into(),
                true => "no .mcap file in this folder; .db3 is the storage sqlite3, which `ros2 bag convert` makes mcap of".into(),
            },
        });
    }
    // NAME_2.mcap comes before NAME_10.mcap.
    files.sort_by_key(|file| {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let stem = name.split(".mcap").next().unwrap_or_default();
        let number = stem.rsplit('_').next().and_then(|n| n.parse::<u64>().ok());
        (number, file.clone())
    });
    Ok(files)
}

/// Decompresses the data of an individually compressed message.
fn unpack(message: &mut Message) -> Result<(), String> {
    match limits::decompress(&message.data) {
        Ok(data) => {
            message.data = data;
            Ok(())
        }
        Err(e) => Err(format!(
            "{}: a message does not unpack: {e}",
            message.topic.name
        )),
    }
}

impl Messages {
    /// Damage found so far; empty for an intact bag.
    pub fn damage(&self) -> Vec<Damage> {
        let current = self.current.iter().flat_map(|f| f.damage());
        self.damage.iter().chain(current).cloned().collect()
    }

    /// Topics found so far, including those without messages.
    pub fn topics(&self) -> impl Iterator<Item = &Arc<RecordedTopic>> {
        let current = self.current.iter().flat_map(|f| f.topics());
        self.topics.iter().chain(current)
    }

    fn close(&mut self) {
        if let Some(file) = self.current.take() {
            self.damage.extend_from_slice(file.damage());
            self.topics.extend(file.topics().cloned());
        }
    }
}

impl Iterator for Messages {
    type Item = Message;

    fn next(&mut self) -> Option<Message> {
        loop {
            if let Some(mut message) = self.current.as_mut().and_then(McapFile::next_message) {
                if self.packed
                    && let Err(what) = unpack(&mut message)
                {
                    self.current
                        .as_mut()
                        .into_iter()
                        .for_each(|f| f.damaged(&what));
                    continue;
                }
                return Some(message);
            }
            self.close();
            let path = self.files.next()?;
            match McapFile::open(&path) {
                Ok(file) => self.current = Some(file),
                Err(e) => self.damage.push(Damage {
                    file: path,
                    at: 0,
                    what: e.to_string(),
                }),
            }
        }
    }
}

impl Message {
    /// Decodes the message.
    ///
    /// # Errors
    /// [`BagError::Type`] if it is not an `M` in CDR, [`BagError::Decode`] if it does not decode.
    pub fn decode<M: Interface>(&self) -> Result<M, BagError> {
        let expected = M::DEFINITION.type_name();
        if self.topic.type_name != expected || self.topic.encoding != "cdr" {
            return Err(BagError::Type {
                topic: self.topic.name.clone(),
                found: format!("{} in {}", self.topic.type_name, self.topic.encoding),
                expected: format!("{expected} in cdr"),
            });
        }
        cdr::decode(&self.data).map_err(|source| BagError::Decode {
            topic: self.topic.name.clone(),
            log_time: self.log_time,
            source,
        })
    }
}

impl RecordedTopic {
    pub(super) fn new(
        channel: mcap::records::Channel,
        (type_name, schema_encoding, schema): (String, String, Vec<u8>),
    ) -> Self {
        let entry = |key: &str| channel.metadata.get(key).filter(|v| !v.is_empty());
        Self {
            qos: entry("offered_qos_profiles").map_or_else(Vec::new, |text| qos::from_yaml(text)),
            type_hash: entry("topic_type_hash").cloned(),
            name: channel.topic,
            encoding: channel.message_encoding,
            type_name,
            schema_encoding,
            schema,
        }
    }
}

impl From<&mcap::Channel<'_>> for RecordedTopic {
    fn from(channel: &mcap::Channel<'_>) -> Self {
        let schema = channel
            .schema
            .as_ref()
            .map(|s| (s.name.clone(), s.encoding.clone(), s.data.to_vec()));
        Self::new(
            mcap::records::Channel {
                id: channel.id,
                schema_id: channel.schema.as_ref().map_or(0, |s| s.id),
                topic: channel.topic.clone(),
                message_encoding: channel.message_encoding.clone(),
                metadata: channel.metadata.clone(),
            },
            schema.unwrap_or_default(),
        )
    }
}
