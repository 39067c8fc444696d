//! Parameters of the servo that tracks commanded joint rates.

use crate::{
    control::{ServoGains, VelocityServoConfig},
    ros::Declare,
};

/// Declares `velocity_servo.*` and reads them.
pub(super) fn declare_servo(declare: &mut Declare) -> VelocityServoConfig {
    let bandwidth = declare
        .param(
            "velocity_servo.bandwidth",
            10.0,
            "Bandwidth of the servo that drives commanded joint rates, the same in all postures [rad/s]",
        )
        .range(1e-3, 1e4)
        .read_only()
        .value();
    let gains = declare
        .param(
            "velocity_servo.gains",
            Vec::<f64>::new(),
            "Gains of the servo, one per joint [N m s/rad or N s/m]; empty uses the bandwidth instead",
        )
        .range(1e-9, 1e9)
        .read_only()
        .value();
    let integral = declare
        .param(
            "velocity_servo.integral",
            0.0,
            "Inverse time constant of the servo's integral part [rad/s]; 0 is a proportional servo",
        )
        .range(0.0, 1e4)
        .read_only()
        .value();
    VelocityServoConfig {
        gains: match gains.is_empty() {
            true => ServoGains::Bandwidth(bandwidth),
            false => ServoGains::PerJoint(gains),
        },
        integral,
    }
}
