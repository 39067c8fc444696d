//! Plots of an estimated tumbling motion and the true one; part of `fuyu bag plot`.

use nalgebra::{UnitQuaternion, UnitVector3, Vector3};

use super::chart::{Figure, Panel, PlaneFigure, Series};
use super::recorded::seconds_since;
use super::recorded_estimation::{
    RecordedEstimation, RecordedMotion, RecordedPrediction, Turning, attitude_at,
};
use crate::estimation::free_body::DynamicParameters;

/// Maximum number of predictions drawn individually.
const PREDICTIONS: usize = 5;
/// Errors of exactly zero are drawn at this value on a logarithmic axis \[deg\].
const FLOOR: f64 = 1e-6;

/// `R_BC`: rotation of the camera relative to the base, if known.
pub type Mount = Option<UnitQuaternion<f64>>;

fn series(name: impl Into<String>, points: Vec<(f64, f64)>) -> Series {
    Series {
        name: name.into(),
        points,
    }
}

/// `|w|²` over time: estimated at each frame, extrapolated in both directions from the last motion, and true.
pub fn squared_rates(estimation: &RecordedEstimation, start: i64) -> Option<Figure> {
    let time = |t: i64| seconds_since(start, t);
    let estimated = estimation.rates.iter();
    let estimated: Vec<_> = estimated
        .map(|(t, w)| (time(*t), w.norm_squared()))
        .collect();
    let mut all = vec![series("at each frame", estimated)];
    if let Some(last) = estimation.motions.last() {
        let times = estimation.rates.iter().map(|(t, _)| *t);
        let times = times.chain(estimation.motions.iter().map(|m| m.time));
        let fit = times.map(|t| (time(t), last.squared_rate(t)));
        let mut fit: Vec<_> = fit.collect();
        fit.sort_by(|a, b| a.0.total_cmp(&b.0));
        all.push(series("fit, the last motion", fit));
    }
    for (name, truth) in &estimation.targets {
        let points = truth
            .iter()
            .map(|s| (time(s.time), s.w_WB_W.norm_squared()));
        all.push(series(format!("true, {name}"), points.collect()));
    }
    all.retain(|s| s.points.len() > 1);
    (!estimation.rates.is_empty() || estimation.motions.len() > 1).then(|| Figure {
        title: "Squared angular velocity of the target".into(),
        x_label: "time [s]".into(),
        panels: vec![Panel {
            y_label: "|w|² [rad²/s²]".into(),
            series: all,
            ..Panel::default()
        }],
        ..Figure::default()
    })
}

impl RecordedMotion {
    /// `|w|²` of the closed form at `time` \[ns\], (2.28): constant if the moments are unknown.
    fn squared_rate(&self, time: i64) -> f64 {
        match DynamicParameters::new(self.J, self.alpha) {
            Ok(p) if !p.is_axisymmetric() && !p.is_single_axis() => {
                let argument = self.phase + p.lambda() * seconds_since(self.time, time);
                let sn = p.modulus().jacobi(argument).sn;
                p.beta() - (p.beta() - p.gamma()) * sn * sn
            }
            _ => self.w_C.norm_squared(),
        }
    }
}

/// The angular velocity projected on the invariable plane, in world axes.
pub fn herpolhode(estimation: &RecordedEstimation, mount: Mount) -> Option<PlaneFigure> {
    let R_BC = mount?;
    let R_WC = |time: i64| attitude_at(&estimation.base, time).map(|R_WB| R_WB * R_BC);
    let directions = estimation.motions.iter();
    let direction = directions
        .filter_map(|m| Some(R_WC(m.time)? * m.momentum_direction))
        .next_back()?;
    let normal = UnitVector3::try_new(direction, 1e-9)?;
    let across = [Vector3::x(), Vector3::y()].map(|a| normal.cross(&a));
    let x = if across[0].norm() > across[1].norm() {
        across[0].normalize()
    } else {
        across[1].normalize()
    };
    let y = normal.cross(&x);
    let in_plane = |w: &Vector3<f64>| (x.dot(w), y.dot(w));
    let rates = estimation.rates.iter();
    let found: Vec<_> = rates
        .filter_map(|(t, w)| Some(in_plane(&(R_WC(*t)? * w))))
        .collect();
    if found.len() < 2 {
        return None;
    }
    let mut all = vec![series("estimated", found)];
    for (name, truth) in &estimation.targets {
        let points = truth.iter().map(|s| in_plane(&s.w_WB_W)).collect();
        all.push(series(format!("true, {name}"), points));
    }
    Some(PlaneFigure {
        title: "Herpolhode of the target".into(),
        x_label: "w in the invariable plane [rad/s]".into(),
        y_label: "w in the invariable plane [rad/s]".into(),
        series: all,
        ..PlaneFigure::default()
    })
}

