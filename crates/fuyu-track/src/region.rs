//! Which pixels belong to the target.

use std::ops::Range;

use crate::{Image, Target};

/// Pixels of the target, row by row; 1 is the target.
#[derive(Debug, Default)]
pub(crate) struct Region {
    width: usize,
    height: usize,
    inside: Vec<u8>,
    /// First and last column, first and last row; `None` if it is empty.
    bounds: Option<[usize; 4]>,
    scratch: Scratch,
}

/// Reused from frame to frame.
#[derive(Debug, Default)]
struct Scratch {
    runs: Vec<Run>,
    /// Index of a run that this one is connected to, or of itself.
    parents: Vec<usize>,
    areas: Vec<usize>,
    outside: Vec<bool>,
}

/// Neighbouring pixels of one row that are all bright or all dark.
#[derive(Debug, Clone, Copy)]
struct Run {
    row: usize,
    first: usize,
    end: usize,
    bright: bool,
}

impl Region {
    /// All pixels of the mask that are not 0.
    pub fn set_mask(&mut self, mask: &Image<'_>) {
        self.resize(mask.width(), mask.height());
        for v in 0..self.height {
            let row = self.inside[v * self.width..][..self.width].iter_mut();
            for (inside, value) in row.zip(mask.row(v)) {
                *inside = u8::from(*value != 0);
            }
        }
        self.find_bounds();
    }

    /// What `target` says about an image.
    pub fn set_target(&mut self, image: &Image<'_>, target: Target) {
        self.resize(image.width(), image.height());
        match target {
            Target::Everything => {
                self.inside.fill(1);
                self.find_bounds();
            }
            Target::Bright {
                threshold,
                smallest,
            } => self.set_bright(image, threshold, smallest),
        }
    }

    fn resize(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        self.inside.resize(width * height, 0);
    }

    /// Connected bright pixels (also diagonally), with the dark regions that they enclose.
    fn set_bright(&mut self, image: &Image<'_>, threshold: u8, smallest: usize) {
        self.inside.fill(0);
        let (width, height) = (self.width, self.height);
        let Scratch {
            runs,
            parents,
            areas,
            outside,
        } = &mut self.scratch;
        runs.clear();
        let mut before = 0..0;
        parents.clear();
        for v in 0..height {
            let row = image.row(v);
            let begin = runs.len();
            let mut first = 0;
            // Most rows show nothing but the sky.
            if row.iter().fold(0, |most, x| *x.max(&most)) < threshold {
                parents.push(begin);
                runs.push(Run {
                    row: v,
                    first: 0,
                    end: width,
                    bright: false,
                });
                first = width;
            }
            while first < width {
                let bright = row[first] >= threshold;
                let rest = row[first..].iter();
                let length = rest.take_while(|x| (**x >= threshold) == bright).count();
                let end = first + length;
                parents.push(runs.len());
                runs.push(Run {
                    row: v,
                    first,
                    end,
                    bright,
                });
                first = end;
            }
            let current = begin..runs.len();
            link(runs, parents, &before, &current, true);
            link(runs, parents, &before, &current, false);
            before = current;
        }
        areas.clear();
        areas.resize(runs.len(), 0);
        outside.clear();
        outside.resize(runs.len(), false);
        let mut largest = 0;
        for (i, run) in runs.iter().enumerate() {
            let root = root(parents, i);
            areas[root] += run.end - run.first;
            let border = run.row == 0 || run.row + 1 == height || run.first == 0;
            outside[root] |= border || run.end == width;
            if run.bright {
                largest = largest.max(areas[root]);
            }
        }
        for (i, run) in runs.iter().enumerate() {
            let root = root(parents, i);
            let belongs = match run.bright {
                true => areas[root] >= smallest,
                // A shadow or a dark surface; the sky within a ring is larger than a part of the body.
                false => !outside[root] && areas[root] <= largest / 4,
            };
            if belongs {
                self.inside[run.row * width..][run.first..run.end].fill(1);
            }
        }
        self.find_bounds();
    }

    fn find_bounds(&mut self) {
        let mut bounds: Option<[usize; 4]> = None;
        for (v, row) in self.inside.chunks_exact(self.width).enumerate() {
            let Some(first) = row.iter().position(|x| *x != 0) else {
                continue;
            };
            let last = row.iter().rposition(|x| *x != 0).unwrap_or(first);
            bounds = Some(match bounds {
                None => [first, last, v, v],
                Some([a, b, top, _]) => [a.min(first), b.max(last), top, v],
            });
        }
        self.bounds = bounds;
    }

    /// First and last column, first and last row; `None` if nothing is in it.
    pub fn bounds(&self) -> Option<[usize; 4]> {
        self.bounds
    }

    /// Whether all pixels within `margin` of a point belong to it. Outside of the image is not outside of the target.
    pub fn contains(&self, u: f64, v: f64, margin: usize) -> bool {
        if !(u > -0.5 && v > -0.5 && u < self.width as f64 - 0.5 && v < self.height as f64 - 0.5) {
            return false;
        }
        let (u, v) = (u.round() as usize, v.round() as usize);
        let columns = u.saturating_sub(margin)..(u + margin + 1).min(self.width);
        let mut rows = v.saturating_sub(margin)..(v + margin + 1).min(self.height);
        rows.all(|row| {
            let row = &self.inside[row * self.width..][..self.width];
            row[columns.clone()].iter().all(|x| *x != 0)
        })
    }
}

