//! Parameters of the estimator node.

use super::CameraAttitude;
use crate::{
    estimation::{
        EstimationMethod,
        bundle::{self, KnownLength, Widths},
    },
    nodes::choice,
    ros::Declare,
    vision::Pinhole,
};

/// Longest time between the starts of two batches while there is no motion yet; also the silence after which the last
/// frames are solved \[s\].
pub(super) const RETRY_PERIOD: f64 = 2.0;

/// Parameters of the estimator node, read at the start.
#[derive(Debug, Clone)]
pub struct EstimatorParams {
    /// Estimation method.
    pub method: EstimationMethod,
    /// Length of the window of frames that a batch uses, up to the newest frame \[s\].
    pub window: f64,
    /// Least time between the starts of two batch solutions \[s\].
    pub solve_period: f64,
    /// Largest share of a processor core for batch solutions: the duration of a batch divided by the time until the
    /// start of the next one.
    pub solver_share: f64,
    /// Whether a filter corrects the last batch solution with every frame.
    pub filter: bool,
    /// Random walk of the angular momentum due to disturbance torques, relative to the momentum \[1/√s\].
    pub disturbance: f64,
    /// Time between two messages of motion and prediction \[s\].
    pub prediction_period: f64,
    /// Prediction horizon \[s\].
    pub horizon: f64,
    /// Number of predicted attitudes per second \[Hz\].
    pub prediction_rate: f64,
    /// Prior standard deviations of torques, gyro errors and calibration errors.
    pub widths: Widths,
    /// Standard deviation of an image coordinate \[px\].
    pub pixel_noise: f64,
    /// A known length on the target, which gives the scale.
    pub known_length: Option<KnownLength>,
    /// Whether the camera's own rotation is compensated by the base's gyro.
    pub use_imu: bool,
    /// The camera's calibration; `None` to use `camera/camera_info`.
    pub camera: Option<Pinhole>,
}

/// Maximum number of attitudes in a prediction, which limits a message to 1 MB.
const MAX_PREDICTED: f64 = 1e4;

