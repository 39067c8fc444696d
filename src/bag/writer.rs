//! Writing a bag.

use mcap::records::{MessageHeader, Metadata as MetadataRecord};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use super::metadata::{self, FileInformation, Metadata, TopicCount, TopicMetadata};
use super::{BagError, Qos, qos};
use crate::msg::{self, Definition, Interface, cdr};

/// How chunks are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Compression {
    /// Not at all.
    None,
    /// Fast.
    Lz4,
    /// Small.
    #[default]
    Zstd,
}

/// How a bag is written.
#[derive(Debug, Clone, Copy)]
pub struct WriterOptions {
    /// How chunks are compressed.
    pub compression: Compression,
    /// Size at which a chunk is closed \[bytes, before compression\]. What is not in a closed chunk is
    /// lost if the process is killed.
    pub chunk_size: u64,
}

impl Default for WriterOptions {
    fn default() -> Self {
        Self {
            compression: Compression::Zstd,
            chunk_size: 1 << 20,
        }
    }
}

/// A topic to be recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct Topic {
    /// Full name, `/chaser/joint_states`.
    pub name: String,
    /// ROS type, `sensor_msgs/msg/JointState`. A type that fuyu does not know is recorded without schema.
    pub type_name: String,
    /// What its publishers offer.
    pub qos: Vec<Qos>,
    /// RIHS01 hash that its publishers state, for types that fuyu does not know.
    pub type_hash: Option<String>,
}

impl Topic {
    /// A topic of messages `M`.
    pub fn of<M: Interface>(name: impl Into<String>, qos: impl Into<Qos>) -> Self {
        Self::named(name, M::DEFINITION.type_name(), qos)
    }

    /// A topic of the ROS type `type_name`, whether fuyu knows it or not.
    pub fn named(
        name: impl Into<String>,
        type_name: impl Into<String>,
        qos: impl Into<Qos>,
    ) -> Self {
        Self {
            name: name.into(),
            type_name: type_name.into(),
            qos: vec![qos.into()],
            type_hash: None,
        }
    }

    fn definition(&self) -> Option<&'static Definition> {
        msg::find(&self.type_name)
    }

    fn hash(&self) -> String {
        match self.definition() {
            Some(d) => d.type_hash(),
            None => self.type_hash.clone().unwrap_or_default(),
        }
    }
}

/// A topic of one [`Writer`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicId(usize);

struct Entry {
    topic: Topic,
    channel: u16,
    count: u64,
}

/// What has been recorded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recording {
    /// The bag's folder.
    pub path: PathBuf,
    /// Number of messages.
    pub messages: u64,
    /// Number of messages of each topic, in the order of their declaration.
    pub topics: Vec<(String, u64)>,
    /// Messages that were not recorded since the queue was full; a [`Writer`] itself drops none.
    pub dropped: u64,
    /// First and last log time \[ns\].
    pub bounds: Option<(u64, u64)>,
    /// Size of the files \[bytes\].
    pub size: u64,
}

/// Writes a bag on the caller's thread. The same calls give the same bytes, whatever the clock says.
pub struct Writer {
    folder: PathBuf,
    file_name: String,
    path: PathBuf,
    mcap: mcap::Writer<BufWriter<File>>,
    topics: Vec<Entry>,
    messages: u64,
    bounds: Option<(u64, u64)>,
    buffer: Vec<u8>,
}

