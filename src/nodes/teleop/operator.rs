//! Who steers, and whether anybody does.

use std::time::{Duration, Instant};

use super::operator_command::{CommandFrame, FrameNames, Joystick, OperatorCommand};
use crate::{
    msg::{geometry_msgs::TwistStamped, sensor_msgs::Joy},
    spatial::Twist,
};

/// What is to be done now.
#[derive(Debug, Clone, PartialEq)]
pub enum Wish {
    /// Nobody has asked for anything yet.
    Nothing,
    /// Move.
    Move(OperatorCommand),
    /// Stand still: the operator says so.
    Released,
    /// Stand still: the operator is lost, or what came last was wrong.
    Lost(String),
}

/// What came last from the operator, by joystick and by twists.
#[derive(Debug, Default)]
pub struct OperatorInput {
    joy: Option<(Instant, Result<Option<Twist>, String>)>,
    cmd_vel: Option<(Instant, Result<OperatorCommand, String>)>,
    /// Whether anybody has moved the arm.
    began: bool,
}

impl OperatorInput {
    /// Takes in a message of `joy` that came at `now`.
    ///
    /// # Errors
    /// Says what is wrong with it; the arm then stops.
    pub fn take_joy(
        &mut self,
        message: &Joy,
        stick: &Joystick,
        now: Instant,
    ) -> Result<(), String> {
        let read = stick.twist(message);
        self.joy = Some((now, read.clone()));
        read.map(drop)
    }

    /// Takes in a message of `cmd_vel` that came at `now`.
    ///
    /// # Errors
    /// Says what is wrong with it; the arm then stops.
    pub fn take_cmd_vel(
        &mut self,
        message: &TwistStamped,
        names: &FrameNames,
        frame: CommandFrame,
        now: Instant,
    ) -> Result<(), String> {
        let read = OperatorCommand::from_msg(message, names, frame);
        self.cmd_vel = Some((now, read.clone()));
        read.map(drop)
    }

    /// What is to be done at `now`. A joystick whose button is pressed goes before twists; what is older than
    /// `timeout` does not count. `frame` is that of the joystick.
    pub fn wish(&mut self, frame: CommandFrame, timeout: Duration, now: Instant) -> Wish {
        let age = |at: &Instant| now.saturating_duration_since(*at);
        let fresh = |at: &Instant| age(at) <= timeout;
        let joy = self.joy.as_ref().filter(|(at, _)| fresh(at));
        let cmd_vel = self.cmd_vel.as_ref().filter(|(at, _)| fresh(at));
        let wish = match (joy, cmd_vel) {
            // What is wrong from either stops the arm, whoever else asks for something.
            (Some((_, Err(problem))), _) => Wish::Lost(format!("joy {problem}")),
            (_, Some((_, Err(problem)))) => Wish::Lost(format!("cmd_vel {problem}")),
            (Some((_, Ok(Some(twist)))), _) => Wish::Move(OperatorCommand {
                frame,
                twist: *twist,
            }),
            (_, Some((_, Ok(command)))) => Wish::Move(*command),
            (Some((_, Ok(None))), None) => Wish::Released,
            (None, None) => {
                let ages = [
                    self.joy.as_ref().map(|(at, _)| age(at)),
                    self.cmd_vel.as_ref().map(|(at, _)| age(at)),
                ];
                match ages.into_iter().flatten().min() {
                    None => Wish::Nothing,
                    Some(least) => Wish::Lost(format!(
                        "no message on joy or cmd_vel for {:.1} s (command_timeout is {} s)",
                        least.as_secs_f64(),
                        timeout.as_secs_f64()
                    )),
                }
            }
        };
        self.began |= matches!(wish, Wish::Move(_));
        wish
    }

    /// Whether anybody has ever moved the arm: before that nothing is commanded, and a simulation that waits for a
    /// command waits for the operator.
    pub fn began(&self) -> bool {
        self.began
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIMEOUT: Duration = Duration::from_millis(500);

    fn stick() -> Joystick {
        Joystick {
            axes: [Some(0), None, None, None, None, None],
            scales: [1.0; 6],
            deadband: 0.0,
            enable_button: Some(0),
        }
    }

    fn joy(axis: f32, button: i32) -> Joy {
        Joy {
            axes: vec![axis],
            buttons: vec![button],
            ..Joy::default()
        }
    }

    fn names() -> FrameNames {
        FrameNames {
            base: "base_link".to_owned(),
            tip: "tool0".to_owned(),
        }
    }

    // A command that outlived its time, or its button, would move the arm with nobody there.
    #[test]
    fn the_arm_moves_only_while_somebody_holds_on() {
        let mut input = OperatorInput::default();
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        let wish = |input: &mut OperatorInput, ms| input.wish(CommandFrame::Base, TIMEOUT, at(ms));
        assert_eq!(wish(&mut input, 0), Wish::Nothing);
        input.take_joy(&joy(0.5, 0), &stick(), at(10)).unwrap();
        assert_eq!(wish(&mut input, 10), Wish::Released);
        assert!(!input.began());
        input.take_joy(&joy(0.5, 1), &stick(), at(20)).unwrap();
        let Wish::Move(command) = wish(&mut input, 519) else {
            panic!("it moves");
        };
        assert_eq!(command.twist.linear.x, 0.5);
        assert!(input.began());
        let Wish::Lost(problem) = wish(&mut input, 521) else {
            panic!("it stops");
        };
        assert!(problem.contains("command_timeout is 0.5 s"), "{problem}");
        input.take_joy(&joy(0.5, 1), &stick(), at(600)).unwrap();
        input.take_joy(&joy(0.5, 0), &stick(), at(601)).unwrap();
        assert_eq!(wish(&mut input, 602), Wish::Released);
    }

    #[test]
    fn what_is_wrong_stops_the_arm_whoever_else_asks() {
        let mut input = OperatorInput::default();
        let now = Instant::now();
        let mut twist = TwistStamped::default();
        twist.twist.linear.x = 0.1;
        let base = CommandFrame::Base;
        (input.take_cmd_vel(&twist, &names(), base, now)).unwrap();
        assert!(matches!(input.wish(base, TIMEOUT, now), Wish::Move(_)));
        let problem = input.take_joy(&joy(f32::NAN, 1), &stick(), now);
        assert!(problem.unwrap_err().contains("NaN"));
        assert!(matches!(input.wish(base, TIMEOUT, now), Wish::Lost(_)));
        // A stick that lies there does not forbid twists.
        input.take_joy(&joy(0.0, 0), &stick(), now).unwrap();
        assert!(matches!(input.wish(base, TIMEOUT, now), Wish::Move(_)));
        twist.header.frame_id = "odom".to_owned();
        let problem = input.take_cmd_vel(&twist, &names(), base, now);
        assert!(problem.unwrap_err().contains("odom"));
        assert!(matches!(input.wish(base, TIMEOUT, now), Wish::Lost(_)));
    }
}
