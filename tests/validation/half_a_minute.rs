//! Motions that half a minute of whole pixels cannot distinguish: two bodies
//! that agree with every pixel, but whose predictions for the next half minute differ.
//!
//! A sphere of 20 points turns about its centre, as in chapter 3 of Masutani 1995, but only 51 frames are seen. The
//! images only tell in which pixel each point is. From the true body, the search moves to the centre of the set of bodies
//! that agree with all pixels, and from there in both directions along which the prediction changes most, as long as every
//! point stays in its pixel. It uses Newton's method on high powers of the residuals, and no code of the estimator.

use std::f64::consts::PI;

use nalgebra::{DMatrix, DVector, Matrix2, Matrix3x2, SMatrix, UnitQuaternion, Vector2, Vector3};

use crate::tumbling::{Motion, View, prediction_errors};

/// End of the observation and of the prediction \[s\].
const SEEN: f64 = 30.0;
const PREDICTED: f64 = 60.0;

/// Unknowns of the motion: ratios of moments (2), rates (3), attitude (3); and of the centre: where it starts across
/// the line of sight (2), and how it drifts (3). Its distance is the unit of length.
const MOTION: usize = 8;
const CENTRE: usize = 5;

/// Exponent of the residuals. With such a high power the cost is nearly flat inside a pixel, as the likelihood of rounding is.
const POWER: i32 = 120;

/// A candidate body.
#[derive(Clone)]
struct Body {
    motion: Motion,
    start: Vector3<f64>,
    drift: Vector3<f64>,
    points: Vec<Vector3<f64>>,
}

impl Body {
    fn moved(&self, step: &DVector<f64>) -> Self {
        let at = |k: usize| Vector3::new(step[k], step[k + 1], step[k + 2]);
        let mut next = self.clone();
        next.motion = self.turned(&step.fixed_rows::<MOTION>(0).into_owned());
        next.start += Vector3::new(step[MOTION], step[MOTION + 1], 0.0);
        next.drift += at(MOTION + 2);
        for (j, p) in next.points.iter_mut().enumerate() {
            *p += at(MOTION + CENTRE + 3 * j);
        }
        next
    }

    fn turned(&self, step: &SMatrix<f64, MOTION, 1>) -> Motion {
        let mut motion = self.motion;
        motion.J.x *= step[0].exp();
        motion.J.y *= step[1].exp();
        motion.w_B += step.fixed_rows::<3>(2);
        motion.R_WB *= UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(5).into_owned());
        motion
    }
}

/// What was seen: times, and of each point the pixel in each frame.
struct Images {
    view: View,
    times: Vec<f64>,
    pixels: Vec<Vec<Vector2<f64>>>,
}

impl Images {
    fn new(view: View, motion: &Motion) -> Self {
        let tracks = view.tracks(motion, &view.sphere());
        let frames = tracks.frames();
        let pixel = |i: usize, j: u64| {
            let f = frames[i].feature(j).unwrap();
            Vector2::new(f.u, f.v)
        };
        let points = view.points as u64;
        Self {
            times: frames.iter().map(|s| s.time).collect(),
            pixels: (0..frames.len())
                .map(|i| (0..points).map(|j| pixel(i, j)).collect())
                .collect(),
            view,
        }
    }

    /// By how much each coordinate is off its pixel's middle \[px\].
    fn residuals(&self, body: &Body) -> DVector<f64> {
        let attitudes = body.motion.attitudes(&self.times);
        let mut out = Vec::new();
        for ((R, t), pixels) in attitudes.iter().zip(&self.times).zip(&self.pixels) {
            for (p, pixel) in body.points.iter().zip(pixels) {
                let x = R * p + body.start + body.drift * *t;
                let [u, v] = self.view.camera.project(&x).unwrap_or([f64::INFINITY; 2]);
                out.extend([u - pixel.x, v - pixel.y]);
            }
        }
        DVector::from_vec(out)
    }

