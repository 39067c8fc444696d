//! State of a tumbling body at one time with its covariance: the interface between batch solution and filter.

use nalgebra::{Matrix3, Matrix4, SMatrix, SVector, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::StandardNormal;

use super::bundle::{FreeMotion, PARAMETERS, derivatives, responses, shape_of, shape_times};
use super::free_body::FreeRotation;
use crate::spatial::exp_so3;

/// Number of error states: rotation of the body (3, body axes), shape of its inertia (5), momentum (3, inertial axes,
/// scaled to an inertia of trace 3), angular acceleration due to torques (3, inertial axes).
pub const STATES: usize = 3 + PARAMETERS + 3;

/// Index of the angular acceleration.
const ACCELERATION: usize = 3 + PARAMETERS;

/// Covariance of the error states.
pub type StateCovariance = SMatrix<f64, STATES, STATES>;

/// Largest rotation between two nodes of an integral over the motion \[rad\].
const NODE_TURN: f64 = 0.25;

/// Largest number of nodes.
const MAX_NODES: f64 = 400.0;

/// Standard deviation of a predicted rotation above which the linearised covariance is not valid \[rad\].
const LINEAR: f64 = 0.12;

/// Number of pairs of random states, and the seed of their generator.
const DRAWS: usize = 60;
const SEED: u64 = 20;

/// Fraction of a sampled covariance that is added in all directions: for small rotations, and increase per radian of
/// the deviation, as rotations in different directions mix.
const ISOTROPIC: f64 = 0.15;
const ISOTROPIC_PER_RADIAN: f64 = 0.6;

/// The same fraction for a covariance from other motions, relative to that of random states.
const ISOTROPIC_OF_OTHERS: f64 = 0.5;

/// Error states.
type StateVector = SVector<f64, STATES>;

/// The covariance with the fraction `share` of its trace added in all directions.
fn widened(covariance: &Matrix3<f64>, share: f64) -> Matrix3<f64> {
    covariance + Matrix3::identity() * (share * covariance.trace() / 3.0)
}

/// Fraction of a sampled covariance that is added in all directions.
fn isotropic(spread: &Matrix3<f64>) -> f64 {
    ISOTROPIC + ISOTROPIC_PER_RADIAN * spread.trace().max(0.0).sqrt().min(1.0)
}

/// A square root of a covariance, which may be singular.
fn square_root(covariance: &StateCovariance) -> StateCovariance {
    let eigen = covariance.symmetric_eigen();
    let roots = eigen.eigenvalues.map(|v| v.max(0.0).sqrt());
    eigen.eigenvectors * StateCovariance::from_diagonal(&roots)
}

/// Random walks that disturb a free rotation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disturbance {
    /// Random walk of the momentum, relative to it \[1/√s\]: torques that change from frame to frame.
    pub momentum_walk: f64,
    /// Random walk of the angular acceleration \[rad/s²/√s\]: torques that persist.
    pub acceleration_walk: f64,
}

impl Disturbance {
    /// No disturbance.
    pub const NONE: Self = Self {
        momentum_walk: 0.0,
        acceleration_walk: 0.0,
    };
}

/// A torque-free motion with its reference at the time of the state, and its uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionState {
    /// The motion.
    pub motion: FreeMotion,
    /// Angular acceleration due to torques, inertial axes \[rad/s²\]; `motion` does not contain its effect.
    pub acceleration: Vector3<f64>,
    /// Covariance of the error states.
    pub covariance: StateCovariance,
    /// Random walk of the acceleration in predictions \[rad/s²/√s\].
    pub acceleration_walk: f64,
    /// Motions of bodies with other shapes, where the observations do not determine the shape.
    pub others: Option<OtherMotions>,
}

/// Motions that explain the observations about as well as the state's motion. Predictions propagate them like the
/// state; measurements do not correct them.
#[derive(Debug, Clone, PartialEq)]
pub struct OtherMotions {
    /// The motions, at the time of the state, with their weights; the weight of the state's own motion is one minus
    /// their sum.
    pub motions: Vec<(f64, FreeMotion)>,
    /// Conditional covariance of the error states: for a known one of these motions.
    pub conditional: StateCovariance,
}

impl MotionState {
    /// Multiplies all covariances by `factor`.
    pub fn inflate(&mut self, factor: f64) {
        self.covariance *= factor;
        if let Some(others) = &mut self.others {
            others.conditional *= factor;
        }
    }

