//! The pinhole camera.

use nalgebra::Vector3;

/// A pinhole camera without distortion: z looks forward, x right, y down (REP-103, optical frame). Pixel
/// centres are at integers, as in `sensor_msgs/CameraInfo`: the centre of the first pixel is (0, 0).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pinhole {
    /// Focal length along rows \[px\].
    pub fx: f64,
    /// Focal length along columns \[px\].
    pub fy: f64,
    /// Column where the optical axis meets the image \[px\].
    pub cx: f64,
    /// Row where the optical axis meets the image \[px\].
    pub cy: f64,
}

/// An invalid intrinsic parameter.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("camera: {name} is {value} px; it must be {right}")]
pub struct PinholeError {
    name: &'static str,
    value: f64,
    right: &'static str,
}

impl Pinhole {
    /// A camera with a square image of `resolution` pixels a side, `width` focal lengths wide, and the optical axis
    /// through its middle.
    pub fn square(resolution: u32, width: f64) -> Self {
        let focal = f64::from(resolution) / width;
        let centre = 0.5 * (f64::from(resolution) - 1.0);
        Self {
            fx: focal,
            fy: focal,
            cx: centre,
            cy: centre,
        }
    }

    /// Checks the parameters.
    ///
    /// # Errors
    /// [`PinholeError`] if a focal length is not positive or any value is not finite.
    pub fn check(&self) -> Result<(), PinholeError> {
        for (name, value) in [("fx", self.fx), ("fy", self.fy)] {
            if !(value.is_finite() && value > 0.0) {
                let right = "positive and finite";
                return Err(PinholeError { name, value, right });
            }
        }
        for (name, value) in [("cx", self.cx), ("cy", self.cy)] {
            if !value.is_finite() {
                let right = "finite";
                return Err(PinholeError { name, value, right });
            }
        }
        Ok(())
    }

    /// Projects the point `p_C` in the camera's optical frame \[m\] to column and row \[px\]; `None` if it is behind
    /// the camera.
    #[inline]
    pub fn project(&self, p_C: &Vector3<f64>) -> Option<[f64; 2]> {
        (p_C.z > 0.0).then(|| {
            [
                self.cx + self.fx * p_C.x / p_C.z,
                self.cy + self.fy * p_C.y / p_C.z,
            ]
        })
    }

    /// Back-projects the pixel (`u`, `v`) \[px\]: the ray through it in the optical frame, scaled to z = 1.
    #[inline]
    pub fn ray(&self, u: f64, v: f64) -> Vector3<f64> {
        Vector3::new((u - self.cx) / self.fx, (v - self.cy) / self.fy, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projection_inverts_back_projection() {
        let camera = Pinhole {
            fx: 800.0,
            fy: 810.0,
            cx: 319.5,
            cy: 239.5,
        };
        let [u, v] = camera.project(&(camera.ray(12.25, 400.0) * 7.0)).unwrap();
        assert!((u - 12.25).abs() < 1e-12 && (v - 400.0).abs() < 1e-12);
        assert_eq!(camera.project(&Vector3::new(0.1, 0.1, -1.0)), None);
    }

    #[test]
    fn the_middle_of_a_square_image_lies_between_its_pixels() {
        let camera = Pinhole::square(1024, 1.25);
        assert_eq!(camera.project(&Vector3::z()), Some([511.5, 511.5]));
        // The right border is half a pixel beyond the last centre.
        let border = camera.project(&Vector3::new(0.625, 0.0, 1.0)).unwrap();
        assert!((border[0] - 1023.5).abs() < 1e-12);
    }

    #[test]
    fn impossible_cameras_are_refused() {
        let mut camera = Pinhole::square(512, 1.25);
        assert_eq!(camera.check(), Ok(()));
        camera.fy = -3.0;
        let text = camera.check().unwrap_err().to_string();
        assert_eq!(text, "camera: fy is -3 px; it must be positive and finite");
        camera.fy = 3.0;
        camera.cx = f64::NAN;
        assert!(camera.check().unwrap_err().to_string().contains("cx"));
    }
}
