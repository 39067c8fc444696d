//! Tracker node: finds points of a target in camera images and tracks them.
//!
//! Its features are the input of the estimator. It reads images of any camera, simulated or real, and needs no
//! calibration.

mod grey;
mod image_tracker;
mod params;

pub use grey::{Grey, mask_of};
pub use image_tracker::ImageTracker;
pub use params::TrackerParams;

use std::{
    collections::VecDeque,
    time::{Duration, Instant},
};

use super::topics;
use crate::{
    msg::{fuyu_msgs::FeatureTracks, sensor_msgs::Image},
    ros::{Node, NodeError, Publisher, Received, Status, Subscription},
};

/// Longest wait for a message.
const PATIENCE: Duration = Duration::from_millis(50);

/// Maximum number of images, and of masks, that wait for each other or for the tracker, to limit memory.
const QUEUE: usize = 8;

/// Time without images after which the node warns.
const SILENCE: Duration = Duration::from_secs(2);

/// The node's program.
///
/// # Errors
/// For invalid parameters, or when DDS reports an error.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let params = TrackerParams::declare(&mut declare);
    declare.finish()?;
    let params = params.map_err(|e| NodeError::Input(format!("node {}: {e}", node.name())))?;
    let mut follower = Follower::new(node, params)?;
    while node.wait_for(PATIENCE) {
        follower.take_messages();
        while let Some((image, mask)) = follower.next() {
            follower.track(&image, mask.as_ref());
        }
        follower.notice_silence();
    }
    Ok(())
}

/// Endpoints and state of the node.
struct Follower {
    tracker: ImageTracker,
    mask_id: Option<u16>,
    images: Subscription<Image>,
    /// `None` unless masks are used.
    masks: Option<Subscription<Image>>,
    features: Publisher<FeatureTracks>,
    waiting: VecDeque<Received<Image>>,
    seen_masks: VecDeque<Received<Image>>,
    /// Number of images for which no mask arrived.
    unmasked: u64,
    status: Status,
}

impl Follower {
    fn new(node: &Node, params: TrackerParams) -> Result<Self, NodeError> {
        let images = topics::IMAGE.subscribe_deep(node, QUEUE)?;
        let masks = match params.mask_id {
            Some(_) => Some(topics::SEGMENTATION.subscribe_deep(node, QUEUE)?),
            None => None,
        };
        let status = node.diagnostics().status("images");
        status.warn(format!("nothing has arrived on {} yet", images.topic()));
        let mask_id = params.mask_id;
        let tracker = ImageTracker::new(params)
            .map_err(|e| NodeError::Input(format!("node {}: {e}", node.name())))?;
        Ok(Self {
            tracker,
            mask_id,
            images,
            masks,
            features: topics::FEATURES.advertise(node)?,
            waiting: VecDeque::new(),
            seen_masks: VecDeque::new(),
            unmasked: 0,
            status,
        })
    }

    fn take_messages(&mut self) {
        while let Some(received) = self.images.take() {
            self.waiting.push_back(received);
        }
        if let Some(masks) = &self.masks {
            while let Some(received) = masks.take() {
                self.seen_masks.push_back(received);
                if self.seen_masks.len() > QUEUE {
                    self.seen_masks.pop_front();
                }
            }
        }
        while self.waiting.len() > QUEUE {
            self.waiting.pop_front();
            self.unmasked += u64::from(self.masks.is_some());
        }
    }

    /// The oldest image with a mask, if masks are used; otherwise the oldest image.
    fn next(&mut self) -> Option<(Image, Option<Image>)> {
        let Some(masks) = &self.masks else {
            return Some((self.waiting.pop_front()?.message, None));
        };
        let stamp_of = |r: &Received<Image>| r.message.header.stamp.clone();
        let found = (self.waiting.iter().enumerate()).find_map(|(i, image)| {
            let stamp = stamp_of(image);
            let mask = (self.seen_masks.iter()).position(|mask| stamp_of(mask) == stamp)?;
            Some((i, mask))
        });
        let Some((i, mask)) = found else {
            if self.waiting.len() == QUEUE {
                let (topic, image) = (masks.topic(), self.images.topic());
                self.status.warn(format!(
                    "{topic} has no mask with the stamp of any of the last {QUEUE} images on {image}; with mask_id 0 none is needed"
                ));
            }
            return None;
        };
        self.unmasked += i as u64;
        let image = self.waiting.drain(..=i).next_back()?;
        let mask = self.seen_masks.drain(..=mask).next_back()?;
        Some((image.message, Some(mask.message)))
    }

    fn track(&mut self, image: &Image, mask: Option<&Image>) {
        let began = Instant::now();
        let mask = match (mask, self.mask_id) {
            (Some(mask), Some(id)) => match mask_of(mask, id) {
                Ok(mask) => Some(mask),
                Err(problem) => {
                    let topic = self.masks.as_ref().map_or("", |masks| masks.topic());
                    self.status
                        .error(format!("{topic}: {problem}; the image is ignored"));
                    return;
                }
            },
            _ => None,
        };
        match self.tracker.track(image, mask.as_ref()) {
            Ok(features) => {
                self.features.publish(&features);
                self.status.ok("images arrive");
                self.status.set("features in sight", features.ids.len());
            }
            Err(problem) => {
                let topic = self.images.topic();
                self.status
                    .error(format!("{topic}: {problem}; the image is ignored"));
                return;
            }
        }
        let milliseconds = began.elapsed().as_secs_f64() * 1e3;
        self.status
            .set("time of an image [ms]", format!("{milliseconds:.1}"));
        let losses = self.tracker.losses();
        for (reason, count) in [
            ("lost: not found again", losses.unmatched),
            ("lost: other appearance", losses.appearance),
            ("lost: edge of the target", losses.edge),
            ("lost: other motion", losses.motion),
            ("images without a mask", self.unmasked),
        ] {
            self.status.set(reason, count);
        }
    }

    fn notice_silence(&self) {
        if let Some(age) = self.images.age().filter(|age| *age > SILENCE) {
            let (topic, seconds) = (self.images.topic(), age.as_secs_f64());
            self.status
                .warn(format!("{topic} has been silent for {seconds:.0} s"));
        }
    }
}
