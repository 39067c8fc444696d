//! Cameras on the moving base: pose measurements of tip and goal, feature tracks of a body, attitudes from a star
//! tracker, and their accuracy.

mod delay_line;
mod distortion;
mod exposure_schedule;
mod feature_camera;
mod feature_frame;
mod frame_stream;
mod pinhole;
mod pixel_noise;
mod pose_camera;
mod star_tracker;

pub use distortion::{Distortion, DistortionError};
pub use feature_camera::{BodyPoint, FeatureCamera, FeatureCameraConfig};
pub use feature_frame::{Feature, FeatureFrame};
pub use frame_stream::{DueExposure, FrameStream, StreamConfig};
pub use pinhole::{Pinhole, PinholeError};
pub use pixel_noise::PoseAccuracy;
pub use pose_camera::{PoseCamera, PoseCameraConfig, PoseFrame};
pub use star_tracker::{StarTracker, StarTrackerConfig, StarTrackerFrame};
