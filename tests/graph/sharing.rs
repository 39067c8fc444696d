//! Nodes of one process share a DDS participant: what other participants see of them, and what they get from each other.

use fuyu::{
    msg::{
        std_msgs::String as Text,
        std_srvs::{Trigger, TriggerResponse},
    },
    ros::{
        DiscoveryRange, Domain, Node, NodeError, Process, Publisher, Qos, RosArgs, Subscription,
    },
};
use ros2_client::Gid;
use rustdds::{QosPolicies, QosPolicyBuilder, TopicKind, policy};
use serde::Deserialize;
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::mpsc,
    thread,
    time::{Duration, Instant},
};

use crate::{
    peer::DomainClaim,
    waiting::{PATIENCE, eventually},
};

fn process(domain: u16) -> Process {
    let range = DiscoveryRange::Localhost;
    Process::new(RosArgs::default(), Domain { id: domain, range })
}

fn text(data: impl ToString) -> Text {
    Text {
        data: data.to_string(),
    }
}

fn idle(node: &Node) -> Result<(), NodeError> {
    while node.wait() {}
    Ok(())
}

/// `rmw_dds_common/ParticipantEntitiesInfo`.
#[derive(Debug, Clone, Deserialize)]
struct Announcement {
    gid: Gid,
    nodes: Vec<AnnouncedNode>,
}

#[derive(Debug, Clone, Deserialize)]
struct AnnouncedNode {
    #[expect(dead_code, reason = "precedes the fields that are read")]
    namespace: String,
    name: String,
    readers: Vec<Gid>,
    writers: Vec<Gid>,
}

/// A participant of rustdds alone, with the newest announcement of each other participant.
struct Onlooker {
    participant: rustdds::DomainParticipant,
    reader: rustdds::no_key::DataReaderCdr<Announcement>,
    newest: BTreeMap<[u8; 16], Announcement>,
}

impl Onlooker {
    fn new(domain: u16) -> Self {
        let participant = rustdds::DomainParticipantBuilder::new(domain)
            .with_only_networks([std::net::Ipv4Addr::LOCALHOST])
            .build()
            .unwrap();
        let qos: QosPolicies = QosPolicyBuilder::new()
            .reliability(policy::Reliability::Reliable {
                max_blocking_time: rustdds::Duration::ZERO,
            })
            .durability(policy::Durability::TransientLocal)
            .history(policy::History::KeepLast { depth: 100 })
            .build();
        let kind = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";
        let topic = participant
            .create_topic(
                "ros_discovery_info".into(),
                kind.into(),
                &qos,
                TopicKind::NoKey,
            )
            .unwrap();
        let subscriber = participant.create_subscriber(&qos).unwrap();
        let reader = subscriber
            .create_datareader_no_key_cdr(&topic, Some(qos))
            .unwrap();
        Self {
            participant,
            reader,
            newest: BTreeMap::new(),
        }
    }

    fn announcements(&mut self) -> Vec<Announcement> {
        while let Ok(Some(sample)) = self.reader.take_next_sample() {
            let announcement = sample.into_value();
            self.newest
                .insert(announcement.gid.to_bytes16(), announcement);
        }
        self.newest.values().cloned().collect()
    }

    /// Names of the nodes by participant, when they are as many as expected.
    fn nodes(&mut self, participants: usize, nodes: usize) -> Vec<Announcement> {
        eventually("all nodes are announced", PATIENCE, || {
            let all = self.announcements();
            let count: usize = all.iter().map(|a| a.nodes.len()).sum();
            (all.len() == participants && count == nodes).then_some(all)
        })
    }

    /// GIDs of the publishers of a DDS topic.
    fn publishers(&self, topic: &str) -> BTreeSet<[u8; 16]> {
        let all = self.participant.discovered_writers().into_iter();
        all.filter(|w| w.publication_topic_data.topic_name == topic)
            .map(|w| Gid::from(w.publication_topic_data.key).to_bytes16())
            .collect()
    }
}

