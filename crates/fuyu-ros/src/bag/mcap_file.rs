//! One MCAP file, read sequentially up to the first damage that cannot be skipped.
//!
//! The mcap crate parses records and chunks; this module iterates over records, because a file left by a killed
//! process or a full disk must be readable up to its last complete chunk.

use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::sans_io::summary_reader::{SummaryReadEvent, SummaryReader};
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::reader::RecordedTopic;
use super::{BagError, Message};

/// Opcode and length before every record.
const RECORD_HEADER: usize = 9;

/// A chunk larger than this is considered damaged. rosbag2's are 768 kB, those of its largest preset 4 MB.
const MAX_CHUNK: u64 = 1 << 30;

/// Damage at one place in a bag.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, thiserror::Error)]
#[error("{}, byte {at}: {what}", file.display())]
pub struct Damage {
    /// The file.
    pub file: PathBuf,
    /// Offset in the file \[bytes\].
    pub at: u64,
    /// What is wrong.
    pub what: String,
}

/// Reads the messages of one file in file order.
pub(super) struct McapFile {
    path: PathBuf,
    input: Box<dyn Read + Send>,
    /// Size \[bytes\]; unknown for a file that is compressed as a whole.
    size: Option<u64>,
    at: u64,
    body: Vec<u8>,
    chunk: std::vec::IntoIter<Record<'static>>,
    schemas: HashMap<u16, (String, String, Vec<u8>)>,
    topics: HashMap<u16, Arc<RecordedTopic>>,
    compressions: Vec<String>,
    done: bool,
    damage: Vec<Damage>,
}

impl McapFile {
    pub fn open(path: &Path) -> Result<Self, BagError> {
        let file = File::open(path).map_err(BagError::io(path))?;
        let (mut input, size): (Box<dyn Read + Send>, _) = if is_compressed(path) {
            let decoder = zstd::Decoder::new(file).map_err(BagError::io(path))?;
            (Box::new(BufReader::with_capacity(1 << 16, decoder)), None)
        } else {
            let size = file.metadata().map_err(BagError::io(path))?.len();
            (
                Box::new(BufReader::with_capacity(1 << 16, file)),
                Some(size),
            )
        };
        let mut magic = Vec::new();
        (&mut input)
            .take(mcap::MAGIC.len() as u64)
            .read_to_end(&mut magic)
            .map_err(BagError::io(path))?;
        if magic.starts_with(b"SQLite f") {
            return Err(BagError::Unsupported {
                path: path.to_owned(),
                what:
                    "its storage is sqlite3; fuyu reads mcap (convert it with `ros2 bag convert`)"
                        .into(),
            });
        }
        if !mcap::MAGIC.starts_with(&magic) {
            return Err(BagError::NotABag {
                path: path.to_owned(),
                what: "not an MCAP file: it does not start with the bytes 89 \"MCAP0\"".into(),
            });
        }
        let mut this = Self {
            path: path.to_owned(),
            input,
            size,
            at: magic.len() as u64,
            body: Vec::new(),
            chunk: Vec::new().into_iter(),
            schemas: HashMap::new(),
            topics: HashMap::new(),
            compressions: Vec::new(),
            done: false,
            damage: Vec::new(),
        };
        if magic.len() < mcap::MAGIC.len() {
            this.stop("the file ends before its first record");
        }
        Ok(this)
    }

    /// Damage found so far.
    pub fn damage(&self) -> &[Damage] {
        &self.damage
    }

    /// Topics declared so far, also those without messages.
    pub fn topics(&self) -> impl Iterator<Item = &Arc<RecordedTopic>> {
        self.topics.values()
    }

    /// Compression algorithms of the chunks read so far; an empty string means none.
    pub fn compressions(&self) -> &[String] {
        &self.compressions
    }

