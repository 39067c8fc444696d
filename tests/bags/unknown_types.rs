//! Recording of types that fuyu does not know.

use fuyu::bag::Bag;
use serde_json::json;

use crate::peer::Peer;
use crate::services::Recorder;
use crate::waiting::{PATIENCE, eventually};

// From rosidl's generator, in the wheel of std_msgs.
const CHAR: &str = "RIHS01_3ad2d04dd29ba19d04b16659afa3ccaedd691914b02a64e82e252f2fa6a586a9";

// Fails when the recorder loses the type hash that the publisher announces.
#[test]
fn a_type_that_only_its_publisher_knows_is_recorded_with_its_hash() {
    assert!(fuyu::msg::find("std_msgs/msg/Char").is_none());
    let domain = 6;
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    let mut peer = Peer::start("publisher", domain);
    let _recorder = Recorder::start(domain, &bag, &["topics:=[/letter]"]);
    peer.does(json!({
        "do": "publish", "topic": "letter", "type": "std_msgs/msg/Char", "message": {"data": 102}
    }));
    let letter = eventually("the letter is in the bag", PATIENCE, || {
        let info = Bag::open(&bag).ok()?.info().ok()?;
        let mut topics = info.topics.into_iter();
        topics.find(|topic| topic.name == "/letter" && topic.count == 1)
    });
    assert_eq!(letter.type_name, "std_msgs/msg/Char");
    assert_eq!(letter.type_hash.as_deref(), Some(CHAR));
}
