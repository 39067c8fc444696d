//! Points of a body in a sequence of images.
//!
//! A [`Tracker`] takes grey images one after the other and gives the pixels of points that it recognizes, each with an
//! id that no other point gets. It knows neither the camera's calibration nor the body. Pixel centres are at integers.
//!
//! ```
//! use fuyu_track::{Image, Settings, Tracker};
//!
//! let mut tracker = Tracker::new(Settings::default())?;
//! let pixels = vec![0; 640 * 480];
//! let image = Image::new(640, 480, 640, &pixels)?;
//! let features = tracker.track(0.0, image, None)?;
//! assert!(features.is_empty(), "nothing is in a black image");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A frame goes through these steps:
//!
//! 1. The target's pixels: a mask of the caller, or connected bright regions without those of a star's size ([`Target`]).
//! 2. Pyramidal Lucas-Kanade tracking from the last frame, started where the motion of the last frames leads to, forward and backward.
//! 3. Alignment with the surroundings at first sight, under an affine map and any gain and offset: removes the drift of step 2 and
//!    ends points that look different.
//! 4. Points at the edge of the target, where silhouettes are, and those that do not move with the others as a rigid body, end.
//! 5. New corners (Shi and Tomasi 1994) where there is room, refined to fractions of a pixel.

mod corners;
mod image;
mod patch;
mod region;
mod rigid;
mod settings;
mod tracker;

pub use image::{Image, ImageError, LARGEST_IMAGE, SMALLEST_IMAGE};
pub use settings::{Settings, SettingsError, Target, ranges};
pub use tracker::{Feature, Losses, TrackError, Tracker};
