//! The views node as an executable.

use std::process::ExitCode;

fn main() -> ExitCode {
    fuyu::ros::run("views", fuyu::nodes::views::program)
}
