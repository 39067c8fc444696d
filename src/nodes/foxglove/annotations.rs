//! What is drawn on the camera's image: feature points, and where tip and goal are seen.

use nalgebra::Point3;
use serde_json::{Value, json};

use super::server::Channel;
use crate::{
    msg::{
        builtin_interfaces::Time,
        fuyu_msgs::FeatureTracks,
        geometry_msgs::{Point, Pose, PoseStamped, TransformStamped, Vector3},
        sensor_msgs::CameraInfo,
        tf2_msgs::TFMessage,
    },
    nodes::geometry::pose_from_msg,
};

/// What is known of the camera, to draw on its image.
#[derive(Default)]
pub struct Overlay {
    info: Option<CameraInfo>,
    /// Static transforms; one of them is the camera's mount.
    fixed: Vec<TransformStamped>,
}

impl Overlay {
    /// Takes a calibration in.
    pub fn set_info(&mut self, info: CameraInfo) {
        self.info = Some(info);
    }

    /// Takes static transforms in.
    pub fn set_transforms(&mut self, message: TFMessage) {
        self.fixed.retain(|old| {
            let same = |new: &TransformStamped| new.child_frame_id == old.child_frame_id;
            !message.transforms.iter().any(same)
        });
        self.fixed.extend(message.transforms);
    }

    /// The pixel at which the origin of `pose` is seen, if it is in front of the camera.
    fn pixel(&self, pose: &PoseStamped) -> Option<[f64; 2]> {
        let info = self.info.as_ref()?;
        let mount = self.fixed.iter().find(|t| {
            t.child_frame_id == info.header.frame_id && t.header.frame_id == pose.header.frame_id
        })?;
        let Vector3 { x, y, z } = mount.transform.translation.clone();
        let X_BC = pose_from_msg(&Pose {
            position: Point { x, y, z },
            orientation: mount.transform.rotation.clone(),
        })
        .ok()?;
        let X_BP = pose_from_msg(&pose.pose).ok()?;
        let p_CP = X_BC.inverse_transform_point(&Point3::from(X_BP.translation.vector));
        let k = &info.k;
        let seen = p_CP.z > 1e-3;
        seen.then(|| [k[0] * p_CP.x / p_CP.z + k[2], k[4] * p_CP.y / p_CP.z + k[5]])
    }

    /// A named point where the origin of `pose` is seen; nothing if that is not known.
    pub fn place(&self, name: &str, pose: &PoseStamped) -> Option<Value> {
        let [x, y] = self.pixel(pose)?;
        let time = stamp(&pose.header.stamp);
        let text = json!({
            "timestamp": time, "position": {"x": x + 8.0, "y": y}, "text": name, "font_size": 16,
            "text_color": COLOUR_OF_PLACES, "background_color": {"r": 0, "g": 0, "b": 0, "a": 0.4},
        });
        let circle = json!({
            "timestamp": time, "position": {"x": x, "y": y}, "diameter": 12, "thickness": 2,
            "fill_color": NOTHING, "outline_color": COLOUR_OF_PLACES,
        });
        Some(json!({"circles": [circle], "points": [], "texts": [text]}))
    }
}

const NOTHING: Rgba = Rgba(0.0, 0.0, 0.0, 0.0);
const COLOUR_OF_PLACES: Rgba = Rgba(0.95, 0.6, 0.1, 1.0);
const COLOUR_OF_FEATURES: Rgba = Rgba(0.2, 0.9, 0.4, 1.0);

#[derive(Clone, Copy)]
struct Rgba(f64, f64, f64, f64);

impl serde::Serialize for Rgba {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        json!({"r": self.0, "g": self.1, "b": self.2, "a": self.3}).serialize(serializer)
    }
}

/// Feature points as dots.
pub fn features(message: &FeatureTracks) -> Value {
    let points: Vec<_> = message
        .u
        .iter()
        .zip(&message.v)
        .map(|(u, v)| json!({"x": u, "y": v}))
        .collect();
    let dots = json!({
        "timestamp": stamp(&message.header.stamp), "type": 1, "points": points,
        "outline_color": COLOUR_OF_FEATURES, "outline_colors": [], "fill_color": NOTHING,
        "thickness": 4,
    });
    json!({"circles": [], "points": [dots], "texts": []})
}

fn stamp(time: &Time) -> Value {
    json!({"sec": time.sec, "nsec": time.nanosec})
}

/// The channel of what is drawn under the name `topic`.
pub fn channel(topic: String) -> Channel {
    Channel {
        topic,
        encoding: "json".into(),
        schema_name: "foxglove.ImageAnnotations".into(),
        schema: schema().to_string(),
        schema_encoding: "jsonschema".into(),
        latched: false,
    }
}

/// The parts of `foxglove.ImageAnnotations`, which are public, as JSON schema.
fn schema() -> Value {
    let object = |properties: Value| json!({"type": "object", "properties": properties});
    let list = |items: &Value| json!({"type": "array", "items": items});
    let number = json!({"type": "number"});
    let integer = json!({"type": "integer"});
    let time = object(json!({"sec": integer, "nsec": integer}));
    let point = object(json!({"x": number, "y": number}));
    let colour = object(json!({"r": number, "g": number, "b": number, "a": number}));
    let circle = object(json!({
        "timestamp": time, "position": point, "diameter": number, "thickness": number,
        "fill_color": colour, "outline_color": colour,
    }));
    let points = object(json!({
        "timestamp": time, "type": integer, "points": list(&point), "outline_color": colour,
        "outline_colors": list(&colour), "fill_color": colour, "thickness": number,
    }));
    let text = object(json!({
        "timestamp": time, "position": point, "text": {"type": "string"}, "font_size": number,
        "text_color": colour, "background_color": colour,
    }));
    let mut schema = object(json!({
        "circles": list(&circle), "points": list(&points), "texts": list(&text),
    }));
    schema["title"] = "foxglove.ImageAnnotations".into();
    schema
}
