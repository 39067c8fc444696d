//! Structures from matrices: trusses, condensation, and a beam as another program would give it.

use fuyu_structures::{
    Axis, Beam, Cantilever, Matrices, NodalModel, Rod, Truss, generalized_eigen, lowest_modes,
};
use nalgebra::{DMatrix, DVector, Vector2, Vector3};

use crate::{random::Random, support::worst};

/// A boom of square bays with diagonals, from x = 0.
fn boom(bays: usize) -> Truss {
    let nodes = (0..=bays)
        .flat_map(|i| [Vector2::new(i as f64, 0.0), Vector2::new(i as f64, 1.0)])
        .collect();
    let mut pairs = vec![[0, 1]];
    for i in 0..bays {
        let a = 2 * i;
        pairs.extend([[a, a + 2], [a + 1, a + 3], [a + 2, a + 3], [a, a + 3]]);
    }
    Truss {
        nodes,
        rods: pairs
            .into_iter()
            .map(|nodes| Rod {
                nodes,
                EA: 1e5,
                mass_per_length: 0.4,
            })
            .collect(),
    }
}

// Integrals through the mass matrix against rods as lines of mass points with linearly interpolated displacements.
#[test]
fn a_truss_as_an_appendage_has_the_integrals_of_its_rods() {
    let truss = boom(5);
    let model = truss.nodal_model().unwrap();
    let body = model
        .appendage("boom", &[0, 1, 2, 3], 4, 0.01, &[("tip", 11)])
        .unwrap();
    let modes = model.matrices.modes(&[0, 1, 2, 3], 4).unwrap();
    let mut points = Vec::new();
    let gauss = [
        (0.5 - 0.15_f64.sqrt(), 5.0 / 18.0),
        (0.5, 8.0 / 18.0),
        (0.5 + 0.15_f64.sqrt(), 5.0 / 18.0),
    ];
    for rod in &truss.rods {
        let [i, j] = rod.nodes;
        let length = (truss.nodes[j] - truss.nodes[i]).norm();
        for (x, weight) in gauss {
            let between = |a: Vector2<f64>, b: Vector2<f64>| {
                let p = a * (1.0 - x) + b * x;
                Vector3::new(p.x, p.y, 0.0)
            };
            let shape = |k: usize, node: usize| {
                Vector2::new(modes.shapes[(2 * node, k)], modes.shapes[(2 * node + 1, k)])
            };
            points.push(fuyu_structures::MassPoint {
                mass: weight * length * rod.mass_per_length,
                position: between(truss.nodes[i], truss.nodes[j]),
                psi: (0..4).map(|k| between(shape(k, i), shape(k, j))).collect(),
                chi: Vec::new(),
            });
        }
    }
    let expected = fuyu_structures::Invariants::from_points(&points).unwrap();
    assert!((body.invariants.mass() - expected.mass()).abs() < 1e-12 * expected.mass());
    for a in 0..5 {
        assert!(
            (body.invariants.first(a) - expected.first(a)).amax() < 1e-10,
            "{a}"
        );
        for b in 0..5 {
            let difference = (body.invariants.second(a, b) - expected.second(a, b)).amax();
            assert!(
                difference < 1e-10 * expected.second(0, 0).amax(),
                "{a} {b}: {difference:e}"
            );
        }
    }
    assert_eq!(body.outputs[0].position, Vector3::new(5.0, 1.0, 0.0));
    assert_eq!(body.outputs[0].translation[0].y, modes.shapes[(23, 0)]);
    // Sign convention: the largest entry is positive.
    for shape in modes.shapes.column_iter() {
        assert!((shape.max() - shape.amax()).abs() < 1e-12, "{shape}");
    }
}

#[test]
fn a_beam_with_condensed_rotations_is_an_appendage() {
    let beam = Beam::uniform(8.0, 6.0, 3000.0, 24);
    let kept: Vec<usize> = (0..25).map(|i| 2 * i).collect();
    // The clamped slope is held before the rotations are condensed.
    let held = beam.matrices().unwrap().held(&[1]).unwrap();
    let in_held: Vec<usize> = kept
        .iter()
        .map(|d| if *d == 0 { 0 } else { d - 1 })
        .collect();
    let (matrices, T) = held.condensed(&in_held).unwrap();
    assert_eq!((matrices.len(), T.shape()), (25, (49, 25)));
    let model = NodalModel {
        matrices,
        positions: (0..25)
            .map(|i| Vector3::new(f64::from(i) / 3.0, 0.0, 0.0))
            .collect(),
        dofs: (0..25).map(|i| (i, Axis::Z)).collect(),
    };
    let body = model
        .appendage("beam", &[0], 2, 0.005, &[("tip", 24)])
        .unwrap();
    let exact = Cantilever::new(8.0, 6.0, 3000.0).unwrap();
    let w = body.frequencies().unwrap();
    assert!(
        (w[0] / exact.frequency(0) - 1.0).abs() < 1e-6
            && (w[1] / exact.frequency(1) - 1.0).abs() < 1e-4,
        "{w}"
    );
    let P = body.coupling();
    assert!(
        (P[(0, 2)].abs() / exact.integral(0) - 1.0).abs() < 1e-5,
        "{P}"
    );
    assert!(
        (P[(0, 4)].abs() / exact.first_moment(0) - 1.0).abs() < 1e-3,
        "{P}"
    );
}

