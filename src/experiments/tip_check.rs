//! Final tip errors of a recorded run: whether position and attitude were controlled, and the uncertainty of the
//! errors.

use nalgebra::{Isometry3, Vector3};

use super::recorded::{RecordedRun, SeenPose};

/// A measured deviation with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Deviation {
    /// Distance \[m\] or angle \[rad\].
    pub value: f64,
    /// Standard deviation of `value` \[m or rad\].
    pub uncertainty: f64,
}

/// The final tip error according to one source.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FinalError {
    /// Name of the source.
    pub name: &'static str,
    /// Description of the measured quantity.
    pub source: String,
    /// Distance from the goal \[m\].
    pub position: Deviation,
    /// Angle from the goal \[rad\].
    pub attitude: Deviation,
}

/// Quantities that the controller's law drives to the goal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Controlled {
    pub position: bool,
    pub attitude: bool,
}

/// Determined by the gains in the last controller state; both if there is none.
pub(super) fn controlled(run: &RecordedRun) -> Controlled {
    match run.controller.last().map(|s| (s.k_p != 0.0, s.k_o != 0.0)) {
        None | Some((false, false)) => Controlled {
            position: true,
            attitude: true,
        },
        Some((position, attitude)) => Controlled { position, attitude },
    }
}

/// The final errors according to controller, camera and tf, as far as recorded.
pub(super) fn final_errors(run: &RecordedRun) -> Vec<FinalError> {
    let exact = |name, source: &str, (position, attitude)| FinalError {
        name,
        source: source.to_owned(),
        position: Deviation::exact(position),
        attitude: Deviation::exact(attitude),
    };
    let stated = run.controller.last().map(|s| {
        let error = (s.position_error, s.attitude_error);
        exact("controller", "last controller/state", error)
    });
    let truth =
        true_tip_error(run).map(|error| exact("tf", "last tf of tool0 and goal_pose", error));
    [stated, seen_tip_error(run), truth]
        .into_iter()
        .flatten()
        .collect()
}

impl Deviation {
    fn exact(value: f64) -> Self {
        Self {
            value,
            uncertainty: 0.0,
        }
    }

    /// The limit for `value`: `limit` plus three standard deviations.
    pub fn allowed(&self, limit: f64) -> f64 {
        limit + 3.0 * self.uncertainty
    }
}

/// Time at the end of a run over which noisy frames are averaged \[ns\].
const AVERAGED: i64 = 1_000_000_000;
/// Number of frames from which the noise is estimated.
const NOISE_FRAMES: usize = 60;
/// Noise below which frames are not averaged \[m or rad\].
const NEGLIGIBLE: f64 = 1e-4;

/// Error between tip and goal according to the camera. The mean over the last second is more accurate than the last
/// frame if the camera is noisy.
fn seen_tip_error(run: &RecordedRun) -> Option<FinalError> {
    let pairs = pairs(&run.seen_tip, &run.seen_goal);
    let &(end, last) = pairs.last()?;
    let recent = &pairs[pairs.len().saturating_sub(NOISE_FRAMES)..];
    let count = recent.iter().filter(|(t, _)| end - t <= AVERAGED).count();
    let averaged = &recent[recent.len() - count..];
    let measure = |part: fn(&Isometry3<f64>) -> Vector3<f64>| {
        let all: Vec<_> = recent.iter().map(|(_, X)| part(X)).collect();
        let noise = noise(&all);
        if noise < NEGLIGIBLE {
            return (Deviation::exact(part(&last).norm()), noise);
        }
        let sum: Vector3<f64> = averaged.iter().map(|(_, X)| part(X)).sum();
        let deviation = Deviation {
            value: (sum / count as f64).norm(),
            uncertainty: noise / (count as f64).sqrt(),
        };
        (deviation, noise)
    };
    let (position, position_noise) = measure(|X| X.translation.vector);
    let (attitude, attitude_noise) = measure(|X| X.rotation.scaled_axis());
    let frames = "last camera/tip_pose and camera/goal_pose";
    let noisy = position_noise.max(attitude_noise) >= NEGLIGIBLE;
    Some(FinalError {
        name: "camera",
        source: match noisy {
            false => frames.to_owned(),
            true => format!(
                "mean of the {count} {frames}; their noise is {position_noise:.1e} m and {attitude_noise:.1e} rad"
            ),
        },
        position,
        attitude,
    })
}