    /// Attitudes of a motion at ascending `times`, all after its time or all before, and the derivatives `X` of the
    /// rotation at each time by the states, body axes: `R exp([X δ]×)`.
    fn rotations_by_state(
        motion: &FreeMotion,
        times: &[f64],
    ) -> Vec<(UnitQuaternion<f64>, SMatrix<f64, 3, STATES>)> {
        let from = motion.time;
        let rate = motion.w_WB_B(&motion.R_WB).norm();
        let is_before = times.first().is_some_and(|t| *t < from);
        let mut order: Vec<f64> = times.to_vec();
        if is_before {
            order.reverse();
        }
        // Nodes of the integrals over torques, with small rotations from one to the next.
        let (mut nodes, mut wanted, mut last) = (Vec::new(), Vec::new(), from);
        for t in order {
            let turn = rate * (t - last).abs();
            let count = (turn / NODE_TURN).ceil().clamp(1.0, MAX_NODES) as u32;
            let step = (t - last) / f64::from(count);
            nodes.extend((1..count).map(|k| last + step * f64::from(k)));
            wanted.push(nodes.len());
            nodes.push(t);
            last = t;
        }
        let count = nodes.len();
        if is_before {
            nodes.reverse();
            wanted = wanted.iter().rev().map(|i| count - 1 - i).collect();
        }
        let attitudes = motion.attitudes_and_sensitivities(&nodes);
        let all = responses(motion, &nodes, &attitudes, |_, _| [Matrix3::identity()]);
        let each = wanted.into_iter().map(|i| {
            let (R, S) = attitudes[i];
            let mut X = SMatrix::<f64, 3, STATES>::zeros();
            X.fixed_columns_mut::<3>(0)
                .copy_from(&motion.turn_by_turn(&S));
            X.fixed_columns_mut::<PARAMETERS>(3).copy_from(&S);
            X.fixed_columns_mut::<3>(ACCELERATION)
                .copy_from(&all[i].turn[0]);
            (R, X)
        });
        each.collect()
    }

    fn rotation_by_state(
        motion: &FreeMotion,
        to: f64,
    ) -> (UnitQuaternion<f64>, SMatrix<f64, 3, STATES>) {
        let only = Self::rotations_by_state(motion, &[to]).pop();
        only.unwrap_or_else(|| (motion.R_WB, SMatrix::zeros()))
    }

    /// Covariances of predicted rotations from the state's time to ascending `times` after it \[s\]: of the rotation
    /// vector `error` in inertial axes \[rad²\], where `estimate = exp(error) truth`, for a prediction by
    /// [`MotionState::motion`]. The motion does not contain the acceleration, so the acceleration counts as an error.
    ///
    /// While the covariance is small it is that of the linearised motion; otherwise it is the mean square error of random
    /// states, each propagated by Euler's equations.
    /// If bodies of other shapes explain the observations as well, the mean square of their rotation errors is added to the
    /// covariance for a known shape.
    pub fn turn_covariances(&self, times: &[f64]) -> Vec<Matrix3<f64>> {
        let Some(others) = &self.others else {
            return self.linear_or_sampled(times);
        };
        let known = Self {
            covariance: others.conditional,
            others: None,
            ..self.clone()
        };
        let mut covariances = known.linear_or_sampled(times);
        let nominal = self.motion.attitudes(times);
        for (weight, other) in &others.motions {
            for ((sum, R), nominal) in
                (covariances.iter_mut().zip(other.attitudes(times))).zip(&nominal)
            {
                let error = self.turn_error(nominal, &R, other);
                *sum += error * error.transpose() * *weight;
            }
        }
        // A few motions show the size of the errors better than their directions: of n motions, one part in n is spread
        // over all directions.
        let squares: f64 = others
            .motions
            .iter()
            .map(|(weight, _)| weight * weight)
            .sum();
        let weights: f64 = others.motions.iter().map(|(weight, _)| weight).sum();
        let few = squares / (weights * weights).max(1e-12);
        for sum in &mut covariances {
            let share = ISOTROPIC_OF_OTHERS * isotropic(sum) + few;
            *sum = widened(sum, weights * share.min(1.0));
        }
        covariances
    }

    /// Difference between the rotation from the state's time to the attitude `nominal` and the rotation of another
    /// motion to the attitude `R`, as a rotation vector in inertial axes.
    fn turn_error(
        &self,
        nominal: &UnitQuaternion<f64>,
        R: &UnitQuaternion<f64>,
        other: &FreeMotion,
    ) -> Vector3<f64> {
        let ours = nominal * self.motion.R_WB.inverse();
        (ours * (R * other.R_WB.inverse()).inverse()).scaled_axis()
    }

