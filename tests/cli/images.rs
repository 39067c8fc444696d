//! Images that `fuyu simulate` writes into a bag, against the true poses in it; and wrong input.

use std::path::Path;

use fuyu::{
    bag::Bag,
    msg::{
        geometry_msgs::Pose,
        nav_msgs::Odometry,
        sensor_msgs::{CameraInfo, CompressedImage, Image},
    },
};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion};

use super::fuyu::{Run, fuyu};

const CONFIG: &str = include_str!("../../config/servicing_images.yaml");

/// Runs the scenario with changes for a fraction of a second, with a bag.
fn simulate(changes: &[(&str, &str)], folder: &Path) -> Run {
    let path = folder.join("scenario.yaml");
    let mut text = CONFIG.to_owned();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replacen(from, to, 1);
    }
    std::fs::write(&path, text).unwrap();
    let bag = folder.join("bag");
    let (scenario, output) = (path.to_str().unwrap(), bag.to_str().unwrap());
    fuyu(&[
        "simulate",
        scenario,
        "--duration",
        "0.3",
        "--output",
        output,
        "--json",
    ])
}

fn isometry(pose: &Pose) -> Isometry3<f64> {
    let (p, q) = (&pose.position, &pose.orientation);
    let q = UnitQuaternion::new_normalize(Quaternion::new(q.w, q.x, q.y, q.z));
    Isometry3::from_parts(Translation3::new(p.x, p.y, p.z), q)
}

#[test]
fn images_in_a_bag_show_the_target_where_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let run = simulate(&[], folder.path());
    assert_eq!(run.code, 0, "{}", run.stderr);
    let bag = Bag::open(folder.path().join("bag")).unwrap();
    let images = |topic: &str| bag.read::<Image>(&format!("/camera/{topic}")).unwrap();
    let (raw, depth, ids) = (images("image_raw"), images("depth"), images("segmentation"));
    // At 0, 0.1, 0.2 and 0.3 s.
    assert_eq!([raw.len(), depth.len(), ids.len()], [4; 3]);
    let bases = bag.read::<Odometry>("/ground_truth/odom").unwrap();
    let targets = bag.read::<Odometry>("/ground_truth/target/odom").unwrap();
    // As in the robot's description.
    let X_BC = Isometry3::from_parts(
        Translation3::new(1.0, 1.05, 0.83),
        UnitQuaternion::from_euler_angles(-std::f64::consts::FRAC_PI_2, 0.0, 0.0),
    );
    for (depth, ids) in depth.iter().zip(&ids) {
        let (depth, ids) = (&depth.message, &ids.message);
        let at = |m: &&fuyu::bag::Stamped<Odometry>| m.message.header.stamp == ids.header.stamp;
        let base = isometry(&bases.iter().find(at).unwrap().message.pose.pose);
        let target = isometry(&targets.iter().find(at).unwrap().message.pose.pose);
        // The ball at the target's hinge, of 0.1 m.
        let p =
            (base * X_BC).inverse() * (target * Point3::new(0.0, -0.866_025_403_784_438_6, 0.0));
        let (u, v) = (319.5 + 640.0 * p.x / p.z, 239.5 + 640.0 * p.y / p.z);
        let pixel = v.round() as usize * 640 + u.round() as usize;
        assert_eq!(ids.encoding, "16UC1");
        assert_eq!(ids.data[2 * pixel..2 * pixel + 2], [2, 0], "({u}, {v})");
        assert_eq!((depth.encoding.as_str(), depth.step), ("32FC1", 4 * 640));
        let z = f32::from_le_bytes(depth.data[4 * pixel..4 * pixel + 4].try_into().unwrap());
        let front = p.z * (1.0 - 0.1 / p.coords.norm());
        assert!((f64::from(z) - front).abs() < 3e-3, "{z} {front}");
        // The arm is in the image, too, and the sky.
        let id = |wanted: u8| ids.data.chunks(2).filter(|id| id[0] == wanted).count();
        assert!(
            id(0) > 1000 && id(1) > 1000 && id(2) > 500,
            "{} {} {}",
            id(0),
            id(1),
            id(2)
        );
    }
    let (left, right) = (images("left/image_raw"), images("right/image_raw"));
    for ((raw, left), right) in raw.iter().zip(&left).zip(&right) {
        assert_eq!(
            (raw.message.encoding.as_str(), raw.message.step),
            ("rgb8", 3 * 640)
        );
        assert_eq!(raw.message, left.message);
        assert!(raw.message.data != right.message.data);
    }
    let infos = bag.read::<CameraInfo>("/camera/right/camera_info").unwrap();
    assert!(infos.iter().all(|info| info.message.p[3] == -640.0 * 0.2));
    // With the stamp of every image, and one at the start.
    assert_eq!(infos.len(), 5);
    let topic = "/camera/image_raw/compressed";
    for (compressed, raw) in bag.read::<CompressedImage>(topic).unwrap().iter().zip(&raw) {
        let decoded = image::load_from_memory(&compressed.message.data)
            .unwrap()
            .to_rgb8();
        let differences = decoded.iter().zip(&raw.message.data);
        let total: f64 = differences.map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
        assert!(total / (raw.message.data.len() as f64) < 4.0);
    }
}

