//! Writing bags.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use super::disk_space::DiskSpace;
use super::metadata::{self, FileInformation, Metadata, TopicCount, TopicMetadata};
use super::part::Part;
use super::{BagError, Qos, RecordedTopic};
use crate::msg::{self, Interface, cdr};

/// Chunk compression.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Compression {
    /// No compression.
    None,
    /// LZ4: fast.
    Lz4,
    /// Zstandard: small.
    #[default]
    Zstd,
}

/// Options for writing a bag.
#[derive(Debug, Clone, Copy)]
pub struct WriterOptions {
    /// Chunk compression.
    pub compression: Compression,
    /// Compression level: 1 to 22 for zstd, 0 to 12 for lz4. 0 is the library's default.
    pub compression_level: u32,
    /// Size at which a chunk is closed \[bytes, before compression\]. The open chunk is lost if the process is
    /// killed.
    pub chunk_size: u64,
    /// Size at which a new file is started \[bytes\]; the open chunk does not count.
    pub max_size: Option<u64>,
    /// Recorded time after which a new file is started.
    pub max_duration: Option<Duration>,
}

impl Default for WriterOptions {
    fn default() -> Self {
        Self {
            compression: Compression::Zstd,
            // The fastest level of zstd: robot states are hardly compressible, so higher levels gain little.
            compression_level: 1,
            chunk_size: 1 << 20,
            max_size: None,
            max_duration: None,
        }
    }
}

/// A topic to record.
#[derive(Debug, Clone, PartialEq)]
pub struct Topic {
    /// Full name, `/chaser/joint_states`.
    pub name: String,
    /// ROS type, `sensor_msgs/msg/JointState`. An unknown type is recorded without schema.
    pub type_name: String,
    /// QoS that its publishers offer.
    pub qos: Vec<Qos>,
    /// RIHS01 hash announced by its publishers. If it differs from that of the built-in definition, the type counts as unknown.
    pub type_hash: Option<String>,
}

impl Topic {
    /// A topic of messages `M`.
    pub fn of<M: Interface>(name: impl Into<String>, qos: impl Into<Qos>) -> Self {
        Self::named(name, M::DEFINITION.type_name(), qos)
    }

    /// A topic of the ROS type `type_name`, known or unknown.
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

    /// The topic with the built-in schema of its type.
    pub fn described(self) -> RecordedTopic {
        let stated = self.type_hash.as_ref();
        let known =
            msg::find(&self.type_name).filter(|d| stated.is_none_or(|hash| *hash == d.type_hash()));
        RecordedTopic {
            name: self.name,
            encoding: "cdr".into(),
            schema_encoding: known.map_or("", |_| "ros2msg").into(),
            schema: known.map_or_else(Vec::new, |d| d.schema_text().into_bytes()),
            type_hash: known.map(|d| d.type_hash()).or(self.type_hash),
            qos: self.qos,
            type_name: self.type_name,
        }
    }
}

/// A topic of one [`Writer`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicId(usize);

struct Entry {
    topic: RecordedTopic,
    count: u64,
}

/// Contents of a finished recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recording {
    /// The bag's folder.
    pub path: PathBuf,
    /// Number of messages.
    pub messages: u64,
    /// Number of messages of each topic, in the order of their declaration.
    pub topics: Vec<(String, u64)>,
    /// Number of messages dropped because the queue of a [`Recorder`](super::Recorder) was full; a [`Writer`] itself
    /// drops none.
    pub dropped: u64,
    /// First and last log time \[ns\].
    pub bounds: Option<(u64, u64)>,
    /// Size of the files \[bytes\].
    pub size: u64,
}

/// Writes a bag on the caller's thread. The same calls give the same bytes: nothing depends on the clock.
pub struct Writer {
    folder: PathBuf,
    name: String,
    options: WriterOptions,
    part: Part,
    /// The files before the current one, with their sizes.
    closed: Vec<FileInformation>,
    closed_size: u64,
    topics: Vec<Entry>,
    messages: u64,
    bounds: Option<(u64, u64)>,
    buffer: Vec<u8>,
    space: Arc<DiskSpace>,
}

impl Writer {
    /// Creates a bag in the new folder `folder`; parent folders are created as needed.
    ///
    /// # Errors
    /// [`BagError::Exists`] if the path exists, [`BagError::Io`] if it cannot be created.
    pub fn create(folder: impl Into<PathBuf>, options: WriterOptions) -> Result<Self, BagError> {
        let folder = folder.into();
        let name = match folder.file_name() {
            Some(name) => name.to_string_lossy().into_owned(),
            None => {
                return Err(BagError::NotABag {
                    path: folder,
                    what: "the path of a bag must end with a folder name".into(),
                });
            }
        };
        if let Some(parent) = folder.parent() {
            fs::create_dir_all(parent).map_err(BagError::io(parent))?;
        }
        // Creating the folder claims the name atomically: of two recorders only one succeeds.
        fs::create_dir(&folder).map_err(|e| match e.kind() {
            std::io::ErrorKind::AlreadyExists => BagError::Exists(folder.clone()),
            _ => BagError::io(&folder)(e),
        })?;
        let space = Arc::new(DiskSpace::default());
        let part = open_part(&folder, &name, 0, &options, &space)?;
        Ok(Self {
            folder,
            name,
            options,
            part,
            closed: Vec::new(),
            closed_size: 0,
            topics: Vec::new(),
            messages: 0,
            bounds: None,
            buffer: Vec::new(),
            space,
        })
    }

