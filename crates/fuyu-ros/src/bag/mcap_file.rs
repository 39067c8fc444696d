//! One MCAP file, read sequentially up to the first damage that cannot be skipped.
//!
//! The mcap crate parses records and chunks; this module iterates over records, because a file left by a killed
//! process or a full disk must be readable up to its last complete chunk.

use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::sans_io::summary_reader::{SummaryReadEvent, SummaryReader};
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::limits;
use super::reader::RecordedTopic;
use super::{BagError, Message};

/// Opcode and length before every record.
const RECORD_HEADER: usize = 9;

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
    /// Largest record \[bytes\].
    largest: u64,
    at: u64,
    body: Vec<u8>,
    chunk: Chunk,
    schemas: HashMap<u16, (String, String, Vec<u8>)>,
    topics: HashMap<u16, Arc<RecordedTopic>>,
    compressions: Vec<String>,
    done: bool,
    damage: Vec<Damage>,
}

impl McapFile {
    pub fn open(path: &Path) -> Result<Self, BagError> {
        let file = File::open(path).map_err(BagError::io(path))?;
        let on_disk = file.metadata().map_err(BagError::io(path))?.len();
        let (mut input, size): (Box<dyn Read + Send>, _) = if is_compressed(path) {
            let decoder = zstd::Decoder::new(file).map_err(BagError::io(path))?;
            (Box::new(BufReader::with_capacity(1 << 16, decoder)), None)
        } else {
            (
                Box::new(BufReader::with_capacity(1 << 16, file)),
                Some(on_disk),
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
            largest: size.unwrap_or_else(|| limits::expanded(on_disk)),
            at: magic.len() as u64,
            body: Vec::new(),
            chunk: Chunk::default(),
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
            // The memory of a large chunk is not kept.
            self.chunk = Chunk::default();
            let opcode = self.next_record()?;
            match opcode {
                op::CHUNK => self.open_chunk(),
                // A file has its messages either in chunks or outside of them. In a file with chunks this is a record of
                // another kind whose opcode is damaged, which no checksum detects.
                op::MESSAGE if !self.compressions.is_empty() => {
                    self.damaged("a message outside of the chunks");
                }
                op::SCHEMA | op::CHANNEL | op::MESSAGE => match parse(opcode, &self.body) {
                    Ok(record) => {
                        let record = record.into_owned();
                        if let Some(message) = self.accept(record) {
                            return Some(message);
                        }
                    }
                    Err(what) => self.damaged(what),
                },
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
            None => u64::MAX,
        };
        let mut body = std::mem::take(&mut self.body);
        body.clear();
        let read = match is_read(opcode) {
            true if length > self.largest && left > self.largest => {
                let (size, limit) = (length, self.largest);
                self.stop(format!("a record of {size} bytes; at most {limit} are read from a compressed file of this size"));
                return None;
            }
            true => self.read_to(length.min(left), &mut body).map(|n| n as u64),
            // Indices, attachments and metadata may be large and are not needed.
            false => io::copy(&mut (&mut self.input).take(length), &mut io::sink()),
        };
        self.body = body;
        match read {
            Ok(n) if n == length => {}
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
                self.chunk = records;
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
                // The declaration is repeated in the summary, and by some writers in every chunk.
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

    /// Reports a message of a channel without declaration: it was in a damaged chunk, and the summary at the end
    /// repeats it.
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
                // Reported once; further messages of the channel are skipped silently.
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

/// Whether the content of records of this kind is needed.
fn is_read(opcode: u8) -> bool {
    matches!(
        opcode,
        op::CHUNK | op::SCHEMA | op::CHANNEL | op::MESSAGE | op::FOOTER
    )
}

fn parse(opcode: u8, body: &[u8]) -> Result<Record<'_>, String> {
    if !limits::lengths_fit(opcode, body) {
        return Err("a text in a record is longer than the record".into());
    }
    mcap::parse_record(opcode, body).map_err(|e| e.to_string())
}

/// The records of a decompressed chunk, one after another, each with a header as in the file.
#[derive(Default)]
struct Chunk {
    bytes: Vec<u8>,
    at: usize,
}

impl Chunk {
    fn push(&mut self, opcode: u8, body: &[u8]) {
        self.bytes.push(opcode);
        self.bytes
            .extend_from_slice(&(body.len() as u64).to_le_bytes());
        self.bytes.extend_from_slice(body);
    }

    fn next(&mut self) -> Option<Record<'static>> {
        let rest = self.bytes.get(self.at..)?;
        let (&opcode, rest) = rest.split_first()?;
        let (length, rest) = rest.split_first_chunk()?;
        let length = u64::from_le_bytes(*length) as usize;
        let body = rest.get(..length)?;
        self.at += RECORD_HEADER + length;
        // Every record was parsed when the chunk was unpacked.
        parse(opcode, body).ok().map(Record::into_owned)
    }
}

/// A chunk's compression and its records.
fn unpack(body: &[u8]) -> Result<(String, Chunk), String> {
    let text = |e: mcap::McapError| e.to_string();
    let Record::Chunk { header, .. } = parse(op::CHUNK, body)? else {
        return Err("not a chunk".into());
    };
    let (size, allowed) = (
        header.uncompressed_size,
        limits::expanded(body.len() as u64),
    );
    if size > allowed {
        return Err(format!(
            "{size} bytes in a record of {}; at most {allowed} are read from one of this size",
            body.len()
        ));
    }
    let compression = header.compression;
    // Verify the checksum before the records, and allow no record larger than the chunk: lengths in a damaged chunk
    // may be wrong.
    let limit = usize::try_from(size.max(body.len() as u64)).map_err(|e| e.to_string())?;
    let mut reader = LinearReader::new_with_options(
        LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(limit),
    );
    let length = (body.len() as u64).to_le_bytes();
    let mut input = [op::CHUNK].as_slice().chain(&length[..]).chain(body);
    let mut records = Chunk::default();
    while let Some(event) = reader.next_event() {
        match event.map_err(text)? {
            LinearReadEvent::ReadRequest(n) => {
                let n = n.min(body.len() + RECORD_HEADER);
                let read = input.read(reader.insert(n)).map_err(|e| e.to_string())?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { data, opcode } => {
                if matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE) {
                    parse(opcode, data)?;
                    records.push(opcode, data);
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
    if !summary_fits(&mut file, size).unwrap_or(false) {
        return Ok(None);
    }
    file.rewind().map_err(BagError::io(path))?;
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
                // The position is beyond the end of the file: there is no footer, hence no summary.
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

/// Whether the lengths in the records of the summary fit into them.
fn summary_fits(file: &mut File, size: u64) -> io::Result<bool> {
    /// Footer record and magic bytes at the end of a file.
    const END: u64 = RECORD_HEADER as u64 + 20 + mcap::MAGIC.len() as u64;
    let Some(footer_at) = size.checked_sub(END) else {
        return Ok(false);
    };
    let mut footer = [0; END as usize];
    file.seek(SeekFrom::Start(footer_at))?;
    file.read_exact(&mut footer)?;
    let start = footer[RECORD_HEADER..].first_chunk().copied();
    let start = u64::from_le_bytes(start.unwrap_or_default());
    if footer[0] != op::FOOTER || start == 0 || start > footer_at {
        return Ok(false);
    }
    file.seek(SeekFrom::Start(start))?;
    let mut input = BufReader::new(file).take(footer_at - start);
    let mut body = Vec::new();
    loop {
        let mut header = [0; RECORD_HEADER];
        match input.read(&mut header[..1])? {
            0 => return Ok(true),
            _ => input.read_exact(&mut header[1..])?,
        }
        let [opcode, length @ ..] = header;
        let length = u64::from_le_bytes(length);
        if length > input.limit() {
            return Ok(false);
        }
        body.clear();
        (&mut input).take(length).read_to_end(&mut body)?;
        if !limits::lengths_fit(opcode, &body) {
            return Ok(false);
        }
    }
}

fn read_some(file: &mut File, buffer: &mut [u8]) -> io::Result<usize> {
    loop {
        match file.read(buffer) {
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            result => return result,
        }
    }
}
