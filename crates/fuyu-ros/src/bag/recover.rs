//! Recovering the intact messages of a damaged bag.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Serialize;

use super::{Bag, BagError, Damage, TopicId, Writer, WriterOptions};

/// Result of recovering a damaged bag.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Recovery {
    /// The new bag.
    pub path: PathBuf,
    /// Messages in it.
    pub messages: u64,
    /// First and last log time \[ns\].
    pub bounds: Option<(u64, u64)>,
    /// Damage of the old bag; the data there is lost.
    pub damage: Vec<Damage>,
    /// Omitted topics, each with the reason.
    pub left_out: BTreeMap<String, String>,
}

/// Writes all readable messages of `bag` to a new bag in `folder`, with index, summary and `metadata.yaml`. Types,
/// schemas, hashes, QoS and times are unchanged.
///
/// # Errors
/// [`BagError`] if the new bag cannot be written.
pub fn recover(
    bag: &Bag,
    folder: impl Into<PathBuf>,
    options: WriterOptions,
) -> Result<Recovery, BagError> {
    let mut writer = Writer::create(folder, options)?;
    let mut left_out = BTreeMap::new();
    // By name and type: of a topic with two types, the first is kept.
    let mut ids: BTreeMap<(String, String), Option<TopicId>> = BTreeMap::new();
    let mut messages = bag.messages();
    for message in messages.by_ref() {
        let topic = &message.topic;
        let key = (topic.name.clone(), topic.type_name.clone());
        let id = match ids.get(&key) {
            Some(id) => *id,
            None => {
                let id = match writer.add_described((**topic).clone()) {
                    Ok(id) => Some(id),
                    Err(e @ BagError::TopicConflict { .. }) => {
                        left_out.insert(topic.name.clone(), e.to_string());
                        None
                    }
                    Err(e) => return Err(e),
                };
                ids.insert(key, id);
                id
            }
        };
        if let Some(id) = id {
            writer.write_cdr(id, message.log_time, message.publish_time, &message.data)?;
        }
    }
    let silent: Vec<_> = messages.topics().map(|t| (**t).clone()).collect();
    for topic in silent {
        if let Err(e) = writer.add_described(topic)
            && !matches!(e, BagError::TopicConflict { .. })
        {
            return Err(e);
        }
    }
    let damage = messages.damage();
    let recording = writer.finish()?;
    Ok(Recovery {
        path: recording.path,
        messages: recording.messages,
        bounds: recording.bounds,
        damage,
        left_out,
    })
}
