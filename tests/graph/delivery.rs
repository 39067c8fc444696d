//! Reliable topics: every message arrives, once and in order.

use fuyu::{
    msg::std_msgs::String as Text,
    ros::{
        DiscoveryRange, Domain, Node, NodeError, Process, Publisher, Qos, RosArgs, Subscription,
    },
};
use std::{
    sync::mpsc,
    thread,
    time::{Duration, Instant},
};

use crate::waiting::PATIENCE;

/// A process whose nodes exchange messages over DDS, or else in memory.
fn process(domain: u16, over_dds: bool) -> Process {
    let range = DiscoveryRange::Localhost;
    let process = Process::new(RosArgs::default(), Domain { id: domain, range });
    match over_dds {
        true => process.isolated(),
        false => process,
    }
}

fn text(number: usize) -> Text {
    // A message as long as the joint state of a robot with an arm.
    Text {
        data: format!("{number:0700}"),
    }
}

fn number(text: &Text) -> usize {
    text.data.parse().expect("a number")
}

/// Publishes zeros until one is echoed, which shows that the subscriber is connected.
fn meet(
    node: &Node,
    say: &[&Publisher<Text>],
    answers: &Subscription<Text>,
) -> Result<(), NodeError> {
    for _ in 0..600 {
        say.iter().for_each(|p| p.publish(&text(0)));
        if answers.wait_next(Duration::from_millis(100)).is_some() {
            return Ok(());
        }
    }
    Err(NodeError::Failed(format!("{}: no answer", node.name())))
}

const DEEP: Qos = Qos::RELIABLE.depth(10_000);

/// Messages that each wait for an echo, and a second topic without echoes, as in a simulation in lockstep.
fn lockstep(domain: u16, over_dds: bool, steps: usize) {
    let mut process = process(domain, over_dds);
    let (result, results) = mpsc::channel();
    process
        .start("follower", move |node: &Node| {
            let step = node.subscribe::<Text>("step", DEEP)?;
            let other = node.subscribe::<Text>("other", DEEP)?;
            let done = node.advertise::<Text>("done", Qos::RELIABLE)?;
            let (mut stepped, mut came) = (Vec::new(), Vec::new());
            let patience = Instant::now() + 3 * PATIENCE;
            let mut met = false;
            while node.ok() && came.len().min(stepped.len()) < steps && Instant::now() < patience {
                node.wait_for(Duration::from_millis(100));
                while let Some(n) = other.take().map(|r| number(&r.message)) {
                    met = true;
                    came.extend((n > 0).then_some(n));
                }
                while let Some(n) = step.take().map(|r| number(&r.message)) {
                    stepped.extend((n > 0).then_some(n));
                    if met {
                        done.publish(&text(n));
                    }
                }
            }
            let _ = result.send((stepped, came));
            while node.wait() {}
            Ok(())
        })
        .unwrap();
    process
        .start("leader", move |node: &Node| {
            let step = node.advertise::<Text>("step", Qos::RELIABLE)?;
            let other = node.advertise::<Text>("other", Qos::RELIABLE)?;
            let done = node.subscribe::<Text>("done", DEEP)?;
            meet(node, &[&other, &step], &done)?;
            for n in 1..=steps {
                other.publish(&text(n));
                step.publish(&text(n));
                let mut ack = 0;
                // Echoes of the zeros may arrive late.
                while ack == 0 {
                    let answer = done.wait_next(PATIENCE);
                    let answer = answer.ok_or(NodeError::Failed(format!("no answer to {n}")))?;
                    ack = number(&answer.message);
                }
                assert_eq!(ack, n);
            }
            while node.wait() {}
            Ok(())
        })
        .unwrap();
    let (stepped, came) = results.recv_timeout(4 * PATIENCE).unwrap();
    process.finish().unwrap();
    let expected: Vec<_> = (1..=steps).collect();
    assert!(stepped == expected, "{} of {steps} steps", stepped.len());
    assert!(
        came == expected,
        "{} of {steps} on the other topic",
        came.len()
    );
}

#[test]
fn nothing_is_lost_or_repeated_in_lockstep() {
    for _ in 0..3 {
        lockstep(58, true, 4000);
        lockstep(58, false, 4000);
    }
}

