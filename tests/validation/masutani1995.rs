//! The thesis's pipeline against an independent implementation of it (Python, numpy and scipy): three motions with
//! every intermediate value, from true angular velocities, from true rotations and from images.
//!
//! The files give inputs to 12 decimals, and that is what the tolerances allow for: values agree to 1e-9, what an
//! iteration found to 1e-8, angles of a prediction, which amplifies them, to 1e-6 degrees. A stamp, a divisor
//! or an interpolation done differently shows at 1e-4 or more.

use fuyu::estimation::evaluation::{parameter_error, prediction_error};
use fuyu::estimation::free_body::FreeRotation;
use fuyu::estimation::masutani1995::{
    Analysis, Fit, Options, Rate, from_tracks, mean_rate, rates_from_tracks,
};
use fuyu::estimation::{Feature, FeatureFrame, Tracks};
use fuyu::vision::Pinhole;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use serde_json::Value;

use crate::fixtures::{matrix3, numbers, rows, vector};

const FILES: [&str; 3] = [
    include_str!("fixtures/pliers_r1024.json"),
    include_str!("fixtures/e050_s+03_r1024.json"),
    include_str!("fixtures/e080_s+04_r256.json"),
];

/// One of the files.
struct Case {
    data: Value,
    truth: FreeRotation,
}

fn quaternion(value: &[f64]) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::new(value[0], value[1], value[2], value[3]))
}

impl Case {
    fn all() -> Vec<Self> {
        FILES.iter().map(|text| Self::new(text)).collect()
    }

    fn new(text: &str) -> Self {
        let data: Value = serde_json::from_str(text).unwrap();
        let truth = &data["truth"];
        let J = Matrix3::from_diagonal(&vector(&truth["J"]));
        let R_CB = quaternion(&numbers(&truth["q0_body_to_camera"]));
        let truth = FreeRotation::new(&J, R_CB, &vector(&truth["omega0_body"]), 0.0).unwrap();
        Self { data, truth }
    }

    fn interval(&self) -> f64 {
        self.data["dt"].as_f64().unwrap()
    }

    fn true_rates(&self) -> Vec<Rate> {
        let w = self.data["omega_true_camera"].as_array().unwrap();
        let stamped = w.iter().enumerate();
        // As many as there are intervals.
        stamped
            .take(w.len() - 1)
            .map(|(i, w)| (self.interval() * i as f64, vector(w)))
            .collect()
    }

    fn rates_of_true_rotations(&self) -> Vec<Rate> {
        let frames = self.data["n_frames"].as_u64().unwrap();
        let at = |i: u64| {
            let time = self.interval() * i as f64;
            (time, self.truth.attitude(time))
        };
        (1..frames).map(|i| mean_rate(at(i - 1), at(i))).collect()
    }

    fn camera(&self) -> Pinhole {
        Pinhole::square(self.data["camera"]["res"].as_u64().unwrap() as u32, 1.25)
    }

    fn tracks(&self) -> Tracks {
        let frames = self.data["pixel_index"].as_array().unwrap();
        let feature = |(id, p): (usize, &Vec<f64>)| Feature {
            id: id as u64,
            u: p[0],
            v: p[1],
        };
        let sightings = frames.iter().enumerate().map(|(i, frame)| FeatureFrame {
            time: self.interval() * i as f64,
            features: rows(frame).iter().enumerate().map(feature).collect(),
        });
        Tracks::new(sightings).unwrap()
    }