    fn linear_or_sampled(&self, times: &[f64]) -> Vec<Matrix3<f64>> {
        let before = SMatrix::<f64, 3, STATES>::identity();
        let each = Self::rotations_by_state(&self.motion, times)
            .into_iter()
            .zip(times);
        let mut covariances: Vec<Matrix3<f64>> = each
            .map(|((R, X), t)| self.spread(&R, &(X - before), *t))
            .collect();
        let is_large = |c: &Matrix3<f64>| c.trace().is_nan() || c.trace() >= LINEAR * LINEAR;
        let Some(first) = covariances.iter().position(is_large) else {
            return covariances;
        };
        if let Some(sampled) = self.sampled_spreads(&times[first..]) {
            for (covariance, sampled) in covariances[first..].iter_mut().zip(sampled) {
                *covariance = sampled;
            }
        }
        covariances
    }

    /// Mean square rotation errors of random states, for each time.
    fn sampled_spreads(&self, times: &[f64]) -> Option<Vec<Matrix3<f64>>> {
        let nominal = self.motion.attitudes(times);
        let factor = square_root(&self.covariance);
        let mut rng = StdRng::seed_from_u64(SEED);
        let mut sums = vec![Matrix3::zeros(); times.len()];
        let mut count = 0.0;
        for _ in 0..DRAWS {
            let unit = StateVector::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal));
            let step = factor * unit;
            for step in [step, -step] {
                let Some(motion) = self.disturbed(&step) else {
                    continue;
                };
                let attitudes = motion.attitudes(times);
                for (sum, (R, nominal)) in sums.iter_mut().zip(attitudes.iter().zip(&nominal)) {
                    let error = self.turn_error(nominal, R, &motion);
                    *sum += error * error.transpose();
                }
                count += 1.0;
            }
        }
        // Few samples contain no rare errors: a fraction of the covariance is added in all directions.
        let spread = |sum: Matrix3<f64>| {
            let mean = sum / f64::max(count, 1.0);
            widened(&mean, isotropic(&mean))
        };
        (count > 0.0).then(|| sums.into_iter().map(spread).collect())
    }

    /// The motion of a state that differs by `step`. The angular velocity changes to first order with the step, so that
    /// an uncertain inertia does not make it uncertain; the momentum follows from angular velocity and inertia.
    fn disturbed(&self, step: &StateVector) -> Option<FreeMotion> {
        let (w, slope) = self.angular_velocity_slope();
        let w_W = w + slope * step;
        let shape = shape_of(&self.motion.inertia) + step.fixed_rows::<5>(3);
        let R_WB = self.motion.R_WB * exp_so3(&step.fixed_rows::<3>(0).into_owned());
        // Some shapes are impossible for a body: such a sample is moved towards the estimate.
        let nominal = shape_of(&self.motion.inertia);
        let mut possible = None;
        for part in [1.0, 0.7, 0.4, 0.0] {
            let shape = nominal + (shape - nominal) * part;
            let inertia = FreeMotion::new(&shape, self.motion.momentum, self.motion.time, R_WB);
            if let Some(found) = inertia {
                possible = Some(found);
                break;
            }
        }
        let motion = possible?;
        let w_B = R_WB.inverse_transform_vector(&w_W);
        Some(FreeMotion {
            momentum: R_WB * (motion.inertia * w_B),
            ..motion
        })
    }

    /// Covariance of the rotation from one time to another \[s\], as in [`MotionState::turn_covariances`] but always
    /// linearised unless `from` is the state's time.
    pub fn covariance_between(&self, from: f64, to: f64) -> Matrix3<f64> {
        if from == self.motion.time && to > from {
            let only = self.turn_covariances(&[to]);
            return only.into_iter().sum();
        }
        let (R, X) = Self::rotation_by_state(&self.motion, to);
        let before = Self::rotation_by_state(&self.motion, from).1;
        self.spread(&R, &(X - before), to)
    }

    fn spread(
        &self,
        R: &UnitQuaternion<f64>,
        by_state: &SMatrix<f64, 3, STATES>,
        to: f64,
    ) -> Matrix3<f64> {
        let mut covariance = self.covariance;
        let mean = self.acceleration * self.acceleration.transpose();
        let span = (to - self.motion.time).abs();
        let walk = Matrix3::identity() * (self.acceleration_walk.powi(2) * span / 3.0);
        let mut block = covariance.fixed_view_mut::<3, 3>(ACCELERATION, ACCELERATION);
        block += mean + walk;
        let turn = R.to_rotation_matrix() * by_state;
        let spread = turn * covariance * turn.transpose();
        (spread + spread.transpose()) * 0.5
    }

    /// Angular velocity in inertial axes \[rad/s\], and its covariance.
    pub fn angular_velocity(&self) -> (Vector3<f64>, Matrix3<f64>) {
        let (w, slope) = self.angular_velocity_slope();
        (w, slope * self.covariance * slope.transpose())
    }

    /// Angular velocity in inertial axes \[rad/s\], and its derivatives by the states.
    fn angular_velocity_slope(&self) -> (Vector3<f64>, SMatrix<f64, 3, STATES>) {
        let R = *self.motion.R_WB.to_rotation_matrix().matrix();
        let w = self.motion.w_WB_B(&self.motion.R_WB);
        let mut slope = SMatrix::<f64, 3, STATES>::zeros();
        let Some(inverse) = self.motion.inertia.try_inverse() else {
            return (R * w, slope);
        };
        let h = R.tr_mul(&self.motion.momentum);
        let by_turn = R * (inverse * h.cross_matrix() - w.cross_matrix());
        slope.fixed_columns_mut::<3>(0).copy_from(&by_turn);
        slope
            .fixed_columns_mut::<5>(3)
            .copy_from(&(-R * inverse * shape_times(&w)));
        slope
            .fixed_columns_mut::<3>(8)
            .copy_from(&(R * inverse * R.transpose()));
        (R * w, slope)
    }

    /// Covariance of the attitude \[rad²\], as a rotation in inertial axes.
    pub fn attitude_covariance(&self) -> Matrix3<f64> {
        let R = *self.motion.R_WB.to_rotation_matrix().matrix();
        R * self.covariance.fixed_view::<3, 3>(0, 0) * R.transpose()
    }

    /// Covariance of the direction of the angular momentum, inertial axes \[rad²\].
    pub fn momentum_direction_covariance(&self) -> Matrix3<f64> {
        let size = self.motion.momentum.norm().max(f64::MIN_POSITIVE);
        let along = self.motion.momentum / size;
        let across = (Matrix3::identity() - along * along.transpose()) / size;
        across * self.covariance.fixed_view::<3, 3>(8, 8) * across
    }

    /// Derivatives of `(J_x, J_y, J_z, alpha)` by shape and momentum, and by a rotation of the body.
    fn derivatives_of_parameters(&self, J: &Vector3<f64>) -> SMatrix<f64, 4, STATES> {
        let slopes = derivatives(&self.motion, J);
        let mut all = SMatrix::<f64, 4, STATES>::zeros();
        // A rotation of the body acts like the inverse rotation of the momentum on the energy.
        let by_turn = slopes.fixed_columns::<5>(0) * self.motion.shape_by_turn();
        all.fixed_columns_mut::<3>(0).copy_from(&by_turn);
        all.fixed_columns_mut::<PARAMETERS>(3).copy_from(&slopes);
        all
    }

    /// Covariance of `(J_x, J_y, J_z, alpha)` \[s⁴\] for moments in the order of `J`.
    pub fn parameter_covariance(&self, J: &Vector3<f64>) -> Matrix4<f64> {
        let slopes = self.derivatives_of_parameters(J);
        let spread = slopes * self.covariance * slopes.transpose();
        (spread + spread.transpose()) * 0.5
    }

    /// The motion in closed form. `None` if the body does not rotate.
    pub fn rotation(&self) -> Option<FreeRotation> {
        let w = self.motion.w_WB_B(&self.motion.R_WB);
        FreeRotation::new(&self.motion.inertia, self.motion.R_WB, &w, self.motion.time).ok()
    }

    /// Propagates the state to `time` \[s\].
    pub fn predict(&mut self, time: f64, disturbance: &Disturbance) {
        let step = time - self.motion.time;
        let walk = disturbance.momentum_walk * self.motion.momentum.norm();
        let by_state = advance(&mut self.motion, &self.acceleration, time);
        let mut transition = StateCovariance::identity();
        transition
            .fixed_view_mut::<3, STATES>(0, 0)
            .copy_from(&by_state);
        for k in 0..3 {
            transition[(8 + k, ACCELERATION + k)] = step;
        }
        let mut noise = StateVector::zeros();
        noise.fixed_rows_mut::<3>(8).fill(walk * walk * step.abs());
        noise
            .fixed_rows_mut::<3>(ACCELERATION)
            .fill(disturbance.acceleration_walk.powi(2) * step.abs());
        let noise = StateCovariance::from_diagonal(&noise);
        let propagate = |covariance: &mut StateCovariance| {
            *covariance = transition * *covariance * transition.transpose() + noise;
        };
        propagate(&mut self.covariance);
        if let Some(others) = &mut self.others {
            propagate(&mut others.conditional);
            for (_, other) in &mut others.motions {
                advance(other, &self.acceleration, time);
            }
        }
    }

    /// The state after a change by error states; `None` if no body can have the inertia.
    pub fn moved(&self, step: &SVector<f64, STATES>) -> Option<Self> {
        let turned = FreeMotion {
            R_WB: self.motion.R_WB * exp_so3(&step.fixed_rows::<3>(0).into_owned()),
            ..self.motion
        };
        Some(Self {
            motion: turned.moved(&step.fixed_rows::<PARAMETERS>(3).into_owned())?,
            acceleration: self.acceleration + step.fixed_rows::<3>(ACCELERATION),
            ..self.clone()
        })
    }
}

