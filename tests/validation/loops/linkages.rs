//! Linkages against their loop-free equations of motion: a single angle describes each of them, and the
//! kinetic energy of a system without momentum is `m(φ) φ̇² / 2`.

use fuyu::dynamics::{
    Direction, Floating, IntegrationMethod, LoopClosure, Loops, State, Workspace,
};
use fuyu::model::Model;
use fuyu::spatial::Twist;
use nalgebra::{Isometry3, Vector2};

use super::mechanisms::*;

/// A linkage closed in `directions` between two frames, at joint positions given approximately.
fn closed(
    model: &Model,
    (a, b): (&str, &str),
    directions: &[Direction],
    q: &[f64],
    qd: &[f64],
) -> Floating {
    let closure = LoopClosure::between(model, "last", a, b, directions).unwrap();
    let mut loops = Loops::new(model, vec![closure]).unwrap();
    let mut state = State::at_rest(model);
    state.q.copy_from_slice(q);
    state.qd.copy_from_slice(qd);
    loops.assemble(&mut state, 1e-6).unwrap();
    assert_eq!(loops.mobility(), 1);
    let mut workspace = Workspace::new(model);
    state.set_base(&mut workspace, &Isometry3::identity(), &Twist::ZERO);
    // At rest as a whole: the base answers the joints.
    state.momentum_W = Default::default();
    Floating::with_loops(loops, state, IntegrationMethod::Dop8)
}

/// Angle after `time` of a linkage with `m(φ) φ̇²` constant, by Runge-Kutta in the only coordinate.
fn angle_after(time: f64, start: f64, rate: f64, m: impl Fn(f64) -> f64) -> f64 {
    let energy = m(start) * rate * rate;
    let f = |phi: f64| rate.signum() * (energy / m(phi)).sqrt();
    let (steps, mut phi) = (4000, start);
    let h = time / f64::from(steps);
    for _ in 0..steps {
        let k1 = f(phi);
        let k2 = f(phi + 0.5 * h * k1);
        let k3 = f(phi + 0.5 * h * k2);
        let k4 = f(phi + h * k3);
        phi += h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4);
    }
    phi
}

/// Angles of coupler and rocker from the base's x axis for a crank angle, and their rates per crank rate:
/// from the vector loop crank + coupler = base + rocker.
fn four_bar_angles(crank: f64) -> ([f64; 3], [f64; 3]) {
    let [a, b, c] = FOUR_BAR;
    let unit = |angle: f64| Vector2::new(angle.cos(), angle.sin());
    let normal = |angle: f64| Vector2::new(-angle.sin(), angle.cos());
    // Two circles meet: about the crank's end with the coupler, about the far pivot with the rocker.
    let gap = Vector2::new(1.0, 0.0) - a * unit(crank);
    let d = gap.norm();
    let along = (d * d + b * b - c * c) / (2.0 * d);
    let across = (b * b - along * along).sqrt();
    let end = gap / d * along + Vector2::new(-gap.y, gap.x) / d * across;
    let rocker_end = end - gap;
    let (coupler, rocker) = (end.y.atan2(end.x), rocker_end.y.atan2(rocker_end.x));
    // a n(φ) + b n(β) β' - c n(γ) γ' = 0
    let (n_b, n_c, rhs) = (b * normal(coupler), c * normal(rocker), -a * normal(crank));
    let det = -n_b.x * n_c.y + n_b.y * n_c.x;
    let coupler_rate = (-rhs.x * n_c.y + rhs.y * n_c.x) / det;
    let rocker_rate = (n_b.x * rhs.y - n_b.y * rhs.x) / det;
    ([crank, coupler, rocker], [1.0, coupler_rate, rocker_rate])
}

