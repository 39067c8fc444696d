//! Deformed appendages: edge and surface of a panel, or line of a boom.

use nalgebra::Vector3;

use super::draw::{self, curve, surface};
use crate::{
    msg::{
        fuyu_msgs::{AppendageOutlines, AppendageStates},
        std_msgs::Header,
        visualization_msgs::Marker,
    },
    nodes::geometry::vector_from_msg,
};

/// Markers of all appendages, each in its attachment frame, which moves with the carrying link. Appendages whose
/// outline and state have different numbers of modes are left out.
pub fn markers(outlines: &AppendageOutlines, states: &AppendageStates) -> Vec<Marker> {
    let mut markers = Vec::new();
    for (body, name) in outlines.name.iter().enumerate() {
        let Some(points) = deformed(outlines, states, body) else {
            continue;
        };
        let header = || Header {
            frame_id: name.clone(),
            ..states.header.clone()
        };
        let group = format!("appendage {name}");
        let is_surface = outlines.is_surface.get(body) == Some(&true);
        let closing = is_surface.then(|| points.first().copied()).flatten();
        let line = points.iter().copied().chain(closing);
        markers.push(curve(&group, 0, header(), line, draw::BLUE));
        if is_surface {
            markers.push(surface(&group, 1, header(), &points, draw::PANEL));
        }
    }
    markers
}

/// Positions of the outline's points in the attachment frame of appendage number `body`.
fn deformed(
    outlines: &AppendageOutlines,
    states: &AppendageStates,
    body: usize,
) -> Option<Vec<Vector3<f64>>> {
    let length = |list: &[u32], i: usize| list.get(i).map(|n| *n as usize);
    let (modes, points) = (
        length(&outlines.modes, body)?,
        length(&outlines.points, body)?,
    );
    let in_states = states.name.iter().position(|n| *n == outlines.name[body])?;
    if length(&states.modes, in_states)? != modes {
        return None;
    }
    let before: usize = states
        .modes
        .iter()
        .take(in_states)
        .map(|n| *n as usize)
        .sum();
    let mu = states.mu.get(before..before.checked_add(modes)?)?;
    let (mut first_point, mut first_shape) = (0_usize, 0_usize);
    for i in 0..body {
        let (modes, points) = (length(&outlines.modes, i)?, length(&outlines.points, i)?);
        first_point = first_point.checked_add(points)?;
        first_shape = first_shape.checked_add(points.checked_mul(modes)?)?;
    }
    let all = outlines
        .position
        .get(first_point..first_point.checked_add(points)?)?;
    let end = first_shape.checked_add(points.checked_mul(modes)?)?;
    let shapes = outlines.shape.get(first_shape..end)?;
    let of_points = all.iter().enumerate().map(|(i, p)| {
        let shapes = shapes[i * modes..(i + 1) * modes].iter().zip(mu);
        let moved: Vector3<f64> = shapes.map(|(s, mu)| vector_from_msg(s) * *mu).sum();
        Vector3::new(p.x, p.y, p.z) + moved
    });
    Some(of_points.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::geometry_msgs::{Point, Vector3 as Vector};

    /// A panel of 2 x 1 m with one bending mode, and after it a line of two points with two modes.
    fn messages() -> (AppendageOutlines, AppendageStates) {
        let point = |x: f64, y: f64| Point { x, y, z: 0.0 };
        let up = |z: f64| Vector {
            z,
            ..Vector::default()
        };
        let outlines = AppendageOutlines {
            name: vec!["panel".to_owned(), "boom".to_owned()],
            modes: vec![1, 2],
            points: vec![4, 2],
            is_surface: vec![true, false],
            position: vec![
                point(0.0, 0.5),
                point(2.0, 0.5),
                point(2.0, -0.5),
                point(0.0, -0.5),
                point(0.0, 0.0),
                point(3.0, 0.0),
            ],
            shape: [0.0, 0.25, 0.25, 0.0, 0.0, 0.0, 0.5, -1.0].map(up).to_vec(),
            ..AppendageOutlines::default()
        };
        let states = AppendageStates {
            name: vec!["boom".to_owned(), "panel".to_owned()],
            modes: vec![2, 1],
            mu: vec![0.2, 0.03, 0.4],
            ..AppendageStates::default()
        };
        (outlines, states)
    }

    fn positions(marker: &Marker) -> Vec<[f64; 3]> {
        marker.points.iter().map(|p| [p.x, p.y, p.z]).collect()
    }

    // Modal coordinates are found by name: .4 x .25 = .1 m at the panel's tip, .2 x .5 - .03 = .07 m at the boom's.
    // With those of the other body the panel's tip would be at .05 m.
    #[test]
    fn panels_are_drawn_where_their_modes_move_them() {
        let (outlines, states) = messages();
        let markers = markers(&outlines, &states);
        let [edge, face, boom] = &markers[..] else {
            panic!("{} markers", markers.len())
        };
        assert_eq!(
            (edge.header.frame_id.as_str(), edge.r#type),
            ("panel", Marker::LINE_STRIP)
        );
        let corners = [
            [0.0, 0.5, 0.0],
            [2.0, 0.5, 0.1],
            [2.0, -0.5, 0.1],
            [0.0, -0.5, 0.0],
        ];
        assert_eq!(positions(edge)[..4], corners);
        assert_eq!(positions(edge)[4], corners[0]);
        let [a, b, c, d] = corners;
        assert_eq!(face.r#type, Marker::TRIANGLE_LIST);
        assert_eq!(positions(face), [a, b, c, a, c, d]);
        assert_eq!(boom.header.frame_id, "boom");
        let tip = positions(boom)[1];
        assert!((tip[2] - 0.07).abs() < 1e-15 && tip[0] == 3.0, "{tip:?}");
    }

    #[test]
    fn messages_that_do_not_agree_are_not_drawn() {
        let (outlines, states) = messages();
        let mut other = states.clone();
        other.modes = vec![2, 4];
        assert_eq!(markers(&outlines, &other).len(), 1);
        other.mu.clear();
        assert!(markers(&outlines, &other).is_empty());
        let mut short = outlines.clone();
        short.shape.truncate(3);
        short.points = vec![u32::MAX, 2];
        assert!(markers(&short, &states).is_empty());
    }
}