impl EstimatorParams {
    /// Declares and reads the parameters. The caller must call `declare.finish`.
    ///
    /// # Errors
    /// A line that names parameters with invalid or contradictory values.
    pub fn declare(declare: &mut Declare) -> Result<Self, String> {
        let method = choice::declare(
            declare,
            "method",
            &EstimationMethod::NAMES,
            "Estimation method",
        )
        .read_only()
        .value();
        let mut number = |name: &str, default: f64, from: f64, to: f64, text: &str| {
            let parameter = declare.param(name, default, text).range(from, to);
            parameter.read_only().value()
        };
        let window = number(
            "window",
            60.0,
            1.0,
            3600.0,
            "Length of the window of frames, up to the newest [s]; older ones are forgotten",
        );
        let solve_period = number(
            "solve_period",
            2.0,
            0.05,
            3600.0,
            "Shortest time between the starts of two batch solutions [s]",
        );
        let solver_share = number(
            "solver_share",
            0.04,
            1e-3,
            1.0,
            "Largest share of one processor core for batch solutions, in real time: one that takes long delays the next one, by 10 s at most, and not while most points of a frame are new",
        );
        let disturbance = number(
            "disturbance",
            1e-6,
            0.0,
            1.0,
            "Random walk of the target's angular momentum due to torques, relative to the momentum, for the filter [1/sqrt(s)]",
        );
        let prediction_period = number(
            "prediction_period",
            0.5,
            0.02,
            3600.0,
            "Time between two messages of motion and prediction [s]",
        );
        let horizon = number("horizon", 30.0, 0.0, 3600.0, "Length of the prediction [s]");
        let prediction_rate = number(
            "prediction_rate",
            2.0,
            0.01,
            100.0,
            "Attitudes per second of the prediction [Hz]",
        );
        let pixel_noise = number(
            "pixel_noise",
            0.3,
            1e-3,
            100.0,
            "Standard deviation of an image coordinate [px]; that of rounding to whole pixels is 0.3",
        );
        let usual = Widths::default();
        let widths = Widths {
            acceleration: number(
                "angular_acceleration",
                usual.acceleration,
                0.0,
                1.0,
                "Standard deviation of the target's angular acceleration by torques [rad/s^2]; the default is for low Earth orbit",
            ),
            focal: number(
                "focal_length_deviation",
                usual.focal,
                0.0,
                1.0,
                "Standard deviation of the focal length, relative to it; it is estimated unless this is 0",
            ),
            centre: number(
                "principal_point_deviation",
                usual.centre,
                0.0,
                1.0,
                "Standard deviation of the principal point, over the focal length; it is estimated unless this is 0",
            ),
            radial: number(
                "radial_distortion_deviation",
                usual.radial,
                0.0,
                1.0,
                "Standard deviation of the first radial coefficient of the distortion that remains",
            ),
            gyro_noise: number(
                "gyro_noise",
                usual.gyro_noise,
                0.0,
                1.0,
                "Random walk of the integrated gyro, if the messages on imu give no covariance [rad/sqrt(s)]",
            ),
            gyro_bias: number(
                "gyro_bias",
                usual.gyro_bias,
                0.0,
                1.0,
                "Standard deviation of the gyro's bias [rad/s]; it is estimated",
            ),
            ..usual
        };
        let mut intrinsic = |name: &str, text: &str| {
            number(
                &format!("camera.{name}"),
                0.0,
                0.0,
                1e6,
                &format!(
                    "{text} [px]; with camera.fx 0 the calibration comes from camera/camera_info"
                ),
            )
        };
        let camera = Pinhole {
            fx: intrinsic("fx", "Focal length along rows"),
            fy: intrinsic("fy", "Focal length along columns"),
            cx: intrinsic("cx", "Column of the optical axis"),
            cy: intrinsic("cy", "Row of the optical axis"),
        };
        let known_length = declare
            .param(
                "known_distance",
                String::new(),
                "Distance between two feature points, which gives the scale of positions: 'ID,ID,M' [m]; empty if none is known",
            )
            .read_only()
            .value();
        let mut flag = |name: &str, default: bool, text: &str| {
            declare.param(name, default, text).read_only().value()
        };
        let filter = flag(
            "filter",
            true,
            "Whether a filter corrects the last batch solution by every frame (method bundle)",
        );
        let use_imu = flag(
            "use_imu",
            true,
            "Whether the camera's own rotation is removed with the gyro on imu, if there is one",
        );
        let known_length = match known_length.is_empty() {
            true => None,
            false => Some(
                KnownLength::distance(&known_length)
                    .map_err(|e| format!("parameter known_distance: {e}"))?,
            ),
        };
        let camera = match camera.fx {
            0.0 => None,
            _ => Some(camera),
        };
        if let Some(camera) = &camera {
            camera.check().map_err(|e| format!("parameter {e}"))?;
        }
        if horizon * prediction_rate > MAX_PREDICTED {
            return Err(format!(
                "parameters horizon {horizon} and prediction_rate {prediction_rate} are more than \
                 {MAX_PREDICTED} attitudes a message; lower one of them"
            ));
        }
        Ok(Self {
            // The declaration refuses other values.
            method: choice::find(&EstimationMethod::NAMES, &method).unwrap_or_default(),
            window,
            solve_period,
            solver_share,
            filter,
            disturbance,
            prediction_period,
            horizon,
            prediction_rate,
            widths,
            pixel_noise,
            known_length,
            use_imu,
            camera,
        })
    }

    /// The disturbance assumed by the filter; `None` without a filter.
    pub fn filter_disturbance(&self) -> Option<f64> {
        self.filter.then_some(self.disturbance)
    }

    /// Time between two batches \[s\] before `solver_share` is considered; shorter while there is no motion yet.
    pub fn batch_period(&self, has_motion: bool) -> f64 {
        match has_motion {
            true => self.solve_period,
            false => self.solve_period.min(RETRY_PERIOD),
        }
    }

    /// Options of a batch, including the camera's motion from the gyro. `has_ranges` says whether distances of points
    /// have been measured.
    pub fn batch_options(&self, attitude: &CameraAttitude, has_ranges: bool) -> bundle::Options {
        bundle::Options {
            pixel_noise: self.pixel_noise,
            widths: Widths {
                gyro_noise: attitude.gyro_noise().unwrap_or(self.widths.gyro_noise),
                ..self.widths
            },
            camera_motion: attitude.gyro.motion(),
            with_points: self.known_length.is_some() || has_ranges,
            ..bundle::Options::default()
        }
    }
}
