//! A robot or target to be drawn, and the motion of its links during an exposure.

use fuyu_render::Motion;
use nalgebra::{DVector, Isometry3, Translation3, UnitQuaternion, Vector3};

use super::shape::{Part, Shape};
use crate::{
    dynamics::Workspace,
    model::{Frame, Model},
    msg::{nav_msgs::Odometry, sensor_msgs::JointState},
    nodes::{
        geometry::{pose_from_msg, vector_from_msg},
        joint_vectors,
    },
    spatial::Pose,
};

/// A robot or target with its meshes.
pub struct Body {
    model: Model,
    workspace: Workspace,
    parts: Vec<(Frame, Part)>,
}

/// State of a body, from which its motion during an exposure is computed.
pub struct BodyState {
    q: DVector<f64>,
    qd: DVector<f64>,
    X_WB: Isometry3<f64>,
    /// Velocity of the base frame's origin, in base axes \[m/s\].
    v_WB_B: Vector3<f64>,
    /// Angular velocity, in base axes \[rad/s\].
    w_WB_B: Vector3<f64>,
}

impl Body {
    /// A body with the links of `model` and the meshes of `shape`. Meshes on links that `model` lacks are left out.
    pub fn new(model: Model, shape: &Shape) -> Self {
        let parts = shape.parts.iter();
        let parts = parts.filter_map(|part| Some((model.frame(&part.link)?.clone(), part.clone())));
        Self {
            workspace: Workspace::new(&model),
            parts: parts.collect(),
            model,
        }
    }

    /// Its model of links and joints.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Its meshes.
    pub fn parts(&self) -> impl Iterator<Item = &Part> {
        self.parts.iter().map(|(_, part)| part)
    }

    /// The state from messages; without `joints`, joint positions and rates are zero.
    ///
    /// # Errors
    /// Names the missing or invalid value.
    pub fn state(
        &self,
        joints: Option<&JointState>,
        odometry: &Odometry,
    ) -> Result<BodyState, String> {
        let (q, qd) = match joints {
            Some(joints) => (
                joint_vectors::positions(&self.model, joints)?,
                joint_vectors::velocities(&self.model, joints)?,
            ),
            None => (
                DVector::zeros(self.model.dof()),
                DVector::zeros(self.model.dof()),
            ),
        };
        let X_WB = pose_from_msg(&odometry.pose.pose)?;
        let twist = &odometry.twist.twist;
        let (v_WB_B, w_WB_B) = (
            vector_from_msg(&twist.linear),
            vector_from_msg(&twist.angular),
        );
        if !v_WB_B.iter().chain(w_WB_B.iter()).all(|x| x.is_finite()) {
            return Err("twist is not finite".to_owned());
        }
        Ok(BodyState {
            q,
            qd,
            X_WB,
            v_WB_B,
            w_WB_B,
        })
    }

    /// Motions of the frames that `of_frames` gives in the base frame, during an exposure of `exposure` seconds;
    /// `state` is at mid-exposure.
    fn motions(
        &mut self,
        state: &BodyState,
        exposure: f64,
        of_frames: impl Fn(&Workspace) -> Vec<Isometry3<f64>>,
    ) -> Vec<Motion> {
        let [open, close] = [-0.5, 0.5].map(|share| {
            let time = share * exposure;
            self.workspace.set_positions(&(&state.q + &state.qd * time));
            let moved = state.X_WB.rotation * state.v_WB_B * time;
            let X_WB = Isometry3::from_parts(
                Translation3::from(state.X_WB.translation.vector + moved),
                state.X_WB.rotation * UnitQuaternion::from_scaled_axis(state.w_WB_B * time),
            );
            let frames = of_frames(&self.workspace).into_iter();
            frames.map(|X_BF| X_WB * X_BF).collect::<Vec<_>>()
        });
        let pairs = open.into_iter().zip(close);
        pairs.map(|(open, close)| Motion { open, close }).collect()
    }

    /// Motions of its meshes during an exposure of `exposure` seconds; `state` is at mid-exposure.
    pub fn part_motions(&mut self, state: &BodyState, exposure: f64) -> Vec<Motion> {
        let frames: Vec<_> = (self.parts.iter())
            .map(|(frame, part)| (frame.clone(), part.origin))
            .collect();
        self.motions(state, exposure, |workspace| {
            let places = frames.iter();
            places
                .map(|(frame, origin)| with_quaternion(&workspace.X_BF(frame)) * origin)
                .collect()
        })
    }

    /// Motion of a link's frame during an exposure; `state` is at mid-exposure.
    pub fn frame_motion(&mut self, frame: &Frame, state: &BodyState, exposure: f64) -> Motion {
        let place = |workspace: &Workspace| vec![with_quaternion(&workspace.X_BF(frame))];
        self.motions(state, exposure, place)[0]
    }
}

fn with_quaternion(X: &Pose) -> Isometry3<f64> {
    Isometry3::from_parts(
        X.translation,
        UnitQuaternion::from_rotation_matrix(&X.rotation),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::geometry_msgs;

    #[test]
    fn the_motion_in_an_exposure_follows_from_the_rates() {
        let xml = include_str!("../../../../urdf/servicer.urdf");
        let model = Model::repaired_from_urdf(xml, "servicer").unwrap().model;
        let dof = model.dof();
        let mut body = Body::new(model, &Shape::of_urdf(xml, "servicer"));
        let joints = JointState {
            name: body
                .model()
                .joints()
                .iter()
                .map(|j| j.name.clone())
                .collect(),
            position: vec![0.1; dof],
            velocity: [vec![0.5], vec![0.0; dof - 1]].concat(),
            ..JointState::default()
        };
        let mut odometry = Odometry::default();
        odometry.pose.pose.orientation.w = 1.0;
        odometry.twist.twist.linear = geometry_msgs::Vector3 {
            x: 2.0,
            y: 0.0,
            z: 0.0,
        };
        odometry.twist.twist.angular = geometry_msgs::Vector3 {
            x: 0.0,
            y: 0.0,
            z: 0.4,
        };
        let state = body.state(Some(&joints), &odometry).unwrap();
        let motions = body.part_motions(&state, 0.02);
        // The first part is the base's cylinder, about its origin.
        let base = &motions[0];
        let moved = base.close.translation.vector - base.open.translation.vector;
        assert!((moved - Vector3::new(0.04, 0.0, 0.0)).norm() < 1e-12);
        let turned = base.open.rotation.rotation_to(&base.close.rotation);
        assert!((turned.angle() - 0.008).abs() < 1e-12);
        // The first link turns about base +y at 0.5 rad/s in addition.
        let link = &motions[3];
        let turned = link.open.rotation.rotation_to(&link.close.rotation);
        assert!((turned.angle() - 0.02 * 0.5_f64.hypot(0.4)).abs() < 1e-6);
        assert!(body.state(None, &odometry).is_ok());
        odometry.twist.twist.angular.z = f64::NAN;
        assert!(body.state(Some(&joints), &odometry).is_err());
    }
}
