//! Log messages about received samples that are not valid messages of the topic's type.

use std::collections::HashMap;

use super::{Gid, NodeName, discovery, endpoint::EndpointSpec, graph_cache::GraphCache};

/// Largest number of publishers that are counted individually; all further ones share one count.
const PUBLISHERS: usize = 64;

/// Counts the invalid samples of a subscription. For each publisher, the first, the tenth, the hundredth ... are
/// logged.
#[derive(Debug, Default)]
pub(super) struct InvalidSamples {
    counts: HashMap<Option<Gid>, u64>,
}

impl InvalidSamples {
    /// Counts a sample and logs it if its number is due. `publisher` is `None` if unknown.
    pub(super) fn report(
        &mut self,
        (node, graph): (&NodeName, &GraphCache),
        spec: &EndpointSpec,
        publisher: Option<Gid>,
        problem: &str,
    ) {
        if let Some(count) = self.count(publisher) {
            let so_far = if count > 1 {
                format!("; {count} so far")
            } else {
                String::new()
            };
            tracing::warn!(
                "node {node}: topic {}: a sample from {} is ignored: {problem}{so_far}",
                spec.name,
                owner(graph, publisher)
            );
        }
    }

    /// The new count if it is to be logged, otherwise `None`.
    fn count(&mut self, publisher: Option<Gid>) -> Option<u64> {
        let is_known = self.counts.contains_key(&publisher) || self.counts.len() < PUBLISHERS;
        let count = self
            .counts
            .entry(publisher.filter(|_| is_known))
            .or_default();
        *count += 1;
        let is_power_of_ten = 10_u64.pow(count.ilog10()) == *count;
        is_power_of_ten.then_some(*count)
    }
}

/// Log text for a sample that is not a message of the type of `spec`.
pub(super) fn not_of_type(spec: &EndpointSpec, bytes: usize) -> String {
    let type_name = discovery::ros_type(&spec.dds_type);
    let type_name = type_name.as_deref().unwrap_or(&spec.dds_type);
    format!("its {bytes} bytes are not a {type_name}")
}

fn owner(graph: &GraphCache, publisher: Option<Gid>) -> String {
    let Some(publisher) = publisher else {
        return "an unknown publisher".to_owned();
    };
    let gid: String = publisher
        .to_bytes16()
        .iter()
        .map(|b| format!("{b:02x}"))
        .collect();
    match graph.node_of(publisher) {
        Some(name) => format!("node {name} (publisher {gid})"),
        None => format!("publisher {gid}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Fails if a flood of invalid samples fills the log, or forged GUIDs fill the memory.
    #[test]
    fn a_flood_is_logged_a_few_times() {
        let mut invalid = InvalidSamples::default();
        let one = Some(Gid::from([1; 16]));
        let logged: Vec<_> = (0..2500).filter_map(|_| invalid.count(one)).collect();
        assert_eq!(logged, [1, 10, 100, 1000]);
        assert_eq!(invalid.count(Some([2; 16].into())), Some(1));
        for number in 0..1000_u64 {
            let mut gid = [3; 16];
            gid[..8].copy_from_slice(&number.to_le_bytes());
            invalid.count(Some(gid.into()));
        }
        assert_eq!(invalid.counts.len(), PUBLISHERS + 1);
    }
}
