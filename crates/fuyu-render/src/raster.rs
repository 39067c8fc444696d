//! Which triangle each pixel of a tile sees.

use crate::{
    camera::{Bounds, TILE_PIXELS, Tile},
    projection::Projected,
};

/// No triangle.
pub const NOTHING: u32 = u32::MAX;

/// Visible triangles of the pixels of a tile.
#[derive(Debug, Clone)]
pub struct Seen {
    /// Inverse depth \[1/m\]; 0 is infinitely far.
    pub inverse_depth: [f32; TILE_PIXELS],
    /// Index of the projected triangle, or [`NOTHING`].
    pub triangle: [u32; TILE_PIXELS],
}

impl Seen {
    pub const NOTHING: Self = Self {
        inverse_depth: [0.0; TILE_PIXELS],
        triangle: [NOTHING; TILE_PIXELS],
    };

    /// Draws a triangle.
    pub fn draw(&mut self, index: u32, triangle: &Projected, tile: &Tile, nearest: f32) {
        if !may_touch(triangle, &tile.bounds) {
            return;
        }
        let [[a0, b0, c0], [a1, b1, c1], [a2, b2, c2]] = triangle.edges;
        let [a, b, c] = triangle.inverse_depth;
        for i in 0..TILE_PIXELS {
            let (x, y) = (tile.x[i], tile.y[i]);
            let e0 = a0 * x + b0 * y + c0;
            let e1 = a1 * x + b1 * y + c1;
            let e2 = a2 * x + b2 * y + c2;
            let w = a * x + b * y + c;
            // Rays without a view are NaN, for which every comparison is false. Of triangles at the same depth the first
            // is seen.
            let is_seen = (e0 >= 0.0)
                & (e1 >= 0.0)
                & (e2 >= 0.0)
                & (w > self.inverse_depth[i])
                & (w <= nearest);
            self.inverse_depth[i] = if is_seen { w } else { self.inverse_depth[i] };
            self.triangle[i] = if is_seen { index } else { self.triangle[i] };
        }
    }
}

/// False if an edge has the whole tile on its outer side.
fn may_touch(triangle: &Projected, tile: &Bounds) -> bool {
    tile.overlap(&triangle.bounds)
        && triangle.edges.iter().all(|[a, b, c]| {
            let x = if *a > 0.0 { tile.x[1] } else { tile.x[0] };
            let y = if *b > 0.0 { tile.y[1] } else { tile.y[0] };
            // Each pixel's sum is rounded in another order than this one.
            let margin = 1e-6 * ((a * x).abs() + (b * y).abs() + c.abs());
            a * x + b * y + c >= -margin
        })
}
