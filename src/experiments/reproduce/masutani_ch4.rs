//! Masutani 1995, chapter 4: manipulability with and without a fixed base.

use std::f64::consts::{PI, TAU};

use super::Report;
use crate::experiments::masutani_ch6::{LINK, Planar};
use crate::experiments::{PlaneFigure, Series};

/// Velocity ellipses of both Jacobians over the workspace, elbow on one side.
pub(super) fn fig_4_5(mut report: Report) -> Report {
    /// Length of a drawn velocity of 1 m/s [m].
    const SCALE: f64 = 0.07;
    let mut planar = Planar::with_mass_ratio(20.0);
    let mut curves = [Vec::new(), Vec::new()];
    for i in 0..12 {
        for j in 0..4 {
            let q = [TAU * f64::from(i) / 12.0, PI * (0.15 + 0.22 * f64::from(j))];
            let [x, y] = planar.tip_at(q);
            for (curve, jacobian) in curves.iter_mut().zip(planar.jacobians(q)) {
                curve.extend((0..=48).map(|k| {
                    let (sin, cos) = (TAU * f64::from(k) / 48.0).sin_cos();
                    let v = jacobian * nalgebra::Vector2::new(cos, sin) * SCALE;
                    (x + v.x, y + v.y)
                }));
                curve.push((f64::NAN, f64::NAN));
            }
        }
    }
    let Comparison {
        near,
        far,
        worse,
        longest,
    } = compare(&mut planar);
    report.holds(
        "difference of the Jacobians, mean of |J - Ĵ|/|J|, outer half of the reach over the inner: above 1",
        far / near,
        far > near,
    );
    report.holds(
        "longest half-axis with a floating base over that with a fixed one, largest anywhere: below 1",
        longest,
        longest < 1.0,
    );
    report.holds(
        "part of the tip's area where manipulability is less with a floating base: above 0.98",
        worse,
        worse > 0.98,
    );
    report.note(&format!(
        "The text: the farther the tip is from the base, the larger is the difference of the two Jacobians \
         ({near:.3} within half of the reach, {far:.3} beyond); and the floating arm moves its tip less easily in the \
         whole workspace. By the area of the ellipse that is not so where the arm is folded or stretched, since a \
         floating base is singular elsewhere than a fixed one. The parameters of Fig. 4.4 are not printed. They are taken to be Table 6.2's arm on a \
         base of mass ratio 20."
    ));
    let [fixed, floating] = curves;
    let series = |name: &str, points| Series {
        name: name.to_owned(),
        points,
    };
    let figure = PlaneFigure {
        title: "Masutani 1995 Fig. 4.5: velocities of the tip for unit joint rates".to_owned(),
        x_label: "x [m]".to_owned(),
        y_label: "y [m]".to_owned(),
        series: vec![series("fixed base", fixed), series("floating", floating)],
        ..PlaneFigure::default()
    };
    report.planes.push(("masutani-fig-4.5".to_owned(), figure));
    report
}

/// Statistics of the ellipses.
struct Comparison {
    /// Mean relative difference of the Jacobians in the inner half of the tip's distances from the base, weighted by
    /// area.
    near: f64,
    /// Mean relative difference in the outer half.
    far: f64,
    /// Fraction of the tip's area where the manipulability is lower with a floating base.
    worse: f64,
    /// Largest ratio of the longest semi-axes.
    longest: f64,
}

fn compare(planar: &mut Planar) -> Comparison {
    const N: u32 = 90;
    let (mut sums, mut worse, mut longest) = ([(0.0, 0.0); 2], 0.0, 0f64);
    for i in 0..N {
        for j in 0..N {
            let q = [i, j].map(|k| (f64::from(k) + 0.5) / f64::from(N));
            let q = [TAU * q[0], PI * q[1]];
            let [x, y] = planar.tip_at(q);
            let [fixed, floating] = planar.jacobians(q);
            let weight = q[1].sin();
            let outer = usize::from(x.hypot(y) > 0.5 * (planar.mount + 2.0 * LINK));
            sums[outer].0 += weight * (fixed - floating).norm() / fixed.norm();
            sums[outer].1 += weight;
            if floating.determinant().abs() < fixed.determinant().abs() {
                worse += weight;
            }
            let axes = [floating, fixed].map(|m| m.singular_values().max());
            longest = longest.max(axes[0] / axes[1]);
        }
    }
    Comparison {
        near: sums[0].0 / sums[0].1,
        far: sums[1].0 / sums[1].1,
        worse: worse / (sums[0].1 + sums[1].1),
        longest,
    }
}