    /// Compares every intermediate value of one run with the file's.
    fn compare(&self, key: &str, rates: &[Rate]) {
        let name = &self.data["name"];
        let expected = &self.data["expected"][key];
        let close = |what: &str, got: f64, tolerance: f64| {
            let expected = expected[what].as_f64().expect(what);
            let error = (got - expected).abs();
            assert!(
                error < tolerance,
                "{name} {key} {what}: {got}, expected {expected}"
            );
        };
        let options = Options {
            aperiodic: false,
            ..Options::default()
        };
        let analysis = Analysis::new(rates, &options).unwrap();
        close("alpha", analysis.plane.alpha, 1e-9);
        close("sigma_n", analysis.plane.scatter, 1e-9);
        close("sigma_v", analysis.scatter, 1e-9);
        close("T", analysis.spectrum.period, 1e-8);
        close("kappa", analysis.spectrum.bin as f64, 0.1);
        close("rival", analysis.spectrum.rival, 1e-9);
        let normal = analysis.plane.normal.into_inner();
        assert!((normal - vector(&expected["n"])).norm() < 1e-9);

        let (estimate, fit) = analysis.solve(rates, &options).unwrap();
        let model = match fit {
            Fit::Asymmetric {
                waveform,
                precession,
            } => {
                close("beta", waveform.beta, 1e-8);
                close("gamma", waveform.gamma(), 1e-8);
                close("k", waveform.k, 1e-8);
                close("rms", waveform.rms, 1e-9);
                close("t_delta", estimate.reference_time(), 1e-7);
                close("A", precession.rate, 1e-9);
                "asym"
            }
            Fit::Axisymmetric(precession) => {
                close("beta", analysis.spectrum.mean, 1e-9);
                close("A", precession.rate, 1e-9);
                let parameters = estimate.rotation().parameters().unwrap();
                close("lam", parameters.lambda(), 1e-9);
                "axi"
            }
            _ => panic!("{name} {key}: {fit:?}"),
        };
        assert_eq!(expected["model"], model, "{name} {key}");
        let J = estimate.J().unwrap();
        assert!(
            (J - vector(&expected["J"])).norm() < 2e-8,
            "{name} {key}: {J}"
        );

        close("r", parameter_error(&estimate, &self.truth).unwrap(), 1e-8);
        let times = numbers(&self.data["t_pred"]);
        let (start, end) = (times[0], times[times.len() - 1]);
        let error = prediction_error(
            estimate.rotation(),
            &self.truth,
            start,
            end - start,
            times.len() as u32,
        );
        close("Theta_deg", error.attitude.to_degrees(), 1e-6);
        close("Phi_deg", error.axis.to_degrees(), 1e-6);
    }
}

/// (2.9) and the attitude (2.16)-(2.23), the polhode, the herpolhode (2.25), and the parameters of the wave.
#[test]
fn the_true_motions_are_those_of_the_files() {
    for case in Case::all() {
        let truth = &case.data["truth"];
        let parameters = case.truth.parameters().unwrap();
        for (key, got) in [
            ("alpha", parameters.alpha()),
            ("lam", parameters.lambda()),
            ("k", parameters.modulus().k()),
            ("T", parameters.period()),
            ("beta", parameters.beta()),
            ("gamma", parameters.gamma()),
        ] {
            let expected = truth[key].as_f64().unwrap();
            // J and the rates have 12 decimals; near the separatrix T magnifies them.
            assert!((got - expected).abs() < 1e-8, "{key}: {got} {expected}");
        }
        let closed = &truth["closed_form"];
        let reference = |i: usize| matrix3(&closed["R_ref_body"][i]);
        let R_CR = case
            .truth
            .solution_attitude(0.0)
            .to_rotation_matrix()
            .into_inner()
            * reference(0).transpose();
        for (i, t) in numbers(&closed["t"]).into_iter().enumerate() {
            let w = case.truth.principal_rates(t).unwrap();
            assert!(
                (w - vector(&closed["omega_body"][i])).norm() < 1e-9,
                "{t}: {w}"
            );
            let R_CB = case.truth.solution_attitude(t).to_rotation_matrix();
            assert!((R_CB.matrix() - R_CR * reference(i)).norm() < 1e-9, "{t}");
            let herpolhode = parameters.herpolhode(&w);
            let rate = closed["chidot"][i].as_f64().unwrap();
            assert!(
                (herpolhode.angle_rate - rate).abs() < 1e-9,
                "{t}: {herpolhode:?}"
            );
            let radius = (w.norm_squared() - parameters.alpha().recip()).sqrt();
            assert!(
                (herpolhode.radius - radius).abs() < 1e-12,
                "{t}: {herpolhode:?}"
            );
        }
        for (t, w) in case.true_rates() {
            assert!((case.truth.angular_velocity(t) - w).norm() < 1e-9, "{t}");
        }
        let ahead = rows(&case.data["q_true_pred"]);
        for (t, q) in numbers(&case.data["t_pred"]).into_iter().zip(&ahead) {
            let error = case.truth.attitude(t).angle_to(&quaternion(q));
            // Seven periods near the separatrix magnify the start's twelve digits.
            assert!(error < 1e-8, "at {t}: {error:e}");
        }
    }
}

