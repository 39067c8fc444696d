//! Parameters of the estimator node.

use crate::{estimation::Method, nodes::choice, ros::Declare, vision::Pinhole};

/// What the estimator node is told; read once, at the start.
#[derive(Debug, Clone)]
pub struct EstimatorParams {
    /// How the motion is estimated.
    pub method: Method,
    /// Frames older than this, seen from the newest, are forgotten \[s\].
    pub window: f64,
    /// Time between the starts of two batch solutions \[s\].
    pub solve_period: f64,
    /// Whether a filter goes on from a batch solution with every frame.
    pub filter: bool,
    /// What torques do to the momentum: its random walk over the momentum \[1/√s\].
    pub disturbance: f64,
    /// Time between two messages of motion and prediction \[s\].
    pub prediction_period: f64,
    /// How far the prediction reaches \[s\].
    pub horizon: f64,
    /// Attitudes per second of the prediction \[Hz\].
    pub prediction_rate: f64,
    /// Whether the focal length is estimated, too.
    pub estimate_focal_length: bool,
    /// Standard deviation of an image coordinate \[px\].
    pub pixel_noise: f64,
    /// Whether the base's gyro is used to take the camera's own rotation out.
    pub use_imu: bool,
    /// The camera, if it is not to come from `camera/camera_info`.
    pub camera: Option<Pinhole>,
}

/// Most attitudes that a prediction may hold: 1 MB in a message.
const MOST_PREDICTED: f64 = 1e4;

impl EstimatorParams {
    /// Declares the parameters and reads them. `finish` of `declare` is the caller's.
    ///
    /// # Errors
    /// A line that names the parameter whose values do not fit together.
    pub fn declare(declare: &mut Declare) -> Result<Self, String> {
        let method = choice::declare(declare, "method", &Method::NAMES, "Estimation method")
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
            "Frames older than this, seen from the newest, are forgotten [s]",
        );
        let solve_period = number(
            "solve_period",
            2.0,
            0.05,
            3600.0,
            "Time between the starts of two batch solutions [s]",
        );
        let disturbance = number(
            "disturbance",
            1e-6,
            0.0,
            1.0,
            "What torques do to the target's momentum, for the filter: random walk over the momentum [1/sqrt(s)]",
        );
        let prediction_period = number(
            "prediction_period",
            0.5,
            0.02,
            3600.0,
            "Time between two messages of motion and prediction [s]",
        );
        let horizon = number(
            "horizon",
            30.0,
            0.0,
            3600.0,
            "How far the prediction reaches [s]",
        );
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
            "Standard deviation of an image coordinate [px]; what rounding to pixels leaves is 0.3",
        );
        let mut intrinsic = |name: &str, text: &str| {
            number(
                &format!("camera.{name}"),
                0.0,
                0.0,
                1e6,
                &format!("{text} [px]; camera.fx 0 is from camera/camera_info"),
            )
        };
        let camera = Pinhole {
            fx: intrinsic("fx", "Focal length along rows"),
            fy: intrinsic("fy", "Focal length along columns"),
            cx: intrinsic("cx", "Column of the optical axis"),
            cy: intrinsic("cy", "Row of the optical axis"),
        };
        let mut flag = |name: &str, default: bool, text: &str| {
            declare.param(name, default, text).read_only().value()
        };
        let estimate_focal_length = flag(
            "estimate_focal_length",
            false,
            "Whether the focal length is estimated, too",
        );
        let filter = flag(
            "filter",
            true,
            "Whether a filter corrects the last batch solution by every frame (method bundle)",
        );
        let use_imu = flag(
            "use_imu",
            true,
            "Whether the camera's own rotation is taken out with the gyro on imu, if it is there",
        );
        let camera = match camera.fx {
            0.0 => None,
            _ => Some(camera),
        };
        if let Some(camera) = &camera {
            camera.check().map_err(|e| format!("parameter {e}"))?;
        }
        if horizon * prediction_rate > MOST_PREDICTED {
            return Err(format!(
                "parameters horizon {horizon} and prediction_rate {prediction_rate} are more than \
                 {MOST_PREDICTED} attitudes a message; lower one of them"
            ));
        }
        Ok(Self {
            // Any other text has been refused by the declaration.
            method: choice::find(&Method::NAMES, &method).unwrap_or_default(),
            window,
            solve_period,
            filter,
            disturbance,
            prediction_period,
            horizon,
            prediction_rate,
            estimate_focal_length,
            pixel_noise,
            use_imu,
            camera,
        })
    }

    /// The filter's disturbance, if there is to be one.
    pub fn filter_disturbance(&self) -> Option<f64> {
        self.filter.then_some(self.disturbance)
    }
}
