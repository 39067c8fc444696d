//! The dynamics node as an executable.

use std::process::ExitCode;

fn main() -> ExitCode {
    fuyu::ros::run("dynamics", fuyu::nodes::dynamics::program)
}
