//! Control loops that sampling makes unstable are found before a run, with parameters that work.

use fuyu::{experiments::ClosedLoop, nodes::scenario::Scenario, ros::ParameterValue};

const SHIPPED: [f64; 6] = [400.0, 100.0, 200.0, 10.0, 2.0, 2.0];

fn scenario(name: &str) -> Scenario {
    Scenario::read(&format!("package://fuyu/config/{name}.yaml")).unwrap()
}

/// `positioning` with these gains and state rate, and without default effort limits.
fn with(k_v: [f64; 6], rate: f64, time_step: f64) -> Scenario {
    let mut scenario = scenario("positioning");
    let double = ParameterValue::Double;
    let gains = ParameterValue::DoubleArray(k_v.to_vec());
    scenario.set("controller", "k_v", gains);
    scenario.set("dynamics", "state_rate", double(rate));
    scenario.set("dynamics", "time_step", double(time_step));
    scenario.set("dynamics", "default_joint_acceleration", double(0.0));
    scenario
}

/// Whether the joints of the closed loop stay below 100 rad/s for two seconds.
fn is_stable(scenario: &Scenario) -> bool {
    let mut closed_loop = ClosedLoop::new(scenario).unwrap();
    while closed_loop.world.time() < 2.0 {
        let answered = closed_loop.answer::<String>(&mut Vec::new(), |_, _| Ok(()));
        if answered.is_err()
            || closed_loop.advance().is_err()
            || closed_loop.world.robot.state().qd.amax() > 100.0
        {
            return false;
        }
    }
    true
}

#[test]
fn scenarios_that_ship_are_stable() {
    for name in [
        "approximate_jacobian",
        "dual_arm",
        "positioning",
        "servicing",
        "straight_path",
        "tracking",
    ] {
        assert_eq!(scenario(name).warnings(false), [""; 0], "{name}");
    }
}

// Would break if the eigenvalue, the limit or a remedy were wrong. A smaller time_step never helps.
#[test]
fn an_unstable_loop_is_found_and_the_remedies_work() {
    for (joint, gain) in [(4, 1e4), (5, 10.0), (3, 1e4)] {
        let mut k_v = SHIPPED;
        k_v[joint] = gain;
        for time_step in [1e-2, 1e-3, 1e-4] {
            assert!(!is_stable(&with(k_v, 100.0, time_step)), "joint {joint}");
        }
        let warnings = with(k_v, 100.0, 1e-2).warnings(true);
        assert_eq!(warnings.len(), 1);
        let warning = &warnings[0];
        println!("{warning}");
        assert!(warning.contains(&format!("joint 'joint{}'", joint + 1)));
        let after = |text: &str| {
            let at = warning.find(text)? + text.len();
            let word = warning[at..].split(' ').next()?;
            word.trim_end_matches(',').parse::<f64>().ok()
        };
        k_v[joint] = after("of at most ").unwrap();
        assert!(k_v[joint] > 0.5 * SHIPPED[joint]);
        assert_eq!(with(k_v, 100.0, 1e-2).warnings(false), [""; 0]);
        assert!(is_stable(&with(k_v, 100.0, 1e-2)), "k_v {}", k_v[joint]);
        if let Some(rate) = after("state_rate of ") {
            k_v[joint] = gain;
            assert_eq!(with(k_v, rate, 1e-2).warnings(false), [""; 0]);
            assert!(is_stable(&with(k_v, rate, 1e-2)), "state_rate {rate}");
        }
    }
}

// The servo of commanded rates is sampled by itself, and the law for several tips has its own damping.
#[test]
fn the_damping_of_a_law_counts_instead_of_k_v() {
    let mut dual_arm = scenario("dual_arm");
    let double = ParameterValue::Double;
    dual_arm.set("controller", "operational_space.frequency", double(200.0));
    let warnings = dual_arm.warnings(true);
    assert!(
        warnings.len() == 1 && warnings[0].contains("operational_space.frequency"),
        "{warnings:?}"
    );
}