    /// Policy of writes on a full disk; by default they fail at once.
    pub(super) fn space(&self) -> &Arc<DiskSpace> {
        &self.space
    }

    /// The bag's folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Declares a topic. A repeated declaration returns the same id.
    ///
    /// # Errors
    /// [`BagError::TopicConflict`] if it was declared with another type; [`BagError::Mcap`] if the file
    /// cannot be written.
    pub fn add_topic(&mut self, topic: Topic) -> Result<TopicId, BagError> {
        self.add_described(topic.described())
    }

    /// Declares a topic with the given schema.
    ///
    /// # Errors
    /// As [`Self::add_topic`].
    pub fn add_described(&mut self, topic: RecordedTopic) -> Result<TopicId, BagError> {
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
        self.part.add_topic(&topic)?;
        self.topics.push(Entry { topic, count: 0 });
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
    /// `publish_time` \[ns\]. Starts a new file if the current one has reached its limit of size or time.
    ///
    /// # Errors
    /// [`BagError::Mcap`] or [`BagError::Io`] if a file cannot be written.
    pub fn write_cdr(
        &mut self,
        topic: TopicId,
        log_time: u64,
        publish_time: u64,
        cdr: &[u8],
    ) -> Result<(), BagError> {
        if self.is_full(log_time) {
            self.split()?;
        }
        self.part.write(topic.0, log_time, publish_time, cdr)?;
        self.topics[topic.0].count += 1;
        self.messages += 1;
        self.bounds = metadata::extend(self.bounds, log_time);
        Ok(())
    }

    fn is_full(&self, log_time: u64) -> bool {
        let Some((start, _)) = self.part.bounds() else {
            return false;
        };
        let age = Duration::from_nanos(log_time.saturating_sub(start));
        self.options.max_duration.is_some_and(|max| age >= max)
            || self
                .options
                .max_size
                .is_some_and(|max| self.part.size() >= max)
    }

    /// Closes the current file and starts a new one.
    ///
    /// # Errors
    /// [`BagError::Mcap`] or [`BagError::Io`] if a file cannot be written.
    pub fn split(&mut self) -> Result<(), BagError> {
        let number = self.closed.len() + 1;
        let mut part = open_part(&self.folder, &self.name, number, &self.options, &self.space)?;
        for entry in &self.topics {
            part.add_topic(&entry.topic)?;
        }
        let metadata = self.metadata();
        let full = std::mem::replace(&mut self.part, part);
        self.closed.push(full.information());
        self.closed_size += full.finish(&metadata)?;
        Ok(())
    }

    /// Number of files.
    pub fn files(&self) -> usize {
        self.closed.len() + 1
    }

    /// Closes the open chunk and passes it to the operating system, so that it survives the process.
    ///
    /// # Errors
    /// [`BagError::Mcap`] if the file cannot be written.
    pub fn flush(&mut self) -> Result<(), BagError> {
        self.part.flush()
    }

    /// Closes the bag: writes index and `metadata.yaml`, and syncs to disk.
    ///
    /// # Errors
    /// [`BagError::Mcap`] or [`BagError::Io`] if the files cannot be written.
    pub fn finish(self) -> Result<Recording, BagError> {
        let metadata = self.metadata();
        let last = self.part.path().to_owned();
        let size = self.closed_size + self.part.finish(&metadata)?;
        let on_disk = |path: &Path| File::open(path).and_then(|f| f.sync_all());
        for file in self
            .closed
            .iter()
            .map(|f| self.folder.join(&f.path))
            .chain([last])
        {
            on_disk(&file).map_err(BagError::io(&file))?;
        }
        let yaml = self.folder.join(metadata::FILE);
        let text = metadata.file_text();
        self.space
            .retry(|| fs::write(&yaml, &text))
            .and_then(|()| on_disk(&yaml))
            .map_err(BagError::io(&yaml))?;
        Ok(Recording {
            size: size + text.len() as u64,
            messages: self.messages,
            topics: self
                .topics
                .into_iter()
                .map(|e| (e.topic.name, e.count))
                .collect(),
            dropped: 0,
            bounds: self.bounds,
            path: self.folder,
        })
    }

    /// Contents of the bag so far.
    fn metadata(&self) -> Metadata {
        let (starting_time, duration) = metadata::span(self.bounds);
        let files: Vec<_> = self
            .closed
            .iter()
            .cloned()
            .chain([self.part.information()])
            .collect();
        let topic = |e: &Entry| TopicCount {
            topic_metadata: TopicMetadata {
                name: e.topic.name.clone(),
                type_name: e.topic.type_name.clone(),
                serialization_format: e.topic.encoding.clone(),
                offered_qos_profiles: e.topic.qos.clone(),
                type_description_hash: e.topic.type_hash.clone().unwrap_or_default(),
            },
            message_count: e.count,
        };
        Metadata {
            duration,
            starting_time,
            message_count: self.messages,
            topics_with_message_count: self.topics.iter().map(topic).collect(),
            relative_file_paths: files.iter().map(|f| f.path.clone()).collect(),
            files,
            ..Metadata::empty()
        }
    }
}

/// Path of file `number` of the bag `name` in `folder`.
fn open_part(
    folder: &Path,
    name: &str,
    number: usize,
    options: &WriterOptions,
    space: &Arc<DiskSpace>,
) -> Result<Part, BagError> {
    let file_name = format!("{name}_{number}.mcap");
    let start = Metadata {
        relative_file_paths: vec![file_name.clone()],
        ..Metadata::empty()
    };
    Part::create(folder, file_name, options, &start, space)
}
