//! Clients of services and actions against the servers of this crate, with interfaces declared outside of it.

use fuyu_ros::{
    msg::action_msgs::GoalStatus,
    ros::{
        ActionClient, ActionServer, CallError, DiscoveryRange, Domain, Node, NodeError, Process,
        RosArgs,
    },
};
use std::time::Duration;

mod sum {
    fuyu_ros::services! {
        package acme_srvs;

        /// Adds two numbers.
        service Sum {
            SumRequest {
                /// First number.
                a: f64,
                /// Second number.
                b: f64,
            }
            SumResponse {
                /// Their sum.
                sum: f64,
            }
        }
    }
}

mod count {
    fuyu_ros::action! {
        package acme_actions;

        /// Counts up to a number.
        action Count {
            goal {
                /// Last number.
                to: u32,
            }
            outcome {
                /// Number that was reached.
                reached: u32,
            }
            feedback {
                /// Number now.
                now: u32,
            }
        }
    }
}

const TIMEOUT: Duration = Duration::from_secs(20);

fn server(node: &Node) -> Result<(), NodeError> {
    let _sum = node.serve::<sum::Sum>("sum", |r| sum::SumResponse { sum: r.a + r.b })?;
    let actions = ActionServer::<count::Count>::new(node, "count")?;
    while node.wait() {
        while let Some(goal) = actions.take() {
            let reached = goal.goal.to;
            (1..=reached).for_each(|now| goal.feedback(count::Feedback { now }));
            goal.succeed(count::Outcome { reached });
        }
    }
    Ok(())
}

fn client(node: &Node) -> Result<(), NodeError> {
    let sum = node.client::<sum::Sum>("sum")?;
    for i in 0..10 {
        let (a, b) = (f64::from(i), 0.5);
        let response = sum.call(&sum::SumRequest { a, b }, TIMEOUT)?;
        assert_eq!(response.sum, a + b);
    }
    let missing = node.client::<sum::Sum>("missing")?;
    let error = missing.call(&sum::SumRequest::default(), Duration::from_millis(50));
    assert!(matches!(error, Err(CallError::Timeout { .. })));

    let counting = ActionClient::<count::Count>::new(node, "count")?;
    let goal = counting.send_goal(count::Goal { to: 3 }, TIMEOUT)?;
    let goal = goal.expect("accepted");
    let mut feedback = Vec::new();
    let result = loop {
        feedback.extend(goal.feedback().into_iter().map(|f| f.now));
        match goal.result() {
            Some(result) => break result,
            None => assert!(node.wait_for(TIMEOUT)),
        }
    };
    assert_eq!(result.0, GoalStatus::STATUS_SUCCEEDED);
    assert_eq!(result.1.reached, 3);
    assert!(feedback.is_sorted() && feedback.iter().all(|now| (1..=3).contains(now)));
    first_calls(node)
}

/// Calls of new clients, without a pause after the discovery of the server. A reply that is sent too early is lost.
fn first_calls(node: &Node) -> Result<(), NodeError> {
    for i in 0..20 {
        let sum = node.client::<sum::Sum>("sum")?;
        assert!(sum.wait_for_service(TIMEOUT));
        let request = sum::SumRequest {
            a: f64::from(i),
            b: 1.0,
        };
        assert_eq!(sum.call(&request, TIMEOUT)?.sum, f64::from(i + 1));
        let counting = ActionClient::<count::Count>::new(node, "count")?;
        assert!(counting.wait_for_server(TIMEOUT));
        let goal = counting.send_goal(count::Goal { to: 1 }, TIMEOUT)?;
        let goal = goal.expect("accepted");
        goal.cancel(TIMEOUT)?;
        while goal.result().is_none() {
            assert!(node.wait_for(TIMEOUT));
        }
    }
    Ok(())
}

#[test]
fn services_and_actions_declared_outside_are_called() {
    let range = DiscoveryRange::Localhost;
    let mut process = Process::new(RosArgs::default(), Domain { id: 88, range });
    process.start("server", server).expect("server");
    process.start("client", client).expect("client");
    process.wait().expect("no failure");
}
