//! What a camera on the moving base measures.

mod feature_camera;
mod pinhole;
mod pixel_noise;
mod pose_camera;
mod exposure_schedule;
mod feature_frame;
mod delay_line;

pub use feature_camera::{BodyPoint, FeatureCamera, FeatureCameraConfig};
pub use pinhole::{Pinhole, PinholeError};
pub use pixel_noise::PoseAccuracy;
pub use pose_camera::{PoseCamera, PoseCameraConfig, PoseFrame};
pub use feature_frame::{Feature, Sighting};
