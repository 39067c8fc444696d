//! Observations from a bag: `camera/features`, or features tracked in its images; the camera's calibration; the base's
//! gyro and the mounting of the camera; point clouds.

use std::{collections::BTreeMap, path::Path};

use nalgebra::Vector3;

use super::{ObservedTracks, Tracking, clouds::RangeReader, masks::Masks};
use crate::{
    bag::{Bag, BagError, Message},
    control::StampPairs,
    estimation::Tracks,
    msg::{
        fuyu_msgs::FeatureTracks,
        sensor_msgs::{CameraInfo, CompressedImage, Image, Imu, PointCloud2},
    },
    nodes::{
        estimator::{StaticRotations, variance_of},
        features::{camera_from_msg, feature_frame_from_msg},
        geometry::vector_from_msg,
        tracker::{Grey, ImageTracker, mask_of},
    },
    ros::Time,
    vision::{Distortion, FeatureFrame, Pinhole},
};

const FEATURES: &str = "/camera/features";
const POINTS: &str = "/camera/points";
const SEGMENTATION: &str = "/camera/segmentation";

/// Reads the features of the one camera in a bag, or tracks them in its images.
///
/// # Errors
/// A line that names the bag and the topic.
pub(super) fn read(path: &Path, tracking: Option<&Tracking>) -> Result<ObservedTracks, String> {
    let through = tracking.map(|t| Through::new(path, t)).transpose()?;
    let bag = Bag::open(path).map_err(|e| e.to_string())?;
    let mut robots: BTreeMap<String, Recorded> = BTreeMap::new();
    let mut frames = StaticRotations::default();
    let mut has_images = false;
    for message in bag.messages() {
        let topic = &message.topic.name;
        let at = |e: String| format!("{}: {topic}: {e}", path.display());
        if topic.ends_with("/tf_static") {
            decode(&message).and_then(|m| frames.take(m)).map_err(at)?;
        }
        for (suffix, take) in TOPICS {
            if suffix == FEATURES && tracking.is_some() {
                continue;
            }
            if let Some(namespace) = topic.strip_suffix(suffix) {
                let robot = robots.entry(namespace.to_owned()).or_default();
                take(robot, &message).map_err(at)?;
            }
        }
        for (suffix, decode) in IMAGES {
            if let (Some(through), Some(namespace)) = (&through, topic.strip_suffix(suffix)) {
                let robot = robots.entry(namespace.to_owned()).or_default();
                (robot.see(suffix, through, &message, decode)).map_err(at)?;
            }
            has_images |= topic.ends_with(suffix);
        }
        if let (Some(through), Some(namespace)) = (&through, topic.strip_suffix(SEGMENTATION))
            && let Some(id) = through.mask_id
        {
            let robot = robots.entry(namespace.to_owned()).or_default();
            robot.see_mask(id, &message).map_err(at)?;
        }
    }
    let needs_masks = through.as_ref().is_some_and(|t| t.mask_id.is_some());
    let has_masks = robots.values().any(|robot| robot.has_masks);
    robots.retain(|_, robot| !robot.frames.is_empty());
    let mut robots = robots.into_iter();
    let at = |e: String| format!("{}: {e}", path.display());
    match (robots.next(), robots.next()) {
        (None, _) if needs_masks && !has_masks => Err(at(format!(
            "holds no message on {SEGMENTATION} (sensor_msgs/msg/Image), which --mask-id needs"
        ))),
        (None, _) if tracking.is_some() => Err(at(format!(
            "holds no points of a body that could be tracked on {} or {}",
            IMAGES[0].0, IMAGES[1].0
        ))),
        (None, _) => Err(at(format!(
            "holds no message on {FEATURES} (fuyu_msgs/msg/FeatureTracks){}",
            match has_images {
                true => "; with --track, points are tracked through its images",
                false => "",
            }
        ))),
        (Some((a, _)), Some((b, _))) => Err(at(format!(
            "holds features of two cameras, {a}{FEATURES} and {b}{FEATURES}; give a bag of one"
        ))),
        (Some((namespace, robot)), None) => {
            let rates = robot.camera_rates(&frames);
            let gyro_noise = robot.gyro_noise();
            let (ranges, ignored_clouds) = robot.ranges.finish();
            let tracks = Tracks::new(robot.frames);
            Ok(ObservedTracks {
                tracks: tracks.map_err(|e| at(format!("{namespace}{FEATURES}: {e}")))?,
                camera: robot.camera,
                distortion: robot.distortion,
                gyro_noise,
                w_WC_C: rates,
                ranges,
                ignored_clouds: ignored_clouds.map(|why| format!("{namespace}{POINTS}: {why}")),
            })
        }
    }
}

