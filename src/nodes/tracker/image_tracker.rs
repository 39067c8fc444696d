//! Image tracker: computes feature tracks from images, for the node and for recordings.

use fuyu_track::{Losses, SettingsError, Tracker};

use super::{Grey, TrackerParams};
use crate::{
    msg::{fuyu_msgs::FeatureTracks, sensor_msgs::Image},
    nodes::features::feature_frame_to_msg,
    ros::Time,
    vision::{Feature, FeatureFrame},
};

/// Tracks points from image to image.
pub struct ImageTracker {
    tracker: Tracker,
    white: u16,
    last: Option<f64>,
    frame_id: String,
}

impl ImageTracker {
    /// A tracker without points.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(params: TrackerParams) -> Result<Self, SettingsError> {
        Ok(Self {
            tracker: Tracker::new(params.settings)?,
            white: params.white,
            last: None,
            frame_id: String::new(),
        })
    }

    /// Numbers of lost points, by reason.
    pub fn losses(&self) -> Losses {
        self.tracker.losses()
    }

    /// The features in an image, with the image's header. If time goes back or the camera changes, all tracks end.
    ///
    /// # Errors
    /// Names the mistake in the image, which is then ignored.
    pub fn track(&mut self, image: &Image, mask: Option<&Grey>) -> Result<FeatureTracks, String> {
        let grey = Grey::new(image, self.white)?;
        let time = Time::from(&image.header.stamp).as_secs_f64();
        if self.frame_id != image.header.frame_id {
            self.frame_id.clone_from(&image.header.frame_id);
            self.last = None;
        }
        let frame = self.track_grey(time, &grey, mask)?;
        let mut message = feature_frame_to_msg(&frame, &image.header.frame_id);
        message.header.stamp = image.header.stamp.clone();
        Ok(message)
    }

    /// The features in a grey image of `time` \[s\].
    ///
    /// # Errors
    /// Names the mistake.
    pub fn track_grey(
        &mut self,
        time: f64,
        grey: &Grey,
        mask: Option<&Grey>,
    ) -> Result<FeatureFrame, String> {
        if self.last.is_none_or(|last| time < last) {
            self.tracker.restart();
        }
        let mask = mask.map(Grey::view).transpose()?;
        let features = (self.tracker.track(time, grey.view()?, mask)).map_err(|e| e.to_string())?;
        self.last = Some(time);
        let features = features.iter().map(|f| Feature {
            id: f.id.into(),
            u: f.u,
            v: f.v,
        });
        Ok(FeatureFrame::new(time, features.collect()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::{builtin_interfaces, std_msgs::Header};

    fn image(second: i32, encoding: &str) -> Image {
        let data = (0..64 * 48).map(|i| {
            let (u, v) = (i % 64, i / 64);
            60 + 120 * (((u / 12) + (v / 12)) % 2) as u8
        });
        let stamp = builtin_interfaces::Time {
            sec: second,
            nanosec: 0,
        };
        Image {
            header: Header {
                stamp,
                frame_id: "camera".to_owned(),
            },
            width: 64,
            height: 48,
            step: 64,
            encoding: encoding.to_owned(),
            data: data.collect(),
            ..Image::default()
        }
    }

    #[test]
    fn a_wrong_image_changes_nothing_and_going_back_in_time_begins_anew() {
        let mut params = TrackerParams::default();
        params.settings.confirmation = 1;
        params.settings.rigid_frames = 0;
        let mut tracker = ImageTracker::new(params).unwrap();
        let first = tracker.track(&image(1, "mono8"), None).unwrap();
        assert!(!first.ids.is_empty());
        assert!(tracker.track(&image(2, "yuv422"), None).is_err());
        let second = tracker.track(&image(2, "mono8"), None).unwrap();
        assert_eq!(second.ids, first.ids);
        assert_eq!(second.header, image(2, "").header);
        // A repeated stamp.
        assert!(tracker.track(&image(2, "mono8"), None).is_err());
        let again = tracker.track(&image(0, "mono8"), None).unwrap();
        assert!(again.ids.iter().all(|id| !first.ids.contains(id)));
        assert_eq!(again.ids.len(), first.ids.len());
    }
}
