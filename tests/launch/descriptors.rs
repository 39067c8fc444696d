//! File descriptors of a launch, and the first samples in its bag.

use fuyu::{
    msg::{
        fuyu_msgs::Momentum, nav_msgs::Odometry, sensor_msgs::JointState, std_msgs::String as Text,
    },
    ros::{DiscoveryRange, Domain, Node, Process, Qos, RosArgs, Time},
};
use std::{fs, path::Path, process::Command, time::Duration};

use crate::{
    binaries::binary,
    process::{Running, read, source},
    waiting::{PATIENCE, eventually},
};

/// Descriptors that the default graph may have: 598 were measured.
const MOST: usize = 605;

fn descriptors(of: &Running) -> usize {
    let folder = format!("/proc/{}/fd", of.id());
    fs::read_dir(folder).expect("it runs").count()
}

/// `fuyu launch config/servicing.yaml` under a limit of descriptors, as `ulimit` sets it.
fn launch_with_limit(domain: u16, limit: &str, bag: &Path, arguments: &str) -> Running {
    let (fuyu, config) = (binary("fuyu"), source("config/servicing.yaml"));
    let mut command = Command::new("bash");
    command
        .args(["-c", "ulimit $1; shift; exec \"$@\"", "bash", limit])
        .args([fuyu, "launch"])
        .arg(config)
        .args(["--bag".as_ref(), bag.as_os_str()])
        .args(arguments.split_whitespace())
        .env("ROS_DOMAIN_ID", domain.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env_remove("ROS_LOCALHOST_ONLY");
    Running::start(command)
}

fn wait_for_commands(bag: &Path) {
    // The recorder writes what it has at least every second.
    eventually("the run begins", PATIENCE, || {
        let bag = fuyu::bag::Bag::open(bag).ok()?;
        let commands = bag.read::<JointState>("/joint_commands").ok()?;
        (!commands.is_empty()).then_some(())
    });
}

// Fails if a soft limit below what the graph needs ends the launch, although the hard limit would do.
#[test]
fn a_low_soft_limit_is_raised() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    let mut launch = launch_with_limit(37, "-Sn 200", &bag, "--duration 600");
    wait_for_commands(&bag);
    let count = descriptors(&launch);
    println!("{count} descriptors");
    assert!((200..=MOST).contains(&count), "{count} descriptors");
    launch.interrupt().well();
}

#[test]
fn isolated_nodes_have_their_own_participants() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    let mut launch = launch_with_limit(38, "-Sn 200", &bag, "--duration 600 --isolated");
    wait_for_commands(&bag);
    assert!(descriptors(&launch) > MOST);
    launch.interrupt().well();
}

/// Publishes on this many topics that nobody else knows, until it is dropped.
fn foreigner(domain: u16, topics: usize) -> Process {
    let range = DiscoveryRange::Localhost;
    let mut process = Process::new(RosArgs::default(), Domain { id: domain, range });
    process
        .start("foreigner", move |node: &Node| {
            let name = |n| format!("foreign_{n}");
            let all: Result<Vec<_>, _> = (0..topics)
                .map(|n| node.advertise::<Text>(&name(n), Qos::RELIABLE))
                .collect();
            let all = all?;
            while node.wait_for(Duration::from_millis(100)) {
                for topic in &all {
                    topic.publish(&Text::default());
                }
            }
            Ok(())
        })
        .unwrap();
    process
}

// Fails if the recorder ends when it cannot subscribe, or keeps subscriptions to topics that nobody publishes any more.
#[test]
fn a_recorder_without_descriptors_continues_and_releases_what_it_has() {
    let domain = 39;
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    let limit = MOST + 40;
    let mut launch = launch_with_limit(domain, &format!("-n {limit}"), &bag, "--duration 600");
    wait_for_commands(&bag);
    let before = descriptors(&launch);
    let foreigner = foreigner(domain, 60);
    let (_, said) = eventually("a topic is not recorded", PATIENCE, || {
        let said = launch.said();
        said.1.contains(" is not recorded: ").then_some(said)
    });
    assert!(said.contains("ulimit -n"), "{said}");
    eventually("some of the topics are recorded", PATIENCE, || {
        let texts = fuyu::bag::Bag::open(&bag).ok()?;
        let texts = texts.read::<Text>("/foreign_0").ok()?;
        (!texts.is_empty()).then_some(())
    });
    foreigner.finish().unwrap();
    eventually("the descriptors are free again", PATIENCE, || {
        (descriptors(&launch) <= before + 8).then_some(())
    });
    launch.interrupt().well();
    let states = read::<JointState>(&bag, "/joint_states").len();
    assert!(states > 100, "{states} states");
}

// Fails if the recorder subscribes to the topics of targets after their first messages.
#[test]
fn a_bag_has_every_state_from_the_first_one() {
    for round in 0..3 {
        let mut launch =
            Running::launch(46, &source("config/servicing.yaml"), &["--duration", "2"]);
        launch.wait(PATIENCE).well();
        let bag = launch.bag();
        let stamps = |of: Vec<fuyu::msg::std_msgs::Header>| -> Vec<Time> {
            of.into_iter().map(|header| header.stamp.into()).collect()
        };
        let headers = |topic: &str| -> Vec<_> {
            let all = read::<Odometry>(&bag, topic).into_iter();
            stamps(all.map(|m| m.header).collect())
        };
        let states = read::<JointState>(&bag, "/joint_states").into_iter();
        let states = stamps(states.map(|m| m.header).collect());
        let momentum = read::<Momentum>(&bag, "/ground_truth/momentum").into_iter();
        let momentum = stamps(momentum.map(|m| m.header).collect());
        assert_eq!(states[0], Time::ZERO, "round {round}");
        assert!(states.len() > 200, "round {round}: {} states", states.len());
        for (topic, others) in [
            ("odom", headers("/ground_truth/odom")),
            ("target/odom", headers("/ground_truth/target/odom")),
            ("momentum", momentum),
        ] {
            assert!(
                others == states,
                "round {round}: {topic}: {} of {}, from {:?}",
                others.len(),
                states.len(),
                others.first()
            );
        }
    }
}
