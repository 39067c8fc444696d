//! Actions between two sessions.

use fuyu_ros::{
    msg::action_msgs::GoalStatus,
    ros::{ActionClient, ActionServer, Node, NodeError},
};

use crate::router::{Network, PATIENCE, idle};

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

fn server(node: &Node) -> Result<(), NodeError> {
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

// Fails if one of the three services and two topics of an action does not work over Zenoh.
#[test]
fn goals_are_reached_with_feedback() {
    Network::each(216, goals_are_reached_with_feedback_over);
}

fn goals_are_reached_with_feedback_over(network: &Network) {
    let (mut one, mut two) = (network.process(0), network.process(0));
    one.start("server", server).expect("it starts");
    let client = two.start("client", idle).expect("it starts");
    let counting = ActionClient::<count::Count>::new(&client, "count").expect("a client");
    assert!(counting.wait_for_server(PATIENCE));
    for to in 1..5 {
        let goal = counting.send_goal(count::Goal { to }, PATIENCE);
        let goal = goal.expect("it replies").expect("it is accepted");
        let mut feedback = Vec::new();
        let (status, outcome) = loop {
            feedback.extend(goal.feedback().into_iter().map(|f| f.now));
            match goal.result() {
                Some(result) => break result,
                None => std::thread::sleep(std::time::Duration::from_millis(2)),
            }
        };
        feedback.extend(goal.feedback().into_iter().map(|f| f.now));
        assert_eq!(status, GoalStatus::STATUS_SUCCEEDED);
        assert_eq!(outcome.reached, to);
        assert!(feedback.is_sorted() && feedback.iter().all(|now| (1..=to).contains(now)));
    }
}
