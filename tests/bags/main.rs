//! Bags: what fuyu writes, it and others can read; what is left of a broken one is not lost.

#[path = "../support/measuring.rs"]
mod measuring;

mod check;
mod command;
mod damage;
mod interfaces;
mod killed;
mod python;
mod run;
mod sample;
mod writing;