// Fails if a node is missing, or if one has the endpoints of another.
#[test]
fn one_participant_announces_all_nodes_of_a_process() {
    let domain = 30;
    let _claim = DomainClaim::new(domain);
    let mut process = process(domain);
    for name in ["alpha", "beta", "gamma"] {
        process
            .start(name, move |node: &Node| {
                let _said = node.advertise::<Text>(&format!("said_by_{name}"), Qos::RELIABLE)?;
                idle(node)
            })
            .unwrap();
    }
    let mut onlooker = Onlooker::new(domain);
    eventually("each node has its publisher", PATIENCE, || {
        let all = onlooker.nodes(1, 3);
        let own = |node: &AnnouncedNode| {
            let topic = format!("rt/said_by_{}", node.name);
            let publishers = onlooker.publishers(&topic);
            let announced: Vec<_> = node.writers.iter().map(|gid| gid.to_bytes16()).collect();
            let other_nodes = all[0].nodes.iter().filter(|other| other.name != node.name);
            let others: Vec<_> = other_nodes
                .flat_map(|n| n.writers.iter().map(|gid| gid.to_bytes16()))
                .collect();
            publishers.len() == 1
                && publishers.iter().all(|gid| announced.contains(gid))
                && !publishers.iter().any(|gid| others.contains(gid))
                // The six parameter services.
                && node.readers.len() >= 6
        };
        all[0].nodes.iter().all(own).then_some(())
    });
    // Logs and parameter events name their node, so one publisher is enough for all.
    for shared in ["rt/rosout", "rt/parameter_events"] {
        assert_eq!(onlooker.publishers(shared).len(), 1, "{shared}");
    }
    assert_eq!(onlooker.publishers("rt/diagnostics").len(), 3);
    process.finish().unwrap();
    // It leaves in order: others need not wait until its lease expires.
    eventually("the participant has left", Duration::from_secs(5), || {
        onlooker.publishers("rt/rosout").is_empty().then_some(())
    });
}

#[test]
fn isolated_nodes_have_a_participant_each() {
    let domain = 31;
    let _claim = DomainClaim::new(domain);
    let mut process = process(domain).isolated();
    process.start("alpha", idle).unwrap();
    process.start("beta", idle).unwrap();
    let all = Onlooker::new(domain).nodes(2, 2);
    assert!(all.iter().all(|participant| participant.nodes.len() == 1));
    process.finish().unwrap();
}

/// Subscribes to what is latched, as `depth` samples, and reports what it gets.
fn listen_to_latched(process: &mut Process, name: &str, depth: usize) -> mpsc::Receiver<String> {
    let (say, heard) = mpsc::channel();
    let program = move |node: &Node| {
        let latched: Subscription<Text> = node.subscribe("latched", Qos::LATCHED.depth(depth))?;
        node.set_ready();
        while node.wait() {
            while let Some(received) = latched.take() {
                let _ = say.send(received.message.data);
            }
        }
        Ok(())
    };
    let node = process.start(name, program).unwrap();
    eventually("it listens", PATIENCE, || node.is_ready().then_some(()));
    heard
}