    /// The next message; `None` at the end of the readable part.
    pub fn next_message(&mut self) -> Option<Message> {
        loop {
            if let Some(record) = self.chunk.next() {
                if let Some(message) = self.accept(record) {
                    return Some(message);
                }
                continue;
            }
            let opcode = self.next_record()?;
            match opcode {
                op::CHUNK => self.open_chunk(),
                // A file has its messages either in chunks or outside of them. In a file with chunks this is a record of
                // another kind whose opcode is damaged, which no checksum detects.
                op::MESSAGE if !self.compressions.is_empty() => {
                    self.damaged("a message outside of the chunks");
                }
                op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                    match mcap::parse_record(opcode, &self.body) {
                        Ok(record) => {
                            let record = record.into_owned();
                            if let Some(message) = self.accept(record) {
                                return Some(message);
                            }
                        }
                        Err(e) => self.damaged(e.to_string()),
                    }
                }
                op::FOOTER => self.done = true,
                // Headers, indices and attachments contain no messages.
                _ => {}
            }
        }
    }

    fn read_to(&mut self, n: u64, buffer: &mut Vec<u8>) -> io::Result<usize> {
        (&mut self.input).take(n).read_to_end(buffer)
    }

    /// Reads a record into `self.body` and returns its opcode; `None` at the end.
    fn next_record(&mut self) -> Option<u8> {
        if self.done {
            return None;
        }
        let mut header = Vec::with_capacity(RECORD_HEADER);
        let read = self.read_to(RECORD_HEADER as u64, &mut header);
        let header: [u8; RECORD_HEADER] = match (read, header.try_into()) {
            (Err(e), _) => {
                self.stop(format!("cannot be read: {e}"));
                return None;
            }
            (Ok(0), _) => {
                self.stop("the recording was not closed: there is no footer");
                return None;
            }
            (Ok(_), Err(_)) => {
                self.stop("the file ends inside a record");
                return None;
            }
            (Ok(_), Ok(header)) => header,
        };
        let [opcode, length @ ..] = header;
        let length = u64::from_le_bytes(length);
        let left = match self.size {
            Some(size) => size.saturating_sub(self.at + RECORD_HEADER as u64),
            // A corrupt length must not cause a huge allocation.
            None => 2 * MAX_CHUNK,
        };
        let mut body = std::mem::take(&mut self.body);
        body.clear();
        let read = self.read_to(length.min(left), &mut body);
        self.body = body;
        match read {
            Ok(n) if n as u64 == length => {}
            Ok(n) => {
                self.stop(format!(
                    "the file ends inside a record: {n} of {length} bytes are there"
                ));
                return None;
            }
            Err(e) => {
                self.stop(format!("cannot be read: {e}"));
                return None;
            }
        }
        self.at += RECORD_HEADER as u64 + length;
        Some(opcode)
    }

    /// Decompresses the chunk in `self.body`: all of it, or nothing if it is damaged.
    fn open_chunk(&mut self) {
        match unpack(&self.body) {
            Ok((compression, records)) => {
                if !self.compressions.contains(&compression) {
                    self.compressions.push(compression);
                }
                self.chunk = records.into_iter();
            }
            Err(what) => self.damaged(format!("chunk: {what}")),
        }
    }

    fn accept(&mut self, record: Record<'static>) -> Option<Message> {
        match record {
            Record::Schema { header, data } => {
                let schema = (header.name, header.encoding, data.into_owned());
                self.schemas.insert(header.id, schema);
                None
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).cloned();
                let id = channel.id;
                let topic = RecordedTopic::new(channel, schema.unwrap_or_default());
                // Written again in the summary, and by some writers in every chunk.
                self.topics.entry(id).or_insert_with(|| Arc::new(topic));
                None
            }
            Record::Message { header, data } => match self.topics.get(&header.channel_id) {
                Some(topic) => Some(Message {
                    topic: topic.clone(),
                    log_time: header.log_time,
                    publish_time: header.publish_time,
                    data: data.into_owned(),
                }),
                None => {
                    self.lost_channel(header.channel_id);
                    None
                }
            },
            _ => None,
        }
    }

    /// A channel's declaration stood in a damaged chunk: the summary at the end repeats it.
    fn lost_channel(&mut self, id: u16) {
        let known = summary(&self.path).ok().flatten().and_then(|s| {
            let channel = s.channels.get(&id)?;
            Some(Arc::new(RecordedTopic::from(&**channel)))
        });
        match known {
            Some(topic) => {
                self.topics.insert(id, topic);
            }
            None => {
                // Said once; further messages of the channel are skipped without another word.
                let what = format!("messages of channel {id}, whose declaration is lost");
                if !self.damage.iter().any(|d| d.what == what) {
                    self.damaged(what);
                }
            }
        }
    }

    /// Records damage at the current offset.
    pub fn damaged(&mut self, what: impl Into<String>) {
        self.damage.push(Damage {
            file: self.path.clone(),
            at: self.at,
            what: what.into(),
        });
    }

    fn stop(&mut self, what: impl Into<String>) {
        self.damaged(what);
        self.done = true;
    }
}

