//! Check of type hashes (REP-2016), which peers state in the user data of their endpoints as `typehash=RIHS01_...;`.
//! rustdds receives user data but cannot send them.

use rustdds::GUID;
use std::collections::{HashMap, HashSet};

use crate::ros::{NodeName, endpoint::EndpointSpec};

/// Length prefix that rustdds leaves in front of user data (docs/upstream.md) \[bytes\].
const LENGTH: usize = 4;

/// Extracts the type hash from an endpoint's user data.
pub(super) fn hash_in_user_data(user_data: &[u8]) -> Option<String> {
    let text = str::from_utf8(user_data.get(LENGTH..)?).ok()?;
    let hash = (text.split(';')).find_map(|pair| pair.trim().strip_prefix("typehash="))?;
    let digits = hash.strip_prefix("RIHS01_")?;
    let is_hash = digits.len() == 64 && digits.bytes().all(|b| b.is_ascii_hexdigit());
    is_hash.then(|| hash.to_owned())
}

/// Type hashes stated by the endpoints of peers.
#[derive(Default)]
pub(super) struct TypeHashCheck {
    stated: HashMap<GUID, String>,
    /// Topics and hashes for which a warning was logged.
    warned: HashSet<(String, String)>,
}

impl TypeHashCheck {
    pub(super) fn endpoint_discovered(&mut self, endpoint: GUID, user_data: &[u8]) {
        if let Some(hash) = hash_in_user_data(user_data) {
            self.stated.insert(endpoint, hash);
        }
    }

    pub(super) fn remove_endpoints(&mut self, is_lost: impl Fn(&GUID) -> bool) {
        self.stated.retain(|endpoint, _| !is_lost(endpoint));
    }

    /// Warns if a matched endpoint of a peer has a different definition of the type.
    pub(super) fn compare(&mut self, node: &NodeName, spec: &EndpointSpec, peer: GUID) {
        let Some(stated) = self.stated.get(&peer) else {
            return;
        };
        let Some(known) = spec.definition else {
            return;
        };
        let here = known.type_hash();
        if *stated != here && self.warned.insert((spec.name.clone(), stated.clone())) {
            tracing::warn!(
                "node {node}: topic {}: a peer has another definition of {} ({stated}, here {here}): messages may be \
                 misread",
                spec.name,
                known.type_name()
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// User data as received, padded to four bytes.
    fn sequence(text: &str) -> Vec<u8> {
        let mut bytes = u32::try_from(text.len()).unwrap().to_le_bytes().to_vec();
        bytes.extend(text.bytes());
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        bytes
    }

    // Fails if the user data of rmw are not understood, or if other data count as a hash.
    #[test]
    fn a_hash_is_found_among_other_user_data() {
        let hash = format!("RIHS01_{}", "0a".repeat(32));
        for text in [
            format!("typehash={hash};"),
            format!("enclave=/;typehash={hash};"),
        ] {
            assert_eq!(
                hash_in_user_data(&sequence(&text)),
                Some(hash.clone()),
                "{text}"
            );
        }
        for text in [
            "",
            "typehash=;",
            "typehash=RIHS01_00;",
            "typehash=INVALID;",
            "enclave=/;",
        ] {
            assert_eq!(hash_in_user_data(&sequence(text)), None, "{text}");
        }
        assert_eq!(hash_in_user_data(&[]), None);
        assert_eq!(hash_in_user_data(&[2, 0, 0, 0, 0xff, 0xfe]), None);
    }
}
