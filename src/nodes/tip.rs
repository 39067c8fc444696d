//! Tip links: the parameters that name them, and their frames.

use crate::{
    model::{Frame, Model},
    ros::Declare,
};

/// Declares and reads `tip_link`.
pub(super) fn declare_tip_link(declare: &mut Declare) -> String {
    declare
        .param("tip_link", "tool0", "Link whose frame is the tip")
        .read_only()
        .value()
}

/// Declares and reads `second_tip_link`, for a robot with two arms.
pub(super) fn declare_second_tip_link(declare: &mut Declare) -> String {
    declare
        .param(
            "second_tip_link",
            "",
            "Link whose frame is the tip of a second arm; empty if there is none",
        )
        .read_only()
        .value()
}

/// The frame of the tip link.
///
/// # Errors
/// Lists the robot's links, or those that joints move if the link is fixed to the base.
pub fn tip_frame(model: &Model, tip_link: &str) -> Result<Frame, String> {
    let links = |is_listed: fn(&Frame) -> bool| {
        let listed = model.frames().iter().filter(|f| is_listed(f));
        let names: Vec<_> = listed.map(|f| f.name.as_str()).collect();
        names.join(", ")
    };
    let Some(frame) = model.frame(tip_link) else {
        return Err(format!(
            "tip_link '{tip_link}' is no link of robot '{}'; it has {}",
            model.name(),
            links(|_| true)
        ));
    };
    if frame.body == 0 && model.dof() > 0 {
        return Err(format!(
            "tip_link '{tip_link}' is fixed to the base of robot '{}', so that no joint moves it; joints move {}",
            model.name(),
            links(|f| f.body > 0)
        ));
    }
    Ok(frame.clone())
}
