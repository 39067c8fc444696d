//! Markers: axes, arrows, curves.

use nalgebra::Vector3;

use crate::msg::{
    geometry_msgs::{self, Point, Pose},
    std_msgs::{ColorRGBA, Header},
    visualization_msgs::Marker,
};

const fn colour(r: f32, g: f32, b: f32) -> ColorRGBA {
    ColorRGBA { r, g, b, a: 1.0 }
}

/// Colour of x axes.
pub const RED: ColorRGBA = colour(0.86, 0.2, 0.2);
/// Colour of y axes.
pub const GREEN: ColorRGBA = colour(0.2, 0.7, 0.3);
/// Colour of z axes and linear quantities.
pub const BLUE: ColorRGBA = colour(0.25, 0.45, 0.95);
/// Colour of angular quantities.
pub const ORANGE: ColorRGBA = colour(0.95, 0.6, 0.1);

/// Colour of panels.
pub const PANEL: ColorRGBA = ColorRGBA {
    r: 0.2,
    g: 0.3,
    b: 0.6,
    a: 0.8,
};

/// Axes of a frame at `pose`, each `size` long \[m\].
pub fn axes(group: &str, id: i32, header: Header, pose: Pose, size: f64) -> Marker {
    let mut marker = line(group, id, header, Marker::LINE_LIST, 0.04 * size);
    marker.pose = pose;
    for (i, colour) in [RED, GREEN, BLUE].into_iter().enumerate() {
        let end = Vector3::ith_axis(i).into_inner() * size;
        marker
            .points
            .extend([Vector3::zeros(), end].map(|p| point(&p)));
        marker.colors.extend([colour.clone(), colour]);
    }
    marker
}

/// An arrow between two points. Deleted if its length is zero, so that it has no direction, or an end is not finite.
pub fn arrow(
    group: &str,
    id: i32,
    header: Header,
    ends: [Vector3<f64>; 2],
    colour: ColorRGBA,
) -> Marker {
    let length = (ends[1] - ends[0]).norm();
    let mut marker = line(group, id, header, Marker::ARROW, 0.03);
    if !length.is_finite() || length < 1e-6 {
        marker.action = Marker::DELETE;
        return marker;
    }
    marker.scale.y = 0.08;
    marker.scale.z = f64::min(0.15, 0.4 * length);
    marker.color = colour;
    marker.points = ends.iter().map(point).collect();
    marker
}

/// A line through points; deleted if there are fewer than two.
pub fn curve(
    group: &str,
    id: i32,
    header: Header,
    points: impl Iterator<Item = Vector3<f64>>,
    colour: ColorRGBA,
) -> Marker {
    let mut marker = line(group, id, header, Marker::LINE_STRIP, 0.01);
    marker.points = points.map(|p| point(&p)).collect();
    marker.color = colour;
    if marker.points.len() < 2 {
        marker.action = Marker::DELETE;
    }
    marker
}

/// A surface of triangles between points that run along one side and back along the other; deleted if the number of
/// points is less than four or odd.
pub fn surface(
    group: &str,
    id: i32,
    header: Header,
    edge: &[Vector3<f64>],
    colour: ColorRGBA,
) -> Marker {
    let mut marker = line(group, id, header, Marker::TRIANGLE_LIST, 1.0);
    (marker.scale.y, marker.scale.z) = (1.0, 1.0);
    marker.color = colour;
    if edge.len() < 4 || !edge.len().is_multiple_of(2) {
        marker.action = Marker::DELETE;
        return marker;
    }
    let (there, back) = edge.split_at(edge.len() / 2);
    let back: Vec<_> = back.iter().rev().collect();
    for (a, b) in there.windows(2).zip(back.windows(2)) {
        let corners = [&a[0], &a[1], b[1], &a[0], b[1], b[0]];
        marker.points.extend(corners.map(point));
    }
    marker
}

fn line(group: &str, id: i32, header: Header, shape: i32, width: f64) -> Marker {
    Marker {
        header,
        ns: group.to_owned(),
        id,
        r#type: shape,
        action: Marker::ADD,
        pose: Pose {
            orientation: geometry_msgs::Quaternion {
                w: 1.0,
                ..Default::default()
            },
            ..Default::default()
        },
        scale: geometry_msgs::Vector3 {
            x: width,
            ..Default::default()
        },
        color: colour(1.0, 1.0, 1.0),
        ..Default::default()
    }
}

fn point(p: &Vector3<f64>) -> Point {
    Point {
        x: p.x,
        y: p.y,
        z: p.z,
    }
}
