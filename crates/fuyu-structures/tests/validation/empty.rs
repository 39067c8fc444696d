//! Models without modes, without rigid coordinates or without inputs, and matrices of wrong sizes: an empty result
//! where that is the answer, otherwise an error. nalgebra panics on such matrices, so each line fails with a panic if a
//! check is missing.

use fuyu_structures::{
    Appendage, Attachment, FemModel, HybridModel, Matrices, ModalModel, StructureError, Vehicle,
    generalized_eigen, lowest_modes, quadratic_roots,
};
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector3};

use crate::support::panel;

fn empty() -> DMatrix<f64> {
    DMatrix::zeros(0, 0)
}

/// The error's message.
fn refused<T>(result: Result<T, StructureError>) -> String {
    match result {
        Ok(_) => panic!("was accepted"),
        Err(e) => e.to_string(),
    }
}

#[test]
fn empty_matrices_have_no_eigenvalues() {
    let eigen = generalized_eigen(&empty(), &empty()).unwrap();
    assert_eq!((eigen.values.len(), eigen.vectors.shape()), (0, (0, 0)));
    assert_eq!(lowest_modes(&empty(), &empty(), 0).unwrap().values.len(), 0);
    let message = refused(lowest_modes(&empty(), &empty(), 1));
    assert_eq!(message, "number of modes is 1; it must be from 0 to 0");
    assert!(refused(generalized_eigen(&empty(), &DMatrix::identity(2, 2))).contains("0 x 0"));
    assert!(refused(generalized_eigen(&DMatrix::zeros(0, 2), &empty())).contains("0 x 2"));
    assert!(
        quadratic_roots(&empty(), &empty(), &empty())
            .unwrap()
            .is_empty()
    );
    // Everything held.
    let matrices = Matrices::new(DMatrix::identity(2, 2), DMatrix::identity(2, 2)).unwrap();
    let modes = matrices.modes(&[0, 1], 0).unwrap();
    assert_eq!((modes.frequencies.len(), modes.shapes.shape()), (0, (2, 0)));
}

#[test]
fn an_appendage_without_modes_is_a_rigid_body() {
    let rigid = (
        10.0,
        Vector3::new(5.0, 0.0, 0.0),
        Matrix3::identity() * 20.0,
    );
    let body = Appendage::from_coupling("antenna", rigid, &[], &[], &DMatrix::zeros(0, 6)).unwrap();
    assert_eq!(body.frequencies().unwrap().len(), 0);
    assert_eq!(body.first_order_limits().unwrap().rate, f64::INFINITY);
    assert_eq!(body.diagonalised().unwrap().modes(), 0);
    assert_eq!(body.selected(&[]).unwrap().modes(), 0);
    let w = Vector3::new(0.0, 0.1, 0.0);
    assert!(
        body.spin_frequencies(&w, &Vector3::zeros())
            .unwrap()
            .is_empty()
    );

    let attachment = Attachment::on_base(&body, &Rotation3::identity(), &Vector3::zeros(), 6);
    let vehicle = Vehicle::new(DMatrix::identity(6, 6) * 100.0, &[attachment]).unwrap();
    assert!(vehicle.frequencies_hz().unwrap().is_empty());
    assert!(vehicle.poles().unwrap().is_empty());
    assert!(vehicle.attitude_zeros().unwrap().is_empty());
    assert!(
        vehicle
            .hybrid()
            .unconstrained()
            .unwrap()
            .poles()
            .unwrap()
            .is_empty()
    );
}

