//! Input arbitration between the operator's joystick (`joy`) and twists (`cmd_vel`).

use std::time::{Duration, Instant};

use super::operator_command::{CommandFrame, FrameNames, Joystick, OperatorCommand};
use crate::{
    msg::{geometry_msgs::TwistStamped, sensor_msgs::Joy},
    spatial::Twist,
};

/// The operator's request.
#[derive(Debug, Clone, PartialEq)]
pub enum Request {
    /// No message has arrived yet.
    Nothing,
    /// Move.
    Move(OperatorCommand),
    /// Stop: the operator has released the button.
    Released,
    /// Stop: messages are missing, or the last one was invalid.
    Lost(String),
}

/// Last messages of the operator from joystick and twists.
#[derive(Debug, Default)]
pub struct OperatorInput {
    joy: Option<(Instant, Result<Option<Twist>, String>)>,
    cmd_vel: Option<(Instant, Result<OperatorCommand, String>)>,
    /// Whether the operator has ever moved the arm.
    has_moved: bool,
}

impl OperatorInput {
    /// Adds a message of `joy` that arrived at `now`.
    ///
    /// # Errors
    /// The reason why it is invalid; the arm then stops.
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

    /// Adds a message of `cmd_vel` that arrived at `now`.
    ///
    /// # Errors
    /// The reason why it is invalid; the arm then stops.
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

    /// The request at `now`. While its button is pressed, the joystick has priority over twists; messages older than
    /// `timeout` are ignored. `frame` gives the axes of joystick commands.
    pub fn request(&mut self, frame: CommandFrame, timeout: Duration, now: Instant) -> Request {
        let age = |at: &Instant| now.saturating_duration_since(*at);
        let fresh = |at: &Instant| age(at) <= timeout;
        let joy = self.joy.as_ref().filter(|(at, _)| fresh(at));
        let cmd_vel = self.cmd_vel.as_ref().filter(|(at, _)| fresh(at));
        let request = match (joy, cmd_vel) {
            // An invalid message on either topic stops the arm.
            (Some((_, Err(problem))), _) => Request::Lost(format!("joy {problem}")),
            (_, Some((_, Err(problem)))) => Request::Lost(format!("cmd_vel {problem}")),
            (Some((_, Ok(Some(twist)))), _) => Request::Move(OperatorCommand {
                frame,
                twist: *twist,
            }),
            (_, Some((_, Ok(command)))) => Request::Move(*command),
            (Some((_, Ok(None))), None) => Request::Released,
            (None, None) => {
                let ages = [
                    self.joy.as_ref().map(|(at, _)| age(at)),
                    self.cmd_vel.as_ref().map(|(at, _)| age(at)),
                ];
                match ages.into_iter().flatten().min() {
                    None => Request::Nothing,
                    Some(least) => Request::Lost(format!(
                        "no message on joy or cmd_vel for {:.1} s (command_timeout is {} s)",
                        least.as_secs_f64(),
                        timeout.as_secs_f64()
                    )),
                }
            }
        };
        self.has_moved |= matches!(request, Request::Move(_));
        request
    }

    /// Whether the operator has ever moved the arm. Before, nothing is commanded, so that a simulation with
    /// `start_on_command` waits for the operator.
    pub fn has_moved(&self) -> bool {
        self.has_moved
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

    // A command that outlives its timeout, or its button, would move the arm without an operator.
    #[test]
    fn the_arm_moves_only_while_the_button_is_pressed_and_messages_arrive() {
        let mut input = OperatorInput::default();
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        let request =
            |input: &mut OperatorInput, ms| input.request(CommandFrame::Base, TIMEOUT, at(ms));
        assert_eq!(request(&mut input, 0), Request::Nothing);
        input.take_joy(&joy(0.5, 0), &stick(), at(10)).unwrap();
        assert_eq!(request(&mut input, 10), Request::Released);
        assert!(!input.has_moved());
        input.take_joy(&joy(0.5, 1), &stick(), at(20)).unwrap();
        let Request::Move(command) = request(&mut input, 519) else {
            panic!("it moves");
        };
        assert_eq!(command.twist.linear.x, 0.5);
        assert!(input.has_moved());
        let Request::Lost(problem) = request(&mut input, 521) else {
            panic!("it stops");
        };
        assert!(problem.contains("command_timeout is 0.5 s"), "{problem}");
        input.take_joy(&joy(0.5, 1), &stick(), at(600)).unwrap();
        input.take_joy(&joy(0.5, 0), &stick(), at(601)).unwrap();
        assert_eq!(request(&mut input, 602), Request::Released);
    }

    #[test]
    fn an_invalid_message_stops_the_arm_even_when_the_other_source_is_valid() {
        let mut input = OperatorInput::default();
        let now = Instant::now();
        let mut twist = TwistStamped::default();
        twist.twist.linear.x = 0.1;
        let base = CommandFrame::Base;
        (input.take_cmd_vel(&twist, &names(), base, now)).unwrap();
        assert!(matches!(
            input.request(base, TIMEOUT, now),
            Request::Move(_)
        ));
        let problem = input.take_joy(&joy(f32::NAN, 1), &stick(), now);
        assert!(problem.unwrap_err().contains("NaN"));
        assert!(matches!(
            input.request(base, TIMEOUT, now),
            Request::Lost(_)
        ));
        // A joystick without its button pressed does not block twists.
        input.take_joy(&joy(0.0, 0), &stick(), now).unwrap();
        assert!(matches!(
            input.request(base, TIMEOUT, now),
            Request::Move(_)
        ));
        twist.header.frame_id = "odom".to_owned();
        let problem = input.take_cmd_vel(&twist, &names(), base, now);
        assert!(problem.unwrap_err().contains("odom"));
        assert!(matches!(
            input.request(base, TIMEOUT, now),
            Request::Lost(_)
        ));
    }
}
