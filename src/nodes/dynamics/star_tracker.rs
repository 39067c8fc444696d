//! The star tracker on the base.

use super::messages::{WORLD, header};
use crate::{
    msg::geometry_msgs::QuaternionStamped,
    nodes::geometry::quaternion_to_msg,
    ros::{Declare, Time},
    vision::{StarTrackerConfig, StarTrackerFrame},
};

/// Declares and reads the star tracker's parameters; `None` without a star tracker, the default.
pub(super) fn declare_star_tracker(declare: &mut Declare) -> Option<StarTrackerConfig> {
    let mut number = |name: &str, default: f64, most: f64, text: &str| {
        let parameter = declare.param(&format!("star_tracker.{name}"), default, text);
        parameter.range(0.0, most).read_only().value()
    };
    let config = StarTrackerConfig {
        rate: number(
            "rate",
            0.0,
            1000.0,
            "Attitudes per second of the star tracker [Hz]; 0 is no star tracker",
        ),
        latency: number(
            "latency",
            0.0,
            60.0,
            "Delay from exposure to delivery of an attitude [s]",
        ),
        noise: number(
            "noise",
            0.0,
            1.0,
            "Standard deviation of each component of an attitude's error, a small rotation [rad]",
        ),
        dropout: number("dropout", 0.0, 1.0, "Probability that an attitude is lost"),
        seed: (declare.param("star_tracker.seed", 1, "Seed of the star tracker's errors"))
            .read_only()
            .value()
            .unsigned_abs(),
    };
    (config.rate > 0.0).then_some(config)
}

/// A measured attitude as a message, stamped with the exposure time.
pub fn star_tracker_message(frame: &StarTrackerFrame) -> QuaternionStamped {
    QuaternionStamped {
        header: header(Time::from_secs_f64(frame.time), WORLD),
        quaternion: quaternion_to_msg(&frame.R_WB),
    }
}
