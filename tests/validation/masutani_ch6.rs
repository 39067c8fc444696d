//! Masutani 1995 chapter 6, the fixed-base Jacobian as an approximation, against an independent reference
//! (`fixtures/masutani_ch6_spots.json`, `fixtures/masutani_ch6_runs.json`).

use fuyu::control::{JacobianKind, LinearisedLoop};
use fuyu::dynamics::{IntegrationMethod, Workspace};
use fuyu::experiments::masutani_ch6::{Example, Planar, STABLE, UNSTABLE, gains};
use nalgebra::DVector;
use serde_json::Value;

use crate::fixtures::numbers;

#[test]
fn jacobians_inertias_and_roots_are_those_of_the_reference() {
    let all: Value =
        serde_json::from_str(include_str!("fixtures/masutani_ch6_spots.json")).unwrap();
    for spot in all["ch6_spots"].as_array().unwrap() {
        let mut planar = Planar::with_mass_ratio(spot["ratio"].as_f64().unwrap());
        let q = numbers(&spot["q"]);
        let ours = planar.jacobians([q[0], q[1]]);
        for (name, ours) in ["J", "Jh"].into_iter().zip(ours) {
            for (r, row) in spot[name].as_array().unwrap().iter().enumerate() {
                for (c, theirs) in numbers(row).into_iter().enumerate() {
                    assert!((ours[(r, c)] - theirs).abs() < 1e-12, "{name} {r} {c}");
                }
            }
        }
        let near = LinearisedLoop::at(
            &planar.model,
            &mut Workspace::new(&planar.model),
            &planar.tip,
            &DVector::from_vec(q),
            &gains(0.1),
            JacobianKind::FixedBase,
        );
        for (r, row) in spot["Hh"].as_array().unwrap().iter().enumerate() {
            for (c, theirs) in numbers(row).into_iter().enumerate() {
                assert!((near.inertia[(r, c)] / theirs - 1.0).abs() < 1e-12);
            }
        }
        let roots = near.eigenvalues().unwrap();
        for theirs in spot["eig"].as_array().unwrap() {
            let theirs = numbers(theirs);
            let off =
                |root: &nalgebra::Complex<f64>| (root.re - theirs[0]).hypot(root.im - theirs[1]);
            let nearest = roots.iter().map(off).fold(f64::INFINITY, f64::min);
            assert!(nearest < 1e-9, "{theirs:?} {roots:?}");
        }
        let growth = near.growth_rate().unwrap();
        assert!((growth - spot["maxre"].as_f64().unwrap()).abs() < 1e-10);
    }
}

#[test]
fn the_unstable_part_of_the_workspace_shrinks_with_the_mass_ratio() {
    let published = [
        (0.5, 0.238),
        (1.0, 0.152),
        (2.0, 0.080),
        (5.0, 0.0247),
        (10.0, 0.0071),
        (20.0, 0.0016),
    ];
    for (ratio, published) in published {
        let mut planar = Planar::with_mass_ratio(ratio);
        let fraction = planar.unstable_fraction(&gains(0.1), 120);
        assert!((fraction - published).abs() < 0.002, "{ratio}: {fraction}");
    }
}

/// From mass ratio 2 on, the unstable region is where the two determinants have opposite signs: gains do not move it.
#[test]
fn gains_do_not_move_the_unstable_region() {
    let mut other = gains(0.1);
    other.k_p = 400.0;
    other.k_v = vec![500.0, 300.0];
    for ratio in [2.0, 5.0] {
        let mut planar = Planar::with_mass_ratio(ratio);
        let mut unstable = 0;
        for i in 0..60 {
            for j in 0..60 {
                let q = [0.1047 * f64::from(i) + 0.01, 0.0523 * f64::from(j) + 0.02];
                let [fixed, generalized] = planar.jacobians(q).map(|m| m.determinant());
                if (fixed * generalized).abs() < 1e-3 {
                    continue;
                }
                for gains in [&gains(0.1), &other] {
                    let growth = planar.growth_rate(q, gains, JacobianKind::FixedBase);
                    assert_eq!(growth > 0.0, fixed * generalized < 0.0, "{q:?} {growth}");
                    unstable += usize::from(growth > 0.0);
                }
            }
        }
        assert!(unstable > 50, "{unstable}");
    }
}

/// Every 10 s: deviation, joints, rates, base and tip, all within 1e-6. The reference integrates by RK4 with 20 ms.
#[test]
fn the_runs_go_as_the_reference_in_the_stable_and_the_unstable_region() {
    let all: Value = serde_json::from_str(include_str!("fixtures/masutani_ch6_runs.json")).unwrap();
    for (name, example) in [("stable_approx", STABLE), ("unstable_approx", UNSTABLE)] {
        let mut run = example
            .start(JacobianKind::FixedBase)
            .with_method(IntegrationMethod::Rk4);
        for sample in all[name]["samples"].as_array().unwrap() {
            let theirs = numbers(sample);
            if theirs[0] > 0.0 {
                run.run_to(theirs[0], 0.02);
            }
            let (state, X_WB) = (run.state(), run.X_WB());
            let (tip, base) = (run.X_WE().translation.vector, X_WB.translation.vector);
            let turned = 2.0 * state.R_WB.k.atan2(state.R_WB.w);
            let ours = [
                run.error().position.norm(),
                state.q[0],
                state.q[1],
                state.qd[0],
                state.qd[1],
                turned,
                base.x,
                base.y,
                tip.x,
                tip.y,
            ];
            for (ours, theirs) in ours.iter().zip(&theirs[1..]) {
                assert!((ours - theirs).abs() < 1e-6, "{name} {ours} {theirs:?}");
            }
        }
    }
}

/// Deviations every 0.1 s.
fn deviations(example: Example, jacobian: JacobianKind, seconds: u32) -> Vec<f64> {
    let mut run = example.start(jacobian);
    let deviation = |k: u32| {
        if k > 0 {
            run.run_to(0.1 * f64::from(k), 0.02);
        }
        run.error().position.norm()
    };
    (0..=10 * seconds).map(deviation).collect()
}

#[test]
fn in_the_unstable_region_the_tip_leaves_first_and_arrives_later() {
    let settled = |d: &[f64]| 0.1 * (d.iter().rposition(|d| *d > 0.01).unwrap() + 1) as f64;
    let approximate = deviations(UNSTABLE, JacobianKind::FixedBase, 110);
    let most = (0..approximate.len()).max_by(|a, b| approximate[*a].total_cmp(&approximate[*b]));
    let most = most.unwrap();
    assert!(
        (approximate[most] - 0.332).abs() < 1e-3,
        "{}",
        approximate[most]
    );
    assert!((0.1 * most as f64 - 59.7).abs() < 0.5, "{most}");
    assert!((settled(&approximate) - 98.3).abs() < 0.2);
    // With the generalized Jacobian the tip never leaves the goal.
    let generalized = deviations(UNSTABLE, JacobianKind::Generalized, 60);
    assert!(generalized.windows(2).skip(20).all(|d| d[1] < d[0]));
    let stable = |jacobian| settled(&deviations(STABLE, jacobian, 40));
    assert!((stable(JacobianKind::Generalized) - 25.9).abs() < 0.2);
    assert!((stable(JacobianKind::FixedBase) - 22.4).abs() < 0.2);
}
