//! Images as an rclpy node receives them.

use serde_json::{Value, json};

use crate::{
    observer::{diagnosed, now, numbers},
    peer::Peer,
    process::{Running, scenario},
    waiting::{PATIENCE, eventually},
};

fn data(image: &Value) -> Vec<f64> {
    numbers(&image["data"])
}

#[test]
fn an_rclpy_node_receives_images_with_depth_and_ids_of_the_same_exposure() {
    let domain = 118;
    let (_folder, config) = scenario(
        "config/servicing_images.yaml",
        &[
            ("image_width: 640", "image_width: 80"),
            ("image_height: 480", "image_height: 60"),
            ("focal_length: 640.0", "focal_length: 80.0"),
        ],
    );
    let mut launch = Running::launch(domain, &config, &["--duration", "600"]);
    let mut peer = Peer::start("viewer", domain);
    for topic in ["image_raw", "depth", "segmentation", "right/image_raw"] {
        let topic = format!("camera/{topic}");
        peer.subscribe(&topic, "sensor_msgs/msg/Image", "sensor_data");
    }
    peer.subscribe(
        "camera/right/camera_info",
        "sensor_msgs/msg/CameraInfo",
        "reliable",
    );
    peer.subscribe(
        "diagnostics",
        "diagnostic_msgs/msg/DiagnosticArray",
        "reliable",
    );
    let image = peer.receive("camera/image_raw", 1)[0]["message"].clone();
    assert_eq!(image["encoding"], "rgb8");
    assert_eq!(image["header"]["frame_id"], "camera_optical_frame");
    assert_eq!(
        [&image["width"], &image["height"], &image["step"]],
        [80, 60, 240]
    );
    let pixels = data(&image);
    assert_eq!(pixels.len(), 240 * 60);
    // The sunlit arm, and the dark sky.
    assert!(pixels.iter().any(|x| *x > 100.0) && pixels.iter().any(|x| *x < 10.0));
    eventually("depth and ids of one exposure", PATIENCE, || {
        // Both from the same time on, so that the same exposures are among them.
        let since = now();
        let mut from_then = |topic: &str| -> Vec<Value> {
            let wait =
                json!({"do": "wait", "topic": topic, "count": 2, "since": since, "timeout": 5.0});
            let received = peer.does(wait);
            let received = received.as_array().expect("a list").iter();
            received.map(|r| r["message"].clone()).collect()
        };
        let (depths, all_ids) = (from_then("camera/depth"), from_then("camera/segmentation"));
        let is_seen = |ids: &Value| {
            let stamp = &ids["header"]["stamp"];
            let Some(depth) = depths.iter().find(|d| d["header"]["stamp"] == *stamp) else {
                return false;
            };
            let (ids, depth) = (data(ids), data(depth));
            let of_target = ids.chunks(2).zip(depth.chunks(4));
            let of_target = of_target.filter(|(id, _)| id[0] == 2.0);
            let near = of_target.filter(|(_, bytes)| {
                let bytes: Vec<u8> = bytes.iter().map(|b| *b as u8).collect();
                let z = f32::from_le_bytes(bytes.try_into().unwrap());
                (9.0..13.0).contains(&z)
            });
            near.count() > 10
        };
        all_ids.iter().any(is_seen).then_some(())
    });
    let info = peer.receive("camera/right/camera_info", 1)[0]["message"].clone();
    assert_eq!(info["p"][3], -16.0);
    diagnosed(&mut peer, "camera: images", |level, text| {
        level == 0 && text == "rendering"
    });
    launch.interrupt().well();
}
