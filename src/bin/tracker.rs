//! The tracker node as an executable.

use std::process::ExitCode;

fn main() -> ExitCode {
    fuyu::ros::run("tracker", fuyu::nodes::tracker::program)
}
