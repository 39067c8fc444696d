//! Parameters of the recorder node. Where `ros2 bag record` has the same thing, it has the same name.

use std::{path::PathBuf, time::Duration};

use regex::Regex;

use super::{super::choice, selection::Selection};
use crate::{
    bag::{Compression, QUEUE_BYTES, WriterOptions},
    ros::{Declare, params::Declaration},
};

/// What the recorder node is told at its start.
#[derive(Debug, Clone)]
pub struct RecorderParams {
    /// Folder to write, which must not exist; `None` is a new one in `bags/`.
    pub bag: Option<PathBuf>,
    /// Which topics.
    pub selection: Selection,
    /// How they are written.
    pub options: WriterOptions,
    /// Bytes that may wait for the disk before messages are dropped.
    pub queue: usize,
    /// Whether it waits for a call of `resume`.
    pub start_paused: bool,
}

const COMPRESSIONS: [(&str, Compression); 3] = [
    ("zstd", Compression::Zstd),
    ("lz4", Compression::Lz4),
    ("none", Compression::None),
];

/// A file smaller than this is not worth the trouble \[bytes\].
const SMALLEST_FILE: i64 = 10_000;

impl RecorderParams {
    /// Declares the parameters and reads them. `finish` of `declare` is the caller's.
    pub fn declare(declare: &mut Declare) -> Self {
        let bag = declare
            .param(
                "bag",
                "",
                "Folder of the bag, which must not exist; empty is bags/ and the time",
            )
            .read_only()
            .value();
        let selection = declare_selection(declare);
        let options = declare_options(declare);
        let queue = declare
            .param(
                "max_cache_size",
                QUEUE_BYTES as i64,
                "What may wait for the disk before messages are dropped [bytes]",
            )
            .range(1 << 16, 1 << 36)
            .read_only()
            .value();
        let start_paused = declare
            .param(
                "start_paused",
                false,
                "Record nothing until the service resume is called",
            )
            .read_only()
            .value();
        Self {
            bag: (!bag.is_empty()).then(|| PathBuf::from(bag)),
            selection,
            options,
            queue: usize::try_from(queue).unwrap_or(QUEUE_BYTES),
            start_paused,
        }
    }
}

fn declare_selection(declare: &mut Declare) -> Selection {
    let names = |declare: &mut Declare, name: &str, description: &str| {
        declare
            .param(name, Vec::<String>::new(), description)
            .read_only()
            .value()
    };
    let topics = names(
        declare,
        "topics",
        "Topics to record; without topics and regex, all",
    );
    let exclude_topics = names(declare, "exclude_topics", "Topics not to record");
    let all = declare
        .param("all", false, "Record all topics, beside those named")
        .read_only()
        .value();
    let regex = expression(
        declare,
        "regex",
        "Record topics, too, of whose full name it matches a part",
    );
    let exclude_regex = expression(
        declare,
        "exclude_regex",
        "Do not record topics of whose full name it matches a part",
    );
    Selection {
        all,
        topics,
        regex,
        exclude_topics,
        exclude_regex,
    }
}

/// A regular expression; empty text is none.
fn expression(declare: &mut Declare, name: &str, description: &str) -> Option<Regex> {
    let text = declare
        .param(name, "", description)
        .check("a regular expression", |text: &String| {
            compile(text).map(|_| ())
        })
        .read_only()
        .value();
    // A wrong one has been refused by the declaration.
    compile(&text).ok().flatten()
}

fn compile(text: &str) -> Result<Option<Regex>, String> {
    if text.is_empty() {
        return Ok(None);
    }
    Regex::new(text).map(Some).map_err(|e| {
        // The lines before the last one draw where it is.
        let text_of_error = e.to_string();
        let reason = text_of_error.lines().last().unwrap_or_default();
        let reason = reason.trim_start_matches("error: ");
        format!("'{text}' is not a regular expression: {reason}")
    })
}

fn declare_options(declare: &mut Declare) -> WriterOptions {
    let compression = choice::declare(
        declare,
        "compression",
        &COMPRESSIONS,
        "Compression of the chunks",
    )
    .read_only()
    .value();
    let mut integer = |name: &str, default: u64, from, to, description: &str| {
        let declaration = declare.param(name, default as i64, description);
        unsigned(declaration.range(from, to).read_only())
    };
    let default = WriterOptions::default();
    let compression_level = integer(
        "compression_level",
        default.compression_level.into(),
        0,
        22,
        "How hard it is tried: 1 to 22 for zstd, 1 to 12 for lz4, 0 is usual",
    );
    let chunk_size = integer(
        "chunk_size",
        default.chunk_size,
        1024,
        1 << 28,
        "Size of a chunk before compression [bytes]",
    );
    let max_size = declare
        .param(
            "max_bagfile_size",
            0,
            "Size at which another file is begun, give or take a chunk [bytes]; 0 is never",
        )
        .check(
            &format!("0 or at least {SMALLEST_FILE}"),
            |&size| match size {
                0 | SMALLEST_FILE.. => Ok(()),
                _ => Err(format!(
                    "{size}: it must be 0 or at least {SMALLEST_FILE} bytes"
                )),
            },
        )
        .read_only();
    let max_size = unsigned(max_size);
    let max_duration = declare
        .param(
            "max_bagfile_duration",
            0.0,
            "Recorded time after which another file is begun [s]; 0 is never",
        )
        .range(0.0, 1e9)
        .check("0 or at least 0.1", |&seconds| match seconds {
            0.0 | 0.1.. => Ok(()),
            _ => Err(format!("{seconds}: it must be 0 or at least 0.1 s")),
        })
        .read_only()
        .value();
    WriterOptions {
        // Any other text has been refused by the declaration.
        compression: choice::find(&COMPRESSIONS, &compression).unwrap_or_default(),
        compression_level: u32::try_from(compression_level).unwrap_or_default(),
        chunk_size,
        max_size: (max_size > 0).then_some(max_size),
        max_duration: (max_duration > 0.0).then(|| Duration::from_secs_f64(max_duration)),
    }
}

// Ranges have refused what is negative.
fn unsigned(declaration: Declaration<'_, i64>) -> u64 {
    u64::try_from(declaration.value()).unwrap_or_default()
}