#[test]
fn models_without_rigid_coordinates_have_poles_and_no_zeros() {
    let model = HybridModel::new(empty(), DMatrix::zeros(2, 0), &[1.0, 2.0], &[0.01; 2]).unwrap();
    assert_eq!(model.poles().unwrap().len(), 4);
    assert_eq!(model.frequencies().unwrap().len(), 2);
    assert_eq!(model.feedback_poles(&empty(), &empty()).unwrap().len(), 4);
    let unconstrained = model.unconstrained().unwrap();
    assert_eq!(unconstrained.poles().unwrap().len(), 4);
    let expected =
        "number of rigid coordinates, on which the forces act, is 0; it must be positive";
    let none = DMatrix::zeros(0, 2);
    let turned = DMatrix::zeros(2, 0);
    for message in [
        refused(model.zeros()),
        refused(model.zeros_measured_elsewhere(&empty(), &none)),
        refused(model.zeros_driven_elsewhere(&empty(), &turned)),
        refused(unconstrained.zeros()),
        refused(unconstrained.zeros_measured_elsewhere(&empty(), &none)),
        refused(unconstrained.zeros_driven_elsewhere(&empty(), &turned)),
    ] {
        assert_eq!(message, expected);
    }
    // The same by holding or eliminating every coordinate.
    let P = DMatrix::from_element(1, 1, 0.5);
    let one = HybridModel::new(DMatrix::identity(1, 1), P, &[1.0], &[0.0]).unwrap();
    assert!(refused(one.held(&[0]).unwrap().zeros()).contains("rigid coordinates"));
    assert!(refused(one.without(&[0]).unwrap().zeros()).contains("rigid coordinates"));
    assert!(one.zeros().is_ok());
}

#[test]
fn models_without_inputs_have_no_zeros() {
    let matrices = Matrices::new(DMatrix::identity(2, 2), DMatrix::identity(2, 2)).unwrap();
    let model = FemModel::collocated(matrices, DMatrix::zeros(2, 2), &[]).unwrap();
    assert_eq!(
        refused(model.zeros()),
        "number of inputs is 0; it must be positive"
    );
    assert!(refused(model.modal(&[0.0; 2], 2).unwrap().zeros()).contains("number of inputs"));
    let no_modes = ModalModel::new(DVector::zeros(0), DVector::zeros(0), DMatrix::zeros(0, 1));
    assert!(refused(no_modes.unwrap().zeros()).contains("number of inputs"));
    let nothing = Matrices::new(empty(), empty()).unwrap();
    let nothing = FemModel::collocated(nothing, empty(), &[]).unwrap();
    assert!(nothing.poles().unwrap().is_empty());
    assert!(nothing.zeros().is_err());
    // As many inputs as degrees of freedom: nothing is left to move.
    let matrices = Matrices::new(DMatrix::identity(2, 2), DMatrix::identity(2, 2)).unwrap();
    let full = FemModel::collocated(matrices, DMatrix::zeros(2, 2), &[0, 1]).unwrap();
    assert!(full.zeros().unwrap().is_empty());
    assert!(
        full.modal(&[0.0; 2], 2)
            .unwrap()
            .zeros()
            .unwrap()
            .is_empty()
    );
}

#[test]
fn matrices_of_the_wrong_size_are_refused() {
    let right = panel(false);
    for part in 0..3 {
        let mut wrong = right.clone();
        let (matrix, name) = match part {
            0 => (&mut wrong.modal_stiffness, "modal stiffness"),
            1 => (&mut wrong.modal_mass, "modal mass"),
            _ => (&mut wrong.modal_damping, "modal damping"),
        };
        *matrix = DMatrix::identity(3, 3);
        let w = Vector3::new(0.0, 0.1, 0.0);
        let attachment = Attachment::on_base(&wrong, &Rotation3::identity(), &Vector3::zeros(), 6);
        for message in [
            refused(wrong.spin_frequencies(&w, &Vector3::zeros())),
            refused(wrong.diagonalised()),
            refused(wrong.selected(&[0])),
            refused(Vehicle::new(DMatrix::identity(6, 6) * 1e4, &[attachment])),
        ] {
            assert!(message.contains("must have"), "{name}: {message}");
        }
        let message = refused(wrong.spin_frequencies(&w, &Vector3::zeros()));
        assert_eq!(
            message,
            format!("panel, {name} has 3 x 3 entries; it must have 4 x 4")
        );
    }
}