impl Writer {
    /// Starts a bag in the new folder `folder`; parents are made as needed.
    ///
    /// # Errors
    /// [`BagError::Exists`] if there is anything of that name, [`BagError::Io`] if it cannot be made.
    pub fn create(folder: impl Into<PathBuf>, options: WriterOptions) -> Result<Self, BagError> {
        let folder = folder.into();
        let name = match folder.file_name() {
            Some(name) => name.to_string_lossy().into_owned(),
            None => {
                return Err(BagError::NotABag {
                    path: folder,
                    what: "a bag needs a folder with a name of its own".into(),
                });
            }
        };
        if let Some(parent) = folder.parent() {
            fs::create_dir_all(parent).map_err(BagError::io(parent))?;
        }
        // Making the folder is what claims the name: of two recorders only one succeeds.
        fs::create_dir(&folder).map_err(|e| match e.kind() {
            std::io::ErrorKind::AlreadyExists => BagError::Exists(folder.clone()),
            _ => BagError::io(&folder)(e),
        })?;

        let file_name = format!("{name}_0.mcap");
        let path = folder.join(&file_name);
        let file = File::create_new(&path).map_err(BagError::io(&path))?;
        let mut mcap = mcap::WriteOptions::new()
            .profile("ros2")
            .library(concat!("fuyu ", env!("CARGO_PKG_VERSION")))
            .compression(match options.compression {
                Compression::None => None,
                Compression::Lz4 => Some(mcap::Compression::Lz4),
                Compression::Zstd => Some(mcap::Compression::Zstd),
            })
            // One thread: compression is far faster than any topic, and its output must not vary.
            .compression_threads(0)
            // The fastest level: states of a robot are nearly noise to zstd, the next ones gain little.
            .compression_level(1)
            .chunk_size(Some(options.chunk_size))
            // Chunks reach the file whole, so that a killed process leaves whole chunks behind.
            .disable_seeking(true)
            .create(BufWriter::new(file))
            .map_err(BagError::mcap(&path))?;
        // rosbag2 looks for its version before anything else, also in a bag that was never closed.
        let start = Metadata {
            relative_file_paths: vec![file_name.clone()],
            ..empty_metadata()
        };
        mcap.write_metadata(&metadata_record(&start))
            .map_err(BagError::mcap(&path))?;
        mcap.flush().map_err(BagError::mcap(&path))?;
        Ok(Self {
            folder,
            file_name,
            path,
            mcap,
            topics: Vec::new(),
            messages: 0,
            bounds: None,
            buffer: Vec::new(),
        })
    }

    /// The bag's folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Declares a topic. Declaring it again gives the same id.
    ///
    /// # Errors
    /// [`BagError::TopicConflict`] if it was declared with another type; [`BagError::Mcap`] if the file
    /// cannot be written.
    pub fn add_topic(&mut self, topic: Topic) -> Result<TopicId, BagError> {
        if let Some(i) = self.topics.iter().position(|e| e.topic.name == topic.name) {
            let first = &self.topics[i].topic.type_name;
            if *first != topic.type_name {
                return Err(BagError::TopicConflict {
                    topic: topic.name,
                    first: first.clone(),
                    second: topic.type_name,
                });
            }
            return Ok(TopicId(i));
        }
        let (encoding, text) = match topic.definition() {
            Some(d) => ("ros2msg", d.schema_text()),
            None => ("", String::new()),
        };
        let schema = self
            .mcap
            .add_schema(&topic.type_name, encoding, text.as_bytes())
            .map_err(BagError::mcap(&self.path))?;
        let channel_metadata = BTreeMap::from([
            ("offered_qos_profiles".to_owned(), qos::to_yaml(&topic.qos)),
            ("topic_type_hash".to_owned(), topic.hash()),
        ]);
        let channel = self
            .mcap
            .add_channel(schema, &topic.name, "cdr", &channel_metadata)
            .map_err(BagError::mcap(&self.path))?;
        self.topics.push(Entry {
            topic,
            channel,
            count: 0,
        });
        Ok(TopicId(self.topics.len() - 1))
    }

    /// Records a message at `time` \[ns\].
    ///
    /// # Errors
    /// [`BagError::Mcap`] if the file cannot be written.
    pub fn write_message<M: Interface>(
        &mut self,
        topic: TopicId,
        time: u64,
        message: &M,
    ) -> Result<(), BagError> {
        let mut buffer = std::mem::take(&mut self.buffer);
        cdr::encode_into(message, &mut buffer);
        let result = self.write_cdr(topic, time, time, &buffer);
        self.buffer = buffer;
        result
    }