    /// Their derivatives: by the motion from differences.
    fn slopes(&self, body: &Body) -> DMatrix<f64> {
        let points = body.points.len();
        let rows = 2 * points * self.times.len();
        let mut J = DMatrix::zeros(rows, MOTION + CENTRE + 3 * points);
        let h = 1e-6;
        for k in 0..MOTION {
            let mut up = body.clone();
            let mut down = body.clone();
            let mut step = SMatrix::<f64, MOTION, 1>::zeros();
            step[k] = h;
            up.motion = body.turned(&step);
            down.motion = body.turned(&-step);
            let slope = (self.residuals(&up) - self.residuals(&down)) / (2.0 * h);
            J.set_column(k, &slope);
        }
        let camera = &self.view.camera;
        let attitudes = body.motion.attitudes(&self.times);
        for (i, (R, t)) in attitudes.iter().zip(&self.times).enumerate() {
            for (j, p) in body.points.iter().enumerate() {
                let x = R * p + body.start + body.drift * *t;
                #[rustfmt::skip]
                let by_x = SMatrix::<f64, 2, 3>::new(
                    camera.fx / x.z, 0.0, -camera.fx * x.x / (x.z * x.z),
                    0.0, camera.fy / x.z, -camera.fy * x.y / (x.z * x.z),
                );
                let row = 2 * (i * points + j);
                J.fixed_view_mut::<2, 2>(row, MOTION)
                    .copy_from(&by_x.fixed_columns::<2>(0));
                J.fixed_view_mut::<2, 3>(row, MOTION + 2)
                    .copy_from(&(by_x * *t));
                J.fixed_view_mut::<2, 3>(row, MOTION + CENTRE + 3 * j)
                    .copy_from(&(by_x * R.to_rotation_matrix().matrix()));
            }
        }
        J
    }
}

/// Predicted direction of `axis`, as a deviation in the two directions perpendicular to its true direction \[rad\].
fn predicted(motion: &Motion, axis: &Vector3<f64>, across: &Matrix3x2<f64>) -> Vector2<f64> {
    let R = motion.attitudes(&[SEEN, PREDICTED]);
    across.tr_mul(&(R[1] * R[0].inverse() * axis))
}

/// The body with the least `- pull wish·x + Σ (2 r)^power`: without pull the centre of the bodies that agree with
/// the pixels, with a large pull one at their boundary in the direction `wish`. Also returns the curvature of the cost.
fn push(
    images: &Images,
    from: &Body,
    wish: &DVector<f64>,
    pull: f64,
    power: i32,
) -> (Body, DMatrix<f64>) {
    let mut body = from.clone();
    let cost = |r: &DVector<f64>, along: f64| {
        r.iter().map(|r| (2.0 * r).powi(power)).sum::<f64>() - pull * along
    };
    let mut H = DMatrix::zeros(wish.len(), wish.len());
    let n = f64::from(power);
    for _ in 0..12 {
        let (r, J) = (images.residuals(&body), images.slopes(&body));
        let now = cost(&r, 0.0);
        let slope = r.map(|r| 2.0 * n * (2.0 * r).powi(power - 1));
        let curvature = r.map(|r| 4.0 * n * (n - 1.0) * (2.0 * r).powi(power - 2));
        let mut weighted = J.clone();
        for (mut row, c) in weighted.row_iter_mut().zip(&curvature) {
            row *= *c;
        }
        H = J.tr_mul(&weighted);
        for k in 0..H.nrows() {
            H[(k, k)] *= 1.0 + 1e-9;
        }
        let gradient = J.tr_mul(&slope) - wish * pull;
        let Some(factor) = H.clone().cholesky() else {
            break;
        };
        let step = -factor.solve(&gradient);
        let promised = -gradient.dot(&step);
        let mut parts = (0..12).map(|k| 0.5f64.powi(k));
        let lower = parts.find_map(|part| {
            let tried = body.moved(&(&step * part));
            let reached = cost(&images.residuals(&tried), part * wish.dot(&step));
            (reached < now).then_some(tried)
        });
        let Some(next) = lower else { break };
        body = next;
        if promised < 1e-2 {
            break;
        }
    }
    (body, H)
}

