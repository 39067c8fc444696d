//! Eight robots on one computer, with one router.

use fuyu::{
    msg::sensor_msgs::JointState,
    ros::{Node, NodeError, Qos, Time},
};
use std::time::Duration;

use super::network::Transport;
use crate::{
    binaries::binary,
    child::{Running, executable},
    namespace::Namespace,
    robots,
};

const DOMAIN: u16 = 215;

/// A node that says of each robot when it has heard 20 commands that answer a state.
pub fn listen(node: &Node) -> Result<(), NodeError> {
    let subscribe = |robot: usize, topic: &str| {
        let topic = format!("/robot{robot}/{topic}");
        node.subscribe::<JointState>(&topic, Qos::RELIABLE.depth(100))
    };
    let mut robots = Vec::new();
    for robot in 1..=robots::ROBOTS {
        let (states, commands) = (
            subscribe(robot, "joint_states")?,
            subscribe(robot, "joint_commands")?,
        );
        robots.push((robot, states, commands, Vec::new(), 0));
    }
    while node.wait_for(Duration::from_millis(20)) {
        for (robot, states, commands, stamps, answers) in &mut robots {
            while let Some(state) = states.take() {
                stamps.push(Time::from(state.message.header.stamp));
            }
            while let Some(command) = commands.take() {
                let stamp = Time::from(command.message.header.stamp);
                *answers += usize::from(stamps.contains(&stamp));
                if *answers == 20 {
                    tracing::info!("hears robot {robot}.");
                }
            }
        }
    }
    Ok(())
}

// Fails when one robot answers another's states, or when processes of one computer do not all find each other.
#[test]
fn eight_robots_share_a_router() {
    let Some(namespace) = Namespace::new("zeight") else {
        return;
    };
    let _router = Transport::Zenoh.router(&namespace, DOMAIN, &[]);
    let folder = tempfile::tempdir().expect("a folder");
    let config = robots::config(folder.path());
    let robots = (1..=robots::ROBOTS).map(|robot| {
        let mut command = Transport::Zenoh.command(&namespace, binary("fuyu"));
        command
            .args(["launch", &config, "--ros-args", "-r"])
            .arg(format!("__ns:=/robot{robot}"))
            .args(robots::OWN_TOPICS)
            .current_dir(folder.path())
            .stdout(std::process::Stdio::null());
        Running::start(command, DOMAIN)
    });
    let robots: Vec<_> = robots.collect();
    for robot in &robots {
        robot.says("tip error");
    }
    let command = Transport::Zenoh.command(&namespace, executable());
    let newcomer = Running::program(command, "listen", DOMAIN, &[]);
    for robot in 1..=robots::ROBOTS {
        newcomer.says(&format!("hears robot {robot}."));
    }
    for robot in robots {
        robot.interrupt();
    }
}
