//! The `fuyu` executable: exit codes, output, error messages; and the examples.

mod articulated_targets;
mod attitude;
mod bad_urdf;
mod campaign;
mod contact;
mod control;
mod elastic_links;
mod estimate;
mod estimate_bad_input;
mod examples;
mod excitations;
mod flexible;
mod free_motion;
mod fuyu;
mod grasps;
mod grippers;
mod images;
mod input_files;
mod inspect;
mod mission;
mod reproduce;
mod tracked_images;
mod tracking;
mod two_servicers;
mod views;
mod wrist;
