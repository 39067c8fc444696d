//! The controller node as an executable.

use std::process::ExitCode;

fn main() -> ExitCode {
    fuyu::ros::run("controller", fuyu::nodes::controller::program)
}
