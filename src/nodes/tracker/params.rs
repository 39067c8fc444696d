//! Parameters of the tracker node.

use std::ops::RangeInclusive;

use fuyu_track::{Settings, Target, ranges};

use crate::ros::Declare;

/// Parameters of the tracker node, read once, at the start.
#[derive(Debug, Clone)]
pub struct TrackerParams {
    /// Settings of the tracker.
    pub settings: Settings,
    /// Id of the target in `camera/segmentation`; `None` to take bright regions of the image as the target.
    pub mask_id: Option<u16>,
    /// Value of `mono16` that counts as white.
    pub white: u16,
}

impl Default for TrackerParams {
    fn default() -> Self {
        Self {
            settings: Settings::default(),
            mask_id: None,
            white: u16::MAX,
        }
    }
}

impl TrackerParams {
    /// Declares and reads the parameters. The caller must call `declare.finish`.
    ///
    /// # Errors
    /// A line that names a parameter with an invalid value.
    pub fn declare(declare: &mut Declare) -> Result<Self, String> {
        let usual = Settings::default();
        let Target::Bright {
            threshold,
            smallest,
        } = usual.target
        else {
            return Err("the usual target is a bright region".to_owned());
        };
        let mut count = |name: &str, default: usize, range: RangeInclusive<usize>, text: &str| {
            let (from, to) = (*range.start() as i64, *range.end() as i64);
            let parameter = declare.param(name, default as i64, text).range(from, to);
            // Other values are refused by the declaration.
            usize::try_from(parameter.read_only().value()).unwrap_or(default)
        };
        let points = count(
            "points",
            usual.points,
            ranges::POINTS,
            "Most points at a time",
        );
        let window = count(
            "window",
            usual.window,
            ranges::WINDOW,
            "Side of the window that is compared, odd [px]",
        );
        let levels = count(
            "levels",
            usual.levels,
            ranges::LEVELS,
            "Levels of the image pyramid",
        );
        let margin = count(
            "margin",
            usual.margin,
            ranges::MARGIN,
            "Distance of points from the edge of the target [px]: closer ones may be a silhouette",
        );
        let rigid_frames = count(
            "rigid_frames",
            usual.rigid_frames,
            0..=*ranges::RIGID_FRAMES.end(),
            "Frames over which the points must move as one rigid body, 6 or more; a point is published in frames in which it is found to, which takes six points. 0 does not test it",
        );
        let confirmation = count(
            "confirmation",
            usual.confirmation,
            ranges::CONFIRMATION,
            "Frames for which a point has to be tracked before it is published",
        );
        let threshold = count(
            "threshold",
            threshold.into(),
            1..=255,
            "Grey value from which a pixel can be of the target (without a mask)",
        );
        let smallest = count(
            "smallest",
            smallest,
            0..=1_000_000_000,
            "Pixels of the smallest bright region that is no star (without a mask)",
        );
        let mask_id = count(
            "mask_id",
            0,
            0..=65_535,
            "Id of the target in camera/segmentation, which then has to have the stamps of the images; 0 uses no mask",
        );
        let white = count(
            "white",
            65_535,
            1..=65_535,
            "Value of mono16 images that is white: 4095 for twelve bits",
        );
        let mut number = |name: &str, default: f64, range: RangeInclusive<f64>, text: &str| {
            let parameter = declare
                .param(name, default, text)
                .range(*range.start(), *range.end());
            parameter.read_only().value()
        };
        let settings = Settings {
            points,
            window,
            levels,
            margin,
            rigid_frames,
            confirmation,
            target: Target::Bright {
                threshold: u8::try_from(threshold).unwrap_or(u8::MAX),
                smallest,
            },
            spacing: number(
                "spacing",
                usual.spacing,
                ranges::SPACING,
                "Distance of new points from all others [px]",
            ),
            quality: number(
                "quality",
                usual.quality,
                ranges::QUALITY,
                "Least strength of new corners, of that of the strongest",
            ),
            strength: number(
                "strength",
                usual.strength,
                ranges::STRENGTH,
                "Least strength of new corners: smaller eigenvalue of the structure tensor [(grey values/px)^2]",
            ),
            backward: number(
                "backward",
                usual.backward,
                ranges::BACKWARD,
                "Largest distance between a point and where tracking backward returns to [px]",
            ),
            similarity: number(
                "similarity",
                usual.similarity,
                ranges::SIMILARITY,
                "Least normalized cross-correlation with the first sight of a point",
            ),
            rigid_error: number(
                "rigid_error",
                usual.rigid_error,
                ranges::RIGID_ERROR,
                "Largest root mean square deviation from rigid motion [px]",
            ),
        };
        settings.check().map_err(|e| format!("parameter {e}"))?;
        Ok(Self {
            settings,
            mask_id: u16::try_from(mask_id).ok().filter(|id| *id != 0),
            white: u16::try_from(white).unwrap_or(u16::MAX),
        })
    }
}
