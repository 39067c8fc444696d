//! trial
use crate::fixtures::{numbers, rows, vector};
use fuyu::estimation::masutani1995::*;
use fuyu::estimation::{Feature, Sighting, Tracks};
use fuyu::vision::Pinhole;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde_json::Value;

#[test]
fn trial() {
    for text in [
        include_str!("fixtures/pliers_r1024.json"),
        include_str!("fixtures/e050_s+03_r1024.json"),
        include_str!("fixtures/e080_s+04_r256.json"),
    ] {
        let data: Value = serde_json::from_str(text).unwrap();
        println!("==== {}", data["name"]);
        let dt = 0.6;
        let w: Vec<_> = data["omega_true_camera"]
            .as_array()
            .unwrap()
            .iter()
            .map(vector)
            .collect();
        let options = Options {
            aperiodic: false,
            ..Options::default()
        };
        let res = data["camera"]["res"].as_f64().unwrap();
        let camera = Pinhole::square(res as u32, 1.25);
        let sightings = data["pixel_index"]
            .as_array()
            .unwrap()
            .iter()
            .enumerate()
            .map(|(i, f)| {
                let features = rows(f)
                    .iter()
                    .enumerate()
                    .map(|(k, p)| Feature {
                        id: k as u64,
                        u: p[0],
                        v: p[1],
                    })
                    .collect();
                Sighting {
                    time: dt * i as f64,
                    features,
                }
            });
        let tracks = Tracks::new(sightings).unwrap();
        let images = rates_from_tracks(&tracks, &camera).unwrap();
        for n in [600, 601] {
            let rates: Vec<Rate> = w
                .iter()
                .take(n)
                .enumerate()
                .map(|(i, w)| (dt * i as f64, *w))
                .collect();
            show(&data, "thesis_from_true_omega", &rates, &options);
        }
        for (r, e) in images
            .iter()
            .zip(data["expected"]["weng_omega_first5"].as_array().unwrap())
        {
            println!("{:e}", (r.1 - vector(e)).norm());
        }
        show(&data, "thesis_from_images", &images, &options);
    }
}

fn show(data: &Value, key: &str, rates: &[Rate], options: &Options) {
    let e = &data["expected"][key];
    let a = Analysis::new(rates, options).unwrap();
    println!("{key} n {}", rates.len());
    let p = |name: &str, got: f64| {
        println!(
            "   {name} {got} {} {:e}",
            e[name],
            got - e[name].as_f64().unwrap_or(0.0)
        )
    };
    p("alpha", a.plane.alpha);
    p("sigma_n", a.plane.scatter);
    p("sigma_v", a.scatter);
    p("T", a.spectrum.period);
    p("kappa", a.spectrum.bin as f64);
    p("rival", a.spectrum.rival);
    println!("  {} {}", a.model.name(), e["model"]);
    println!(
        "n {:e}",
        (vector(&e["n"]) - a.plane.normal.into_inner()).norm()
    );
    let (m, fit) = match a.solve(rates, options) {
        Ok(x) => x,
        Err(e) => {
            println!("{e}");
            return;
        }
    };
    match fit {
        Fit::Asymmetric {
            waveform,
            precession,
        } => {
            p("beta", waveform.beta);
            p("gamma", waveform.gamma());
            p("k", waveform.k);
            p("t_delta", m.reference_time());
            p("A", precession.rate);
            p("rms", waveform.rms);
        }
        Fit::Axisymmetric(precession) => {
            p("A", precession.rate);
            p("beta", a.spectrum.mean);
        }
        _ => {}
    }
    println!("J {:?} {}", m.J().unwrap(), e["J"]);
    let times = numbers(&data["t_pred"]);
    let truth: Vec<_> = rows(&data["q_true_pred"])
        .iter()
        .map(|q| UnitQuaternion::new_normalize(Quaternion::new(q[0], q[1], q[2], q[3])))
        .collect();
    let mut worst = (0f64, 0f64);
    for (t, q) in times.iter().zip(&truth) {
        let d_true = q * truth[0].inverse();
        let d = m.attitude(*t) * m.attitude(times[0]).inverse();
        worst.0 = worst.0.max(d.angle_to(&d_true));
        let z0 = m.attitude(times[0]) * Vector3::z();
        let z = m.attitude(*t) * Vector3::z();
        worst.1 = worst.1.max(z.angle(&(d_true * z0)));
    }
    p("Theta_deg", worst.0.to_degrees());
    p("Phi_deg", worst.1.to_degrees());
}