#[test]
fn true_angular_velocities_give_what_the_files_say() {
    for case in Case::all() {
        case.compare("thesis_from_true_omega", &case.true_rates());
    }
}

#[test]
fn true_rotations_give_what_the_files_say() {
    for case in Case::all() {
        let rates = case.rates_of_true_rotations();
        let first = case.data["expected"]["true_rot_rate_first5"].as_array();
        for ((_, w), expected) in rates.iter().zip(first.unwrap()) {
            assert!((w - vector(expected)).norm() < 1e-10);
        }
        case.compare("thesis_from_true_R", &rates);
    }
}

#[test]
fn images_give_what_the_files_say() {
    for case in Case::all() {
        let tracks = case.tracks();
        let rates = rates_from_tracks(&tracks, &case.camera()).unwrap();
        let first = case.data["expected"]["weng_omega_first5"].as_array();
        for ((_, w), expected) in rates.iter().zip(first.unwrap()) {
            assert!((w - vector(expected)).norm() < 1e-10);
        }
        case.compare("thesis_from_images", &rates);
    }
}

/// From tracks to a prediction in one call. A frame without features leaves a gap, which is bridged: without the gap
/// the attitude errs by 12.06 degrees.
#[test]
fn tracks_give_an_estimate_that_survives_an_empty_frame() {
    let case = Case::new(FILES[1]);
    let mut sightings = case.tracks().frames().to_vec();
    sightings[300].features.clear();
    let tracks = Tracks::new(sightings).unwrap();
    let estimate = from_tracks(&tracks, &case.camera(), &Options::default()).unwrap();
    assert_eq!(estimate.model().name(), "asymmetric");
    let error = prediction_error(estimate.rotation(), &case.truth, 360.0, 30.0, 101);
    assert!(error.attitude.to_degrees() < 12.5, "{error:?}");
}

/// A swing through the separatrix, which chapter 3 leaves out: half a period in the window is enough for the
/// aperiodic model, and its attitude needs no moments.
#[test]
fn an_aperiodic_motion_is_estimated() {
    let I_B = Matrix3::from_diagonal(&Vector3::new(3.0, 2.0, 1.0));
    // As in free_body_closed_form: exactly L² = 2 E I_y; fastest after some 50 s.
    let w_B = Vector3::new(0.008, -0.05, 0.008 * 3f64.sqrt());
    let R_CB = UnitQuaternion::from_euler_angles(0.4, -0.9, 2.1);
    let truth = FreeRotation::new(&I_B, R_CB, &w_B, 0.0).unwrap();
    let rates: Vec<Rate> = (0..300)
        .map(|i| 0.5 * f64::from(i))
        .map(|t| (t, truth.angular_velocity(t)))
        .collect();
    let analysis = Analysis::new(&rates, &Options::default()).unwrap();
    assert_eq!(analysis.model.name(), "aperiodic");
    let (estimate, _) = analysis.solve(&rates, &Options::default()).unwrap();
    assert_eq!(estimate.J(), None);
    assert!((estimate.alpha() / truth.alpha() - 1.0).abs() < 1e-9);
    assert!(estimate.rms() < 1e-7, "{}", estimate.rms());
    let error = prediction_error(estimate.rotation(), &truth, 150.0, 30.0, 101);
    assert!(error.attitude < 1e-5, "{error:?}");
}

