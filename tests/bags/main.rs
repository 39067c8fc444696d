//! Bags: writing, reading by fuyu and by others, damage and recovery.

#[path = "../support/child_guard.rs"]
mod child_guard;
#[path = "../support/lateness.rs"]
mod lateness;
#[path = "../support/measuring.rs"]
mod measuring;
#[path = "../support/peer.rs"]
#[expect(dead_code, reason = "few of its commands are needed here")]
mod peer;
#[path = "../support/python.rs"]
mod python;
#[path = "../support/waiting.rs"]
mod waiting;

mod check;
mod cockpit;
mod command;
mod convert;
mod damage;
mod foreign;
mod foxglove;
mod full_disk;
mod hostile;
mod interfaces;
mod killed;
mod play;
mod recover;
mod run;
mod sample;
mod scripts;
mod services;
mod splitting;
mod unknown_types;
mod writing;
