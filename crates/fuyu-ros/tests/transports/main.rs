//! The transports: nodes with each other over DDS and over Zenoh, and over Zenoh with a program that is written from
//! the design document of rmw_zenoh.

mod actions;
mod eavesdropper;
mod graph;
mod log;
mod messages;
mod python_peer;
mod recovery;
mod router;
mod security;
mod services;
mod topics;