/// Messages of one robot.
#[derive(Default)]
struct Recorded {
    frames: Vec<FeatureFrame>,
    camera_frame: String,
    camera: Option<Pinhole>,
    distortion: Option<Distortion>,
    /// Variance of a gyro sample \[rad²/s²\], if known.
    gyro_variance: Option<f64>,
    /// Angular velocity of the inertial measurement unit in its own axes, over time.
    gyro: Vec<(f64, Vector3<f64>)>,
    gyro_frame: String,
    /// Topic of the images, and their tracker.
    tracker: Option<(&'static str, ImageTracker)>,
    /// Time of the last image \[s\].
    last_image: Option<f64>,
    /// Images and masks, paired by stamp.
    pairs: StampPairs<Time, Image, Grey>,
    has_masks: bool,
    ranges: RangeReader,
}

/// Tracking of images while a bag is read.
struct Through<'a> {
    tracking: &'a Tracking,
    /// Id of the target in the bag's segmentation images.
    mask_id: Option<u16>,
    /// A mask for all images.
    mask: Option<Grey>,
}

impl<'a> Through<'a> {
    fn new(bag: &Path, tracking: &'a Tracking) -> Result<Self, String> {
        let id = tracking.params.mask_id;
        let mask = match Masks::new(tracking.mask.as_deref(), id)? {
            Masks::None => None,
            Masks::Same(mask) => Some(mask),
            Masks::Files(folder, _) => {
                return Err(format!(
                    "{}: is a folder, and the images of the bag {} have no names; --mask must be one PNG file, or --mask-id alone uses {SEGMENTATION}",
                    folder.display(),
                    bag.display()
                ));
            }
        };
        Ok(Self {
            tracking,
            mask_id: id.filter(|_| mask.is_none()),
            mask,
        })
    }
}

type Take = fn(&mut Recorded, &Message) -> Result<(), String>;

const TOPICS: [(&str, Take); 4] = [
    (FEATURES, |robot, message| {
        let features: FeatureTracks = decode(message)?;
        let frame = feature_frame_from_msg(&features)?;
        // A state that was published twice is recorded twice.
        if robot.frames.last().is_none_or(|last| *last != frame) {
            robot.frames.push(frame);
            robot.measure_ranges();
        }
        robot.camera_frame = features.header.frame_id;
        Ok(())
    }),
    (POINTS, |robot, message| {
        let cloud: PointCloud2 = decode(message)?;
        robot.ranges.take(&cloud, &robot.camera_frame);
        robot.measure_ranges();
        Ok(())
    }),
    ("/camera/camera_info", |robot, message| {
        let (camera, lens) = camera_from_msg(&decode::<CameraInfo>(message)?)?;
        (robot.camera, robot.distortion) = (Some(camera), lens);
        Ok(())
    }),
    ("/imu", |robot, message| {
        let imu: Imu = decode(message)?;
        let time = Time::from(&imu.header.stamp).as_secs_f64();
        let w = vector_from_msg(&imu.angular_velocity);
        if !w.iter().all(|w| w.is_finite()) {
            return Err(format!("angular_velocity at {time} s is not finite"));
        }
        if robot.gyro.last().is_none_or(|(last, _)| *last < time) {
            robot.gyro.push((time, w));
        }
        robot.gyro_variance = variance_of(&imu.angular_velocity_covariance);
        robot.gyro_frame = imu.header.frame_id;
        Ok(())
    }),
];

