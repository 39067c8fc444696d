//! Clipping of curves at the edges of a plot.

use std::ops::Range;

type Point = (f64, f64);

/// The parts of a curve inside a rectangle; a non-finite point interrupts the curve.
pub(super) fn clipped(points: &[Point], x: &Range<f64>, y: &Range<f64>) -> Vec<Vec<Point>> {
    let mut pieces: Vec<Vec<Point>> = Vec::new();
    let mut open = false;
    for pair in points.windows(2) {
        let Some([a, b]) = inside(pair[0], pair[1], x, y) else {
            open = false;
            continue;
        };
        match pieces.last_mut() {
            Some(piece) if open => piece.push(b),
            _ => pieces.push(vec![a, b]),
        }
        // The next part continues this one unless the curve has left the rectangle here.
        open = b == pair[1];
    }
    pieces
}

/// The part of the line from `a` to `b` inside of the rectangle (Liang and Barsky 1984).
fn inside(a: Point, b: Point, x: &Range<f64>, y: &Range<f64>) -> Option<[Point; 2]> {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    if !(a.0 + a.1 + dx + dy).is_finite() {
        return None;
    }
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    for (speed, room) in [
        (-dx, a.0 - x.start),
        (dx, x.end - a.0),
        (-dy, a.1 - y.start),
        (dy, y.end - a.1),
    ] {
        if speed == 0.0 {
            if room < 0.0 {
                return None;
            }
        } else if speed < 0.0 {
            enter = enter.max(room / speed);
        } else {
            leave = leave.min(room / speed);
        }
    }
    let at = |t: f64| match t {
        0.0 => a,
        1.0 => b,
        _ => (a.0 + t * dx, a.1 + t * dy),
    };
    (enter <= leave).then(|| [at(enter), at(leave)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_that_leaves_and_returns_is_two_pieces() {
        let curve = [
            (0.0, 0.0),
            (1.0, 1.0),
            (1.0, 5.0),
            (2.0, 5.0),
            (2.0, 0.0),
            (3.0, f64::NAN),
        ];
        let pieces = clipped(&curve, &(0.0..4.0), &(-1.0..3.0));
        assert_eq!(
            pieces,
            [
                vec![(0.0, 0.0), (1.0, 1.0), (1.0, 3.0)],
                vec![(2.0, 3.0), (2.0, 0.0)]
            ]
        );
        // Through a corner region without touching the rectangle, and across all of it.
        assert!(clipped(&[(-3.0, 0.0), (0.0, 9.0)], &(0.0..4.0), &(-1.0..3.0)).is_empty());
        let across = clipped(&[(-2.0, 1.0), (6.0, 1.0)], &(0.0..4.0), &(-1.0..3.0));
        assert_eq!(across, [vec![(0.0, 1.0), (4.0, 1.0)]]);
        assert!(clipped(&[(0.0, f64::NAN), (1.0, 1.0)], &(0.0..4.0), &(-1.0..3.0)).is_empty());
    }
}