/// Connects the runs of one kind in two successive rows. Bright pixels are also connected diagonally, dark ones are not.
fn link(
    runs: &[Run],
    parents: &mut [usize],
    upper: &Range<usize>,
    lower: &Range<usize>,
    bright: bool,
) {
    let reach = usize::from(bright);
    // Bright and dark runs take turns.
    let first = |row: &Range<usize>| match runs.get(row.start) {
        Some(run) if run.bright != bright => row.start + 1,
        _ => row.start,
    };
    let (mut a, mut b) = (first(upper), first(lower));
    while a < upper.end && b < lower.end {
        let (above, below) = (runs[a], runs[b]);
        if above.first < below.end + reach && below.first < above.end + reach {
            join(parents, a, b);
        }
        if above.end < below.end {
            a += 2;
        } else {
            b += 2;
        }
    }
}

fn root(parents: &mut [usize], mut i: usize) -> usize {
    while parents[i] != i {
        parents[i] = parents[parents[i]];
        i = parents[i];
    }
    i
}

fn join(parents: &mut [usize], a: usize, b: usize) {
    let (a, b) = (root(parents, a), root(parents, b));
    parents[a.max(b)] = a.min(b);
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 40;

    fn region(pixels: &[(usize, usize)], smallest: usize) -> Region {
        let mut data = vec![0; WIDTH * WIDTH];
        for (u, v) in pixels {
            data[v * WIDTH + u] = 200;
        }
        let image = Image::new(WIDTH, WIDTH, WIDTH, &data).unwrap();
        let mut region = Region::default();
        let threshold = 100;
        region.set_target(
            &image,
            Target::Bright {
                threshold,
                smallest,
            },
        );
        region
    }

    fn square(u: usize, v: usize, side: usize) -> Vec<(usize, usize)> {
        let cells = (0..side * side).map(|i| (u + i % side, v + i / side));
        cells.collect()
    }

    /// Regions by flood fill over pixels instead of runs.
    fn flooded(pixels: &[(usize, usize)], smallest: usize) -> Vec<(usize, usize)> {
        let mut left: std::collections::BTreeSet<_> = pixels.iter().copied().collect();
        let mut kept = Vec::new();
        while let Some(seed) = left.pop_first() {
            let mut found = vec![seed];
            let mut next = 0;
            while next < found.len() {
                let (u, v) = found[next];
                next += 1;
                for du in 0..3 {
                    for dv in 0..3 {
                        let neighbour = (u + du, v + dv);
                        let Some(neighbour) =
                            neighbour.0.checked_sub(1).zip(neighbour.1.checked_sub(1))
                        else {
                            continue;
                        };
                        if left.remove(&neighbour) {
                            found.push(neighbour);
                        }
                    }
                }
            }
            if found.len() >= smallest {
                kept.extend(found);
            }
        }
        kept.sort_unstable();
        kept
    }

    #[test]
    fn regions_are_those_of_a_flood_fill() {
        let mut state = 1_u64;
        for density in [20, 35, 45] {
            let mut pixels = Vec::new();
            for v in 0..WIDTH {
                for u in 0..WIDTH {
                    state = state
                        .wrapping_mul(6_364_136_223_846_793_005)
                        .wrapping_add(1_442_695_040_888_963_407);
                    if (state >> 33) % 100 < density {
                        pixels.push((u, v));
                    }
                }
            }
            let smallest = 12;
            let region = region(&pixels, smallest);
            let bright = |p: &&(usize, usize)| region.contains(p.0 as f64, p.1 as f64, 0);
            let mut kept: Vec<_> = pixels.iter().filter(bright).copied().collect();
            kept.sort_unstable();
            assert_eq!(kept, flooded(&pixels, smallest), "density {density} %");
        }
    }

    #[test]
    fn stars_are_left_out_and_holes_are_filled() {
        let mut pixels = square(10, 12, 12);
        pixels.retain(|p| *p != (15, 17) && *p != (15, 18));
        pixels.extend(square(30, 30, 3));
        let region = region(&pixels, 20);
        assert!(region.contains(15.0, 17.0, 0), "a dark spot on the body");
        assert!(!region.contains(31.0, 31.0, 0), "a star");
        assert_eq!(region.bounds(), Some([10, 21, 12, 23]));
    }

    #[test]
    fn the_margin_is_kept_from_the_edge_of_the_body_but_not_of_the_image() {
        let region = region(&square(0, 5, 20), 20);
        assert!(region.contains(0.0, 10.0, 3));
        assert!(region.contains(16.0, 10.0, 3));
        assert!(!region.contains(17.0, 10.0, 3));
        assert!(!region.contains(f64::NAN, 10.0, 0));
        assert!(!region.contains(-5.0, 10.0, 0));
    }
}