/// Topics with images, and the decoders of their messages.
const IMAGES: [(&str, DecodeImage); 2] = [
    ("/camera/image_raw", |message| decode(message)),
    ("/camera/image_raw/compressed", |message| {
        let compressed: CompressedImage = decode(message)?;
        let decoded = image::load_from_memory(&compressed.data)
            .map_err(|e| format!("data of format '{}': {e}", compressed.format))?;
        let grey = decoded.into_luma8();
        let (width, height) = grey.dimensions();
        Ok(Image {
            header: compressed.header,
            width,
            height,
            encoding: "mono8".to_owned(),
            step: width,
            data: grey.into_raw(),
            ..Image::default()
        })
    }),
];

type DecodeImage = fn(&Message) -> Result<Image, String>;

impl Recorded {
    /// Tracks points into an image when its mask has arrived; ignores images of other topics than the first one's.
    fn see(
        &mut self,
        topic: &'static str,
        through: &Through,
        message: &Message,
        decode: DecodeImage,
    ) -> Result<(), String> {
        if self.tracker.is_none() {
            let params = through.tracking.params.clone();
            let tracker = ImageTracker::new(params).map_err(|e| e.to_string())?;
            self.tracker = Some((topic, tracker));
        }
        if (self.tracker.as_ref()).is_none_or(|(used, _)| *used != topic) {
            return Ok(());
        }
        let image = decode(message)?;
        if through.mask_id.is_none() {
            return self.track(&image, through.mask.as_ref());
        }
        let stamp = Time::from(&image.header.stamp);
        self.pairs.push_first(stamp, image);
        self.track_pairs()
    }

    fn see_mask(&mut self, id: u16, message: &Message) -> Result<(), String> {
        let segmentation: Image = decode(message)?;
        let stamp = Time::from(&segmentation.header.stamp);
        self.pairs.push_second(stamp, mask_of(&segmentation, id)?);
        self.has_masks = true;
        self.track_pairs()
    }

    fn track_pairs(&mut self) -> Result<(), String> {
        while let Some((_, image, mask)) = self.pairs.pop() {
            self.track(&image, Some(&mask))?;
        }
        Ok(())
    }

    fn track(&mut self, image: &Image, mask: Option<&Grey>) -> Result<(), String> {
        let Some((_, tracker)) = &mut self.tracker else {
            return Ok(());
        };
        let time = Time::from(&image.header.stamp).as_secs_f64();
        // An image that was published twice is recorded twice.
        if self.last_image.is_some_and(|last| time <= last) {
            return Ok(());
        }
        let features = tracker.track(image, mask)?;
        self.last_image = Some(time);
        if !features.ids.is_empty() {
            self.frames.push(feature_frame_from_msg(&features)?);
            self.measure_ranges();
        }
        self.camera_frame = features.header.frame_id;
        Ok(())
    }

    /// Measures the distances of features if the camera's calibration is known.
    fn measure_ranges(&mut self) {
        if let Some(camera) = &self.camera {
            let lens = self.distortion.as_ref();
            self.ranges.measure(&self.frames, camera, lens);
        }
    }

    /// Angular random walk of the integrated gyro \[rad/√s\]: standard deviation of a sample times the square root of
    /// the interval.
    fn gyro_noise(&self) -> Option<f64> {
        let (first, last) = (self.gyro.first()?, self.gyro.last()?);
        let interval = (last.0 - first.0) / self.gyro.len().saturating_sub(1).max(1) as f64;
        Some((self.gyro_variance? * interval).sqrt())
    }

    /// Angular velocity of the camera in its own axes over time; empty unless a gyro was recorded and the camera is
    /// fixed to it.
    fn camera_rates(&self, frames: &StaticRotations) -> Vec<(f64, Vector3<f64>)> {
        let Some(R_IC) = frames.rotation(&self.gyro_frame, &self.camera_frame) else {
            return Vec::new();
        };
        let in_camera_axes = |(time, w): &(f64, Vector3<f64>)| (*time, R_IC.inverse() * w);
        self.gyro.iter().map(in_camera_axes).collect()
    }
}

fn decode<M: crate::msg::Interface>(message: &Message) -> Result<M, String> {
    message.decode().map_err(|e: BagError| e.to_string())
}
