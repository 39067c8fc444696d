//! Dashing of curves that cover earlier ones, so that both remain visible.

/// Dash and gap \[units of length\]: first pattern for a curve that covers a solid one, next for one that covers the
/// first, ...
const PATTERNS: [(f64, f64); 3] = [(10.0, 7.0), (5.0, 6.0), (2.0, 5.0)];
/// Two curves cover each other where they are closer than this \[units of length\].
const CLOSE: f64 = 2.0;
/// A curve covers another one if at least this fraction of it is close to the other.
const COVERED: f64 = 0.15;
/// Number of points of a curve that are compared.
const COMPARED: usize = 150;

type Point = (f64, f64);

/// Dash and gap of each curve, in the units of the points; `None` for a solid line. A curve has shorter dashes than all
/// curves that it covers.
pub(super) fn patterns(curves: &[Vec<Point>]) -> Vec<Option<(f64, f64)>> {
    let mut levels: Vec<usize> = Vec::new();
    for (i, curve) in curves.iter().enumerate() {
        let earlier = curves[..i].iter().zip(&levels);
        let covered = earlier.filter(|(other, _)| covers(curve, other));
        let level = covered.map(|(_, level)| level + 1).max();
        levels.push(level.unwrap_or(0));
    }
    let pattern = |level: usize| Some(PATTERNS[level.checked_sub(1)?.min(PATTERNS.len() - 1)]);
    levels.into_iter().map(pattern).collect()
}

fn covers(curve: &[Point], other: &[Point]) -> bool {
    let some = |points: &[Point]| -> Vec<Point> {
        let step = points.len().div_ceil(COMPARED).max(1);
        let finite = |p: &&Point| p.0.is_finite() && p.1.is_finite();
        points
            .iter()
            .step_by(step)
            .filter(finite)
            .copied()
            .collect()
    };
    let (curve, other) = (some(curve), some(other));
    let is_close = |p: &&Point| other.windows(2).any(|w| distance(**p, w[0], w[1]) < CLOSE);
    let close = curve.iter().filter(is_close).count();
    close as f64 > COVERED * curve.len() as f64
}

/// Distance of a point from the line between `a` and `b`.
fn distance(p: Point, a: Point, b: Point) -> f64 {
    let (u, v) = ((b.0 - a.0, b.1 - a.1), (p.0 - a.0, p.1 - a.1));
    let length = u.0 * u.0 + u.1 * u.1;
    let part = match length > 0.0 {
        true => ((u.0 * v.0 + u.1 * v.1) / length).clamp(0.0, 1.0),
        false => 0.0,
    };
    (v.0 - part * u.0).hypot(v.1 - part * u.1)
}

/// The dashes of a curve; a non-finite point interrupts it.
pub(super) fn dashed(points: &[Point], (dash, gap): (f64, f64)) -> Vec<Vec<Point>> {
    let mut pieces: Vec<Vec<Point>> = Vec::new();
    // Position within dash and gap.
    let mut at = 0.0;
    let mut open = false;
    for pair in points.windows(2) {
        let [a, b] = [pair[0], pair[1]];
        let length = (b.0 - a.0).hypot(b.1 - a.1);
        if !length.is_finite() {
            open = false;
            continue;
        }
        let mut done = 0.0;
        while done < length {
            let step = match at < dash {
                true => dash - at,
                false => dash + gap - at,
            };
            let step = step.min(length - done);
            let point = |s: f64| {
                (
                    a.0 + (b.0 - a.0) * s / length,
                    a.1 + (b.1 - a.1) * s / length,
                )
            };
            if at < dash {
                match pieces.last_mut() {
                    Some(piece) if open => piece.push(point(done + step)),
                    _ => pieces.push(vec![point(done), point(done + step)]),
                }
            }
            open = at < dash;
            done += step;
            at += step;
            if at >= dash + gap - 1e-9 {
                at = 0.0;
                open = false;
            } else if (at - dash).abs() < 1e-9 {
                at = dash;
                open = false;
            }
        }
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(shift: f64) -> Vec<Point> {
        let point = |i| {
            let x = f64::from(i);
            (x, 100.0 * (0.02 * x).sin() + shift)
        };
        (0..800).map(point).collect()
    }

    #[test]
    fn a_curve_that_covers_another_is_dashed_and_others_are_solid() {
        let patterns = patterns(&[wave(0.0), wave(60.0), wave(0.5), wave(-0.5)]);
        assert_eq!(patterns[..2], [None, None]);
        assert!(patterns[2].is_some() && patterns[3].is_some());
        assert_ne!(patterns[2], patterns[3]);
    }

    #[test]
    fn curves_on_each_other_have_different_dashes() {
        // The third curve covers only the second, which is dashed itself.
        let mut second = wave(0.0);
        second.extend(wave(60.0).into_iter().map(|(x, y)| (x + 800.0, y)));
        let third: Vec<_> = second[800..].to_vec();
        let patterns = patterns(&[wave(0.0), second, third]);
        assert_eq!(patterns[0], None);
        assert!(patterns[1].is_some() && patterns[2].is_some());
        assert_ne!(patterns[1], patterns[2]);
    }

    #[test]
    fn dashes_cover_their_share_and_keep_to_the_curve() {
        let line: Vec<Point> = (0..=100).map(|i| (f64::from(i) * 1.7, 3.0)).collect();
        let pieces = dashed(&line, (10.0, 7.0));
        assert_eq!(pieces.len(), 10);
        for (k, piece) in pieces.iter().enumerate() {
            let (first, last) = (piece[0], piece[piece.len() - 1]);
            assert!((first.0 - 17.0 * k as f64).abs() < 1e-6, "{first:?}");
            assert!((last.0 - first.0 - 10.0).abs() < 1e-6, "{piece:?}");
            assert!(piece.iter().all(|p| (p.1 - 3.0).abs() < 1e-12));
        }
        let broken = [
            (0.0, 0.0),
            (5.0, 0.0),
            (f64::NAN, 0.0),
            (6.0, 0.0),
            (9.0, 0.0),
        ];
        assert_eq!(dashed(&broken, (10.0, 7.0)).len(), 2);
    }
}
