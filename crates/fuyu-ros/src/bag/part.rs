//! One MCAP file of a bag being written.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use mcap::records::{MessageHeader, Metadata as MetadataRecord};

use super::disk_space::DiskSpace;
use super::metadata::{self, FileInformation, Metadata};
use super::{BagError, Compression, RecordedTopic, WriterOptions, qos};

/// A file, its channels in the order of the bag's topics, and its contents so far.
pub(super) struct Part {
    path: PathBuf,
    name: String,
    mcap: mcap::Writer<Counted>,
    bytes: Arc<AtomicU64>,
    channels: Vec<u16>,
    counts: Vec<u32>,
    messages: u64,
    bounds: Option<(u64, u64)>,
}

impl Part {
    /// Creates the file. `start` is the metadata record at its beginning, which counts until the file is closed.
    pub fn create(
        folder: &Path,
        name: String,
        options: &WriterOptions,
        start: &Metadata,
        space: &Arc<DiskSpace>,
    ) -> Result<Self, BagError> {
        let path = folder.join(&name);
        let file = space
            .retry(|| File::create_new(&path))
            .map_err(BagError::io(&path))?;
        let bytes = Arc::new(AtomicU64::new(0));
        let output = Counted {
            file: BufWriter::new(file),
            bytes: Arc::clone(&bytes),
            space: Arc::clone(space),
        };
        let mut mcap = mcap::WriteOptions::new()
            .profile("ros2")
            .library(concat!("fuyu ", env!("CARGO_PKG_VERSION")))
            .compression(match options.compression {
                Compression::None => None,
                Compression::Lz4 => Some(mcap::Compression::Lz4),
                Compression::Zstd => Some(mcap::Compression::Zstd),
            })
            // One thread: compression is far faster than any topic, and the output must be deterministic.
            .compression_threads(0)
            .compression_level(options.compression_level)
            .chunk_size(Some(options.chunk_size))
            // Chunks are written in one piece, so that a killed process leaves complete chunks.
            .disable_seeking(true)
            .create(output)
            .map_err(BagError::mcap(&path))?;
        // rosbag2 reads the metadata version first, also in a bag that was never closed.
        mcap.write_metadata(&metadata_record(start))
            .map_err(BagError::mcap(&path))?;
        mcap.flush().map_err(BagError::mcap(&path))?;
        Ok(Self {
            path,
            name,
            mcap,
            bytes,
            channels: Vec::new(),
            counts: Vec::new(),
            messages: 0,
            bounds: None,
        })
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// First and last log time \[ns\].
    pub fn bounds(&self) -> Option<(u64, u64)> {
        self.bounds
    }

    /// Bytes in the file, without the open chunk.
    pub fn size(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    /// Declares the next topic.
    pub fn add_topic(&mut self, topic: &RecordedTopic) -> Result<(), BagError> {
        let schema = self
            .mcap
            .add_schema(&topic.type_name, &topic.schema_encoding, &topic.schema)
            .map_err(BagError::mcap(&self.path))?;
        let metadata = BTreeMap::from([
            ("offered_qos_profiles".to_owned(), qos::to_yaml(&topic.qos)),
            (
                "topic_type_hash".to_owned(),
                topic.type_hash.clone().unwrap_or_default(),
            ),
        ]);
        let channel = self
            .mcap
            .add_channel(schema, &topic.name, &topic.encoding, &metadata)
            .map_err(BagError::mcap(&self.path))?;
        self.channels.push(channel);
        self.counts.push(0);
        Ok(())
    }

    /// Writes a message of the topic declared as number `topic`.
    pub fn write(
        &mut self,
        topic: usize,
        log_time: u64,
        publish_time: u64,
        cdr: &[u8],
    ) -> Result<(), BagError> {
        let header = MessageHeader {
            channel_id: self.channels[topic],
            sequence: self.counts[topic],
            log_time,
            publish_time,
        };
        self.mcap
            .write_to_known_channel(&header, cdr)
            .map_err(BagError::mcap(&self.path))?;
        // Sequence numbers wrap, like those of a publisher.
        self.counts[topic] = self.counts[topic].wrapping_add(1);
        self.messages += 1;
        self.bounds = metadata::extend(self.bounds, log_time);
        Ok(())
    }

    /// Closes the open chunk and passes it to the operating system.
    pub fn flush(&mut self) -> Result<(), BagError> {
        self.mcap.flush().map_err(BagError::mcap(&self.path))
    }

    /// The entry of this file in the bag's metadata.
    pub fn information(&self) -> FileInformation {
        let (starting_time, duration) = metadata::span(self.bounds);
        FileInformation {
            path: self.name.clone(),
            starting_time,
            duration,
            message_count: self.messages,
        }
    }

    /// Closes the file: writes `metadata`, index and footer. Returns its size \[bytes\].
    pub fn finish(mut self, metadata: &Metadata) -> Result<u64, BagError> {
        self.mcap
            .write_metadata(&metadata_record(metadata))
            .map_err(BagError::mcap(&self.path))?;
        self.mcap.finish().map_err(BagError::mcap(&self.path))?;
        Ok(self.size())
    }
}

fn metadata_record(metadata: &Metadata) -> MetadataRecord {
    MetadataRecord {
        name: "rosbag2".into(),
        metadata: BTreeMap::from([("serialized_metadata".into(), metadata.to_yaml())]),
    }
}

/// A file that counts the bytes written to it, and waits when the disk is full.
struct Counted {
    file: BufWriter<File>,
    bytes: Arc<AtomicU64>,
    space: Arc<DiskSpace>,
}

impl Write for Counted {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let n = self.space.retry(|| self.file.write(buffer))?;
        self.bytes.fetch_add(n as u64, Ordering::Relaxed);
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.space.retry(|| self.file.flush())
    }
}

impl Seek for Counted {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        // Writes what is buffered first.
        self.space.retry(|| self.file.seek(to))
    }
}
