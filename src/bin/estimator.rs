//! The estimator node as an executable.

use std::process::ExitCode;

fn main() -> ExitCode {
    fuyu::ros::run("estimator", fuyu::nodes::estimator::program)
}