/// Attitude error of predictions of a target: of some predictions over their horizons, and the maximum of each
/// prediction.
pub fn prediction_error(
    estimation: &RecordedEstimation,
    truth: &[Turning],
    mount: Mount,
    start: i64,
) -> Option<Figure> {
    let R_BC = mount?;
    let curves = estimation.predictions.iter().filter_map(|prediction| {
        let R_WC = attitude_at(&estimation.base, prediction.time)? * R_BC;
        let curve = deviation(prediction, &R_WC, truth);
        (curve.len() > 1).then_some(curve)
    });
    let curves: Vec<_> = curves.collect();
    if curves.is_empty() {
        return None;
    }
    let drawn = |(t, error): &(i64, f64)| {
        let degrees = error.to_degrees().max(FLOOR);
        (seconds_since(start, *t), degrees)
    };
    let reported = |stamp: i64| {
        let motion = estimation.motions.iter().find(|m| m.time == stamp);
        motion.map_or(&[][..], |m| m.deviations.as_slice())
    };
    let some = curves.iter().step_by(curves.len().div_ceil(PREDICTIONS));
    let some = some.flat_map(|curve| {
        let from = format!("from {:.1} s", seconds_since(start, curve[0].0));
        // The error is zero at the start, which has no logarithm.
        let error = series(from.clone(), curve.iter().skip(1).map(drawn).collect());
        let band = reported(curve[0].0).iter().map(drawn);
        [
            error,
            series(format!("standard deviation {from}"), band.collect()),
        ]
    });
    let some = some.filter(|s| !s.points.is_empty());
    let worst = curves.iter().map(|curve| {
        let most = curve.iter().map(|(_, e)| *e).fold(0.0, f64::max);
        drawn(&(curve[0].0, most))
    });
    let expected = curves.iter().filter_map(|curve| {
        let end = curve.last()?.0;
        let known = reported(curve[0].0).iter().rev();
        let last = known.filter(|(t, _)| *t <= end).map(|(_, d)| *d).next()?;
        Some(drawn(&(curve[0].0, last)))
    });
    let expected = series("standard deviation", expected.collect());
    let mut largest = vec![series("by time of prediction", worst.collect())];
    largest.extend((!expected.points.is_empty()).then_some(expected));
    Some(Figure {
        title: "Error of the predicted attitude".into(),
        x_label: "time [s]".into(),
        panels: vec![
            Panel {
                y_label: "error [deg]".into(),
                series: some.collect(),
                log: true,
                ..Panel::default()
            },
            Panel {
                y_label: "largest error [deg]".into(),
                series: largest,
                log: true,
                ..Panel::default()
            },
        ],
        ..Figure::default()
    })
}

/// Angles \[rad\] over time \[ns\] between the predicted rotation since the first pose and the true one. Both are
/// rotations in the world, so the choice of body axes in the estimate does not matter.
fn deviation(
    prediction: &RecordedPrediction,
    R_WC: &UnitQuaternion<f64>,
    truth: &[Turning],
) -> Vec<(i64, f64)> {
    let pairs = prediction.R_CB.iter().filter_map(|(time, R_CB)| {
        let R_WT = attitude_at(truth, *time)?;
        Some((*time, R_WC * R_CB, R_WT))
    });
    let pairs: Vec<_> = pairs.collect();
    let Some((_, predicted_start, true_start)) = pairs.first().copied() else {
        return Vec::new();
    };
    let angle = |(time, predicted, actual): &(i64, _, _)| {
        let predicted: UnitQuaternion<f64> = predicted / predicted_start;
        let actual: UnitQuaternion<f64> = actual / true_start;
        (*time, predicted.angle_to(&actual))
    };
    pairs.iter().map(angle).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiments::masutani_ch3::TumblingMotion;

    const SECOND: i64 = 1_000_000_000;

    /// A prediction in the axes of a rotated camera and with other body axes has no error; one that rotates 1 % too
    /// fast has an error of 1 % of the rotation.
    #[test]
    fn deviations_do_not_depend_on_axes() {
        let spin = |t: f64| UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.2, 0.1) * t);
        let truth: Vec<_> = (0..=40)
            .map(|i| Turning {
                time: i * SECOND / 4,
                R_WB: spin(0.25 * i as f64),
                w_WB_W: Vector3::zeros(),
            })
            .collect();
        let R_WC = UnitQuaternion::from_euler_angles(0.3, -1.0, 2.0);
        let body = UnitQuaternion::from_euler_angles(1.0, 0.2, -0.4);
        let prediction = |pace: f64| RecordedPrediction {
            time: 2 * SECOND,
            R_CB: (2..=8)
                .map(|i| (i * SECOND, R_WC.inverse() * spin(pace * i as f64) * body))
                .collect(),
        };
        let exact = deviation(&prediction(1.0), &R_WC, &truth);
        assert_eq!(exact.len(), 7);
        assert!(exact.iter().all(|(_, e)| *e < 1e-7), "{exact:?}");
        let fast = deviation(&prediction(1.01), &R_WC, &truth);
        let expected = 0.01 * 6.0 * 0.05f64.sqrt();
        assert!((fast[6].1 - expected).abs() < 1e-7, "{fast:?} {expected}");
    }

    /// The closed form of `|w|²` computed from a message equals that of the motion.
    #[test]
    fn squared_rates_follow_the_motion() {
        let truth = TumblingMotion {
            e: 0.5,
            s: 0.2,
            s_alpha: 0.4,
            beta: 0.8,
        };
        let truth = truth.rotation().unwrap();
        let stated = 3.0;
        let motion = RecordedMotion {
            time: 3 * SECOND,
            J: truth.parameters().unwrap().J(),
            alpha: truth.alpha(),
            phase: truth.phase_at(stated),
            momentum_direction: Vector3::z(),
            w_C: truth.angular_velocity(stated),
            deviations: Vec::new(),
        };
        for i in 0..20 {
            let found = motion.squared_rate(i * SECOND);
            let exact = truth.angular_velocity(i as f64).norm_squared();
            assert!((found - exact).abs() < 1e-9, "{i}: {found} {exact}");
        }
    }
}
