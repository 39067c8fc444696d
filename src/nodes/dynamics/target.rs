//! A free body, rigid or with joints: its motion, name, frames and description.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use roxmltree::{Document, Node};

use super::{
    divergence::{self, StateBackup},
    messages::FrameTree,
    params::TargetParams,
};
use crate::{
    dynamics::{Floating, IntegrationMethod, JointPhysics, State},
    model::Model,
};

/// A free body. Its joints have no drives; only springs, dampers, friction and stops act on them.
pub struct Target {
    /// Unique identifier: a body that is removed and one that is added later may have the same name.
    pub(super) id: u64,
    /// Its name, also that of its root frame.
    pub name: String,
    /// The body.
    pub body: Floating,
    /// Its description as URDF, for viewers. Links are named as their frames: the root link `name`, any other link L
    /// `name/L`. Two targets with the same description thus have no frame in common.
    pub description: String,
    /// File or parameter that the description is from.
    pub(super) source: String,
    /// Whether it was spawned after the start.
    pub spawned: bool,
    /// Its frames.
    pub(super) frames: FrameTree,
    start: State,
    /// The state before the last step.
    backup: StateBackup,
    /// Whether the last step was undone after a divergence.
    is_restored: bool,
}

impl Target {
    /// The free body that `params` describe.
    ///
    /// A line that names the description's source, if it is invalid; the parameter, if it does not fit the joints; or
    /// the target, if it moves too fast.
    /// the target, if it moves too fast.
    pub fn new(
        params: &TargetParams,
        method: IntegrationMethod,
        joint_physics: &JointPhysics,
    ) -> Result<Self, String> {
        Self::of_model(params, params.description.compile()?, method, joint_physics)
    }

    /// As [`Self::new`], with the model compiled from the description.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(super) fn of_model(
        params: &TargetParams,
        model: Model,
        method: IntegrationMethod,
        joint_physics: &JointPhysics,
    ) -> Result<Self, String> {
        let name = params.name.as_str();
        let mut start = State::at_rest(&model);
        params.joints.place(name, &mut start)?;
        params.motion.place(&model, &mut start);
        let frames = FrameTree::of_target(name, &model);
        let body = Floating::new(model, start.clone(), method).with_joint_physics(joint_physics);
        if let Some(what) = divergence::of(&body) {
            return Err(format!(
                "target {name} cannot be simulated from its start: {what}"
            ));
        }
        static NEXT_ID: AtomicU64 = AtomicU64::new(0);
        Ok(Self {
            id: NEXT_ID.fetch_add(1, Relaxed),
            name: name.to_owned(),
            backup: StateBackup::new(&body),
            body,
            description: with_link_names(name, &params.description.xml),
            source: params.description.source.clone(),
            spawned: false,
            frames,
            start,
            is_restored: false,
        })
    }

    /// Restores the initial state, or the state in which it was spawned.
    pub fn reset(&mut self) {
        self.body.set_state(self.start.clone());
    }

    /// Saves the current state, to be restored after a divergence.
    pub(super) fn save(&mut self) {
        if !std::mem::take(&mut self.is_restored) {
            self.backup.note_command();
        }
        self.backup.save(&self.body);
    }

    /// Advances by `steps` steps of `dt` \[s\].
    pub(super) fn step(&mut self, dt: f64, steps: usize) {
        self.save();
        self.body.step(dt, steps);
    }

    /// Restores the state before the last step, at `time` \[s\], with the joints stopped and the momentum unchanged.
    /// The body is stopped completely if it has no joints, or if the previous step was undone, too.
    pub(super) fn restore(&mut self, time: f64) {
        match self.has_joints() {
            true => self.backup.restore(&mut self.body, time),
            false => self.backup.restore_at_rest(&mut self.body, time),
        }
        self.is_restored = true;
    }

    /// Whether it has movable joints.
    pub fn has_joints(&self) -> bool {
        self.body.model().dof() > 0
    }
}

