//! Bags: recordings in the layout of rosbag2, a folder with `metadata.yaml` and MCAP files.
//!
//! | | |
//! | --- | --- |
//! | [`Writer`] | writes a bag on the caller's thread; the same calls give the same file |
//! | [`Recorder`] | a [`Writer`] on a separate thread, behind a bounded queue, for live topics |
//! | [`convert()`] | writes a bag as CSV or Parquet tables |
//! | [`recover()`] | writes an intact bag from a damaged one |
//! | [`Bag`] | reads a bag by fuyu or rosbag2, also a truncated one |
//!
//! This module does not interpret messages.
//!
//! ```
//! use fuyu_ros::bag::{Bag, Topic, Writer, WriterOptions};
//! use fuyu_ros::msg::std_msgs::Float64;
//! use fuyu_ros::ros::Qos;
//!
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("run");
//! let mut writer = Writer::create(&path, WriterOptions::default())?;
//! let height = writer.add_topic(Topic::of::<Float64>("/height", Qos::RELIABLE))?;
//! for i in 0..100 {
//!     writer.write_message(height, i * 10_000_000, &Float64 { data: 0.1 * i as f64 })?;
//! }
//! writer.finish()?;
//!
//! let bag = Bag::open(&path)?;
//! let heights = bag.read::<Float64>("/height")?;
//! assert_eq!(heights.len(), 100);
//! assert_eq!(bag.info()?.duration_ns(), 990_000_000);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod convert;
mod disk_space;
mod error;
mod info;
mod limits;
mod mcap_file;
mod metadata;
mod part;
mod qos;
mod reader;
mod recorder;
mod recover;
mod writer;

pub use convert::{Conversion, ELEMENTS, MOST_COLUMNS, Table, TableFormat, convert};
pub use error::BagError;
pub use info::{Info, TopicSummary};
pub use mcap_file::Damage;
pub use qos::{Durability, History, Liveliness, Qos, QosDuration, Reliability};
pub use reader::{Bag, Message, Messages, RecordedTopic, Stamped};
pub use recorder::{
    BATCHING_DELAY, QUEUE_BYTES, Recorder, RecorderHandle, RecorderStatus, RecorderTopic,
};
pub use recover::{Recovery, recover};
pub use writer::{Compression, Recording, Topic, TopicId, Writer, WriterOptions};
