//! A rendered image.

/// Image of a camera, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Linear red, green and blue radiance; 1 is a white diffuse surface in full sunlight at normal incidence.
    pub radiance: Vec<[f32; 3]>,
    /// Distance along the optical axis at half the exposure \[m\]; infinite where nothing is.
    pub depth: Vec<f32>,
    /// Id of the body at half the exposure; 0 where nothing is.
    pub ids: Vec<u16>,
}

impl Frame {
    pub(crate) fn empty(width: usize, height: usize) -> Self {
        let pixels = width * height;
        Self {
            width,
            height,
            radiance: vec![[0.0; 3]; pixels],
            depth: vec![f32::INFINITY; pixels],
            ids: vec![0; pixels],
        }
    }

    /// Depth in millimetres, little-endian, as `sensor_msgs/Image` has it in the encoding `16UC1` (REP-118): 0 where nothing
    /// is, or farther than 65.535 m.
    pub fn depth_16uc1(&self) -> Vec<u8> {
        let depths = self.depth.iter();
        let millimetres = depths.map(|z| {
            let rounded = (f64::from(*z) * 1000.0).round();
            if rounded <= 65_535.0 {
                rounded as u16
            } else {
                0
            }
        });
        millimetres.flat_map(u16::to_le_bytes).collect()
    }

    /// Depth in metres, little-endian, in the encoding `32FC1` (REP-118): infinite where nothing is.
    pub fn depth_32fc1(&self) -> Vec<u8> {
        self.depth.iter().flat_map(|z| z.to_le_bytes()).collect()
    }

    /// Ids of bodies, little-endian, in the encoding `16UC1`.
    pub fn ids_16uc1(&self) -> Vec<u8> {
        self.ids.iter().flat_map(|id| id.to_le_bytes()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_are_coded_as_rep_118_says() {
        let frame = Frame {
            depth: vec![1.2346, f32::INFINITY, 65.535, 70.0],
            ids: vec![1, 0, 258, 3],
            ..Frame::empty(2, 2)
        };
        assert_eq!(frame.depth_16uc1(), [0xd3, 0x04, 0, 0, 0xff, 0xff, 0, 0]);
        assert_eq!(frame.depth_32fc1()[..4], 1.2346_f32.to_le_bytes());
        assert_eq!(frame.depth_32fc1()[4..8], f32::INFINITY.to_le_bytes());
        assert_eq!(frame.ids_16uc1(), [1, 0, 0, 0, 2, 1, 3, 0]);
    }
}
