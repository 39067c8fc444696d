//! What a camera on the moving base measures.

mod pose_camera;

pub use pose_camera::{PoseCamera, PoseCameraConfig, PoseFrame};
