//! `fuyu estimate`: the scale of lengths from clouds of points in a bag.

use std::path::{Path, PathBuf};

use fuyu::bag::{Topic, Writer, WriterOptions};
use fuyu::msg::{
    Interface,
    builtin_interfaces::Time,
    fuyu_msgs::FeatureTracks,
    sensor_msgs::{CameraInfo, PointCloud2, PointField},
    std_msgs::Header,
};
use fuyu::ros::Qos;
use fuyu::spatial::Pose;
use fuyu::vision::{BodyPoint, FeatureCamera, FeatureCameraConfig, FeatureFrame};
use nalgebra::{Translation3, Vector3};

use crate::estimate::{estimate, json, numbers, truth};

/// Of the clouds.
const NAMES: [&str; 3] = ["x", "y", "z"];
const CAMERA_FRAME: &str = "camera_optical_frame";
/// Position of the centre in the camera's axes \[m\].
const CENTRE: [f64; 3] = [0.2, -0.1, 1.8];
/// Radius of the ball that carries the points \[m\].
const RADIUS: f64 = 0.9;

fn header(time: f64, frame: &str) -> Header {
    let nanos = (time * 1e9).round() as i64;
    Header {
        stamp: Time::from_nanos(nanos),
        frame_id: frame.to_owned(),
    }
}

fn cloud(time: f64, frame: &str, points: impl Iterator<Item = Vector3<f64>>) -> PointCloud2 {
    let data: Vec<u8> = points
        .flat_map(|p| {
            p.iter()
                .flat_map(|v| (*v as f32).to_le_bytes())
                .collect::<Vec<_>>()
        })
        .collect();
    let fields = NAMES.iter().zip(0..).map(|(name, k)| PointField {
        name: (*name).to_owned(),
        offset: 4 * k,
        datatype: PointField::FLOAT32,
        count: 1,
    });
    PointCloud2 {
        header: header(time, frame),
        height: 1,
        width: (data.len() / 12) as u32,
        fields: fields.collect(),
        point_step: 12,
        row_step: data.len() as u32,
        data,
        ..PointCloud2::default()
    }
}

fn tracks(frame: &FeatureFrame) -> FeatureTracks {
    FeatureTracks {
        header: header(frame.time, CAMERA_FRAME),
        ids: frame.features.iter().map(|f| f.id as u32).collect(),
        u: frame.features.iter().map(|f| f.u).collect(),
        v: frame.features.iter().map(|f| f.v).collect(),
    }
}

/// A bag of 601 frames over 60 s of 20 points, and of a cloud with these points every ten seconds, .02 s after a frame. A wall behind
/// the body is in each cloud, too.
fn bag(folder: &Path, cloud_frame: &str, has_calibration: bool) -> PathBuf {
    fn write<M: Interface>(writer: &mut Writer, name: &str, time: f64, message: &M) {
        let topic = writer
            .add_topic(Topic::of::<M>(name, Qos::SENSOR_DATA))
            .unwrap();
        let nanos = (time * 1e9).round() as u64;
        writer.write_message(topic, nanos, message).unwrap();
    }
    let path = folder.join(cloud_frame);
    let mut writer = Writer::create(&path, WriterOptions::default()).unwrap();
    if has_calibration {
        let info = CameraInfo {
            header: header(0.0, CAMERA_FRAME),
            k: [819.2, 0.0, 511.5, 0.0, 819.2, 511.5, 0.0, 0.0, 1.0],
            distortion_model: "plumb_bob".to_owned(),
            d: vec![0.0; 5],
            ..CameraInfo::default()
        };
        write(&mut writer, "/camera/camera_info", 0.0, &info);
    }
    let config = FeatureCameraConfig {
        quantised: true,
        ..FeatureCameraConfig::ideal(1024, 1.25)
    };
    let points = BodyPoint::on_sphere(20, RADIUS, 5);
    let mut camera = FeatureCamera::new(config, points.clone());
    for k in 0..=600 {
        let time = 0.1 * f64::from(k);
        let R_CB = truth().attitude(time).to_rotation_matrix();
        let X_CB = Pose::from_parts(Translation3::from(CENTRE), R_CB);
        camera.show(time, &X_CB);
        let frame = camera.deliver(time).unwrap();
        write(&mut writer, "/camera/features", time, &tracks(&frame));
        if k % 100 == 50 {
            let of_body = points
                .iter()
                .map(|p| (X_CB * nalgebra::Point3::from(p.p_B)).coords);
            let wall = (0..400)
                .map(|i| Vector3::new(f64::from(i % 20) - 9.5, f64::from(i / 20) - 9.5, 8.0));
            let message = cloud(time + 0.02, cloud_frame, of_body.chain(wall));
            write(&mut writer, "/camera/points", time + 0.02, &message);
        }
    }
    writer.finish().unwrap();
    path
}

// Fails if the clouds are not read, not paired with their frames or not in the camera's axes: the unit of length would be the depth of
// the centre, 1.8 m, instead of the metre.
#[test]
fn clouds_in_a_bag_give_the_scale() {
    let folder = tempfile::tempdir().unwrap();
    let bag = bag(folder.path(), CAMERA_FRAME, true);
    let found = json(&bag, &[]);
    assert_eq!(found["centre"]["unit"], "m", "{}", found["notes"]);
    let position = Vector3::from_row_slice(&numbers(&found["centre"]["position"]));
    let error = position - Vector3::from(CENTRE);
    let variances = found["centre"]["covariance"].as_array().unwrap();
    for k in 0..3 {
        let deviation = numbers(&variances[k])[k].sqrt();
        assert!(
            error[k].abs() < 5.0 * deviation && deviation < 0.02,
            "{error} with {deviation}"
        );
    }
    for point in found["points"].as_array().unwrap() {
        let radius = Vector3::from_row_slice(&numbers(&point["p"])).norm();
        assert!((radius / RADIUS - 1.0).abs() < 0.02, "{point}");
    }
    // A length that is given is used instead.
    let given = ["--distance", "0,1,0.5"];
    let found = json(&bag, &given);
    let point = |k: usize| Vector3::from_row_slice(&numbers(&found["points"][k]["p"]));
    assert!(((point(0) - point(1)).norm() - 0.5).abs() < 1e-9);
}

#[test]
fn clouds_that_are_ignored_are_noted() {
    let folder = tempfile::tempdir().unwrap();
    let args = &crate::estimate::CAMERA[..];
    for (frame, has_calibration, needle) in [
        ("lidar", true, "/camera/points: header.frame_id is 'lidar'"),
        (
            CAMERA_FRAME,
            false,
            "/camera/points: no point of a cloud is near",
        ),
    ] {
        let output = estimate(&bag(folder.path(), frame, has_calibration), args);
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success() && text.contains(needle), "{text}");
        assert!(text.contains("the scale is not determined"), "{text}");
    }
}
