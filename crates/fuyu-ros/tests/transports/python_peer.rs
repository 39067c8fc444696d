//! An independent implementation: a Python program on Zenoh's Python client, which follows the design document of
//! rmw_zenoh.

use fuyu_ros::{msg::std_msgs, ros::Qos};
use std::{
    io::{BufRead, BufReader},
    path::Path,
    process::{Child, ChildStdout, Command, Stdio},
};

use crate::{
    messages::{AddTwoInts, AddTwoIntsRequest, AddTwoIntsResponse},
    router::{PATIENCE, Router, eventually, idle},
};

#[path = "../../../../tests/support/python.rs"]
#[expect(dead_code, reason = "tests of other packages use all of it")]
mod python;

const DOMAIN: u16 = 2;
const STRING: &str = "std_msgs::msg::dds_::String_/RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";
const SUM: &str = "example_interfaces::srv::dds_::AddTwoInts_/RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a";

/// The program; ends when dropped.
struct Peer {
    child: Child,
    output: BufReader<ChildStdout>,
}

impl Peer {
    fn start(endpoint: &str) -> Self {
        let packages = ["zenoh", "eclipse-zenoh==1.10.2", "xxhash==4.1.0"];
        let python = python::environment("test-venv.sh", &packages);
        let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/transports/peer.py");
        let mut child = Command::new(python)
            .arg(program)
            .arg(endpoint)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("Python runs");
        let output = child.stdout.take().expect("its output is piped");
        Self {
            child,
            output: BufReader::new(output),
        }
    }

    /// The next line.
    fn says(&mut self) -> String {
        let mut line = String::new();
        self.output
            .read_line(&mut line)
            .expect("its output is read");
        assert!(!line.is_empty(), "the peer has ended, see above");
        line.trim().to_owned()
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        drop(self.child.stdin.take());
        let _ = self.child.wait();
    }
}

// Fails if anything on the wire differs from the design document: keys, tokens, attachments, GIDs, CDR, caches,
// queries.
#[test]
fn an_independent_peer_understands_everything() {
    let router = Router::start();
    let mut process = router.process(DOMAIN);
    let node = process.start("fuyu", idle).expect("it starts");
    let said = node.advertise::<std_msgs::String>("chatter", Qos::RELIABLE.depth(7));
    let said = said.expect("it publishes");
    let latched = node.advertise::<std_msgs::String>("description", Qos::LATCHED);
    let latched = latched.expect("it publishes");
    for data in ["old", "new"] {
        latched.publish(&std_msgs::String { data: data.into() });
    }
    let _sum = node
        .serve::<AddTwoInts>("add_two_ints", |r| AddTwoIntsResponse { sum: r.a + r.b })
        .expect("it serves");
    let sums = node.client::<AddTwoInts>("python_sum").expect("a client");
    let heard = node.subscribe::<std_msgs::String>("from_python", Qos::RELIABLE);
    let heard = heard.expect("it subscribes");

    let mut peer = Peer::start(&router.endpoint());
    assert_eq!(peer.says(), r#"{"ready": true}"#);
    assert!(sums.wait_for_service(PATIENCE));
    let late = node.subscribe::<std_msgs::String>("python_description", Qos::LATCHED);
    let late = late.expect("it subscribes").wait_next(PATIENCE);
    assert_eq!(late.expect("it arrives").message.data, "description 3");
    for i in 1..=3 {
        let data = format!("hello {i}");
        said.publish(&std_msgs::String { data });
    }
    let chatter = peer.says();
    let expected = r#"{"heard": ["hello 1", "hello 2", "hello 3"], "numbers": [1, 2, 3], "gids_are_those_of_the_token": true"#;
    assert!(chatter.starts_with(expected), "{chatter}");
    for token in [
        "/NN/%/%/fuyu\"".to_owned(),
        format!("/MP/%/%/fuyu/%chatter/{STRING}/::,7:,:,:,,\""),
        format!("/MP/%/%/fuyu/%description/{STRING}/:1:,1:,:,:,,\""),
        format!("/MS/%/%/fuyu/%from_python/{STRING}/::,10:,:,:,,\""),
        format!("/SS/%/%/fuyu/%add_two_ints/{SUM}/::,10:,:,:,,\""),
        format!("/SC/%/%/fuyu/%python_sum/{SUM}/::,10:,:,:,,\""),
    ] {
        assert!(chatter.contains(&token), "no {token} in {chatter}");
    }
    assert_eq!(peer.says(), r#"{"description": ["new"]}"#);
    assert_eq!(peer.says(), r#"{"sums": [[1, 41], [2, 42], [3, 43]]}"#);

    let message = heard.wait_next(PATIENCE).expect("it arrives");
    assert!(message.message.data.starts_with("message "));
    assert!(message.source_time.is_some());
    assert_eq!(node.node_of(message.publisher).as_deref(), Some("/python"));
    assert!(heard.is_matched(message.publisher));
    for a in 0..5 {
        let reply = sums.call(&AddTwoIntsRequest { a, b: 7 }, PATIENCE);
        assert_eq!(reply.expect("it replies").sum, a + 7);
    }
    drop(peer);
    eventually("it has left", || {
        node.discovered_publishers().is_empty() && !sums.is_available()
    });
    process.finish().expect("no failure");
}
