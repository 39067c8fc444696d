//! `urdf/tr942_*.urdf` are the robots of the report's tables.

use fuyu::dynamics::{Formulation, Input, Kane, TreeAcceleration, TreeMotion};
use fuyu::experiments::tr942::{chain, pantograph};
use fuyu::model::Model;
use fuyu::spatial::Twist;
use nalgebra::{UnitQuaternion, Vector3};

use super::difference;

fn description(name: &str) -> Model {
    let path = format!("{}/urdf/{name}.urdf", env!("CARGO_MANIFEST_DIR"));
    Model::from_urdf(&std::fs::read_to_string(&path).unwrap(), &path).unwrap()
}

/// Positions or rates at which nothing is special.
fn generic(n: usize, seed: f64) -> Vec<f64> {
    (0..n).map(|j| (seed + 1.7 * j as f64).sin()).collect()
}

/// Answers to the same question, springs and dampers pulling.
fn compare(description: &Model, table: &Model, [of_description, of_table]: [&mut Kane; 2]) {
    let names = |model: &Model| -> Vec<_> {
        model
            .joints()
            .iter()
            .map(|j| (j.name.clone(), j.kind, j.spring, j.damping))
            .collect()
    };
    assert_eq!(names(description), names(table));
    for seed in [0.0, 1.0, 2.0] {
        let (q, qd) = (generic(table.dof(), seed), generic(table.dof(), 9.0 - seed));
        let motion = TreeMotion {
            R_WB: UnitQuaternion::new(Vector3::new(0.3, seed, -0.5)),
            V_WB_B: Twist::new(Vector3::new(0.4, -0.7, seed), Vector3::new(1.0, 0.2, -0.3)),
            q: &q,
            qd: &qd,
        };
        let input = Input::zero(table);
        let mut answers = [TreeAcceleration::zero(table), TreeAcceleration::zero(table)];
        of_description.accelerations(description, &motion, &input, &mut answers[0]);
        of_table.accelerations(table, &motion, &input, &mut answers[1]);
        let off = difference(&answers[0], &answers[1]);
        assert!(off < 1e-12, "{}: {off:e}", table.name());
    }
}

/// The description moves moments of inertia between neighbours to have possible bodies: no acceleration may differ. A
/// wrong digit in a mass, a length, an angle or a gain does.
#[test]
fn the_chain_is_described_as_tabulated() {
    let (description, table) = (description("tr942_chain"), chain::model());
    let mut kane = [Kane::new(&description), Kane::new(&table)];
    let [a, b] = &mut kane;
    compare(&description, &table, [a, b]);
}

/// The same for the carriages' mass, with the loops cut and with the tree alone.
#[test]
fn the_pantograph_is_described_as_tabulated() {
    let (description, table) = (description("tr942_pantograph"), pantograph::model());
    let [mut a, mut b] = [Kane::new(&description), Kane::new(&table)];
    compare(&description, &table, [&mut a, &mut b]);
    let cuts = pantograph::cuts(&table);
    assert_eq!(cuts, pantograph::cuts(&description));
    let [mut a, mut b] = [&description, &table].map(|m| Kane::with_cuts(m, &cuts).unwrap());
    compare(&description, &table, [&mut a, &mut b]);
    for cut in [0, 1] {
        let (ours, theirs) = (a.cut_wrench(cut).force, b.cut_wrench(cut).force);
        assert!(
            (ours - theirs).norm() < 1e-10 * theirs.norm(),
            "{ours} {theirs}"
        );
    }
    // The frames that a description's reader closes the loops with.
    for (cut, names) in cuts
        .iter()
        .zip([["pin6_2", "pin6_3"], ["pin7_4", "pin7_5"]])
    {
        let ends = [(cut.body_k, cut.X_KH), (cut.body_l, cut.X_LH)];
        for ((body, X), name) in ends.into_iter().zip(names) {
            let frame = description.frame(name).unwrap();
            assert_eq!((frame.body, frame.X_BF), (body, X), "{name}");
        }
    }
}
