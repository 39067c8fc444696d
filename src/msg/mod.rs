//! ROS 2 messages: Rust structs, CDR and `.msg` text from one declaration.