#[test]
fn the_same_scenario_gives_the_same_images_whatever_the_number_of_threads() {
    let images = |threads: &str| {
        let folder = tempfile::tempdir().unwrap();
        let change = format!("cameras: [camera]\n      samples: 2\n      threads: {threads}");
        let run = simulate(&[("cameras: [camera]", &change)], folder.path());
        assert_eq!(run.code, 0, "{}", run.stderr);
        let bag = Bag::open(folder.path().join("bag")).unwrap();
        let images = bag.read::<Image>("/camera/right/image_raw").unwrap();
        images.into_iter().map(|m| m.message).collect::<Vec<_>>()
    };
    assert!(images("1") == images("3"));
}

#[test]
fn wrong_parameters_of_images_are_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let urdf = folder.path().join("robot.urdf");
    let text = include_str!("../../urdf/servicer.urdf");
    let box_size = "<box size=\"0.15 0.2 0.15\"/>";
    assert!(text.contains(box_size));
    let mesh = "<mesh filename=\"package://fuyu/urdf/none.stl\"/>";
    std::fs::write(&urdf, text.replace(box_size, mesh)).unwrap();
    let robot = format!("urdf: {}", urdf.display());
    for (from, to, expected) in [
        (
            "encoding: rgb8",
            "encoding: yuv422",
            "'yuv422' is not one of mono8, rgb8",
        ),
        ("depth: 32FC1", "depth: 64FC1", "none, 16UC1, 32FC1"),
        (
            "baseline: 0.2",
            "link: hand",
            "parameter images.camera.link: robot 'servicer' has no link 'hand'",
        ),
        (
            "baseline: 0.2",
            "distortion: [0.1]",
            "plumb_bob has 5 coefficients, not 1",
        ),
        (
            "baseline: 0.2",
            "distortion_model: fisheye",
            "plumb_bob or equidistant",
        ),
        (
            "rate: 10.0\n      transfer",
            "bodies: [debris]\n      transfer",
            "images.bodies",
        ),
        (
            "cameras: [camera]",
            "cameras: [camera, camera]",
            "given twice",
        ),
        (
            "cameras: [camera]",
            "cameras: ['a b']",
            "cannot be part of a topic's name",
        ),
        (
            "direction: [-0.5, -0.7, 0.5]",
            "direction: [0.0, 0.0, 0.0]",
            "cannot be zero",
        ),
        (
            "urdf: package://fuyu/urdf/servicer.urdf",
            &robot,
            "visual of link 'base_link': package://fuyu/urdf/none.stl",
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let run = simulate(&[(from, to)], folder.path());
        assert_eq!(run.code, 2, "{to}: {}", run.stderr);
        let line = run.stderr.lines().find(|line| line.contains(expected));
        assert!(line.is_some(), "{to}: {}", run.stderr);
    }
}
