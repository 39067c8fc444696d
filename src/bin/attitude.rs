//! The attitude node as an executable.

use std::process::ExitCode;

fn main() -> ExitCode {
    fuyu::ros::run("attitude", fuyu::nodes::attitude::program)
}