// Fails if a late subscription does not get what a publisher of another process keeps, because an earlier one of its process
// shares its DDS reader; if it gets it twice; or if it gets what a publisher kept that has left.
#[test]
fn a_late_latched_subscription_gets_what_its_process_has_received() {
    let domain = 17;
    let _claim = DomainClaim::new(domain);
    let (mut here, mut there) = (process(domain), process(domain));
    let (leave, left) = mpsc::channel::<()>();
    let program = move |node: &Node| {
        let latched: Publisher<Text> = node.advertise("latched", Qos::LATCHED.depth(2))?;
        for number in 1..=3 {
            latched.publish(&text(number));
        }
        while left.try_recv().is_err() && node.wait_for(Duration::from_millis(10)) {}
        Ok(())
    };
    there.start("talker", program).unwrap();
    let next = |heard: &mpsc::Receiver<String>| heard.recv_timeout(PATIENCE).expect("a sample");
    let first = listen_to_latched(&mut here, "first", 2);
    // It may have been there before the first message.
    while next(&first) != "3" {}
    let late = listen_to_latched(&mut here, "late", 2);
    assert_eq!([next(&late), next(&late)], ["2", "3"]);
    // The depth of a subscription limits what it gets.
    let short = listen_to_latched(&mut here, "short", 1);
    assert_eq!(next(&short), "3");
    leave.send(()).unwrap();
    there.finish().unwrap();
    eventually("its publisher has left", PATIENCE, || {
        let onlooker = Onlooker::new(domain);
        onlooker.publishers("rt/latched").is_empty().then_some(())
    });
    thread::sleep(Duration::from_millis(500));
    let after = listen_to_latched(&mut here, "after", 2);
    for heard in [first, late, short, after] {
        let more = heard.recv_timeout(Duration::from_millis(200));
        assert!(more.is_err(), "{more:?}");
    }
    here.finish().unwrap();
}

/// Publishes numbers until all listeners have answered that they have enough.
fn talk(node: &Node, name: &str) -> Result<(), NodeError> {
    let say: Publisher<Text> = node.advertise("say", Qos::RELIABLE)?;
    let mut number = 0;
    while node.wait_for(Duration::from_millis(2)) {
        number += 1;
        say.publish(&text(format!("{name} {number}")));
    }
    Ok(())
}

/// Reports what it gets.
fn listen(node: &Node, heard: &mpsc::Sender<(String, u32)>) -> Result<(), NodeError> {
    let said: Subscription<Text> = node.subscribe("say", Qos::RELIABLE.depth(1000))?;
    node.set_ready();
    while node.wait() {
        while let Some(received) = said.take() {
            let (name, number) = received.message.data.split_once(' ').expect("two words");
            let number = number.parse().expect("a number");
            let _ = heard.send((name.to_owned(), number));
        }
    }
    Ok(())
}

// Fails if a message arrives both in memory and over DDS, if one is lost, or if one of the ways is missing.
#[test]
fn each_message_arrives_once_in_the_process_and_outside() {
    let domain = 32;
    let _claim = DomainClaim::new(domain);
    let (mut here, mut there) = (process(domain), process(domain));
    let mut ears = Vec::new();
    for (process, name) in [(&mut here, "here"), (&mut there, "there")] {
        let (heard, ear) = mpsc::channel();
        ears.push(ear);
        let listener = format!("listener_{name}");
        let listener = process
            .start(&listener, move |node: &Node| listen(node, &heard))
            .unwrap();
        eventually("it listens", PATIENCE, || listener.is_ready().then_some(()));
        process
            .start(&format!("talker_{name}"), move |node: &Node| {
                talk(node, name)
            })
            .unwrap();
    }
    let deadline = Instant::now() + PATIENCE;
    for (ear, own) in ears.iter().zip(["here", "there"]) {
        let mut heard: BTreeMap<String, Vec<u32>> = BTreeMap::new();
        while ["here", "there"].iter().any(|name| {
            let enough = |numbers: &Vec<u32>| numbers.len() >= 500;
            !heard.get(*name).is_some_and(enough)
        }) {
            assert!(Instant::now() < deadline, "{own} hears too little");
            let (name, number) = ear.recv_timeout(PATIENCE).unwrap();
            heard.entry(name).or_default().push(number);
        }
        for (name, numbers) in heard {
            let gaps = numbers.windows(2).filter(|w| w[1] != w[0] + 1).count();
            assert_eq!(gaps, 0, "{own} hears {name}: {:?}...", &numbers[..20]);
            if name == own {
                assert_eq!(numbers[0], 1, "the first message of its own process");
            }
        }
    }
    here.finish().unwrap();
    there.finish().unwrap();
}

