//! A network that loses a fifth of all packets and delays the others by 50 ms.

use serde_json::{Value, json};

use crate::{
    child::{Running, executable},
    peer::{Peer, python},
    waiting::{PATIENCE, eventually},
    wire::Wire,
};

// Fails if a lost datagram is not sent again, or a message arrives twice or out of order.
#[test]
fn reliable_topics_survive_loss_and_delay() {
    let Some(wire) = Wire::new(["near", "far"], 0.2, 0.05) else {
        return;
    };
    let domain = 17;
    let [near, far] = &wire.ends;
    let mut echo = near.command(executable());
    echo.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET");
    let echo = Running::program(echo, "echo", domain, &["--ros-args", "-r", "__node:=echo"]);
    echo.says("echoes");
    let mut command = far.command("env");
    // `env` sets the variable after those that `Peer::start_with` sets.
    command
        .arg("ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET")
        .arg(python());
    let mut peer = Peer::start_with(command, "far", domain);
    let number = "std_msgs/msg/Int64";
    peer.subscribe("retained", "std_msgs/msg/String", "latched");
    peer.subscribe("out/std_msgs/Int64", number, "reliable");
    assert_eq!(
        peer.receive("retained", 1)[0]["message"]["data"],
        "from before"
    );
    let publish = |peer: &mut Peer, value: i64| {
        peer.does(json!({
            "do": "publish", "topic": "in/std_msgs/Int64", "type": number, "message": {"data": value}
        }))
    };
    eventually("the way there and back", 3 * PATIENCE, || {
        publish(&mut peer, -1);
        let wait = json!({"do": "wait", "topic": "out/std_msgs/Int64", "timeout": 2.0});
        let came = peer.does(wait);
        (!came.as_array()?.is_empty()).then_some(())
    });
    for value in 0..200 {
        publish(&mut peer, value);
    }
    let numbers = eventually("all numbers", 3 * PATIENCE, || {
        let wait = json!({"do": "wait", "topic": "out/std_msgs/Int64", "timeout": 1.0});
        let came = peer.does(wait);
        let numbers: Vec<_> = came
            .as_array()?
            .iter()
            .map(|m| m["message"]["data"].clone())
            .collect();
        (numbers.last() == Some(&Value::from(199))).then_some(numbers)
    });
    let numbers: Vec<_> = numbers
        .iter()
        .filter_map(Value::as_i64)
        .filter(|n| *n >= 0)
        .collect();
    assert_eq!(numbers, (0..200).collect::<Vec<_>>());
    assert_eq!(echo.said().matches("ERROR").count(), 0);
    echo.interrupt();
}
