//! The camera node as an executable.

use std::process::ExitCode;

fn main() -> ExitCode {
    fuyu::ros::run("camera", fuyu::nodes::camera::program)
}
