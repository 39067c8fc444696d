use super::*;
use crate::control::fixtures::satellite;
use crate::dynamics::flexible::Thruster;
use nalgebra::Unit;

/// A cube of 2 m with thrusters on its edges: pairs that push in parallel to give torques about each axis.
fn system(min_on_time: f64, which: &[([f64; 3], [f64; 3])]) -> FlexibleSystem {
    let model = satellite();
    let base = model.frame("base_link").unwrap();
    let mut builder = FlexibleSystem::builder(&model);
    for (i, (position, direction)) in which.iter().enumerate() {
        let thruster = Thruster {
            name: format!("t{i}"),
            position: Vector3::from(*position),
            direction: Unit::new_normalize(Vector3::from(*direction)),
            thrust: 5.0,
            min_on_time,
        };
        builder = builder.thruster(base, thruster);
    }
    builder.build().unwrap()
}

/// Twelve thrusters: for each axis two couples in each sense.
fn twelve() -> Vec<([f64; 3], [f64; 3])> {
    let mut all = Vec::new();
    for axis in 0..3 {
        let (along, across) = ((axis + 1) % 3, (axis + 2) % 3);
        for (side, sense) in [(1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)] {
            let (mut position, mut direction) = ([0.0; 3], [0.0; 3]);
            position[along] = side;
            direction[across] = sense;
            all.push((position, direction));
        }
    }
    all
}

// Couples exist, so the torque comes without a net force, and with the least propellant: each couple has a lever of 2
// m.
#[test]
fn a_torque_is_given_by_couples() {
    let system = system(0.0, &twelve());
    let mut allocator = ThrusterAllocator::new(&system, 1.0).unwrap().unwrap();
    for wanted in [
        Vector3::new(3.0, 0.0, 0.0),
        Vector3::new(-1.0, 2.0, 0.5),
        Vector3::new(1e-6, 0.0, -2e-6),
    ] {
        let given = allocator.allocate(&wanted, &Vector3::zeros());
        assert!(
            (given.torque - wanted).norm() < 1e-9 * wanted.norm(),
            "{given:?}"
        );
        assert!(given.force.norm() < 1e-3 * wanted.norm(), "{given:?}");
        let total: f64 = allocator.on_times().iter().sum();
        let least = wanted.abs().sum() / 5.0;
        assert!((total / least - 1.0).abs() < 1e-6, "{total} {least}");
        assert!(!given.saturated);
    }
    // About another centre of mass.
    let p_BC = Vector3::new(0.2, -0.1, 0.3);
    let wanted = Vector3::new(0.5, 1.0, -1.5);
    let given = allocator.allocate(&wanted, &p_BC);
    assert!((given.torque - wanted).norm() < 1e-9);
}

// More than the thrusters can give: the direction stays, and nothing is owed.
#[test]
fn on_times_do_not_exceed_the_period() {
    let system = system(0.0, &twelve());
    let mut allocator = ThrusterAllocator::new(&system, 0.5).unwrap().unwrap();
    let wanted = Vector3::new(100.0, 50.0, 0.0);
    let given = allocator.allocate(&wanted, &Vector3::zeros());
    assert!(given.saturated);
    let longest = allocator.on_times().iter().copied().fold(0.0, f64::max);
    assert!((longest - 0.5).abs() < 1e-12);
    assert!(given.torque.cross(&wanted).norm() < 1e-6 * given.torque.norm() * wanted.norm());
    let given = allocator.allocate(&Vector3::zeros(), &Vector3::zeros());
    assert_eq!(given.torque, Vector3::zeros());
}

// A torque whose on-time of 2 ms is below the shortest of 20 ms is given by a pulse in every tenth period or so: the
// mean is right within one pulse.
#[test]
fn short_pulses_are_collected() {
    let system = system(0.02, &twelve());
    let mut allocator = ThrusterAllocator::new(&system, 0.1).unwrap().unwrap();
    let wanted = Vector3::new(0.2, -0.07, 0.11);
    let (mut sum, mut pulses) = (Vector3::zeros(), 0);
    for _ in 0..1000 {
        sum += allocator.allocate(&wanted, &Vector3::zeros()).torque * 0.1;
        for time in allocator.on_times() {
            assert!(*time == 0.0 || *time >= 0.02);
            pulses += usize::from(*time > 0.0);
        }
    }
    // The impulse of the shortest pulse is .1 N m s.
    let error = sum - wanted * 100.0;
    assert!(error.amax() < 0.1 + 1e-9, "{error}");
    assert!(pulses > 100 && pulses < 1000, "{pulses}");
}

#[test]
fn thrusters_that_cannot_do_are_refused() {
    let one_sided: Vec<_> = twelve().into_iter().take(10).collect();
    let text = ThrusterAllocator::new(&system(0.0, &one_sided), 0.1)
        .unwrap_err()
        .to_string();
    assert!(
        text.starts_with("the thrusters give no torque of ") && text.ends_with("every direction"),
        "{text}"
    );
    let text = ThrusterAllocator::new(&system(0.2, &twelve()), 0.1)
        .unwrap_err()
        .to_string();
    assert_eq!(
        text,
        "thruster t0, min_on_time [s] is 0.2; it must be at most the control period"
    );
    assert!(
        ThrusterAllocator::new(&system(0.0, &[]), 0.1)
            .unwrap()
            .is_none()
    );
}