/// `m(φ)` of the four-bar linkage on its free base: the energy of all bodies less that which the base's own
/// motion takes away, the system being without linear and angular momentum.
fn four_bar_inertia(crank: f64) -> f64 {
    let (angles, rates) = four_bar_angles(crank);
    let unit = |i: usize| Vector2::new(angles[i].cos(), angles[i].sin());
    let velocity = |i: usize| Vector2::new(-angles[i].sin(), angles[i].cos()) * rates[i];
    let [a, b, c] = FOUR_BAR;
    let (left, right) = (Vector2::new(0.2, 0.0), Vector2::new(1.2, 0.0));
    let positions = [
        Vector2::zeros(),
        left + unit(0) * (a / 2.0),
        left + unit(0) * a + unit(1) * (b / 2.0),
        right + unit(2) * (c / 2.0),
    ];
    let velocities = [
        Vector2::zeros(),
        velocity(0) * (a / 2.0),
        velocity(0) * a + velocity(1) * (b / 2.0),
        velocity(2) * (c / 2.0),
    ];
    let masses = [BASE.0, BAR_MASS[0], BAR_MASS[1], BAR_MASS[2]];
    let total: f64 = masses.iter().sum();
    let mean = |v: &[Vector2<f64>; 4]| {
        v.iter()
            .zip(masses)
            .map(|(v, m)| v * m)
            .sum::<Vector2<f64>>()
            / total
    };
    let (com, drift) = (mean(&positions), mean(&velocities));
    let (mut energy, mut spin, mut inertia) = (0.0, 0.0, BASE.1);
    for ((p, v), m) in positions.iter().zip(velocities).zip(masses) {
        let (r, v) = (p - com, v - drift);
        energy += m * v.norm_squared();
        spin += m * (r.x * v.y - r.y * v.x);
        inertia += m * r.norm_squared();
    }
    for (i, rate) in rates.iter().enumerate() {
        energy += BAR_MOMENT[i] * rate * rate;
        spin += BAR_MOMENT[i] * rate;
        inertia += BAR_MOMENT[i];
    }
    energy - spin * spin / inertia
}

/// The crank goes round; closing the loop in the directions that matter, in all of a hinge,
/// and in those with none left over makes no difference.
#[test]
fn a_planar_four_bar_moves_as_its_equation_says() {
    let model = four_bar();
    let (angles, rates) = four_bar_angles(0.3);
    let q = [angles[0], angles[1] - angles[0], angles[2]];
    let speed = 2.0;
    let qd = [speed, (rates[1] - 1.0) * speed, rates[2] * speed];
    let ends = ("coupler_tip", "rocker_tip");
    let mut others = Vec::new();
    for directions in [IN_PLANE, HINGE, &[X, Y, Z, Roll]] {
        let mut floating = closed(&model, ends, directions, &q, &qd);
        for second in 1..=10 {
            floating.step(0.01, 100);
            let crank = floating.state().q[0];
            let time = f64::from(second);
            let expected = angle_after(time, 0.3, speed, four_bar_inertia);
            assert!(
                (crank - expected).abs() < 1e-10,
                "{time} {crank} {expected}"
            );
            let (angles, _) = four_bar_angles(crank);
            let q = &floating.state().q;
            assert!((q[1] + crank - angles[1]).sin().abs() < 1e-13);
            assert!((q[2] - angles[2]).sin().abs() < 1e-13);
        }
        assert!(floating.state().q[0] > std::f64::consts::TAU);
        others.push(floating.state().clone());
    }
    for other in &others {
        assert!((&other.q - &others[0].q).amax() < 1e-13);
        assert!(other.R_WB.angle_to(&others[0].R_WB) < 1e-13);
    }
}

/// Joint angles of the Bennett linkage for its first: opposite ones are equal and opposite, and half
/// angles of neighbours have a constant product of tangents (Bennett 1903).
fn bennett_angles(first: f64) -> [f64; 3] {
    let (alpha, beta) = bennett_twists();
    let product = ((beta + alpha) / 2.0).sin() / ((beta - alpha) / 2.0).sin();
    let second = 2.0 * (product / (first / 2.0).tan()).atan();
    [first, second, -first]
}

