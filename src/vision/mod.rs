//! What a camera on the moving base measures.

mod pinhole;
mod pose_camera;
mod sighting;

pub use pinhole::{Pinhole, PinholeError};
pub use pose_camera::{PoseCamera, PoseCameraConfig, PoseFrame};
pub use sighting::{Feature, Sighting};
