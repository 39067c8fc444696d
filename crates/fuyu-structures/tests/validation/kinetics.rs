//! Mass integrals and convective terms against a cloud of mass points that moves.

use fuyu_structures::{Appendage, Invariants, Kinetics, MassPoint};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use crate::{random::Random, support::panel};

/// A body of random points with random shapes.
fn cloud(random: &mut Random, modes: usize, second_order: bool) -> (Vec<MassPoint>, Appendage) {
    let mut vector = || Vector3::from_fn(|_, _| random.number());
    let pairs = if second_order {
        modes * (modes + 1) / 2
    } else {
        0
    };
    let points: Vec<MassPoint> = (0..30)
        .map(|i| MassPoint {
            mass: 0.5 + f64::from(i) / 30.0,
            position: vector() * 2.0,
            psi: (0..modes).map(|_| vector()).collect(),
            chi: (0..pairs).map(|_| vector()).collect(),
        })
        .collect();
    let invariants = Invariants::from_points(&points).unwrap();
    let mass = DMatrix::from_fn(modes, modes, |k, l| invariants.second(1 + k, 1 + l).trace());
    let mut body =
        Appendage::with_frequencies("cloud", invariants, &vec![1.0; modes], &vec![0.0; modes])
            .unwrap();
    body.modal_mass = mass;
    (points, body)
}

/// Position of a point in the attachment frame.
fn place(point: &MassPoint, mu: &[f64]) -> Vector3<f64> {
    let mut r = point.position;
    for (k, a) in mu.iter().enumerate() {
        r += point.psi[k] * *a;
        for (l, b) in mu.iter().enumerate().filter(|_| !point.chi.is_empty()) {
            r += point.chi[fuyu_structures::pair_index(mu.len(), k, l)] * (a * b / 2.0);
        }
    }
    r
}

/// Velocity of a point relative to the attachment frame, by its derivatives with respect to μ.
fn gradient(point: &MassPoint, mu: &[f64], k: usize) -> Vector3<f64> {
    let mut g = point.psi[k];
    for (l, b) in mu.iter().enumerate().filter(|_| !point.chi.is_empty()) {
        g += point.chi[fuyu_structures::pair_index(mu.len(), k, l)] * *b;
    }
    g
}

struct State {
    mu: Vec<f64>,
    mu_dot: Vec<f64>,
    v: Vector3<f64>,
    w: Vector3<f64>,
}

fn state(random: &mut Random, n: usize) -> State {
    let mut list = || (0..n).map(|_| random.number()).collect::<Vec<_>>();
    let (mu, mu_dot) = (list(), list());
    let mut vector = || Vector3::from_fn(|_, _| random.number());
    State {
        mu,
        mu_dot,
        v: vector(),
        w: vector(),
    }
}

// The formulas of `Kinetics` use integrals; this sums the accelerations of the points one by one, with each of d'Alembert's terms written out.
#[test]
fn mass_matrix_and_bias_are_sums_over_the_points() {
    let mut random = Random::new(1);
    let mut worst = 0.0_f64;
    for (trial, second_order) in (0..40).map(|i| (i, i % 2 == 1)) {
        let n = random.count(1, 4);
        let (points, body) = cloud(&mut random, n, second_order);
        let s = state(&mut random, n);
        let mut kinetics = Kinetics::new(&body);
        kinetics.update(&body, &s.mu, &s.mu_dot, &s.w);
        let (mut M, mut bias) = (
            DMatrix::<f64>::zeros(6 + n, 6 + n),
            DVector::<f64>::zeros(6 + n),
        );
        for point in &points {
            let r = place(point, &s.mu);
            let g: Vec<_> = (0..n).map(|k| gradient(point, &s.mu, k)).collect();
            // Velocity of the point for unit generalized velocities, 3 x (6 + n).
            let mut B = DMatrix::zeros(3, 6 + n);
            B.view_mut((0, 0), (3, 3)).copy_from(&Matrix3::identity());
            B.view_mut((0, 3), (3, 3)).copy_from(&-r.cross_matrix());
            (0..n).for_each(|k| B.set_column(6 + k, &g[k]));
            let relative: Vector3<f64> = g.iter().zip(&s.mu_dot).map(|(g, d)| g * *d).sum();
            let mut acceleration = s.w.cross(&s.w.cross(&r)) + s.w.cross(&relative) * 2.0;
            if second_order {
                for k in 0..n {
                    for l in 0..n {
                        let chi = point.chi[fuyu_structures::pair_index(n, k, l)];
                        acceleration += chi * (s.mu_dot[k] * s.mu_dot[l]);
                    }
                }
            }
            M += B.transpose() * &B * point.mass;
            bias += B.transpose() * acceleration * point.mass;
        }
        let errors = [
            (kinetics.mass_matrix.clone() - &M).amax() / M.amax(),
            (&kinetics.bias - &bias).amax() / bias.amax(),
        ];
        worst = worst.max(errors[0]).max(errors[1]);
        assert!(
            errors[0] < 1e-14 && errors[1] < 1e-13,
            "trial {trial}: {errors:?}"
        );
    }
    println!("worst relative difference {worst:.1e}");
}