/// A motion about one axis, under a clock that counts from 1970: no digit of the phase may be lost to it.
#[test]
fn a_spin_is_estimated_at_any_time_of_day() {
    let w = Vector3::new(0.1, -0.2, 0.4);
    let rates: Vec<Rate> = (0..100).map(|i| (1.79e9 + 0.5 * f64::from(i), w)).collect();
    let analysis = Analysis::new(&rates, &Options::default()).unwrap();
    assert_eq!(analysis.model.name(), "single_axis");
    let (estimate, _) = analysis.solve(&rates, &Options::default()).unwrap();
    let later = estimate.attitude(1.79e9 + 80.0) / estimate.attitude(1.79e9 + 50.0);
    let expected = UnitQuaternion::from_scaled_axis(w * 30.0);
    assert!(later.angle_to(&expected) < 1e-9);
}

/// What each wrong input is answered with; none may panic, hang or give NaN.
#[test]
fn wrong_input_is_answered_clearly() {
    let camera = Case::new(FILES[1]).camera();
    let good = Case::new(FILES[1]).tracks().frames()[..40].to_vec();
    let answer = |sightings: Vec<FeatureFrame>| match Tracks::new(sightings) {
        Err(error) => error.to_string(),
        Ok(tracks) => from_tracks(&tracks, &camera, &Options::default())
            .map(|_| String::from("an estimate"))
            .unwrap_or_else(|error| error.to_string()),
    };
    let changed = |change: &dyn Fn(usize, &mut FeatureFrame)| {
        let mut sightings = good.clone();
        for (i, sighting) in sightings.iter_mut().enumerate() {
            change(i, sighting);
        }
        answer(sightings)
    };
    let few = changed(&|_, s| s.features.truncate(7));
    assert!(few.contains("7 points in common; at least 8"), "{few}");
    let line = changed(&|i, s| {
        for f in &mut s.features {
            (f.u, f.v) = (40.0 * f.id as f64 + i as f64, 30.0 * f.id as f64 + 50.0);
        }
    });
    assert!(line.contains("lie on a line"), "{line}");
    let still = good[0].features.clone();
    let constant = changed(&|_, s| s.features.clone_from(&still));
    assert!(constant.contains("no point moved"), "{constant}");
    let nan = changed(&|i, s| s.features[3].u = if i == 20 { f64::NAN } else { 5.0 });
    assert!(nan.contains("frame 20 at 12 s: feature 3"), "{nan}");
    let backwards = changed(&|i, s| s.time = if i == 8 { 0.1 } else { s.time });
    assert!(backwards.contains("times must increase"), "{backwards}");
    assert!(answer(vec![]).contains("empty"));
    let alone = answer(good[..1].to_vec());
    assert!(alone.contains("fewer than two frames"), "{alone}");
    let short = answer(good[..5].to_vec());
    assert!(short.contains("there are 4 angular velocities"), "{short}");

    let rates = |rates: &[Rate]| match Analysis::new(rates, &Options::default()) {
        Ok(_) => String::from("an analysis"),
        Err(error) => error.to_string(),
    };
    let at = |i: usize| (i as f64, Vector3::new(0.1, 0.0, 0.01 * i as f64));
    let some: Vec<Rate> = (0..20).map(at).collect();
    assert_eq!(rates(&some), "an analysis");
    assert!(rates(&[]).contains("there are 0 angular velocities"));
    let mut wrong = some.clone();
    wrong[7].1.y = f64::INFINITY;
    assert!(rates(&wrong).contains("sample 7"));
    wrong = some.clone();
    wrong[7].0 = 3.0;
    assert!(rates(&wrong).contains("sample 7: time is 3 s, but the sample before is at 6 s"));
    let still: Vec<Rate> = (0..20).map(|i| (f64::from(i), Vector3::zeros())).collect();
    assert!(rates(&still).contains("does not turn"));
}