// Fails if DDS keeps fewer samples than arrive while the receiving thread is blocked.
#[test]
fn nothing_is_lost_while_the_receiver_is_blocked() {
    blocked_receiver(true);
    blocked_receiver(false);
}

fn blocked_receiver(over_dds: bool) {
    const MESSAGES: usize = 2000;
    let mut process = process(59, over_dds);
    let (came, all) = mpsc::channel();
    process
        .start("slow", move |node: &Node| {
            let ready = node.advertise::<Text>("ready", Qos::RELIABLE)?;
            let _slow = node.subscribe_raw("fast", "std_msgs/msg/String", DEEP, move |sample| {
                let digits = String::from_utf8_lossy(&sample.cdr[8..sample.cdr.len()]);
                let n: usize = digits.trim_end_matches('\0').parse().expect("a number");
                match n {
                    0 => return ready.publish(&text(0)),
                    1 => thread::sleep(Duration::from_secs(2)),
                    _ => {}
                }
                let _ = came.send(n);
            })?;
            while node.wait() {}
            Ok(())
        })
        .unwrap();
    process
        .start("fast", move |node: &Node| {
            let fast = node.advertise::<Text>("fast", Qos::RELIABLE.depth(MESSAGES))?;
            let ready = node.subscribe::<Text>("ready", Qos::RELIABLE)?;
            meet(node, &[&fast], &ready)?;
            for n in 1..=MESSAGES {
                fast.publish(&text(n));
                if n % 20 == 0 {
                    thread::sleep(Duration::from_millis(10));
                }
            }
            while node.wait() {}
            Ok(())
        })
        .unwrap();
    let all: Vec<_> = (0..MESSAGES)
        .map_while(|_| all.recv_timeout(PATIENCE).ok())
        .collect();
    process.finish().unwrap();
    let expected: Vec<_> = (1..=MESSAGES).collect();
    assert!(
        all == expected,
        "{} of {MESSAGES}: {:?}...",
        all.len(),
        &all[..all.len().min(80)]
    );
}

// Would break without acknowledgements for the listener: rustdds waits for it, and the observer gets 8192 messages only.
#[test]
fn subscriptions_of_the_publishers_process_hold_up_no_other_process() {
    const MESSAGES: usize = 20_000;
    let domain = 23;
    let (mut here, mut there) = (process(domain, false), process(domain, false));
    let (came, all) = mpsc::channel();
    there
        .start("observer", move |node: &Node| {
            let echo = node.advertise::<Text>("echo", Qos::RELIABLE)?;
            let stream = node.subscribe::<Text>("stream", DEEP)?;
            while node.ok() {
                node.wait_for(Duration::from_millis(100));
                while let Some(n) = stream.take().map(|r| number(&r.message)) {
                    if n % 100 == 0 {
                        echo.publish(&text(n));
                    }
                    let _ = came.send(n);
                }
            }
            Ok(())
        })
        .unwrap();
    here.start("listener", move |node: &Node| {
        let _stream = node.subscribe::<Text>("stream", DEEP)?;
        while node.wait() {}
        Ok(())
    })
    .unwrap();
    here.start("publisher", move |node: &Node| {
        let stream = node.advertise::<Text>("stream", Qos::RELIABLE)?;
        let echo = node.subscribe::<Text>("echo", DEEP)?;
        meet(node, &[&stream], &echo)?;
        for n in 1..=MESSAGES {
            stream.publish(&text(n));
            // Not faster than the observer.
            let mut echoed = n % 100;
            while n % 100 == 0 && echoed < n {
                let answer = echo.wait_next(PATIENCE);
                let answer = answer.ok_or(NodeError::Failed(format!("no answer to {n}")))?;
                echoed = number(&answer.message);
            }
        }
        while node.wait() {}
        Ok(())
    })
    .unwrap();
    let all = std::iter::from_fn(|| all.recv_timeout(PATIENCE).ok());
    let received: Vec<_> = all.skip_while(|n| *n == 0).take(MESSAGES).collect();
    here.finish().unwrap();
    there.finish().unwrap();
    let expected: Vec<_> = (1..=MESSAGES).collect();
    assert!(received == expected, "{} messages", received.len());
}
