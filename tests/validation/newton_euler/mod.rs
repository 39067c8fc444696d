//! The matrix method against the tables of TR-942 (1987), against closed forms, and against the reduced form.

mod chain;
mod pantograph;
