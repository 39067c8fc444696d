//! Parameters of the recorder node. Those that `ros2 bag record` has, too, have the same names.

use std::{path::PathBuf, time::Duration};

use regex::Regex;

use super::{super::choice, folders::RecordFolders, selection::Selection};
use crate::{
    bag::{Compression, QUEUE_BYTES, WriterOptions},
    ros::{Declare, params::Declaration},
};

/// Parameters of the recorder node.
#[derive(Debug, Clone)]
pub struct RecorderParams {
    /// Output folder, which must not exist; `None` for a new folder in `bags/`.
    pub bag: Option<PathBuf>,
    /// Topics to record.
    pub selection: Selection,
    /// Options of the writer.
    pub options: WriterOptions,
    /// Queue capacity in bytes before messages are dropped.
    pub queue: usize,
    /// Whether recording starts paused.
    pub start_paused: bool,
    /// Folders in which other nodes may request bags.
    pub folders: RecordFolders,
}

const COMPRESSIONS: [(&str, Compression); 3] = [
    ("zstd", Compression::Zstd),
    ("lz4", Compression::Lz4),
    ("none", Compression::None),
];

/// Smallest allowed `max_bagfile_size` \[bytes\].
const SMALLEST_FILE: i64 = 10_000;

impl RecorderParams {
    /// Declares and reads the parameters. The caller calls `finish` of `declare`.
    pub fn declare(declare: &mut Declare) -> Self {
        let bag = declare
            .param(
                "bag",
                "",
                "Folder of the bag, which must not exist; empty: bags/ and the time",
            )
            .read_only()
            .value();
        let selection = declare_selection(declare);
        let options = declare_options(declare);
        let queue = declare
            .param(
                "max_cache_size",
                QUEUE_BYTES as i64,
                "Data that may wait for the disk before messages are dropped [bytes]",
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
        let folders = declare
            .param(
                "record_folders",
                vec!["bags".to_owned()],
                "Folders below which the service record may create bags",
            )
            .read_only()
            .value();
        Self {
            folders: RecordFolders::new(folders),
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
        "Topics to record; without topics and regex, all, or those of its robot if the recorder is in a namespace",
    );
    let exclude_topics = names(declare, "exclude_topics", "Topics not to record");
    let all = declare
        .param(
            "all",
            false,
            "Record all topics, of other robots as well, in addition to those named",
        )
        .read_only()
        .value();
    let regex = expression(
        declare,
        "regex",
        "Also record topics whose full name it matches (in part)",
    );
    let exclude_regex = expression(
        declare,
        "exclude_regex",
        "Do not record topics whose full name it matches (in part)",
    );
    Selection {
        all,
        topics,
        regex,
        exclude_topics,
        exclude_regex,
        own_robot: None,
    }
}

/// A regular expression; an empty string means none.
fn expression(declare: &mut Declare, name: &str, description: &str) -> Option<Regex> {
    let text = declare
        .param(name, "", description)
        .check("a regular expression", |text: &String| {
            compile(text).map(|_| ())
        })
        .read_only()
        .value();
    // An invalid expression has been rejected by the declaration.
    compile(&text).ok().flatten()
}

fn compile(text: &str) -> Result<Option<Regex>, String> {
    if text.is_empty() {
        return Ok(None);
    }
    Regex::new(text).map(Some).map_err(|e| {
        // The last line of the error has the reason; earlier lines mark the position.
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
        "Compression level: 1 to 22 for zstd, 1 to 12 for lz4, 0: default",
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
            "Size at which a new file is started, to within a chunk [bytes]; 0: never",
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
            "Recorded time after which a new file is started [s]; 0: never",
        )
        .range(0.0, 1e9)
        .check("0 or at least 0.1", |&seconds| match seconds {
            0.0 | 0.1.. => Ok(()),
            _ => Err(format!("{seconds}: it must be 0 or at least 0.1 s")),
        })
        .read_only()
        .value();
    WriterOptions {
        // Any other text has been rejected by the declaration.
        compression: choice::find(&COMPRESSIONS, &compression).unwrap_or_default(),
        compression_level: u32::try_from(compression_level).unwrap_or_default(),
        chunk_size,
        max_size: (max_size > 0).then_some(max_size),
        max_duration: (max_duration > 0.0).then(|| Duration::from_secs_f64(max_duration)),
    }
}

// The declared ranges exclude negative values.
fn unsigned(declaration: Declaration<'_, i64>) -> u64 {
    u64::try_from(declaration.value()).unwrap_or_default()
}
