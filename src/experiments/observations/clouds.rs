//! Distances of features, measured by the point clouds of a bag, which give the scale of lengths.

use crate::{
    estimation::bundle::MeasuredRange,
    msg::sensor_msgs::PointCloud2,
    nodes::{estimator::Ranges, features::rectified},
    vision::{Distortion, FeatureFrame, Pinhole},
};

/// Measures distances while a bag is read, without storing clouds.
#[derive(Default)]
pub(super) struct RangeReader {
    ranges: Ranges,
    has_clouds: bool,
    /// The error of the first cloud that was ignored.
    problem: Option<String>,
}

impl RangeReader {
    /// Takes a cloud whose coordinates must be in the frame `camera`; empty if that is not known yet.
    pub(super) fn take(&mut self, cloud: &PointCloud2, camera: &str) {
        self.has_clouds = true;
        if camera.is_empty() {
            return;
        }
        if let Err(problem) = self.ranges.take(cloud, camera) {
            self.problem.get_or_insert(problem);
        }
    }

    /// Measures the features of the frames nearest in time to the waiting clouds. `frames` has all frames so far.
    pub(super) fn measure(
        &mut self,
        frames: &[FeatureFrame],
        camera: &Pinhole,
        lens: Option<&Distortion>,
    ) {
        let Some(start) = self.ranges.frames_needed_from() else {
            return;
        };
        let first = frames.partition_point(|frame| frame.time < start);
        let near = frames[first..].iter();
        let near: Vec<_> = near.map(|f| rectified(f.clone(), camera, lens)).collect();
        self.ranges.measure(&near, camera);
    }

    /// The distances, and the reason why clouds were ignored, if any were.
    pub(super) fn finish(self) -> (Vec<MeasuredRange>, Option<String>) {
        let measured = self.ranges.measured().to_vec();
        let unused = (self.has_clouds && measured.is_empty()).then(|| {
            "no point of a cloud is near a feature in the image of the recorded camera_info"
                .to_owned()
        });
        (measured, self.problem.or(unused))
    }
}
