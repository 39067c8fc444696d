//! The robot descriptions of this repository as the crate urdf-rs reads them. fuyu reads URDF without it, because it repairs
//! files that urdf-rs refuses; where both read a file, they must find the same robot.

use fuyu_physics::{
    model::{JointKind, Model},
    spatial::Pose,
};
use nalgebra::{Matrix3, Rotation3, Translation3, Vector3};
use std::{collections::HashMap, fs};

const TOLERANCE: f64 = 1e-14;

const ROOT_OF_UR5: &str = r#"<link name="base_link"/>"#;
const HEAVY_ROOT_OF_UR5: &str = r#"<link name="base_link"><inertial><mass value="300"/>
  <inertia ixx="50" ixy="0" ixz="0" iyy="50" iyz="0" izz="50"/></inertial></link>"#;

fn pose(origin: &urdf_rs::Pose) -> Pose {
    let [roll, pitch, yaw] = origin.rpy.0;
    let turn = Rotation3::from_euler_angles(roll, pitch, yaw);
    Pose::from_parts(Translation3::from(Vector3::from(origin.xyz.0)), turn)
}

/// Poses of all links in the root link, with all joints at zero.
fn link_poses(robot: &urdf_rs::Robot) -> HashMap<&str, Pose> {
    let is_child = |name: &str| robot.joints.iter().any(|j| j.child.link == name);
    let roots = robot.links.iter().filter(|l| !is_child(&l.name));
    let mut poses: HashMap<_, _> = roots.map(|l| (l.name.as_str(), Pose::identity())).collect();
    for _ in &robot.joints {
        for joint in &robot.joints {
            if let Some(parent) = poses.get(joint.parent.link.as_str()) {
                let child = parent * pose(&joint.origin);
                poses.insert(&joint.child.link, child);
            }
        }
    }
    poses
}

/// Mass \[kg\], centre of mass \[m\] and rotational inertia \[kg m²\] about the root link's origin, in its axes.
type MassProperties = (f64, Vector3<f64>, Matrix3<f64>);

fn total(parts: impl Iterator<Item = (f64, Vector3<f64>, Matrix3<f64>)>) -> MassProperties {
    let mut sum = (0.0, Vector3::zeros(), Matrix3::zeros());
    for (mass, com, about_com) in parts {
        sum.0 += mass;
        sum.1 += mass * com;
        let square = com.norm_squared() * Matrix3::identity() - com * com.transpose();
        sum.2 += about_com + mass * square;
    }
    (sum.0, sum.1 / sum.0, sum.2)
}

fn masses_of_urdf_rs(robot: &urdf_rs::Robot) -> MassProperties {
    let poses = link_poses(robot);
    total(robot.links.iter().map(|link| {
        let urdf_rs::Inertial {
            origin,
            mass,
            inertia: i,
        } = &link.inertial;
        let com = poses[link.name.as_str()] * pose(origin);
        let turn = com.rotation;
        let about_com = Matrix3::new(
            i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz,
        );
        let about_com = turn.matrix() * about_com * turn.matrix().transpose();
        (mass.value, com.translation.vector, about_com)
    }))
}

/// Poses of the bodies in the base, with all joints at zero.
fn body_poses(model: &Model) -> Vec<Pose> {
    let mut poses = vec![Pose::identity()];
    for (k, joint) in model.tree_joints().enumerate() {
        let parent = model.bodies()[k + 1].parent.unwrap();
        poses.push(poses[parent] * joint.X_PJ);
    }
    poses
}

fn masses_of_fuyu(model: &Model) -> MassProperties {
    let bodies = model.bodies().iter().zip(body_poses(model));
    total(bodies.map(|(body, pose)| {
        let inertia = body.inertia.expressed_in(&pose);
        (inertia.mass, inertia.com, inertia.about_com)
    }))
}

// Fails if the reader confuses an order of rotations, an attribute or a unit, or loses a link that it welds to another.
#[test]
fn urdf_rs_reads_the_same_robots() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../urdf");
    let mut compared = 0;
    for file in fs::read_dir(folder).unwrap() {
        let path = file.unwrap().path();
        // Textures are in the same folder.
        if path.extension().is_none_or(|extension| extension != "urdf") {
            continue;
        }
        let name = path.display().to_string();
        let mut xml = fs::read_to_string(&path).unwrap();
        if path.ends_with("ur5.urdf") {
            // An arm for a base of the user's: its root has no mass of its own.
            assert!(xml.contains(ROOT_OF_UR5), "{name}");
            xml = xml.replace(ROOT_OF_UR5, HEAVY_ROOT_OF_UR5);
        }
        let model = Model::from_urdf(&xml, &name).unwrap();
        let robot = urdf_rs::read_from_string(&xml).unwrap();

        let poses = link_poses(&robot);
        let bodies = body_poses(&model);
        for frame in model.frames() {
            let expected = poses[frame.name.as_str()];
            let found = bodies[frame.body] * frame.X_BF;
            let off = (found.to_homogeneous() - expected.to_homogeneous()).amax();
            assert!(off < TOLERANCE, "{name}: frame {}: {off:e}", frame.name);
        }
        assert_eq!(model.frames().len(), robot.links.len(), "{name}");

        let (found, expected) = (masses_of_fuyu(&model), masses_of_urdf_rs(&robot));
        assert!((found.0 - expected.0).abs() < TOLERANCE * expected.0);
        let off = (found.1 - expected.1).amax();
        assert!(off < TOLERANCE, "{name}: centre of mass: {off:e}");
        let off = (found.2 - expected.2).amax() / expected.2.amax();
        assert!(off < TOLERANCE, "{name}: inertia: {off:e}");

        for joint in model.tree_joints() {
            let same = robot.joints.iter().find(|j| j.name == joint.name);
            let same = same.unwrap_or_else(|| panic!("{name}: urdf-rs has no {}", joint.name));
            let axis = Vector3::from(same.axis.xyz.0).normalize();
            assert!((joint.axis.into_inner() - axis).amax() < TOLERANCE);
            let kind = match same.joint_type {
                urdf_rs::JointType::Revolute => JointKind::Revolute,
                urdf_rs::JointType::Continuous => JointKind::Continuous,
                urdf_rs::JointType::Prismatic => JointKind::Prismatic,
                ref other => panic!("{name}: {} is {other:?} to urdf-rs", joint.name),
            };
            assert_eq!(joint.kind, kind, "{name}: {}", joint.name);
            // The damping of a joint that follows another is part of that one's.
            let damping = |j: &urdf_rs::Joint| j.dynamics.as_ref().map_or(0.0, |d| d.damping);
            let followers = robot.joints.iter().filter_map(|j| {
                let mimic = j.mimic.as_ref().filter(|m| m.joint == joint.name)?;
                Some(mimic.multiplier.unwrap_or(1.0).powi(2) * damping(j))
            });
            let own = match same.mimic {
                Some(_) => 0.0,
                None => damping(same),
            };
            let expected = own + followers.sum::<f64>();
            assert_eq!(joint.damping, expected, "{name}: {}", joint.name);
            let given = format!("<joint name=\"{}\"", joint.name);
            let element = &xml[xml.find(&given).unwrap()..];
            let element = &element[..element.find("</joint>").unwrap()];
            if joint.kind != JointKind::Continuous && element.contains("<limit") {
                assert_eq!(joint.limits.lower, same.limit.lower);
                assert_eq!(joint.limits.upper, same.limit.upper);
            }
            compared += 1;
        }
    }
    assert!(compared > 30, "{compared} joints");
}
