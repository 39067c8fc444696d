//! The `fuyu` command line.

use std::process::ExitCode;

fn main() -> ExitCode {
    fuyu::cli::main()
}
