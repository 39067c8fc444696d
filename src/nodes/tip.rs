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
/// Lists the robot's links.
pub fn tip_frame(model: &Model, tip_link: &str) -> Result<Frame, String> {
    model.frame(tip_link).cloned().ok_or_else(|| {
        let links: Vec<_> = model.frames().iter().map(|f| f.name.as_str()).collect();
        format!(
            "tip_link '{tip_link}' is no link of robot '{}'; it has {}",
            model.name(),
            links.join(", ")
        )
    })
}
