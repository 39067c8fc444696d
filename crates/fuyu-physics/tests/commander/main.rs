//! What a commander may ask for, on a robot with seven joints: joint trajectories, paths and twists of the tip, with
//! their tracking errors and the drift of the base.

#![allow(non_snake_case)]

mod drive;
mod invalid;
mod paths;
mod splines;
mod tracking;
mod twists;