// The rates of momentum, angular momentum and energy along the motion of a body without forces, with differences of fourth order. A
// Coriolis term that is missing in the bias makes them as large as the bias.
#[test]
fn momentum_and_energy_have_no_rate_without_forces() {
    let mut random = Random::new(2);
    let mut worst = 0.0_f64;
    for (n, second_order) in (0..20).map(|i| (1 + i % 3, i >= 10)) {
        let (_, mut body) = cloud(&mut random, n, second_order);
        body.modal_stiffness = random.definite(n, 1.0);
        let s = state(&mut random, n);
        let mut kinetics = Kinetics::new(&body);
        kinetics.update(&body, &s.mu, &s.mu_dot, &s.w);
        let mut force = -kinetics.bias.clone();
        let strain = &body.modal_stiffness * DVector::from_column_slice(&s.mu);
        let mut modal = force.rows_mut(6, n);
        modal -= strain;
        let rates = kinetics.mass_matrix.clone().lu().solve(&force).unwrap();
        let part = |i: usize| Vector3::new(rates[i], rates[i + 1], rates[i + 2]);
        let (a, alpha) = (part(0), part(3));
        // A curve through the state with these rates; only its first derivative matters.
        let at = |t: f64| {
            let mu: Vec<f64> = s.mu.iter().zip(&s.mu_dot).map(|(x, d)| x + d * t).collect();
            let mut u = DVector::zeros(6 + n);
            u.fixed_rows_mut::<3>(0)
                .copy_from(&(s.v + (a - s.w.cross(&s.v)) * t));
            u.fixed_rows_mut::<3>(3).copy_from(&(s.w + alpha * t));
            for k in 0..n {
                u[6 + k] = s.mu_dot[k] + rates[6 + k] * t;
            }
            let mut k = Kinetics::new(&body);
            k.update(&body, &mu, &u.as_slice()[6..], &s.w);
            let momenta = &k.mass_matrix * &u;
            let x = DVector::from_vec(mu);
            let energy = (momenta.dot(&u) + x.dot(&(&body.modal_stiffness * &x))) / 2.0;
            DVector::from_iterator(7, momenta.iter().take(6).copied().chain([energy]))
        };
        let h = 1e-3;
        let slope = ((at(h) - at(-h)) * 8.0 - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
        let now = at(0.0);
        let vector = |x: &DVector<f64>, i: usize| Vector3::new(x[i], x[i + 1], x[i + 2]);
        // Momenta are in axes that turn with w, about a point that moves with v.
        let P_rate = vector(&slope, 0) + s.w.cross(&vector(&now, 0));
        let L_rate = vector(&slope, 3) + s.w.cross(&vector(&now, 3)) + s.v.cross(&vector(&now, 0));
        let scale = kinetics.bias.amax();
        for (name, rate) in [
            ("P", P_rate.norm()),
            ("L", L_rate.norm()),
            ("E", slope[6].abs()),
        ] {
            worst = worst.max(rate / scale);
            assert!(
                rate < 1e-8 * scale,
                "d{name}/dt {rate:e} of {scale:e}, second order {second_order}"
            );
        }
    }
    println!("worst rate {worst:.1e} of the convective forces");
}

// Mass points on a mesh much finer and of another rule (midpoints) than that of the integrals: its error falls with 1/n².
#[test]
fn integrals_of_the_panel_are_those_of_a_fine_mesh_of_points() {
    let body = panel(true);
    let fem = crate::support::strip(false);
    let beam = fuyu_structures::Cantilever::new(fem.length, 6.0, fem.EI).unwrap();
    let shaft = fuyu_structures::Shaft::new(fem.length, 2.0, fem.GJ).unwrap();
    let mesh = |stations: usize| {
        let n = 4;
        let h = fem.length / stations as f64;
        let mut points = Vec::new();
        let mut running = vec![[0.0; 4]; 10]; // shortening, chord, slope and deflection in the plane
        for i in 0..stations {
            let x = (i as f64 + 0.5) * h;
            let w: Vec<_> = (0..n)
                .map(|k| {
                    if k < 3 {
                        beam.shape(k, x)
                    } else {
                        Default::default()
                    }
                })
                .collect();
            let theta: Vec<_> = (0..n)
                .map(|k| {
                    if k == 3 {
                        shaft.shape(0, x)
                    } else {
                        (0.0, 0.0)
                    }
                })
                .collect();
            let mut chi_at = |y: f64, advance: bool| {
                let mut list = Vec::new();
                for (place, (k, l)) in (0..n).flat_map(|k| (k..n).map(move |l| (k, l))).enumerate()
                {
                    let rates = [
                        w[k].slope * w[l].slope,
                        w[k].slope * theta[l].1 + w[l].slope * theta[k].1,
                        theta[k].0 * w[l].curvature + theta[l].0 * w[k].curvature,
                    ];
                    let r = &running[place];
                    let middle: Vec<f64> = (0..3).map(|j| r[j] + rates[j] * h / 2.0).collect();
                    let lateral = r[3] + (r[2] + middle[2]) / 2.0 * h / 2.0;
                    list.push(Vector3::new(
                        -middle[0] - y * middle[1],
                        -lateral - y * theta[k].0 * theta[l].0,
                        0.0,
                    ));
                    if advance {
                        let r = &mut running[place];
                        r[3] += middle[2] * h;
                        (0..3).for_each(|j| r[j] += rates[j] * h);
                    }
                }
                list
            };
            let chord = 40;
            for j in 0..chord {
                let y = fem.width * ((f64::from(j) + 0.5) / f64::from(chord) - 0.5);
                points.push(MassPoint {
                    mass: 48.0 / (stations as f64 * f64::from(chord)),
                    position: Vector3::new(x, y, 0.0),
                    psi: (0..n)
                        .map(|k| Vector3::new(0.0, 0.0, w[k].value + y * theta[k].0))
                        .collect(),
                    chi: chi_at(y, j == chord - 1),
                });
            }
        }
        Invariants::from_points(&points).unwrap()
    };
    let difference = |mesh: &Invariants| {
        let mut largest = 0.0_f64;
        for a in 0..mesh.functions() {
            largest = largest.max((mesh.first(a) - body.invariants.first(a)).amax() / 192.0);
            for b in 0..mesh.functions() {
                largest =
                    largest.max((mesh.second(a, b) - body.invariants.second(a, b)).amax() / 1024.0);
            }
        }
        largest
    };
    let (coarse, fine) = (difference(&mesh(50)), difference(&mesh(100)));
    println!("50 stations {coarse:.2e}, 100 stations {fine:.2e}");
    // The chord's 40 points leave an error of 1/40² of 16 kg m², 1e-2 of 1024.
    assert!(fine < 2e-4 && fine < coarse, "{coarse:e} {fine:e}");
}

// Changing coordinates and changing back gives the same body; a body in other coordinates has the same motion.
#[test]
fn other_modal_coordinates_describe_the_same_body() {
    let mut random = Random::new(3);
    let body = panel(true);
    let T = random.definite(4, 0.3);
    let other = body.transformed(&T).unwrap();
    let back = other
        .transformed(&T.clone().try_inverse().unwrap())
        .unwrap();
    for a in 0..body.invariants.functions() {
        for b in 0..body.invariants.functions() {
            assert!((body.invariants.second(a, b) - back.invariants.second(a, b)).amax() < 1e-9);
        }
    }
    let nu = DVector::from_fn(4, |_, _| 0.1 * random.number());
    let nu_dot = DVector::from_fn(4, |_, _| 0.1 * random.number());
    let (mu, mu_dot) = (&T * &nu, &T * &nu_dot);
    let w = Vector3::new(0.2, -0.1, 0.3);
    let (mut here, mut there) = (Kinetics::new(&body), Kinetics::new(&other));
    here.update(&body, mu.as_slice(), mu_dot.as_slice(), &w);
    there.update(&other, nu.as_slice(), nu_dot.as_slice(), &w);
    assert!((here.bias.rows(0, 6) - there.bias.rows(0, 6)).amax() < 1e-11);
    assert!((T.transpose() * here.bias.rows(6, 4) - there.bias.rows(6, 4)).amax() < 1e-11);
    let tips = [
        body.outputs[1].displacement(mu.as_slice()),
        other.outputs[1].displacement(nu.as_slice()),
    ];
    assert!((tips[0] - tips[1]).amax() < 1e-13, "{tips:?}");
    // Diagonalising returns to frequencies in ascending order: b1, t1, b2, b3.
    let diagonal = other.diagonalised().unwrap();
    let expected = body.selected(&[0, 3, 1, 2]).unwrap();
    assert!(
        (diagonal.coupling() - expected.coupling()).amax() < 1e-9,
        "{}{}",
        diagonal.coupling(),
        expected.coupling()
    );
}

// The multibody engine calls this in each step.
#[test]
fn kinetics_do_not_allocate() {
    for second_order in [false, true] {
        let body = panel(second_order);
        let mut kinetics = Kinetics::new(&body);
        let counted = allocation_counter::measure(|| {
            for _ in 0..10 {
                let w = Vector3::new(0.1, 0.2, -0.3);
                kinetics.update(&body, &[0.1, -0.2, 0.05, 0.3], &[1.0, 0.5, -0.2, 0.1], &w);
            }
        });
        assert_eq!(counted.count_total, 0, "second order {second_order}");
    }
}
