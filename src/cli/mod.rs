//! The `fuyu` command line.
