//! Links 2 and 3 of the servicer as elastic bodies.

use fuyu_physics::dynamics::IntegrationMethod;
use fuyu_physics::dynamics::flexible::{
    FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleSystem, FlexibleWorkspace,
    LinearModel,
};
use fuyu_physics::spatial::Pose;
use fuyu_structures::ElasticLink;
use nalgebra::DVector;

use crate::support::{
    POSTURES, attitude_error, difference, efforts, fixture, numbers, relative, servicer, vector,
};

fn servicer_with_elastic_links(fixed_interface_modes: usize) -> FlexibleSystem {
    let model = servicer();
    let link = ElasticLink {
        length: 2.5,
        mass_per_length: 20.0,
        EI: [2e5, 2e5],
        radius_of_gyration: 0.07071,
        fixed_interface_modes,
        elements: 16,
        damping_time: 0.0,
        second_order: false,
    };
    let mut builder = FlexibleSystem::builder(&model);
    for name in ["link2", "link3"] {
        let body = link.appendage(name).unwrap();
        builder = builder.elastic_link(name, Pose::identity(), body, 0);
    }
    builder.build().unwrap()
}

// Base free and base fixed, joints locked, three postures. The shapes span the same space as the fixture's, so the
// agreement is better than the convergence: 1e-5 against the converged values with four functions in each plane.
#[test]
fn frequencies_with_elastic_links_are_the_independent_ones() {
    let expected = &fixture("flexible_beam")["flexible_links"];
    for (extra, key) in [(0, "2+2"), (2, "4+4")] {
        let system = servicer_with_elastic_links(extra);
        for (name, q) in &POSTURES {
            let linear = LinearModel::new(&system, &DVector::from_row_slice(q));
            let free = linear.frequencies_hz(&linear.base_and_modes()).unwrap();
            let modes: Vec<usize> = linear.base_and_modes().split_off(6);
            let fixed = linear.frequencies_hz(&modes).unwrap();
            let case = &expected[format!("{name} static+Ritz {key}")];
            let free_hz = numbers(&case["base_free_hz"]);
            let worst = [
                relative(&free[..2], &free_hz[..2]),
                relative(&fixed[..2], &numbers(&case["base_fixed_hz"])[..2]),
            ];
            let converged = &expected[format!("{name} static+Ritz 6+6")];
            let to_converged = relative(&free[..2], &numbers(&converged["base_free_hz"])[..2]);
            println!("{name} {key}: {worst:?}; to 6 functions {to_converged:.1e}");
            assert!(
                worst[0] < 1e-5 && worst[1] < 1e-5,
                "{name} {key}: {worst:?}"
            );
            assert!(
                extra == 0 || to_converged < 1e-5,
                "{name}: {to_converged:e}"
            );
        }
    }
}

// The run of 10 s with two static shapes in each plane: joints, attitude and tip.
#[test]
fn an_arm_with_elastic_links_moves_as_in_the_independent_run() {
    let run = &fixture("flexible_beam")["flexible_links"]["run"];
    let system = servicer_with_elastic_links(0);
    let tip = system.model().frame("tool0").unwrap().clone();
    let q0 = DVector::from_vec(numbers(&run["q"][0]));
    let mut state = FlexibleState::at_rest_with(&system, &q0);
    let mut workspace = FlexibleWorkspace::new(&system);
    let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Dop8);
    let mut drive = |t: f64, state: &FlexibleState, input: &mut FlexibleInput| {
        efforts(1.0, t, state.tree.qd.as_slice(), &mut input.tree.efforts);
    };
    let mut worst = [0.0_f64; 6];
    for i in 1..=10 {
        integrator.steps(&mut state, &mut workspace, 0.005, 200, &mut drive);
        let p = (workspace.X_WB(&state) * workspace.X_BF(&tip))
            .translation
            .vector;
        worst[0] = worst[0].max(attitude_error(&state, &run["quat"][i]));
        worst[1] = worst[1].max(difference(state.tree.q.as_slice(), &numbers(&run["q"][i])));
        worst[2] = worst[2].max((p - vector(&run["tip"][i])).norm());
        let energy = workspace.kinetic_energy(&state) + workspace.strain_energy(&state);
        worst[3] = worst[3].max((energy - state.tree.work).abs());
        worst[5] = worst[5].max((energy - run["energy"][i].as_f64().unwrap()).abs());
        let carried = workspace.carried_momentum(&state);
        worst[4] = worst[4].max(carried.angular.norm() + carried.linear.norm());
    }
    println!("attitude, joints, tip, balance, momentum, energy: {worst:?}");
    // The fixture's shapes are integrated on another mesh. An angle that differs by 1e-7 changes the work of 10 N m by
    // 1e-6 J.
    assert!(
        worst[0] < 1e-8 && worst[1] < 1e-7 && worst[2] < 1e-7,
        "{worst:?}"
    );
    assert!(worst[3] < 1e-9 && worst[4] < 1e-12, "{worst:?}");
    assert!(worst[5] < 1e-6, "{worst:?}");
}
