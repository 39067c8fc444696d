//! Amplitude of an excitation, limited by the load on the grasp while the arm moves the held body.

use nalgebra::DVector;

use super::excitation::Excitation;
use crate::dynamics::{Input, State, Workspace};
use crate::model::{Frame, Model};
use crate::spatial::RigidInertia;

/// Number of times at which the load is computed.
const SAMPLES: usize = 300;
/// Fraction of the limits at the grasp that an excitation uses.
const LOAD_SHARE: f64 = 0.8;
/// Largest factor on the configured amplitudes.
const LARGEST_FACTOR: f64 = 2.0;
/// Fraction of the distance to a joint's limits, and of its velocity limit, that an excitation uses.
const JOINT_SHARE: f64 = 0.8;

/// Largest force \[N\] and torque about the tip's origin \[N m\] of the arm on `payload` in an excitation from rest.
/// `whole` is the workspace of the robot with the payload at its tip; no external force acts and the momentum is zero.
pub(super) fn excitation_load(
    whole: &mut Workspace,
    tip: &Frame,
    payload: &RigidInertia,
    excitation: &Excitation,
) -> (f64, f64) {
    let model = whole.model().clone();
    let n = model.dof();
    let no_input = Input::zero(&model);
    let mut state = State::at_rest(&model);
    let mut free = DVector::zeros(n);
    let mut qdd = DVector::zeros(n);
    let mut largest = (0.0_f64, 0.0_f64);
    for k in 0..=SAMPLES {
        let time = excitation.start() + excitation.duration() * k as f64 / SAMPLES as f64;
        for j in 0..n {
            let point = excitation.at(j, time);
            (state.q[j], state.qd[j], qdd[j]) = (point.position, point.rate, point.acceleration);
        }
        whole.set_positions(&state.q);
        whole.set_motion(&state);
        // Gives the bias accelerations that `set_accelerations` begins with.
        whole.accelerations(&state, &no_input, &mut free);
        whole.set_accelerations(&qdd);
        let (V, A) = (whole.V_WF_B(tip), whole.A_WF_B(tip));
        let R_BE = whole.X_BF(tip).rotation;
        let arm = R_BE * payload.com;
        let inertia = R_BE.matrix() * payload.about_com * R_BE.matrix().transpose();
        let (w, dw) = (V.angular, A.angular);
        let force = (A.linear + dw.cross(&arm) + w.cross(&w.cross(&arm))) * payload.mass;
        let torque = inertia * dw + w.cross(&(inertia * w)) + arm.cross(&force);
        largest = (largest.0.max(force.norm()), largest.1.max(torque.norm()));
    }
    largest
}

