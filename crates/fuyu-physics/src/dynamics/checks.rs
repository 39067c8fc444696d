//! Checks of arguments. A vector of the wrong length or the scratch of another robot is a programming error, so the
//! check panics, with a message that names the argument. A check costs a comparison and allocates only when it fails.

use super::{Input, State, TreeAcceleration, TreeMotion};
use crate::model::{Frame, Model};

/// Panics unless `given` is the number of joints.
#[inline]
#[track_caller]
pub(super) fn joint_vector(name: &str, given: usize, model: &Model) {
    if given != model.dof() {
        wrong_length(name, given, model, model.dof(), "joints");
    }
}

/// Panics unless `given` is the number of bodies.
#[inline]
#[track_caller]
pub(super) fn body_vector(name: &str, given: usize, model: &Model) {
    if given != model.bodies().len() {
        wrong_length(name, given, model, model.bodies().len(), "bodies");
    }
}

/// Panics unless positions and rates of `state` fit.
#[inline]
#[track_caller]
pub(super) fn state(state: &State, model: &Model) {
    joint_vector("state.q", state.q.len(), model);
    joint_vector("state.qd", state.qd.len(), model);
}

/// Panics unless efforts and wrenches fit.
#[inline]
#[track_caller]
pub(super) fn input(input: &Input, model: &Model) {
    joint_vector("input.efforts", input.efforts.len(), model);
    body_vector("input.wrenches", input.wrenches.len(), model);
}

/// Panics unless the arguments of a formulation fit.
#[inline]
#[track_caller]
pub(super) fn formulation(
    motion: &TreeMotion,
    acting: &Input,
    out: &TreeAcceleration,
    model: &Model,
) {
    joint_vector("motion.q", motion.q.len(), model);
    joint_vector("motion.qd", motion.qd.len(), model);
    input(acting, model);
    joint_vector("out.qdd", out.qdd.len(), model);
}

/// Panics unless `frame` can belong to the robot.
#[inline]
#[track_caller]
pub(super) fn frame(frame: &Frame, model: &Model) {
    if frame.body >= model.bodies().len() {
        wrong_frame(frame, model);
    }
}

/// Panics unless two objects that work together were made for the same robot. Clones of one [`Model`] are recognised by
/// address; models that were made separately are compared.
#[inline]
#[track_caller]
pub(super) fn same_robot(this: &str, of: &Model, other: &str, other_of: &Model) {
    if of != other_of {
        two_robots(this, of, other, other_of);
    }
}

#[cold]
#[track_caller]
fn wrong_length(name: &str, given: usize, model: &Model, expected: usize, what: &str) -> ! {
    let robot = model.name();
    panic!("`{name}` has {given} elements, but robot `{robot}` has {expected} {what}");
}

#[cold]
#[track_caller]
fn wrong_frame(frame: &Frame, model: &Model) -> ! {
    let (name, body, robot) = (&frame.name, frame.body, model.name());
    let count = model.bodies().len();
    panic!("frame `{name}` is on body {body}, but robot `{robot}` has {count} bodies");
}

#[cold]
#[track_caller]
fn two_robots(this: &str, of: &Model, other: &str, other_of: &Model) -> ! {
    let text = |model: &Model| format!("robot `{}` ({} joints)", model.name(), model.dof());
    let (of, other_of) = (text(of), text(other_of));
    panic!("{this} was made for {of}, {other} for {other_of}: make both from the same model");
}
