//! Feature tracks: the image points of one body over time.

use crate::vision::{Distortion, DistortionError, Feature, FeatureFrame, Pinhole};

/// Frames of image points of one body, in the order of time. Every pixel is finite, and no frame has an id twice.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tracks {
    frames: Vec<FeatureFrame>,
}

/// Why frames are not valid tracks.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TracksError {
    /// There is no frame, or none with a feature.
    #[error("the tracks are empty: no frame has a feature")]
    Empty,
    /// A frame's time is NaN or infinite.
    #[error("frame {frame}: time is {time}; it must be finite")]
    Time {
        /// Index of the frame, from 0.
        frame: usize,
        /// Its time \[s\].
        time: f64,
    },
    /// A frame is not later than the one before.
    #[error(
        "frame {frame}: time is {time} s, but the frame before is at {before} s; times must increase"
    )]
    Order {
        /// Index of the frame, from 0.
        frame: usize,
        /// Its time \[s\].
        time: f64,
        /// The time of the frame before \[s\].
        before: f64,
    },
    /// A pixel coordinate is NaN or infinite.
    #[error(
        "frame {frame} at {time} s: feature {id} is at pixel ({u}, {v}); both must be finite (leave out features that are not visible)"
    )]
    Pixel {
        /// Index of the frame, from 0.
        frame: usize,
        /// Its time \[s\].
        time: f64,
        /// The feature.
        id: u64,
        /// Column \[px\].
        u: f64,
        /// Row \[px\].
        v: f64,
    },
    /// A frame has an id twice.
    #[error(
        "frame {frame} at {time} s: feature {id} is there twice; ids must be unique in a frame"
    )]
    Twice {
        /// Index of the frame, from 0.
        frame: usize,
        /// Its time \[s\].
        time: f64,
        /// The feature.
        id: u64,
    },
}

impl Tracks {
    /// Tracks from frames in the order of time; the features of each frame may be in any order.
    ///
    /// # Errors
    /// [`TracksError`] that names the first invalid frame, or reports that there are no features.
    pub fn new(frames: impl IntoIterator<Item = FeatureFrame>) -> Result<Self, TracksError> {
        let mut tracks = Self::default();
        for feature_frame in frames {
            tracks.push(feature_frame)?;
        }
        if tracks.frames.iter().all(|s| s.features.is_empty()) {
            return Err(TracksError::Empty);
        }
        Ok(tracks)
    }

    /// Adds a frame; its features may be in any order, or none.
    ///
    /// # Errors
    /// [`TracksError`] if the frame is invalid or not later than the last; it is then not added.
    pub fn push(&mut self, mut feature_frame: FeatureFrame) -> Result<(), TracksError> {
        let frame = self.frames.len();
        let time = feature_frame.time;
        if !time.is_finite() {
            return Err(TracksError::Time { frame, time });
        }
        if let Some(last) = self.frames.last()
            && time <= last.time
        {
            let before = last.time;
            return Err(TracksError::Order {
                frame,
                time,
                before,
            });
        }
        if let Some(bad) = (feature_frame.features.iter()).find(|f| !(f.u + f.v).is_finite()) {
            return Err(TracksError::Pixel {
                frame,
                time,
                id: bad.id,
                u: bad.u,
                v: bad.v,
            });
        }
        feature_frame.features.sort_by_key(|f| f.id);
        if let Some(pair) = feature_frame
            .features
            .windows(2)
            .find(|p| p[0].id == p[1].id)
        {
            let id = pair[0].id;
            return Err(TracksError::Twice { frame, time, id });
        }
        self.frames.push(feature_frame);
        Ok(())
    }

    /// The tracks without lens distortion.
    ///
    /// # Errors
    /// [`DistortionError::Outside`] if the lens shows nothing where a point is said to be.
    pub fn rectified(&self, lens: &Distortion, camera: &Pinhole) -> Result<Self, DistortionError> {
        let frames = self.frames.iter().map(|frame| {
            let features = frame.features.iter().map(|f| {
                let [u, v] = lens.rectify(camera, f.u, f.v)?;
                Ok(Feature { id: f.id, u, v })
            });
            let features = features.collect::<Result<_, DistortionError>>()?;
            Ok(FeatureFrame::new(frame.time, features))
        });
        Ok(Self {
            frames: frames.collect::<Result<_, DistortionError>>()?,
        })
    }

    /// Forgets the frames before `time` \[s\].
    pub fn forget_before(&mut self, time: f64) {
        let old = self.frames.partition_point(|s| s.time < time);
        self.frames.drain(..old);
    }

    /// The frames, in the order of time.
    pub fn frames(&self) -> &[FeatureFrame] {
        &self.frames
    }

    /// Time of the first and of the last frame \[s\]; `None` without frames.
    pub fn span(&self) -> Option<(f64, f64)> {
        Some((self.frames.first()?.time, self.frames.last()?.time))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::Feature;

    fn at(time: f64, features: &[(u64, f64)]) -> FeatureFrame {
        let feature = |&(id, u)| Feature { id, u, v: 1.0 };
        let features = features.iter().map(feature).collect();
        FeatureFrame { time, features }
    }

    #[test]
    fn features_are_kept_sorted() {
        let tracks = Tracks::new([at(0.0, &[(5, 1.0), (2, 2.0)]), at(0.5, &[])]).unwrap();
        let ids: Vec<_> = tracks.frames()[0].features.iter().map(|f| f.id).collect();
        assert_eq!(ids, [2, 5]);
        assert_eq!(tracks.span(), Some((0.0, 0.5)));
    }

    #[test]
    fn errors_name_the_invalid_frame() {
        let message = |frames: Vec<FeatureFrame>| Tracks::new(frames).unwrap_err().to_string();
        assert!(message(vec![]).contains("empty"));
        assert!(message(vec![at(0.0, &[]), at(1.0, &[])]).contains("empty"));
        let backwards = message(vec![at(0.6, &[(1, 2.0)]), at(0.3, &[(1, 2.0)])]);
        assert_eq!(
            backwards,
            "frame 1: time is 0.3 s, but the frame before is at 0.6 s; times must increase"
        );
        assert!(message(vec![at(0.6, &[(1, 2.0)]), at(0.6, &[])]).contains("frame 1"));
        assert!(message(vec![at(f64::NAN, &[(1, 2.0)])]).contains("NaN"));
        let nan = message(vec![at(0.0, &[(1, 2.0), (7, f64::NAN)])]);
        assert!(nan.contains("feature 7 is at pixel (NaN, 1)"), "{nan}");
        let twice = message(vec![at(0.0, &[(7, 2.0), (3, 4.0), (7, 2.0)])]);
        assert!(twice.contains("feature 7 is there twice"), "{twice}");
    }

    #[test]
    fn a_refused_frame_leaves_the_tracks_unchanged() {
        let mut tracks = Tracks::new([at(0.0, &[(1, 2.0)]), at(1.0, &[(1, 3.0)])]).unwrap();
        let before = tracks.clone();
        assert!(tracks.push(at(0.5, &[(1, 2.0)])).is_err());
        assert_eq!(tracks, before);
        tracks.forget_before(1.0);
        assert_eq!(tracks.span(), Some((1.0, 1.0)));
    }
}
