//! Nodes over Zenoh: with each other, and with a program that is written from the design document of rmw_zenoh.

mod actions;
mod graph;
mod messages;
mod python_peer;
mod recovery;
mod router;
mod security;
mod services;
mod topics;
