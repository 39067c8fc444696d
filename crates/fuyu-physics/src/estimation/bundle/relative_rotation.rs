//! Fit of a torque-free rotation to the rotations between frames, for tracks too short for a structure.
//!
//! Each pair of frames up to four apart gives a rotation; different pairs may show different points. These rotations do
//! not determine the initial attitude, so the eight parameters of [`FreeMotion`] are the unknowns.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{Const, Dyn, Matrix3, OMatrix, OVector, Owned, SVector, UnitQuaternion, Vector3};
use rand::Rng;

use super::frames::Frames;
use super::free_motion::{FreeMotion, PARAMETERS, SHAPE_SPREAD, Sensitivity, shape_of};
use super::linear_inertia::{AttitudeSample, fit_inertia_and_momentum, rates};
use super::relative_pose::relative_pose;
use super::rotations::right_jacobian_inverse;

/// Largest distance of the two frames of a pair \[frames\].
const BASELINES: usize = 4;

/// Largest number of rotations that are chained for the start; errors accumulate along the chain.
const CHAIN: usize = 80;

/// A measured rotation between two frames, in inertial axes: `R_WB(to) = turn R_WB(from)`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct RelativeRotation {
    from: usize,
    to: usize,
    turn: UnitQuaternion<f64>,
    /// Square root of its information matrix: whitens an error in inertial axes at `from`.
    whitening: Matrix3<f64>,
}

/// Fits a motion to the rotations between frames; `noise` is the image noise \[px\].
pub fn relative_rotation_fit(
    frames: &Frames,
    noise: f64,
    rng: &mut impl Rng,
) -> Option<FreeMotion> {
    let angle = noise * frames.pixel_angle();
    let mut turns = Vec::new();
    for from in 0..frames.list.len() {
        for to in from + 1..(from + 1 + BASELINES).min(frames.list.len()) {
            turns.extend(measure(frames, from, to, angle, rng));
        }
    }
    let times: Vec<f64> = frames.list.iter().map(|f| f.time).collect();
    let start = chained_start(&times, &turns)?;
    let distance = |t: &RelativeRotation| (times[t.from] - start.time).abs();
    let full_span = turns.iter().map(distance).fold(0.0, f64::max);
    let rate = start.w_WB_B(&start.R_WB).norm();
    let mut span = (12.0 / rate.max(1e-9)).min(full_span);
    let mut motion = start;
    loop {
        let within: Vec<RelativeRotation> = turns
            .iter()
            .filter(|t| distance(t) <= span)
            .copied()
            .collect();
        for _ in 0..3 {
            motion = improve(motion, &times, &within)?;
        }
        if span >= full_span {
            return Some(motion);
        }
        span = (1.5 * span).min(full_span);
    }
}

fn measure(
    frames: &Frames,
    from: usize,
    to: usize,
    angle: f64,
    rng: &mut impl Rng,
) -> Option<RelativeRotation> {
    let pose = relative_pose(&frames.pairs(from, to), angle, rng)?;
    let (first, second) = (frames.list[from].R_WC, frames.list[to].R_WC);
    let turn = second * UnitQuaternion::from_rotation_matrix(&pose.R) * first.inverse();
    // The information is for rotations in the first camera's axes; Sampson errors have the variance of a ray.
    let R = first.to_rotation_matrix();
    let scale = 1.0 / angle.max(pose.rms);
    let eigen = pose.information.symmetric_eigen();
    let root = eigen.eigenvalues.map(|e| e.max(0.0).sqrt() * scale);
    let whitening = Matrix3::from_diagonal(&root) * (R.matrix() * eigen.eigenvectors).transpose();
    Some(RelativeRotation {
        from,
        to,
        turn,
        whitening,
    })
}

/// Motion from the longest chain of rotations, at most [`CHAIN`] frames of it.
fn chained_start(times: &[f64], turns: &[RelativeRotation]) -> Option<FreeMotion> {
    let mut best: Vec<AttitudeSample> = Vec::new();
    let mut chain: Vec<AttitudeSample> = Vec::new();
    let mut at = usize::MAX;
    for turn in turns {
        // The shortest step from a frame comes first in the list; longer ones bridge gaps.
        if turn.from == at || chain.is_empty() {
            if chain.is_empty() {
                chain.push(AttitudeSample {
                    time: times[turn.from],
                    R_WB: UnitQuaternion::identity(),
                });
            }
            let mut R_WB = turn.turn * chain[chain.len() - 1].R_WB;
            R_WB.renormalize();
            chain.push(AttitudeSample {
                time: times[turn.to],
                R_WB,
            });
            at = turn.to;
        } else if turn.from > at {
            if chain.len() > best.len() {
                best = std::mem::take(&mut chain);
            }
            chain.clear();
        }
        if chain.len() == CHAIN {
            break;
        }
    }
    if chain.len() > best.len() {
        best = chain;
    }
    fit_inertia_and_momentum(&rates(&best), 0.5)
}

fn improve(motion: FreeMotion, times: &[f64], turns: &[RelativeRotation]) -> Option<FreeMotion> {
    let mut problem = Problem {
        start: motion,
        times,
        turns,
        weights: vec![1.0; turns.len()],
        parameters: OVector::<f64, Const<PARAMETERS>>::zeros(),
    };
    let sizes: Vec<f64> = problem.errors()?.iter().map(|e| e.norm()).collect();
    let mut sorted = sizes.clone();
    sorted.sort_by(f64::total_cmp);
    let width = (2.0 * sorted[sorted.len() / 2]).max(3.0);
    problem.weights = sizes
        .iter()
        .map(|e| 1.0 / (1.0 + (e / width).powi(2)).sqrt())
        .collect();
    let solver = LevenbergMarquardt::new().with_patience(4).with_tol(1e-7);
    let (solved, _) = solver.minimize(problem);
    solved.current()
}