/// Propagates a motion to `time` \[s\] under the angular acceleration `acceleration` (inertial axes,
/// [`MotionState::acceleration`]). Returns the derivatives of its rotation by the states.
fn advance(
    motion: &mut FreeMotion,
    acceleration: &Vector3<f64>,
    time: f64,
) -> SMatrix<f64, 3, STATES> {
    let (R_WB, by_state) = MotionState::rotation_by_state(motion, time);
    let turn = by_state.fixed_columns::<3>(ACCELERATION) * acceleration;
    motion.R_WB = R_WB * exp_so3(&turn);
    motion.momentum += acceleration * (time - motion.time);
    motion.time = time;
    by_state
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(acceleration: Vector3<f64>) -> MotionState {
        let shape = SVector::<f64, 5>::new(0.3, -0.2, 0.1, 0.05, -0.15);
        let R = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -0.7, 1.1));
        let motion = FreeMotion::new(&shape, Vector3::new(0.3, -0.5, 0.6), 3.0, R).unwrap();
        let covariance = StateCovariance::identity() * 1e-6;
        MotionState {
            motion,
            acceleration,
            covariance,
            acceleration_walk: 1e-3,
            others: Some(OtherMotions {
                motions: vec![(0.3, motion)],
                conditional: covariance,
            }),
        }
    }

    // Another motion that is equal to the state's must stay equal: they would part if torques acted on only one of
    // them.
    #[test]
    fn predictions_move_other_shapes_like_the_state() {
        let mut state = state(Vector3::new(2e-3, -1e-3, 3e-3));
        let disturbance = Disturbance {
            momentum_walk: 1e-2,
            acceleration_walk: 1e-3,
        };
        for k in 1..=5 {
            state.predict(3.0 + 2.0 * f64::from(k), &disturbance);
        }
        let others = state.others.as_ref().unwrap();
        assert_eq!(others.conditional, state.covariance);
        assert_eq!(others.motions[0].1, state.motion);
        assert!(state.covariance[(8, 8)] > 1e-4);
    }

    // A long step equals many short ones, for the state and for another shape.
    #[test]
    fn torques_turn_other_shapes() {
        let mut once = state(Vector3::new(2e-4, -1e-4, 3e-4));
        let other = &mut once.others.as_mut().unwrap().motions[0].1;
        let shape = SVector::<f64, 5>::new(0.1, 0.2, -0.1, 0.0, 0.1);
        *other = FreeMotion::new(&shape, other.momentum, other.time, other.R_WB).unwrap();
        let mut often = once.clone();
        once.predict(13.0, &Disturbance::NONE);
        for k in 1..=400 {
            often.predict(3.0 + 0.025 * f64::from(k), &Disturbance::NONE);
        }
        let motion = |state: &MotionState| state.others.as_ref().unwrap().motions[0].1;
        let (a, b) = (motion(&once), motion(&often));
        assert!((a.momentum - b.momentum).norm() < 1e-12);
        let apart = a.R_WB.angle_to(&b.R_WB);
        assert!(apart < 2e-4, "{apart}");
    }
}
