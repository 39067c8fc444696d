//! Annotations of the camera's image: feature points, and the measured positions of tip and goal.

use foxglove::messages::{
    CircleAnnotation, Color, ImageAnnotations, Point2, PointsAnnotation, TextAnnotation, Timestamp,
    points_annotation,
};
use nalgebra::Point3;

use crate::{
    msg::{
        builtin_interfaces::Time,
        fuyu_msgs::FeatureTracks,
        geometry_msgs::{Point, Pose, PoseStamped, TransformStamped, Vector3},
        sensor_msgs::{CameraInfo, Image},
        tf2_msgs::TFMessage,
    },
    nodes::geometry::pose_from_msg,
};

/// Calibration and mount of the camera, needed to draw on its image.
#[derive(Default)]
pub struct Overlay {
    info: Option<CameraInfo>,
    /// Static transforms, including the camera's mount.
    fixed: Vec<TransformStamped>,
}

impl Overlay {
    /// Stores a calibration.
    pub fn set_info(&mut self, info: CameraInfo) {
        self.info = Some(info);
    }

    /// Stores static transforms.
    pub fn set_transforms(&mut self, message: TFMessage) {
        self.fixed.retain(|old| {
            let same = |new: &TransformStamped| new.child_frame_id == old.child_frame_id;
            !message.transforms.iter().any(same)
        });
        self.fixed.extend(message.transforms);
    }

    /// The pixel of the origin of `pose`, if it is in front of the camera.
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

    /// Smallest length \[px\] that is visible when the image fills a panel: about a thousandth of its longer side.
    fn unit(&self) -> f64 {
        let info = self.info.as_ref();
        info.map_or(1.0, |i| f64::from(i.width.max(i.height)) / 1024.0)
    }

    /// A labelled point at the origin of `pose`; empty if its pixel is unknown.
    pub fn place(&self, name: &str, pose: &PoseStamped) -> Option<ImageAnnotations> {
        let [x, y] = self.pixel(pose)?;
        let timestamp = Some(stamp(&pose.header.stamp));
        let width = f64::from(self.info.as_ref()?.width);
        let unit = self.unit();
        let (gap, font) = (20.0 * unit, 36.0 * unit);
        // Letters are about half as wide as high; keep the label within the image.
        let length = 0.6 * font * name.len() as f64;
        let start = match x + gap + length > width {
            true => x - gap - length,
            false => x + gap,
        };
        let text = TextAnnotation {
            timestamp,
            position: Some(Point2 {
                x: start,
                y: y + 0.3 * font,
            }),
            text: name.to_owned(),
            font_size: font,
            text_color: Some(COLOUR_OF_PLACES),
            background_color: Some(NOTHING),
            ..Default::default()
        };
        let circle = CircleAnnotation {
            timestamp,
            position: Some(Point2 { x, y }),
            diameter: 24.0 * unit,
            thickness: 4.0 * unit,
            fill_color: Some(NOTHING),
            outline_color: Some(COLOUR_OF_PLACES),
            ..Default::default()
        };
        Some(ImageAnnotations {
            circles: vec![circle],
            texts: vec![text],
            ..Default::default()
        })
    }

    /// Feature points as dots.
    pub fn features(&self, message: &FeatureTracks) -> ImageAnnotations {
        let points = message.u.iter().zip(&message.v);
        let dots = PointsAnnotation {
            timestamp: Some(stamp(&message.header.stamp)),
            r#type: points_annotation::Type::Points.into(),
            points: points.map(|(&u, &v)| Point2 { x: u, y: v }).collect(),
            outline_color: Some(COLOUR_OF_FEATURES),
            fill_color: Some(NOTHING),
            thickness: 8.0 * self.unit(),
            ..Default::default()
        };
        ImageAnnotations {
            points: vec![dots],
            ..Default::default()
        }
    }
}

/// Maximum number of pixels of the background image.
const MOST_PIXELS: usize = 1 << 24;

const NOTHING: Color = rgba(0.0, 0.0, 0.0, 0.0);
const COLOUR_OF_PLACES: Color = rgba(0.95, 0.6, 0.1, 1.0);
const COLOUR_OF_FEATURES: Color = rgba(0.2, 0.9, 0.4, 1.0);

const fn rgba(r: f64, g: f64, b: f64, a: f64) -> Color {
    Color { r, g, b, a }
}

/// A dark grey image of the camera's size; none if the size is zero or unreasonably large.
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

/// Times before 1970, which Foxglove cannot represent, become zero.
fn stamp(time: &Time) -> Timestamp {
    let sec = u32::try_from(time.sec).unwrap_or(0);
    Timestamp::new_checked(sec, time.nanosec).unwrap_or(Timestamp::MIN)
}
