//! Images that the camera node renders.

mod body;
mod imager;
mod outputs;
mod params;
mod shape;
mod thread;
mod topics;

pub use body::{Body, BodyState};
pub use imager::{ImageScene, Imager, Shot, checked_shape};
pub use outputs::{Content, ImageMessage, Output};
pub use params::{CameraSpec, Colour, Compression, Depth, ImageParams, ImageSettings};
pub use params::{LiveImageSettings, MAIN};
pub use shape::{Part, Shape};
pub use topics::ImageTopics;
