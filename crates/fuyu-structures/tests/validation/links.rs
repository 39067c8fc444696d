//! Elastic links: static shapes, a loaded cantilever, and the servicer with two elastic links.

use fuyu_structures::{Appendage, Beam, ElasticLink, End, NodeBody, generalized_eigen};
use nalgebra::{DMatrix, Matrix3, Vector3};

use crate::{
    servicer::{LINKS, Link, add_body, links, mass_matrix},
    support::{boom, fixture, numbers, worst},
};

fn link(fixed_interface_modes: usize) -> ElasticLink {
    ElasticLink {
        length: 2.5,
        mass_per_length: 20.0,
        EI: [2e5, 2e5],
        radius_of_gyration: 0.07071,
        fixed_interface_modes,
        elements: 16,
        damping_time: 0.0,
        second_order: false,
    }
}

// A tip force F and moment M deflect a cantilever by FL³/3EI + ML²/2EI and turn its tip by FL²/2EI + ML/EI: exact with two shapes.
#[test]
fn static_shapes_are_exact_for_loads_at_the_tip() {
    let body = link(2).appendage("link").unwrap();
    let tip = &body.outputs[0];
    let (L, EI) = (2.5_f64, 2e5);
    for (force, moment) in [(100.0, 0.0), (0.0, 40.0), (70.0, -30.0)] {
        for plane in 0..2 {
            // Force along y or z; moment about z, or about -y, which both raise the slope.
            let (f, t) = if plane == 0 {
                (
                    Vector3::new(0.0, force, 0.0),
                    Vector3::new(0.0, 0.0, moment),
                )
            } else {
                (
                    Vector3::new(0.0, 0.0, force),
                    Vector3::new(0.0, -moment, 0.0),
                )
            };
            let Q = nalgebra::DVector::from_fn(body.modes(), |k, _| {
                tip.translation[k].dot(&f) + tip.rotation[k].dot(&t)
            });
            let mu = body.modal_stiffness.clone().cholesky().unwrap().solve(&Q);
            let moved = tip.displacement(mu.as_slice())[1 + plane];
            let exact = force * L.powi(3) / (3.0 * EI) + moment * L * L / (2.0 * EI);
            assert!(
                (moved - exact).abs() < 1e-12 * exact.abs(),
                "{moved} {exact}"
            );
            let turned = tip.rotation(mu.as_slice());
            let slope = if plane == 0 { turned.z } else { -turned.y };
            let exact = force * L * L / (2.0 * EI) + moment * L / EI;
            assert!(
                (slope - exact).abs() < 1e-12 * exact.abs(),
                "{slope} {exact}"
            );
        }
    }
    // The static shapes are not orthogonal: modal matrices that are not diagonal.
    assert!(body.modal_stiffness[(0, 1)].abs() > 1e3 && body.modal_mass[(0, 1)].abs() > 0.1);
    let diagonal = body.diagonalised().unwrap();
    assert!(
        worst(
            diagonal.frequencies().unwrap().as_slice(),
            body.frequencies().unwrap().as_slice()
        ) < 1e-9
    );
}

/// First frequency with a body at the tip, from the link's modes.
fn loaded(body: &Appendage, mass: f64, inertia: f64) -> f64 {
    let tip = &body.outputs[0];
    let n = body.modes();
    let M = DMatrix::from_fn(n, n, |k, l| {
        body.modal_mass[(k, l)]
            + mass * tip.translation[k].dot(&tip.translation[l])
            + inertia * tip.rotation[k].dot(&tip.rotation[l])
    });
    generalized_eigen(&body.modal_stiffness, &M).unwrap().values[0].sqrt()
}

// Clamped-free modes converge with 1/n for a loaded link; static shapes with few functions. Compared with finite elements that carry the load.
#[test]
fn a_loaded_link_needs_static_shapes() {
    let mut beam = Beam::uniform(2.5, 20.0, 2e5, 32);
    beam.bodies.push(NodeBody {
        node: 32,
        mass: 70.0,
        inertia: 60.0,
    });
    let exact = beam.modes(End::Clamped, End::Free, 1).unwrap().frequencies[0];
    let mut errors = Vec::new();
    for extra in [0, 1, 2] {
        let mut spec = link(extra);
        spec.elements = 32;
        let body = spec.appendage("link").unwrap();
        errors.push((loaded(&body, 70.0, 60.0) / exact - 1.0).abs());
    }
    let plain = Beam::uniform(2.5, 20.0, 2e5, 32);
    let free =
        |modes: usize| (loaded(&boom(&plain, [modes, 0], false), 70.0, 60.0) / exact - 1.0).abs();
    let clamped_free = [free(2), free(4), free(8)];
    println!(
        "static shapes and 0, 1, 2 modes: {errors:?}; 2, 4, 8 clamped-free modes: {clamped_free:?}"
    );
    assert!(
        errors[0] < 1e-4 && errors[1] < 1e-5 && errors[2] < 1e-6,
        "{errors:?}"
    );
    assert!(
        clamped_free[2] > 1e-3 && clamped_free[0] / clamped_free[2] < 8.0,
        "1/n: {clamped_free:?}"
    );
}

