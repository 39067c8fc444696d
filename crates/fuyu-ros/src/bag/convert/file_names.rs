//! Names of the files that tables are written to: one per topic, whatever characters the topic's name contains.

use std::collections::BTreeSet;
use std::fmt::Write;

/// Longest name before the extension \[bytes\]; file systems allow 255.
const LONGEST: usize = 200;

/// The names without extension of the files for `topics`, in their order, all different.
///
/// `/chaser/joint_states` becomes `chaser__joint_states`: names of ROS never contain two consecutive underscores. Other
/// writers are less strict. Characters that ROS does not allow are written as `%` and two hexadecimal digits, long names are
/// cut, and of several topics with the same result all but the first get a number behind `~`.
pub(super) fn of<'a>(topics: impl Iterator<Item = &'a String>) -> Vec<String> {
    let mut taken = BTreeSet::new();
    topics
        .map(|topic| {
            let plain = encoded(topic);
            let mut name = plain.clone();
            let mut number = 2;
            while !taken.insert(name.clone()) {
                name = format!("{plain}~{number}");
                number += 1;
            }
            name
        })
        .collect()
}

fn encoded(topic: &str) -> String {
    let mut name = String::new();
    for byte in topic.trim_start_matches('/').bytes() {
        match byte {
            b'/' => name.push_str("__"),
            b'_' | b'0'..=b'9' | b'a'..=b'z' | b'A'..=b'Z' => name.push(byte.into()),
            _ => {
                // Writing to a string cannot fail.
                let _ = write!(name, "%{byte:02X}");
            }
        }
        if name.len() > LONGEST {
            break;
        }
    }
    name.truncate(LONGEST);
    match name.is_empty() {
        true => "topic".to_owned(),
        false => name,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(topics: &[&str]) -> Vec<String> {
        let topics: Vec<_> = topics.iter().map(|t| (*t).to_owned()).collect();
        of(topics.iter())
    }

    #[test]
    fn every_topic_has_a_valid_file_of_its_own() {
        assert_eq!(
            names(&["/chaser/joint_states", "/a/b", "/a__b", "a/b", "/"]),
            ["chaser__joint_states", "a__b", "a__b~2", "a__b~3", "topic"]
        );
        assert_eq!(
            names(&["/..", "/a\0b", "/é"]),
            ["%2E%2E", "a%00b", "%C3%A9"]
        );
        let long = "x".repeat(70_000);
        let two = names(&[&long, &format!("{long}y")]);
        assert!(two.iter().all(|n| n.len() < 210) && two[0] != two[1]);
    }
}