/// Stamps, and the poses of the goal relative to the tip, in base axes.
fn pairs(tips: &[SeenPose], goals: &[SeenPose]) -> Vec<(i64, Isometry3<f64>)> {
    let mut goals = goals.iter().peekable();
    let mut pairs = Vec::new();
    for tip in tips {
        while goals.next_if(|goal| goal.time < tip.time).is_some() {}
        if let Some(goal) = goals.peek().filter(|goal| goal.time == tip.time) {
            let (a, b) = (&tip.pose, &goal.pose);
            let offset = b.translation.vector - a.translation.vector;
            let turn = b.rotation * a.rotation.inverse();
            pairs.push((tip.time, Isometry3::from_parts(offset.into(), turn)));
        }
    }
    pairs
}

/// Standard deviation of the noise in a smooth sequence of vectors, estimated from second differences.
fn noise(values: &[Vector3<f64>]) -> f64 {
    let squares = values
        .windows(3)
        .map(|w| (w[0] - 2.0 * w[1] + w[2]).norm_squared());
    let count = values.len().saturating_sub(2);
    match count {
        0 => 0.0,
        // Second differences of independent values have six times their variance.
        count => (squares.sum::<f64>() / (6.0 * count as f64)).sqrt(),
    }
}

/// Errors between tip and goal according to tf, which depends on neither controller nor camera.
fn true_tip_error(run: &RecordedRun) -> Option<(f64, f64)> {
    const TIP: &str = "tool0";
    run.frames.get(TIP)?;
    let (goal_frame, X_FD) = run.goal.as_ref()?;
    let (tip_root, X_RE) = run.pose_in_root(TIP);
    let (goal_root, X_RF) = run.pose_in_root(goal_frame);
    let X_RD = X_RF * X_FD;
    (tip_root == goal_root).then(|| {
        (
            (X_RE.translation.vector - X_RD.translation.vector).norm(),
            X_RE.rotation.angle_to(&X_RD.rotation),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion};

    fn seen(offset: impl Fn(i64) -> f64) -> Vec<SeenPose> {
        let pose = |i| SeenPose {
            time: i * 100_000_000,
            pose: Isometry3::from_parts(
                Translation3::new(offset(i), 0.0, 0.0),
                UnitQuaternion::identity(),
            ),
        };
        (0..100).map(pose).collect()
    }

    fn camera(error: impl Fn(i64) -> f64) -> Deviation {
        let run = RecordedRun {
            seen_tip: seen(|_| 0.0),
            seen_goal: seen(error),
            ..RecordedRun::default()
        };
        seen_tip_error(&run).unwrap().position
    }

    #[test]
    fn noise_is_averaged_and_hides_no_error() {
        // Alternating noise is the worst case for second differences: they overestimate its deviation twofold.
        let noise = |i: i64| if i % 2 == 0 { 0.02 } else { -0.02 };
        let arrived = camera(noise);
        assert!(arrived.value <= arrived.allowed(0.01), "{arrived:?}");
        let missed = camera(|i| 0.1 + noise(i));
        assert!(missed.value > missed.allowed(0.01), "{missed:?}");
        // Without noise the last frame counts, and the limit is unchanged.
        let exact = camera(|i| 0.011 + 0.1 * (99 - i) as f64);
        assert!((exact.value - 0.011).abs() < 1e-12 && exact.allowed(0.01) == 0.01);
        assert!(exact.value > exact.allowed(0.01));
    }
}