/// Whether rosbag2 has compressed the file as a whole.
fn is_compressed(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "zstd")
}

/// A chunk's compression and its records.
fn unpack(body: &[u8]) -> Result<(String, Vec<Record<'static>>), String> {
    let text = |e: mcap::McapError| e.to_string();
    let Record::Chunk { header, .. } = mcap::parse_record(op::CHUNK, body).map_err(text)? else {
        return Err("not a chunk".into());
    };
    if header.uncompressed_size > MAX_CHUNK {
        let size = header.uncompressed_size;
        return Err(format!("{size} bytes, more than any writer produces"));
    }
    let compression = header.compression;
    // Verify the checksum before the records, and allow no record larger than the chunk: lengths in a damaged chunk
    // may be wrong.
    let limit = usize::try_from(header.uncompressed_size.max(body.len() as u64))
        .map_err(|e| e.to_string())?;
    let mut reader = LinearReader::new_with_options(
        LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(limit),
    );
    let length = (body.len() as u64).to_le_bytes();
    let mut input = [op::CHUNK].as_slice().chain(&length[..]).chain(body);
    let mut records = Vec::new();
    while let Some(event) = reader.next_event() {
        match event.map_err(text)? {
            LinearReadEvent::ReadRequest(n) => {
                let n = n.min(body.len() + RECORD_HEADER);
                let read = input.read(reader.insert(n)).map_err(|e| e.to_string())?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { data, opcode } => {
                if matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE) {
                    let record = mcap::parse_record(opcode, data).map_err(text)?;
                    records.push(record.into_owned());
                }
            }
        }
    }
    Ok((compression, records))
}

/// The summary at the end of a closed file; `None` if there is none.
pub(super) fn summary(path: &Path) -> Result<Option<mcap::Summary>, BagError> {
    if is_compressed(path) {
        return Ok(None);
    }
    let mut file = File::open(path).map_err(BagError::io(path))?;
    let size = file.metadata().map_err(BagError::io(path))?.len();
    let options = mcap::sans_io::summary_reader::SummaryReaderOptions::default()
        .with_file_size(size)
        .with_record_length_limit(usize::try_from(size).unwrap_or(usize::MAX));
    let mut reader = SummaryReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event {
            Ok(SummaryReadEvent::ReadRequest(n)) => {
                let read = read_some(&mut file, reader.insert(n)).map_err(BagError::io(path))?;
                reader.notify_read(read);
            }
            Ok(SummaryReadEvent::SeekRequest(to)) => {
                // Beyond the end of the file: no footer, so no summary.
                let Ok(position) = file.seek(to) else {
                    return Ok(None);
                };
                reader.notify_seeked(position);
            }
            Err(_) => return Ok(None),
        }
    }
    Ok(reader.finish())
}

fn read_some(file: &mut File, buffer: &mut [u8]) -> io::Result<usize> {
    loop {
        match file.read(buffer) {
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            result => return result,
        }
    }
}