/// Mass and stiffness matrices of the servicer with elastic links 2 and 3: coordinates (base 6, joints 6, modes).
fn servicer(q: &[f64], body: &Appendage) -> (DMatrix<f64>, DMatrix<f64>) {
    let (n, list) = (body.modes(), links(q));
    let size = 12 + 2 * n;
    // Links after an elastic one move with its tip.
    let tip = &body.outputs[0];
    let widened = |link: &Link, moving: &[usize]| {
        let mut jacobian = DMatrix::zeros(6, size);
        jacobian.columns_mut(0, 12).copy_from(&link.jacobian);
        for elastic in moving {
            let carrier = &list[*elastic];
            let arm = link.p - (carrier.p + carrier.R * tip.position);
            for k in 0..n {
                let (t, r) = (carrier.R * tip.translation[k], carrier.R * tip.rotation[k]);
                let v = t + r.cross(&arm);
                let column = 12 + (elastic - 2) * n + k;
                (0..3).for_each(|i| jacobian[(i, column)] = v[i]);
                (0..3).for_each(|i| jacobian[(3 + i, column)] = r[i]);
            }
        }
        Link {
            R: link.R,
            p: link.p,
            jacobian,
        }
    };
    let mut M = DMatrix::zeros(size, size);
    M.view_mut((0, 0), (12, 12))
        .copy_from(&mass_matrix(q, &[2, 3, 4, 5, 6]));
    // The list begins with the base.
    for (link, (.., mass, x, inertia)) in list[4..].iter().zip(&LINKS[3..]) {
        add_body(
            &mut M,
            &widened(link, &[2, 3]),
            *mass,
            Vector3::new(*x, 0.0, 0.0),
            Matrix3::from_diagonal(&Vector3::from(*inertia)),
        );
    }
    for (elastic, moving) in [(2_usize, &[][..]), (3, &[2][..])] {
        let at = 12 + (elastic - 2) * n;
        let frame = widened(&list[elastic], moving);
        let R = frame.R.matrix().transpose();
        let mut J = frame.jacobian.clone();
        let (v, w) = (R * J.rows(0, 3), R * J.rows(3, 3));
        J.rows_mut(0, 3).copy_from(&v);
        J.rows_mut(3, 3).copy_from(&w);
        M += J.transpose() * body.rigid_mass_matrix() * &J;
        let coupled = body.coupling() * &J;
        let mut rows = M.rows_mut(at, n);
        rows += &coupled;
        let mut columns = M.columns_mut(at, n);
        columns += coupled.transpose();
        let mut modal = M.view_mut((at, at), (n, n));
        modal += &body.modal_mass;
    }
    let mut K = DMatrix::zeros(size, size);
    for at in [12, 12 + n] {
        K.view_mut((at, at), (n, n))
            .copy_from(&body.modal_stiffness);
    }
    (M, K)
}

// The file's base-free and base-fixed frequencies of the servicer with span{s², s³} in each plane, orthonormalised. These need the same linear space, so
// they agree to rounding in posture A, B and C. With a wrong tip rotation sign they differ in the first digit.
#[test]
fn the_servicer_with_elastic_links_has_the_independent_frequencies() {
    let expected = &fixture("flexible_beam")["flexible_links"];
    let postures = [
        ("A", [0.0; 6]),
        ("B", [0.3, 0.8, -1.4, 0.6, 0.4, 0.0]),
        ("C", [1.2, 1.9, -2.2, -0.7, 0.5, 0.3]),
    ];
    for (extra, key, limit) in [(0, "2+2", 1e-5), (2, "4+4", 1e-5)] {
        let body = link(extra).appendage("link").unwrap();
        for (name, q) in &postures {
            let (M, K) = servicer(q, &body);
            let n = K.nrows();
            let locked: Vec<usize> = (0..6).chain(12..n).collect();
            let fixed: Vec<usize> = (12..n).collect();
            let frequencies = |kept: &[usize], skipped: usize| {
                let part = |m: &DMatrix<f64>| m.select_rows(kept).select_columns(kept);
                let values = generalized_eigen(&part(&K), &part(&M)).unwrap().values;
                (skipped..skipped + 4)
                    .map(|k| values[k].sqrt() / std::f64::consts::TAU)
                    .collect::<Vec<_>>()
            };
            let case = &expected[format!("{name} static+Ritz {key}")];
            let free = worst(&frequencies(&locked, 6), &numbers(&case["base_free_hz"]));
            let base_fixed = worst(&frequencies(&fixed, 0), &numbers(&case["base_fixed_hz"]));
            println!("{name} {key}: base free {free:.1e}, base fixed {base_fixed:.1e}");
            let first = worst(
                &frequencies(&locked, 6)[..2],
                &numbers(&case["base_free_hz"])[..2],
            );
            assert!(first < limit, "{name} {key}: {first:e}");
            if extra == 2 {
                let converged = &expected[format!("{name} static+Ritz 6+6")];
                let error = worst(
                    &frequencies(&locked, 6)[..2],
                    &numbers(&converged["base_free_hz"])[..2],
                );
                println!("  against 6 functions: {error:.1e}");
                assert!(error < 1e-5, "{name}: {error:e}");
            }
        }
    }
}

#[test]
fn impossible_links_are_rejected() {
    let mut wrong = link(0);
    wrong.EI[1] = 0.0;
    assert_eq!(
        wrong.appendage("link").unwrap_err().to_string(),
        "EI of beam element 0 [N m²] is 0; it must be positive"
    );
    let mut wrong = link(40);
    wrong.elements = 4;
    assert!(
        wrong
            .appendage("link")
            .unwrap_err()
            .to_string()
            .starts_with("number of modes is 40")
    );
}