struct Problem<'a> {
    start: FreeMotion,
    times: &'a [f64],
    turns: &'a [RelativeRotation],
    weights: Vec<f64>,
    parameters: OVector<f64, Const<PARAMETERS>>,
}

impl Problem<'_> {
    fn current(&self) -> Option<FreeMotion> {
        let step: SVector<f64, PARAMETERS> = self.parameters;
        self.start.moved(&step)
    }

    /// Whitened rotation vectors between measured and modelled rotations.
    fn errors(&self) -> Option<Vec<Vector3<f64>>> {
        let attitudes = self.current()?.attitudes(self.times);
        let error = |t: &RelativeRotation| {
            let (from, to) = (attitudes[t.from], attitudes[t.to]);
            let off = (to.inverse() * t.turn * from).scaled_axis();
            t.whitening * (from * off)
        };
        Some(self.turns.iter().map(error).collect())
    }
}

impl LeastSquaresProblem<f64, Dyn, Const<PARAMETERS>> for Problem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Const<PARAMETERS>>;
    type ParameterStorage = Owned<f64, Const<PARAMETERS>>;

    fn set_params(&mut self, x: &OVector<f64, Const<PARAMETERS>>) {
        self.parameters = *x;
    }

    fn params(&self) -> OVector<f64, Const<PARAMETERS>> {
        self.parameters
    }

    fn residuals(&self) -> Option<OVector<f64, Dyn>> {
        let rows = 3 * self.turns.len();
        let Some(errors) = self.errors() else {
            // No body has this inertia: return residuals so large that the step is rejected.
            return Some(OVector::<f64, Dyn>::from_element(rows + 5, 1e6));
        };
        let each = errors.iter().zip(&self.weights);
        let weighted = each.flat_map(|(e, w)| [e.x * w, e.y * w, e.z * w]);
        // The errors are whitened, and so is the prior.
        let shape = shape_of(&self.current()?.inertia) / SHAPE_SPREAD;
        let all = weighted.chain(shape.iter().copied());
        Some(OVector::<f64, Dyn>::from_iterator(rows + 5, all))
    }

    fn jacobian(&self) -> Option<OMatrix<f64, Dyn, Const<PARAMETERS>>> {
        let swept: Vec<(UnitQuaternion<f64>, Sensitivity)> =
            self.current()?.attitudes_and_sensitivities(self.times);
        let mut J = OMatrix::<f64, Dyn, Const<PARAMETERS>>::zeros(3 * self.turns.len() + 5);
        for k in 0..5 {
            J[(3 * self.turns.len() + k, k)] = 1.0 / SHAPE_SPREAD;
        }
        for (i, (t, weight)) in self.turns.iter().zip(&self.weights).enumerate() {
            let ((from, S_from), (to, S_to)) = (&swept[t.from], &swept[t.to]);
            let E = to.inverse() * t.turn * from;
            let off = E.scaled_axis();
            // E exp(θ_from) and exp(-θ_to) E = E exp(-Eᵀ θ_to).
            let inner = S_from - E.to_rotation_matrix().matrix().transpose() * S_to;
            let by_turn = right_jacobian_inverse(&off) * inner - off.cross_matrix() * S_from;
            let R = from.to_rotation_matrix();
            let rows = t.whitening * R.matrix() * by_turn * *weight;
            J.fixed_view_mut::<3, PARAMETERS>(3 * i, 0).copy_from(&rows);
        }
        Some(J)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_rotations_give_the_motion_and_the_jacobian_matches_finite_differences() {
        let shape = SVector::<f64, 5>::new(0.3, -0.2, 0.1, 0.05, -0.15);
        let R = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -0.7, 1.1));
        let truth = FreeMotion::new(&shape, Vector3::new(0.3, -0.5, 0.6), 6.0, R).unwrap();
        let times: Vec<f64> = (0..100).map(|i| 0.3 * f64::from(i)).collect();
        let attitudes = truth.attitudes(&times);
        let mut turns = Vec::new();
        for from in 0..98 {
            for to in from + 1..from + 3 {
                turns.push(RelativeRotation {
                    from,
                    to,
                    turn: attitudes[to] * attitudes[from].inverse(),
                    whitening: Matrix3::new(900.0, 0.0, 10.0, 0.0, 800.0, 0.0, -5.0, 0.0, 300.0),
                });
            }
        }
        let mut motion = chained_start(&times, &turns).unwrap();
        for _ in 0..6 {
            motion = improve(motion, &times, &turns).unwrap();
        }
        // Body axes are those at the chain's first frame.
        let w = |m: &FreeMotion, k: usize| {
            let R = m.attitudes(&times)[k];
            R * m.w_WB_B(&R)
        };
        for k in [0, 50, 99] {
            // The prior on the shape shifts the solution a little.
            assert!((w(&motion, k) - w(&truth, k)).norm() < 1e-5);
        }
        let mut problem = Problem {
            start: motion,
            times: &times,
            turns: &turns[40..90],
            weights: vec![1.0; 50],
            parameters: OVector::<f64, Const<PARAMETERS>>::zeros(),
        };
        problem.set_params(&SVector::from_fn(|i, _| 0.01 * (i as f64 - 3.5)));
        let analytic = problem.jacobian().unwrap();
        let numeric = levenberg_marquardt::differentiate_numerically(&mut problem).unwrap();
        assert!((&analytic - &numeric).norm() < 1e-5 * numeric.norm());
    }
}