/// The excitation from `positions` with the shape of `amplitudes` that loads the grasp by [`LOAD_SHARE`] of `limits` (force
/// \[N\], torque \[N m\]), but at most [`LARGEST_FACTOR`] times as large, and within the limits of the joints of `model`.
pub(super) fn sized(
    (model, whole): (&Model, &mut Workspace),
    (tip, payload): (&Frame, &RigidInertia),
    (start, duration): (f64, f64),
    (positions, amplitudes): (&[f64], &[f64]),
    limits: (f64, f64),
) -> Excitation {
    let of = |factor: f64| {
        let amplitudes: Vec<f64> = amplitudes.iter().map(|a| a * factor).collect();
        Excitation::new(start, duration, positions, &amplitudes)
    };
    let unit = of(1.0);
    let mut factor = LARGEST_FACTOR;
    for (j, joint) in model.joints().iter().enumerate() {
        let limits = &joint.limits;
        let room = (limits.upper - positions[j]).min(positions[j] - limits.lower);
        for (room, needed) in [
            (room.max(0.0), amplitudes[j].abs()),
            (limits.velocity, unit.largest_rate(j)),
        ] {
            if needed > 0.0 && room.is_finite() {
                factor = factor.min(JOINT_SHARE * room / needed);
            }
        }
    }
    // Forces grow slightly faster than the amplitude, because of centrifugal forces: a few corrections suffice.
    let largest = factor;
    for _ in 0..6 {
        let (force, torque) = excitation_load(whole, tip, payload, &of(factor));
        let ratio = (force / limits.0).max(torque / limits.1) / LOAD_SHARE;
        if (ratio - 1.0).abs() < 0.01 || (ratio < 1.0 && factor == largest) {
            break;
        }
        factor = (factor / ratio).min(largest);
    }
    of(factor)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Vector3};

    use super::*;
    use crate::control::capture::payload::with_payload;
    use crate::control::fixtures::servicer;
    use crate::dynamics::Momentum;

    const T: f64 = 20.0;

    fn case() -> (Model, Frame, RigidInertia, Vec<f64>) {
        let (model, tip) = servicer();
        let payload = RigidInertia {
            mass: 300.0,
            com: Vector3::new(0.7, -0.1, 0.2),
            about_com: Matrix3::new(110.0, 3.0, -2.0, 3.0, 150.0, 5.0, -2.0, 5.0, 170.0),
        };
        let positions = vec![1.396, 1.571, -1.571, 0.0, 0.524, 0.0];
        (model, tip, payload, positions)
    }

    // Fails if the acceleration of the base, or a centrifugal part, is left out: the payload's centre of mass relative
    // to the system's is a function of the joints, and the base turns by the conservation of momentum. Both are
    // differentiated numerically.
    #[test]
    fn the_force_accelerates_the_centre_of_mass() {
        let (model, tip, payload, positions) = case();
        let whole = with_payload(&model, &tip, &payload).unwrap();
        let mut workspace = Workspace::new(&whole);
        let excitation = Excitation::new(0.0, T, &positions, &[0.1, 0.1, 0.1, 0.4, 0.4, 0.4]);
        let n = model.dof();
        // Position of the payload's centre of mass from the system's, and angular velocity of the base: base axes.
        let mut at = |time: f64| {
            let q = DVector::from_fn(n, |j, _| excitation.at(j, time).position);
            let qd = DVector::from_fn(n, |j, _| excitation.at(j, time).rate);
            workspace.set_positions(&q);
            let X_BE = workspace.X_BF(&tip);
            let r = X_BE.translation.vector + X_BE.rotation * payload.com - workspace.p_BC();
            let zero = Momentum {
                linear: Vector3::zeros(),
                angular: Vector3::zeros(),
            };
            (r, workspace.base_twist(&zero, &qd).angular)
        };
        let mut largest = 0.0_f64;
        let h = 1e-3;
        for k in 0..=SAMPLES {
            let time = (T * k as f64 / SAMPLES as f64).clamp(2.0 * h, T - 2.0 * h);
            let [(r0, w0), (r, w), (r1, w1)] = [time - h, time, time + h].map(&mut at);
            let (dr, dw) = ((r1 - r0) / (2.0 * h), (w1 - w0) / (2.0 * h));
            let ddr = (r1 - r * 2.0 + r0) / (h * h);
            let a = ddr + w.cross(&dr) * 2.0 + dw.cross(&r) + w.cross(&w.cross(&r));
            largest = largest.max(payload.mass * a.norm());
        }
        let (force, _) = excitation_load(&mut workspace, &tip, &payload, &excitation);
        assert!((force / largest - 1.0).abs() < 1e-5, "{force} {largest}");
    }

    #[test]
    fn the_size_uses_its_share_of_the_limits() {
        let (model, tip, payload, positions) = case();
        let mut whole = Workspace::new(&with_payload(&model, &tip, &payload).unwrap());
        let amplitudes = [0.05, 0.05, 0.05, 0.4, 0.4, 0.4];
        for (limits, share) in [((10.0, 1e6), 0.8), ((1e6, 8.0), 0.8), ((1e6, 1e6), 0.0)] {
            let excitation = sized(
                (&model, &mut whole),
                (&tip, &payload),
                (3.0, 35.0),
                (&positions, &amplitudes),
                limits,
            );
            let (force, torque) = excitation_load(&mut whole, &tip, &payload, &excitation);
            let used = (force / limits.0).max(torque / limits.1);
            match share {
                // The joints' limits, or the largest factor, limit the amplitude.
                0.0 => assert!(used < 0.1, "{used}"),
                share => assert!((used / share - 1.0).abs() < 0.011, "{used}"),
            }
        }
    }
}
