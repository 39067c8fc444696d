//! The wrench that a part of the robot exerts on the rest through a joint.

use super::composite::Articulated;
use super::{FlexibleInput, FlexibleState, FlexibleWorkspace};
use crate::spatial::{Twist, Wrench};

impl FlexibleWorkspace {
    /// Implements [`FlexibleFloating::transmitted_wrench`](super::FlexibleFloating::transmitted_wrench).
    pub(super) fn transmitted_wrench(
        &mut self,
        b: usize,
        state: &FlexibleState,
        input: &FlexibleInput,
    ) -> Wrench {
        assert!(
            (1..self.nodes.len()).contains(&b),
            "body {b} is not moved by a joint"
        );
        match self.system.is_gyrostat() {
            true => self.wrench_on_rest(b, state, input),
            false => self.wrench_on_subtree(b) * -1.0,
        }
    }

    /// Wrench of the rest on body `b` with its subtree: acceleration times articulated inertia, plus bias force (R.
    /// Featherstone, Rigid Body Dynamics Algorithms, 2008, section 7.1). Valid only for a robot that holds no target,
    /// whose articulated inertias are those of the last accelerations.
    fn wrench_on_subtree(&self, b: usize) -> Wrench {
        let node = &self.nodes[b];
        (node.inertia.times(&node.A) + node.force).shifted_to_parent(&node.X_0)
    }

    /// Wrench of the subtree of `b` on the rest: rate of momentum of the bodies outside the subtree, minus all other
    /// wrenches on them. So it is also valid while the subtree holds a target. For rigid bodies with wheels; the terms
    /// are those of the equations of motion (`acceleration.rs`).
    fn wrench_on_rest(&mut self, b: usize, state: &FlexibleState, input: &FlexibleInput) -> Wrench {
        self.set_poses();
        self.set_external(state, input);
        let system = &self.system;
        let beyond = b..system.model().bodies()[b].subtree_end;
        let rest = self.nodes.iter().zip(&system.compiled().bodies).enumerate();
        let mut total_B = Wrench::ZERO;
        for (_, (node, body)) in rest.filter(|(index, _)| !beyond.contains(index)) {
            let turning = Twist::new(node.V.angular, nalgebra::Vector3::zeros());
            let gained = Articulated::of(&body.rigid).times(&node.A)
                + turning.cross_force(&body.rigid.momentum(&turning));
            total_B += (gained - node.external).shifted_to_parent(&node.X_0);
        }
        let wheels = system.wheels().iter().zip(state.wheel_speeds());
        let motors = system.wheel_rotors().iter().zip(&input.wheel_torques);
        for ((wheel, speed), (rotor, wanted)) in wheels.zip(motors) {
            if beyond.contains(&rotor.body) {
                continue;
            }
            let node = &self.nodes[rotor.body];
            // The wheel's speed limit applies at this instant, as for accelerations.
            let torque = wheel.limited_torque(*wanted, *speed, 0.0) + wheel.friction(*speed);
            let locked = rotor.inertia * rotor.axis.dot(&node.A.angular);
            let gained = rotor.axis * (torque - locked);
            let turned = node.V.angular.cross(&rotor.momentum(state));
            total_B.torque += node.X_0.rotation * (gained + turned);
        }
        total_B
    }
}

#[cfg(test)]
mod tests {
    use super::super::{FlexibleFloating, FlexibleSystem, Thruster, Wheel};
    use super::*;
    use crate::dynamics::IntegrationMethod;
    use crate::model::Model;
    use nalgebra::Vector3;

    // Two formulations that share only the state: articulated inertias, and the momentum of the rest. Fails if one of
    // them omits wheels or thrusters, or if an axis or a sign is wrong.
    #[test]
    fn articulated_inertias_and_the_momentum_of_the_rest_agree() {
        let text = include_str!("../../../../../urdf/servicer.urdf");
        let model = Model::from_urdf(text, "servicer.urdf").unwrap();
        let frame = |name: &str| model.frame(name).unwrap();
        let mut wheel = Wheel::new("x", Vector3::x_axis(), 0.2);
        wheel.viscous_friction = 0.01;
        let jet = Thruster {
            name: "jet".into(),
            position: Vector3::new(0.5, 0.0, -0.7),
            direction: Vector3::y_axis(),
            thrust: 10.0,
            min_on_time: 0.0,
        };
        let system = FlexibleSystem::builder(&model)
            .wheel(frame("base_link"), wheel)
            .wheel(
                frame("link2"),
                Wheel::new("on the arm", Vector3::z_axis(), 1e-3),
            )
            .wheel(
                frame("link5"),
                Wheel::new("beyond", Vector3::y_axis(), 1e-4),
            )
            .thruster(frame("base_link"), jet)
            .build()
            .unwrap();
        let mut state = FlexibleState::at_rest(&system);
        state.tree.momentum_W.angular = Vector3::new(40.0, -25.0, 60.0);
        for (j, (q, qd)) in (state.tree.q.iter_mut().zip(&mut state.tree.qd)).enumerate() {
            (*q, *qd) = (0.4 - 0.3 * j as f64, 0.2 * (j as f64 - 2.0));
        }
        state
            .wheel_speeds_mut()
            .copy_from_slice(&[120.0, -80.0, 200.0]);
        let mut robot = FlexibleFloating::new(&system, state, IntegrationMethod::Rk4);
        robot.hold_efforts(&[5.0, -20.0, 8.0, 1.0, -2.0, 0.5]);
        robot
            .input_mut()
            .wheel_torques
            .copy_from_slice(&[0.6, -0.02, 0.01]);
        robot.fire(0, 1.0);
        robot.input_mut().tree.wrenches[2] =
            Wrench::new(Vector3::new(1.0, 2.0, -3.0), Vector3::new(-4.0, 5.0, 6.0));
        robot.set_accelerations();
        for b in 1..model.bodies().len() {
            let articulated = robot.workspace().wrench_on_subtree(b) * -1.0;
            let balance = robot.transmitted_wrench(b);
            let off = articulated - balance;
            let scale = articulated.force.norm() + articulated.torque.norm();
            assert!(scale > 1.0, "{b}: {scale}");
            let off = (off.force.norm() + off.torque.norm()) / scale;
            assert!(off < 1e-11, "{b}: {off:e}");
        }
    }
}
