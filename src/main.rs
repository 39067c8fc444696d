//! The `fuyu` command line.

fn main() {}
