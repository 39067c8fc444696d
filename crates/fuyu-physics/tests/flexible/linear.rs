//! Frequencies from the engine's mass matrix.

use fuyu_physics::dynamics::Workspace;
use fuyu_physics::dynamics::flexible::{
    FlexibleJacobian, FlexibleState, FlexibleWorkspace, LinearModel,
};
use nalgebra::{DVector, Matrix6xX};

use crate::conservation::everything;
use crate::support::{
    POSTURES, Random, fixture, numbers, relative, servicer, servicer_with_panels,
};

#[test]
fn base_free_frequencies_are_the_independent_ones() {
    let expected = fixture("flexible_panels_linear");
    let mut worst = [0.0_f64; 2];
    for alpha in ["0.0", "0.6"] {
        let system = servicer_with_panels(alpha.parse().unwrap());
        for (name, q) in &POSTURES {
            let case = &expected["linear"][alpha][name];
            let linear = LinearModel::new(&system, &DVector::from_row_slice(q));
            let locked = linear.frequencies_hz(&linear.base_and_modes()).unwrap();
            let free = linear.frequencies_hz(&linear.without_wheels()).unwrap();
            worst[0] = worst[0].max(relative(&locked, &numbers(&case["frequencies_locked_hz"])));
            let free_joints = numbers(&case["frequencies_free_joints_hz"]);
            worst[1] = worst[1].max(relative(&free, &free_joints));
        }
    }
    println!("joints locked {:.1e}, free {:.1e}", worst[0], worst[1]);
    assert!(worst[0] < 1e-8 && worst[1] < 1e-8, "{worst:?}");
}

// Columns for joints, modes, motors and wheels: a difference quotient of a motion at zero momentum. For the rigid
// robot, the generalized Jacobian of the rigid engine.
#[test]
fn the_generalized_jacobian_is_the_velocity_at_zero_momentum() {
    let model = servicer();
    let mut random = Random::new(21);
    for elastic_link in [false, true] {
        let system = everything(true, elastic_link);
        let tip = model.frame("tool0").unwrap();
        let mut jacobian = FlexibleJacobian::new(&system);
        let mut state = random.state(&system, 0.3);
        let columns = state.tree.q.len() + state.mu().len() + 3 + 2;
        let mut J = Matrix6xX::zeros(columns);
        jacobian.compute(&state, tip, &mut J);
        // The twist of the tip with all rates at once and zero momentum.
        state.tree.momentum_W = Default::default();
        let mut workspace = FlexibleWorkspace::new(&system);
        workspace.set_state(&state);
        let V = workspace.V_WF_B(tip);
        let rates = [
            state.tree.qd.as_slice(),
            state.mu_dot(),
            state.motor_rates(),
            state.wheel_speeds(),
        ];
        let found = &J * DVector::from_vec(rates.concat());
        let error = (found.fixed_rows::<3>(0) - V.linear).norm()
            + (found.fixed_rows::<3>(3) - V.angular).norm();
        assert!(error < 1e-11, "{error:e}");
        // Another path to the same velocity: positions a short time apart.
        let step = |t: f64| {
            let mut moved = state.clone();
            moved.tree.q += &state.tree.qd * t;
            let rates = state.mu_dot().to_vec();
            moved
                .mu_mut()
                .iter_mut()
                .zip(&rates)
                .for_each(|(x, d)| *x += d * t);
            let turn = workspace.V_WB_B().angular * t;
            moved.tree.R_WB *= nalgebra::UnitQuaternion::from_scaled_axis(turn);
            let mut workspace = FlexibleWorkspace::new(&system);
            workspace.set_state(&moved);
            let X_WF = workspace.X_WB(&moved) * workspace.X_BF(tip);
            (X_WF.translation.vector, X_WF.rotation)
        };
        let h = 1e-5;
        let ((p1, R1), (p0, R0)) = (step(h), step(-h));
        let R_WB = state.tree.R_WB.to_rotation_matrix();
        let v = (p1 - p0) / (2.0 * h);
        // Of so small a turn the angle by its cosine would have only ten digits.
        let turn = (R1 * R0.inverse()).into_inner();
        let w = (turn - turn.transpose()) / (4.0 * h);
        let w = nalgebra::Vector3::new(w[(2, 1)], w[(0, 2)], w[(1, 0)]);
        let error = (R_WB * V.linear - v).norm() + (R_WB * V.angular - w).norm();
        assert!(error < 1e-9, "{error:e}");
    }
    // Undeformed, the columns of the joints are those of the rigid robot with heavier panels.
    let system = fuyu_physics::dynamics::flexible::FlexibleSystem::builder(&model);
    let system = system.build().unwrap();
    let q = DVector::from_row_slice(&POSTURES[1].1);
    let state = FlexibleState::at_rest_with(&system, &q);
    let tip = model.frame("tool0").unwrap();
    let (mut J, mut rigid) = (Matrix6xX::zeros(6), Matrix6xX::zeros(6));
    FlexibleJacobian::new(&system).compute(&state, tip, &mut J);
    let mut workspace = Workspace::new(&model);
    workspace.set_positions(&q);
    workspace.generalized_jacobian(tip, &mut rigid);
    assert!((&J - &rigid).amax() < 1e-13, "{J}{rigid}");
}