/// Two bodies that all pixels fit, and by how much their predictions differ \[deg\].
fn farthest_apart(e: f64, s_alpha: f64, seed: u64) -> f64 {
    let view = View {
        duration: SEEN,
        seed,
        ..View::chapter_3(1024)
    };
    let truth = Motion::new(e, 0.0, s_alpha, 0.8, Vector3::z());
    let body = Body {
        motion: truth,
        start: Vector3::new(0.0, 0.0, view.distance),
        drift: Vector3::zeros(),
        points: view.sphere(),
    };
    let images = Images::new(view, &truth);
    let R = truth.attitudes(&[SEEN, PREDICTED]);
    let axis = R[0] * Vector3::z();
    let then = R[1] * Vector3::z();
    let aside = then.cross(&Vector3::ith(then.iamin(), 1.0)).normalize();
    let across = Matrix3x2::from_columns(&[aside, then.cross(&aside)]);
    let unknowns = MOTION + CENTRE + 3 * body.points.len();
    let none = DVector::zeros(unknowns);
    let mut middle = body;
    let mut H = DMatrix::zeros(unknowns, unknowns);
    for power in [4, 12, 40, POWER] {
        (middle, H) = push(&images, &middle, &none, 0.0, power);
    }
    let mut G = DMatrix::zeros(unknowns, 2);
    for k in 0..MOTION {
        let mut step = SMatrix::<f64, MOTION, 1>::zeros();
        step[k] = 1e-6;
        let up = predicted(&middle.turned(&step), &axis, &across);
        let down = predicted(&middle.turned(&-step), &axis, &across);
        G.fixed_view_mut::<1, 2>(k, 0)
            .copy_from(&((up - down) / 2e-6).transpose());
    }
    // The direction in which the ellipsoid of the barrier is widest.
    let spread = G.tr_mul(&H.cholesky().unwrap().solve(&G));
    let spread = Matrix2::from_iterator(spread.iter().copied()).symmetric_eigen();
    let widest = spread
        .eigenvectors
        .column(spread.eigenvalues.imax())
        .into_owned();
    let wish = &G * DVector::from_iterator(2, widest.iter().copied());
    let ends = [1.0, -1.0].map(|sign| {
        let (mut last, mut pull) = (middle.clone(), 100.0);
        loop {
            let next = push(&images, &last, &(&wish * sign), pull, POWER).0;
            if images.residuals(&next).amax() >= 0.5 || pull > 1e9 {
                return last;
            }
            (last, pull) = (next, 1.6 * pull);
        }
    });
    for body in &ends {
        // What is claimed, without Newton's method: each point is in its pixel in each frame.
        assert!(images.residuals(body).amax() < 0.5);
        assert!(body.motion.J.max() < body.motion.J.sum() - body.motion.J.max());
    }
    let phi = |a: &Body, b: &Body| {
        let times: Vec<f64> = (0..=100).map(|i| SEEN + 0.3 * f64::from(i)).collect();
        let attitudes = b.motion.attitudes(&times);
        let at = |t: f64| attitudes[((t - SEEN) / 0.3).round() as usize];
        prediction_errors(&a.motion, SEEN, at).1
    };
    let [a, b] = &ends;
    phi(a, b).min(phi(b, a))
}

/// Those of chapter 3's 294 motions, as (e, s_alpha), whose prediction from 30 s of images of 1024 px is wrong by more than
/// 0.1 degrees (`every_half_minute_is_predicted_or_left_open`).
pub const MISSED: [(f64, f64); 12] = [
    (0.9, 0.1),
    (0.9, 0.2),
    (0.9, 0.4),
    (0.9, 0.6),
    (0.9, 0.8),
    (0.95, -0.8),
    (0.95, -0.7),
    (0.95, -0.6),
    (0.95, -0.3),
    (0.95, 0.4),
    (0.95, 0.5),
    (0.95, 0.9),
];