/// Its hinge constrains five directions and the tree has three joints, yet it moves: three of the
/// constraints depend on the others, at every position.
#[test]
fn a_bennett_linkage_moves_on_its_closed_form() {
    let model = bennett();
    let rate = 1.5;
    let slopes = |first: f64| {
        let h = 1e-4;
        let (up, down) = (bennett_angles(first + h), bennett_angles(first - h));
        let (up2, down2) = (
            bennett_angles(first + 2.0 * h),
            bennett_angles(first - 2.0 * h),
        );
        [0, 1, 2].map(|i| (8.0 * (up[i] - down[i]) - (up2[i] - down2[i])) / (12.0 * h))
    };
    let start = 0.8;
    let q = bennett_angles(start);
    let qd = slopes(start).map(|s| s * rate);
    let ends = ("hinge", "end");
    let mut floating = closed(&model, ends, HINGE, &q, &qd);
    let mut workspace = Workspace::new(&model);
    let mut inertia = |first: f64| {
        let q = nalgebra::DVector::from_row_slice(&bennett_angles(first));
        let g = nalgebra::DVector::from_row_slice(&slopes(first));
        workspace.set_positions(&q);
        g.dot(&(workspace.reduced_inertia() * &g))
    };
    let energy = inertia(start) * rate * rate;
    for step in 0..300 {
        floating.step(0.01, 1);
        let state = floating.state();
        let first = state.q[0];
        if first > 2.9 {
            // Half angles near a right angle have no tangent to compare.
            assert!(step > 50);
            break;
        }
        let expected = bennett_angles(first);
        for (q, expected) in state.q.iter().zip(expected) {
            assert!(((q - expected) / 2.0).sin().abs() < 1e-12, "{q} {expected}");
        }
        let now = inertia(first) * state.qd[0] * state.qd[0];
        assert!((now / energy - 1.0).abs() < 1e-10, "{now} {energy}");
    }
}

/// The hinge force at the four-bar's cut, from Newton's law for the rocker alone: what the closure exerts
/// on it about its pivot is its spin's rate of change. Redundant directions have no force of their own.
#[test]
fn closure_forces_are_those_of_newtons_law() {
    let model = four_bar();
    let (angles, rates) = four_bar_angles(0.3);
    let q = [angles[0], angles[1] - angles[0], angles[2]];
    let qd = [2.0, (rates[1] - 1.0) * 2.0, rates[2] * 2.0];
    let mut floating = closed(&model, ("coupler_tip", "rocker_tip"), HINGE, &q, &qd);
    floating.step(0.01, 50);
    let forces = floating.closure_forces();
    let [Some(x), Some(y), None, None, None, Some(0.0)] = forces[0] else {
        panic!("{forces:?}")
    };
    floating.accelerations();
    let workspace = floating.workspace();
    let rocker = model.frame("rocker").unwrap();
    let (motion, acceleration) = (workspace.V_WF_B(rocker), workspace.A_WF_B(rocker));
    let X_BR = workspace.X_BF(rocker);
    let r = X_BR.rotation * nalgebra::Vector3::x() * (FOUR_BAR[2] / 2.0);
    let w = motion.angular;
    let a_com = acceleration.linear + acceleration.angular.cross(&r) + w.cross(&w.cross(&r));
    let torque = BAR_MOMENT[2] * acceleration.angular.z + BAR_MASS[2] * r.cross(&a_com).z;
    let tip = model.frame("coupler_tip").unwrap();
    let force = workspace.X_BF(tip).rotation * nalgebra::Vector3::new(x, y, 0.0);
    let exerted = (r * 2.0).cross(&force).z;
    assert!(exerted.abs() > 0.1);
    assert!(
        (exerted - torque).abs() < 1e-11 * torque.abs().max(1.0),
        "{exerted} {torque}"
    );
}
