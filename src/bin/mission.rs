//! The mission node as an executable.

use std::process::ExitCode;

fn main() -> ExitCode {
    fuyu::ros::run("mission", fuyu::nodes::mission::program)
}
