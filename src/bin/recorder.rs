//! The recorder node as an executable.

use std::process::ExitCode;

fn main() -> ExitCode {
    fuyu::ros::run("recorder", fuyu::nodes::recorder::program)
}
