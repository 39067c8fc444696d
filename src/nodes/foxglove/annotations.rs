//! What is drawn on the camera's image: feature points, and where tip and goal are seen.

use nalgebra::Point3;
use serde_json::{Value, json};

use super::server::Channel;
use crate::{
    msg::{
        Interface,
        builtin_interfaces::Time,
        fuyu_msgs::FeatureTracks,
        geometry_msgs::{Point, Pose, PoseStamped, TransformStamped, Vector3},
        sensor_msgs::{CameraInfo, Image},
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

    /// Pixels that can be told apart when the image fills a panel, about a thousandth of its longer side.
    fn unit(&self) -> f64 {
        let info = self.info.as_ref();
        info.map_or(1.0, |i| f64::from(i.width.max(i.height)) / 1024.0)
    }

    /// A named point where the origin of `pose` is seen; nothing if that is not known.
    pub fn place(&self, name: &str, pose: &PoseStamped) -> Option<Value> {
        let [x, y] = self.pixel(pose)?;
        let width = f64::from(self.info.as_ref()?.width);
        let (time, unit) = (stamp(&pose.header.stamp), self.unit());
        let (gap, font) = (20.0 * unit, 36.0 * unit);
        // Letters are about half as wide as high; the name must not lie beyond the image's right edge.
        let length = 0.6 * font * name.len() as f64;
        let start = match x + gap + length > width {
            true => x - gap - length,
            false => x + gap,
        };
        let text = json!({
            "timestamp": time, "position": {"x": start, "y": y + 0.3 * font}, "text": name,
            "font_size": font, "text_color": COLOUR_OF_PLACES, "background_color": NOTHING,
        });
        let circle = json!({
            "timestamp": time, "position": {"x": x, "y": y}, "diameter": 24.0 * unit,
            "thickness": 4.0 * unit, "fill_color": NOTHING, "outline_color": COLOUR_OF_PLACES,
        });
        Some(json!({"circles": [circle], "points": [], "texts": [text]}))
    }

    /// Feature points as dots.
    pub fn features(&self, message: &FeatureTracks) -> Value {
        let points: Vec<_> = message
            .u
            .iter()
            .zip(&message.v)
            .map(|(u, v)| json!({"x": u, "y": v}))
            .collect();
        let dots = json!({
            "timestamp": stamp(&message.header.stamp), "type": 1, "points": points,
            "outline_color": COLOUR_OF_FEATURES, "outline_colors": [], "fill_color": NOTHING,
            "thickness": 8.0 * self.unit(),
        });
        json!({"circles": [], "points": [dots], "texts": []})
    }
}

/// Of a background.
const MOST_PIXELS: usize = 1 << 24;

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

/// An image as large as the camera's that shows nothing but a dark grey; none if that has no pixels, or more
/// than anyone should be sent.
pub fn background(info: &CameraInfo) -> Option<Image> {
    let (width, height) = (info.width, info.height);
    let pixels = width as usize * height as usize;
    (1..=MOST_PIXELS).contains(&pixels).then(|| Image {
        header: info.header.clone(),
        height,
        width,
        encoding: "mono8".into(),
        is_bigendian: 0,
        step: width,
        data: vec![24; pixels],
    })
}

/// The channel of the background under the name `topic`.
pub fn background_channel(topic: String) -> Channel {
    Channel {
        topic,
        encoding: "cdr".into(),
        schema_name: Image::DEFINITION.type_name(),
        schema: Image::DEFINITION.schema_text(),
        schema_encoding: "ros2msg".into(),
        latched: true,
    }
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
