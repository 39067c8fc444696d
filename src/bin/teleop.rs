//! The teleop node as an executable.

use std::process::ExitCode;

fn main() -> ExitCode {
    fuyu::ros::run("teleop", fuyu::nodes::teleop::program)
}