// Fails if requests or replies within a process take the way over the network, where a long reply is lost.
#[test]
fn services_answer_within_a_process() {
    let domain = 36;
    let _claim = DomainClaim::new(domain);
    let mut process = process(domain);
    process
        .start("server", |node: &Node| {
            let _server = node.serve::<Trigger>("/long", |_| TriggerResponse {
                success: true,
                message: "x".repeat(200_000),
            })?;
            idle(node)
        })
        .unwrap();
    let (answered, answer) = mpsc::channel();
    process
        .start("client", move |node: &Node| {
            let client = node.client::<Trigger>("/long")?;
            let mut slowest = Duration::ZERO;
            for _ in 0..100 {
                let start = Instant::now();
                let response = client.call(&Default::default(), PATIENCE)?;
                assert_eq!(response.message.len(), 200_000);
                slowest = slowest.max(start.elapsed());
            }
            let _ = answered.send(slowest);
            idle(node)
        })
        .unwrap();
    let slowest = answer.recv_timeout(PATIENCE).unwrap();
    println!("slowest of 100 calls: {slowest:?}");
    assert!(process.run_for(Duration::ZERO), "no node has failed");
    process.finish().unwrap();
}

// Fails if the graph that a node asks for lacks the nodes of its own process.
#[test]
fn a_node_finds_the_publishers_of_its_process() {
    let domain = 34;
    let _claim = DomainClaim::new(domain);
    let mut process = process(domain);
    let (found, find) = mpsc::channel();
    process
        .start("looker", move |node: &Node| {
            let said: Subscription<Text> = node.subscribe("say", Qos::RELIABLE)?;
            while node.wait_for(Duration::from_millis(10)) {
                let Some(received) = said.take() else {
                    continue;
                };
                let publisher = received.publisher;
                assert!(said.is_matched(publisher));
                let mut all = node.discovered_publishers().into_iter();
                let listed = all.any(|p| p.topic == "/say" && p.gid == publisher);
                let _ = found.send((listed, node.owner_of(publisher)));
            }
            Ok(())
        })
        .unwrap();
    process
        .start("sayer", |node: &Node| talk(node, "sayer"))
        .unwrap();
    let found = find.recv_timeout(PATIENCE).unwrap();
    assert_eq!(found, (true, "node /sayer".to_owned()));
    process.finish().unwrap();
}

// Fails if the first message is published before those who watch for publishers have subscribed.
#[test]
fn who_watches_for_publishers_gets_their_first_message() {
    let domain = 35;
    let _claim = DomainClaim::new(domain);
    let mut process = process(domain);
    let (heard, ear) = mpsc::channel();
    let watcher = process
        .start("watcher", move |node: &Node| {
            let subscriptions = std::sync::Mutex::new(Vec::new());
            let (watching, heard) = (node.clone(), heard.clone());
            node.watch_local_topics(move |new| {
                if new.topic.starts_with("/new_") && new.is_published {
                    let heard = heard.clone();
                    let take = move |_| {
                        let _ = heard.send(());
                    };
                    let (topic, kind) = (new.topic.clone(), &new.type_name);
                    let subscription =
                        watching.subscribe_resolved(topic, kind, Qos::RELIABLE, take);
                    subscriptions.lock().unwrap().push(subscription);
                }
            });
            node.set_ready();
            idle(node)
        })
        .unwrap();
    eventually("the watcher is ready", PATIENCE, || {
        watcher.is_ready().then_some(())
    });
    process
        .start("speaker", |node: &Node| {
            for n in 0..20 {
                let new = node.advertise::<Text>(&format!("new_{n}"), Qos::RELIABLE)?;
                new.publish(&text(n));
            }
            idle(node)
        })
        .unwrap();
    for _ in 0..20 {
        ear.recv_timeout(PATIENCE).unwrap();
    }
    process.finish().unwrap();
    assert!(ear.try_recv().is_err(), "each once");
}