/// The same about the middle axis: e of motions with s_alpha 0.
pub const MISSED_ABOUT_MIDDLE_AXIS: [f64; 4] = [0.4, 0.55, 0.6, 0.75];

/// The difference of the predictions for two bodies that all pixels fit \[deg\], if one of them rotates about its middle axis. The other
/// has other moments of inertia, which do not matter as long as it rotates about the same axis, and the largest angular velocity across that
/// axis with which every point stays in its pixel in each frame. It has left the axis half a minute later.
fn apart_from_middle_axis(e: f64) -> f64 {
    let view = View {
        duration: SEEN,
        ..View::chapter_3(1024)
    };
    let truth = Motion::new(e, 0.0, 0.0, 0.8, Vector3::z());
    let images = Images::new(view, &truth);
    let times: Vec<f64> = (0..=100).map(|i| SEEN + 0.3 * f64::from(i)).collect();
    let attitudes = truth.attitudes(&times);
    let at = |t: f64| attitudes[((t - SEEN) / 0.3).round() as usize];
    let along = truth.w_B.normalize();
    let slender = Motion::new(0.35, 0.0, 0.0, 0.8, Vector3::z());
    let mut farthest: f64 = 0.0;
    for turn in 0..8 {
        let aside = along.cross(&Vector3::ith(along.iamin(), 1.0)).normalize();
        let about = UnitQuaternion::from_scaled_axis(along * (PI / 8.0 * f64::from(turn)));
        let mut size = 0.1 * truth.w_B.norm();
        let other = loop {
            let mut motion = Motion {
                J: slender.J,
                ..truth
            };
            motion.w_B += about * aside * size;
            let body = Body {
                motion,
                start: Vector3::new(0.0, 0.0, images.view.distance),
                drift: Vector3::zeros(),
                points: images.view.sphere(),
            };
            if images.residuals(&body).amax() < 0.5 {
                break motion;
            }
            size *= 0.8;
        };
        farthest = farthest.max(prediction_errors(&other, SEEN, at).1);
    }
    farthest
}

/// Rotation about the middle axis, on the separatrix, is unstable.
#[test]
fn whole_pixels_of_half_a_minute_leave_rotation_about_the_middle_axis_open() {
    for e in MISSED_ABOUT_MIDDLE_AXIS {
        let apart = apart_from_middle_axis(e);
        println!("e {e}, s_alpha 0: {apart:.2} deg apart");
        assert!(apart > 0.2, "e {e}: {apart}");
    }
}

/// For nearly spherical bodies no estimate from these pixels can guarantee a prediction to 0.1 degrees: of two bodies that
/// agree with the images, every estimate misses at least one by half of their difference or more. The search uses the
/// images of the true body, which is one of many bodies that agree with them.
fn is_left_open((e, s_alpha): (f64, f64)) {
    let apart = farthest_apart(e, s_alpha, 1);
    println!("e {e}, s_alpha {s_alpha}: {apart:.2} deg apart");
    assert!(apart > 0.2, "e {e}, s_alpha {s_alpha}: {apart}");
}

/// For a less spherical body the pixels do determine the motion.
#[test]
fn whole_pixels_of_half_a_minute_leave_nearly_round_bodies_open() {
    for missed in [MISSED[0], MISSED[8]] {
        is_left_open(missed);
    }
    let apart = farthest_apart(0.5, 0.3, 1);
    println!("e 0.5, s_alpha 0.3: {apart:.2} deg apart");
    assert!((0.01..0.2).contains(&apart), "{apart}");
}

/// `cargo test --release --test validation is_left_open -- --ignored --nocapture`.
#[test]
#[ignore = "ten seconds"]
fn every_motion_that_half_a_minute_does_not_tell_is_left_open() {
    for missed in MISSED {
        is_left_open(missed);
    }
}