/// A valid URDF with renamed links: the root link becomes `name`, any other link L `name/L`.
fn with_link_names(name: &str, xml: &str) -> String {
    // A model was compiled from it: it is valid XML.
    let Ok(document) = Document::parse(xml) else {
        return xml.to_owned();
    };
    let robot = document.root_element();
    let elements = |tag: &'static str| robot.children().filter(move |e| e.has_tag_name(tag));
    let ends = |tag: &'static str| {
        (elements("joint"))
            .flat_map(move |joint| joint.children().filter(move |e| e.has_tag_name(tag)))
    };
    let links: Vec<&str> = elements("link")
        .filter_map(|e| e.attribute("name"))
        .collect();
    let children: Vec<&str> = ends("child").filter_map(|e| e.attribute("link")).collect();
    let mentions = (elements("link").map(|e| (e, "name")))
        .chain(ends("parent").map(|e| (e, "link")))
        .chain(ends("child").map(|e| (e, "link")))
        .chain(elements("gazebo").map(|e| (e, "reference")))
        .filter_map(|(element, key): (Node, _)| element.attribute_node(key));
    // References of Gazebo elements may also be to joints, which keep their names.
    let mut mentions: Vec<_> = mentions.filter(|a| links.contains(&a.value())).collect();
    mentions.sort_by_key(|attribute| attribute.range_value().start);
    let mut renamed = String::with_capacity(xml.len() + mentions.len() * (name.len() + 1));
    let mut done = 0;
    for mention in mentions {
        let range = mention.range_value();
        renamed += &xml[done..range.start];
        renamed += name;
        if children.contains(&mention.value()) {
            renamed += "/";
            renamed += &xml[range.clone()];
        }
        done = range.end;
    }
    renamed + &xml[done..]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::dynamics::params::{Description, InitialJoints, InitialMotion};

    const STATION: &str = r#"<robot name="station"><!-- <link name="hull"/> -->
        <link name='hull'><inertial><mass value="2"/>
            <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <link name="mast"/>
        <joint name="hull" type="fixed"><origin xyz="0 0 3"/><parent link="hull"/><child link="mast"/></joint>
        <gazebo reference="mast"/>
    </robot>"#;

    // Would break if a link kept its name, or if a joint or a comment with a link's name were taken for the link.
    #[test]
    fn links_are_named_after_the_target() {
        let renamed = with_link_names("far/debris", STATION);
        assert_eq!(
            renamed,
            STATION
                .replace("'hull'", "'far/debris'")
                .replace(r#"parent link="hull""#, r#"parent link="far/debris""#)
                .replace(r#""mast""#, r#""far/debris/mast""#)
        );
        let model = Model::from_urdf(&renamed, "station").unwrap();
        let names: Vec<_> = model.frames().iter().map(|f| f.name.as_str()).collect();
        assert_eq!(names, ["far/debris", "far/debris/mast"]);
    }

    fn params(xml: &str, joints: InitialJoints) -> TargetParams {
        TargetParams {
            name: "debris".to_owned(),
            description: Description::new(xml.to_owned(), "station".to_owned(), true),
            motion: InitialMotion {
                pose: nalgebra::Isometry3::identity(),
                velocity_W: nalgebra::Vector3::zeros(),
                angular_velocity_B: nalgebra::Vector3::zeros(),
            },
            joints,
        }
    }

    fn target(xml: &str, joints: InitialJoints) -> Target {
        let physics = JointPhysics::default();
        Target::new(&params(xml, joints), IntegrationMethod::Rk4, &physics).unwrap()
    }

    #[test]
    fn fixed_frames_are_those_of_the_description() {
        let target = target(STATION, InitialJoints::default());
        let fixed = target.frames.fixed_transforms();
        let [mast] = fixed.as_slice() else {
            panic!("{fixed:?}")
        };
        assert_eq!(mast.header.frame_id, "debris");
        assert_eq!(mast.child_frame_id, "debris/mast");
        assert_eq!(mast.transform.translation.z, 3.0);
        assert!(target.frames.find("debris/mast").is_some());
        // The root's frame has the target's name.
        assert!(target.frames.find("debris/hull").is_none());
    }

    const PANEL: &str = r#"<robot name="sail"><link name="hull"><inertial><mass value="2"/>
            <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <link name="panel"><inertial><mass value="1"/>
            <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="hinge" type="continuous"><parent link="hull"/><child link="panel"/><axis xyz="0 0 1"/></joint>
    </robot>"#;

    fn turning(rate: f64) -> InitialJoints {
        InitialJoints {
            positions: vec![0.5],
            velocities: vec![rate],
        }
    }

    // Momentum is that of a hull at rest with a turning panel. Would break if a reset forgot the joints.
    #[test]
    fn joints_begin_and_are_reset_as_given() {
        let mut target = target(PANEL, turning(0.2));
        let start = target.body.state().clone();
        assert_eq!((start.q[0], start.qd[0]), (0.5, 0.2));
        assert!((start.momentum_W.angular.z - 0.2).abs() < 1e-15);
        target.step(0.01, 100);
        assert!((target.body.state().q[0] - 0.7).abs() < 1e-12);
        target.reset();
        assert_eq!(target.body.state(), &start);
    }

    #[test]
    fn values_for_other_joints_are_refused() {
        let joints = InitialJoints {
            positions: vec![0.1, 0.2],
            velocities: Vec::new(),
        };
        let physics = JointPhysics::default();
        let refused = Target::new(&params(PANEL, joints), IntegrationMethod::Rk4, &physics);
        assert_eq!(
            refused.err().unwrap(),
            "parameter debris.initial_joint_positions has 2 values; target debris has 1 joints"
        );
    }

    // The first restore stops the joints and keeps the momentum; a second one in a row stops everything.
    #[test]
    fn a_second_divergence_in_a_row_stops_the_whole_target() {
        let mut target = target(PANEL, turning(0.2));
        let momentum = target.body.state().momentum_W;
        target.step(0.01, 1);
        target.restore(0.01);
        let state = target.body.state();
        assert_eq!((state.q[0], state.qd[0], state.time), (0.5, 0.0, 0.01));
        assert_eq!(state.momentum_W, momentum);
        target.step(0.01, 1);
        target.step(0.01, 1);
        target.restore(0.03);
        assert_eq!(target.body.state().momentum_W, momentum);
        target.step(0.01, 1);
        target.restore(0.04);
        assert_eq!(target.body.state().momentum_W, Default::default());
    }
}