// Craig and Bampton: with all modes of the interior the basis is complete, so the reduced frequencies are those of the whole.
#[test]
fn a_complete_craig_bampton_basis_keeps_all_frequencies() {
    let mut random = Random::new(5);
    let matrices = Matrices::new(random.definite(8, 0.5), random.definite(8, 0.5)).unwrap();
    let basis = matrices.craig_bampton(&[6, 7], &[0], 5).unwrap();
    assert_eq!(basis.shape(), (8, 7));
    let part = |m: &DMatrix<f64>| {
        let r = basis.transpose() * m * &basis;
        (&r + r.transpose()) / 2.0
    };
    let reduced = generalized_eigen(&part(&matrices.K), &part(&matrices.M))
        .unwrap()
        .values;
    let whole = matrices.modes(&[0], 7).unwrap().frequencies.map(|w| w * w);
    assert!(worst(reduced.as_slice(), whole.as_slice()) < 1e-10);
    // Interior displacements of the static shapes are in equilibrium.
    let statics = basis.columns(0, 2);
    let forces = &matrices.K * statics;
    assert!((1..6).all(|i| forces[(i, 0)].abs() < 1e-12 && forces[(i, 1)].abs() < 1e-12));
}

// The low eigenvalues of a stiff mesh: the reduction by M loses eps * largest, that by K does not.
#[test]
fn low_frequencies_of_a_fine_mesh_keep_their_digits() {
    let exact = Cantilever::new(8.0, 6.0, 3000.0).unwrap().frequency(0);
    let matrices = Beam::uniform(8.0, 6.0, 3000.0, 64)
        .matrices()
        .unwrap()
        .held(&[0, 1])
        .unwrap();
    let by_K = lowest_modes(&matrices.K, &matrices.M, 1).unwrap().values[0].sqrt();
    let by_M = generalized_eigen(&matrices.K, &matrices.M).unwrap().values[0]
        .abs()
        .sqrt();
    let errors = [by_K, by_M].map(|w| (w / exact - 1.0).abs());
    println!("reduction by K {:.1e}, by M {:.1e}", errors[0], errors[1]);
    assert!(errors[0] < 1.5e-9, "h^4: {:e}", errors[0]);
}

#[test]
fn matrices_that_no_structure_has_are_rejected() {
    let definite = DMatrix::<f64>::identity(2, 2);
    let mut asymmetric = definite.clone();
    asymmetric[(0, 1)] = 0.5;
    let message = Matrices::new(asymmetric, definite.clone())
        .unwrap_err()
        .to_string();
    assert_eq!(
        message,
        "mass matrix M is not symmetric: entries (1, 0) and (0, 1) differ by 5e-1"
    );
    let message = Matrices::new(definite.clone(), DMatrix::identity(3, 3))
        .unwrap_err()
        .to_string();
    assert_eq!(
        message,
        "stiffness matrix K has 3 x 3 entries; it must have 2 x 2"
    );
    let message = lowest_modes(&-&definite, &definite, 1)
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("a stiffness cannot be negative"),
        "{message}"
    );
    let message = lowest_modes(&definite, &DMatrix::zeros(2, 2), 1)
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("mass matrix M is not positive definite"),
        "{message}"
    );
    let nan = DMatrix::from_diagonal(&DVector::from_vec(vec![1.0, f64::NAN]));
    assert!(
        Matrices::new(definite.clone(), nan)
            .unwrap_err()
            .to_string()
            .contains("NaN")
    );
    assert!(
        Matrices::new(definite.clone(), definite)
            .unwrap()
            .modes(&[7], 1)
            .unwrap_err()
            .to_string()
            .contains("fixed degree of freedom is 7")
    );
    let mut truss = boom(1);
    truss.rods[1].nodes = [0, 9];
    assert_eq!(
        truss.matrices().unwrap_err().to_string(),
        "node of rod 1 is 9; it must be from 0 to 3"
    );
    let mut truss = boom(1);
    truss.rods[2].EA = -1.0;
    assert_eq!(
        truss.matrices().unwrap_err().to_string(),
        "EA of rod 2 [N] is -1; it must be zero or positive"
    );
}