    /// Records CDR bytes (with their encapsulation header) that were received at `log_time` and sent at
    /// `publish_time` \[ns\].
    ///
    /// # Errors
    /// [`BagError::Mcap`] if the file cannot be written.
    pub fn write_cdr(
        &mut self,
        topic: TopicId,
        log_time: u64,
        publish_time: u64,
        cdr: &[u8],
    ) -> Result<(), BagError> {
        let entry = &mut self.topics[topic.0];
        let header = MessageHeader {
            channel_id: entry.channel,
            sequence: entry.count as u32,
            log_time,
            publish_time,
        };
        self.mcap
            .write_to_known_channel(&header, cdr)
            .map_err(BagError::mcap(&self.path))?;
        entry.count += 1;
        self.messages += 1;
        let (start, end) = self.bounds.unwrap_or((log_time, log_time));
        self.bounds = Some((start.min(log_time), end.max(log_time)));
        Ok(())
    }

    /// Closes the open chunk and hands it to the operating system: from then on it survives the process.
    ///
    /// # Errors
    /// [`BagError::Mcap`] if the file cannot be written.
    pub fn flush(&mut self) -> Result<(), BagError> {
        self.mcap.flush().map_err(BagError::mcap(&self.path))
    }

    /// Closes the bag: index, `metadata.yaml`, everything on disk.
    ///
    /// # Errors
    /// [`BagError::Mcap`] or [`BagError::Io`] if the files cannot be written.
    pub fn finish(mut self) -> Result<Recording, BagError> {
        let metadata = self.metadata();
        self.mcap
            .write_metadata(&metadata_record(&metadata))
            .map_err(BagError::mcap(&self.path))?;
        self.mcap.finish().map_err(BagError::mcap(&self.path))?;
        let on_disk = |path: &Path| File::open(path).and_then(|f| f.sync_all());
        on_disk(&self.path).map_err(BagError::io(&self.path))?;
        let yaml = self.folder.join(metadata::FILE);
        fs::write(&yaml, metadata.file_text())
            .and_then(|()| on_disk(&yaml))
            .map_err(BagError::io(&yaml))?;
        let size = |path: &Path| fs::metadata(path).map_or(0, |m| m.len());
        Ok(Recording {
            size: size(&self.path) + size(&yaml),
            messages: self.messages,
            topics: self
                .topics
                .drain(..)
                .map(|e| (e.topic.name, e.count))
                .collect(),
            dropped: 0,
            bounds: self.bounds,
            path: std::mem::take(&mut self.folder),
        })
    }

    fn metadata(&self) -> Metadata {
        let (starting_time, duration) = metadata::span(self.bounds);
        let (file_start, file_duration) = metadata::span(self.bounds);
        Metadata {
            duration,
            starting_time,
            message_count: self.messages,
            topics_with_message_count: self
                .topics
                .iter()
                .map(|e| TopicCount {
                    topic_metadata: TopicMetadata {
                        name: e.topic.name.clone(),
                        type_name: e.topic.type_name.clone(),
                        serialization_format: "cdr",
                        offered_qos_profiles: e.topic.qos.clone(),
                        type_description_hash: e.topic.hash(),
                    },
                    message_count: e.count,
                })
                .collect(),
            relative_file_paths: vec![self.file_name.clone()],
            files: vec![FileInformation {
                path: self.file_name.clone(),
                starting_time: file_start,
                duration: file_duration,
                message_count: self.messages,
            }],
            ..empty_metadata()
        }
    }
}

fn empty_metadata() -> Metadata {
    let (starting_time, duration) = metadata::span(None);
    Metadata {
        version: 9,
        storage_identifier: "mcap",
        duration,
        starting_time,
        message_count: 0,
        topics_with_message_count: Vec::new(),
        // Chunks are compressed within the file, which is no business of rosbag2's own compression.
        compression_format: "",
        compression_mode: "",
        relative_file_paths: Vec::new(),
        files: Vec::new(),
        custom_data: None,
        ros_distro: "jazzy",
    }
}

fn metadata_record(metadata: &Metadata) -> MetadataRecord {
    MetadataRecord {
        name: "rosbag2".into(),
        metadata: BTreeMap::from([("serialized_metadata".into(), metadata.to_yaml())]),
    }
}
