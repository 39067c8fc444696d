//! A free body: its motion, and its name, frames and description.

use roxmltree::{Document, Node};

use super::{
    divergence::{self, StateBackup},
    params::{Description, InitialMotion},
};
use crate::{
    dynamics::{Floating, IntegrationMethod, State},
    spatial::Pose,
};

/// A free body.
pub struct Target {
    /// Its name and frame.
    pub name: String,
    /// The body.
    pub body: Floating,
    /// Its description as URDF, for viewers: the root link is called `name`, any other link L `name/L`, as their frames
    /// are. Two targets with one description thus share no frame.
    pub description: String,
    /// Whether it was added after the start.
    pub spawned: bool,
    start: State,
    /// The state before the last step.
    backup: StateBackup,
}

impl Target {
    /// The free body that `description` describes.
    ///
    /// # Errors
    /// A line that names the description's source, if it is invalid or has joints, or the target, if it moves too fast.
    pub fn new(
        name: &str,
        description: &Description,
        motion: &InitialMotion,
        method: IntegrationMethod,
    ) -> Result<Self, String> {
        let model = description.compile()?;
        if model.dof() > 0 {
            let source = &description.source;
            let joints = model.dof();
            return Err(format!(
                "{source}: target {name} has {joints} joints; a target must be a single body"
            ));
        }
        let mut start = State::at_rest(&model);
        motion.place(&model, &mut start);
        let body = Floating::new(model, start.clone(), method);
        if let Some(what) = divergence::of(&body) {
            return Err(format!(
                "target {name} cannot be simulated from its start: {what}"
            ));
        }
        Ok(Self {
            name: name.to_owned(),
            backup: StateBackup::new(&body),
            body,
            description: with_link_names(name, &description.xml),
            spawned: false,
            start,
        })
    }

    /// Returns to its state at the start, or in which it was spawned.
    pub fn reset(&mut self) {
        self.body.set_state(self.start.clone());
    }

    /// Advances by `steps` steps of `dt` \[s\].
    pub(super) fn step(&mut self, dt: f64, steps: usize) {
        self.backup.save(&self.body);
        self.body.step(dt, steps);
    }

    /// Returns to the state before the last step, at `time` \[s\], and stops.
    pub(super) fn restore(&mut self, time: f64) {
        self.backup.restore_at_rest(&mut self.body, time);
    }

    /// Frames fixed in its root frame: name and pose in it.
    pub fn fixed_frames(&self) -> impl Iterator<Item = (String, Pose)> + '_ {
        let links = self.body.model().frames().iter().skip(1);
        links.map(|link| (format!("{}/{}", self.name, link.name), link.X_BF))
    }
}

/// A valid URDF with its links renamed: the root link to `name`, any other link L to `name/L`.
fn with_link_names(name: &str, xml: &str) -> String {
    // A model has been compiled from it: it is XML.
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
    // Gazebo's references may be to joints, which keep their names.
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
    use crate::model::Model;

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

    #[test]
    fn fixed_frames_are_those_of_the_description() {
        let description = Description::new(STATION.to_owned(), "station".to_owned(), true);
        let motion = InitialMotion {
            pose: nalgebra::Isometry3::identity(),
            velocity_W: nalgebra::Vector3::zeros(),
            angular_velocity_B: nalgebra::Vector3::zeros(),
        };
        let target = Target::new("debris", &description, &motion, IntegrationMethod::Rk4).unwrap();
        let frames: Vec<_> = target.fixed_frames().collect();
        assert_eq!(frames.len(), 1);
        assert_eq!(frames[0].0, "debris/mast");
        assert_eq!(frames[0].1.translation.vector.z, 3.0);
    }
}
