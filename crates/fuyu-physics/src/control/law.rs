//! Interface of a control law.

use std::fmt;

use nalgebra::{DVector, UnitQuaternion, Vector3};

use super::prediction::TipPrediction;
use super::{Gains, LawConfig, LawError, Manipulator, SaturatedError};

/// A control law: computes joint efforts from the state of the arm and its goal, without the joint damping `-K_V q̇`, which
/// the [`Controller`](super::Controller) adds.
///
/// Only [`Law::efforts`] is required; `Controller` has an example. A step must allocate no memory.
pub trait Law: fmt::Debug + Send {
    /// Writes the joint efforts \[N m or N\], one per joint; they are zero when the law is called.
    /// `manipulator.workspace` holds the joint positions of `input`, and must still hold them afterwards.
    ///
    /// # Errors
    /// [`LawError`] if there are no efforts. The joints are then only damped, and the controller returns the error.
    fn efforts(
        &mut self,
        input: &LawInput<'_>,
        manipulator: &mut Manipulator,
        efforts: &mut DVector<f64>,
    ) -> Result<LawStatus, LawError>;

    /// Resets all state except the settings: the next step belongs to another run.
    fn reset(&mut self) {}

    /// Takes checked settings, and keeps its state. Returns whether they are settings of this law. Only built-in laws
    /// implement this; a user-defined law manages its settings itself.
    fn configure(&mut self, config: &LawConfig) -> bool {
        *config == LawConfig::Custom
    }

    /// Fraction of `K_V` that the controller adds while the law acts, 0 to 1; less than one for a law that adds damping
    /// itself.
    fn joint_damping_fraction(&self) -> f64 {
        1.0
    }

    /// Whether the efforts never exceed those derived from the potential of Masutani 1995 chapter 5. The controller
    /// then reports a tip that does not converge ([`ConvergenceFailure`](super::ConvergenceFailure)) and moves the arm
    /// out of singular positions.
    fn monitors_convergence(&self) -> bool {
        false
    }

    /// Whether the controller adds the efforts for a moving goal, [`FeedForward`](super::FeedForward), when it predicts the
    /// motion of the goal.
    fn feeds_forward(&self) -> bool {
        false
    }
}

/// State of arm and goal at the time of the joint state, after latency compensation.
#[derive(Debug, Clone, Copy)]
pub struct LawInput<'a> {
    /// Time of the joint state \[s\].
    pub time: f64,
    /// Joint positions \[rad or m\].
    pub q: &'a DVector<f64>,
    /// Joint rates \[rad/s or m/s\].
    pub qd: &'a DVector<f64>,
    /// Gains of the controller.
    pub gains: &'a Gains,
    /// Tip and goal of each arm; `None` without a camera measurement.
    pub tips: &'a [Option<TipPrediction>],
    /// Deviation of the first tip, saturated; `None` without a camera measurement.
    pub error: Option<SaturatedError>,
    /// Angular velocity of the base in the inertial frame I of [`super::prediction`], base axes \[rad/s\].
    pub w_IB_B: &'a Vector3<f64>,
    /// Attitude of the base in I.
    pub R_IB: &'a UnitQuaternion<f64>,
    /// Joint rates `q̇_D` that move the tip with its goal \[rad/s or m/s\]; `None` without feed-forward.
    pub reference_rates: Option<&'a DVector<f64>>,
}

impl LawInput<'_> {
    /// First tip and its goal; `None` without a camera measurement.
    pub fn tip(&self) -> Option<&TipPrediction> {
        self.tips.first()?.as_ref()
    }
}

/// The measurements on which a law has acted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LawStatus {
    /// None: a measurement is missing. The efforts are not used; the joints are only damped.
    Inactive,
    /// The deviation of the tip, [`LawInput::error`].
    TipFeedback,
    /// Joint positions and rates only.
    JointFeedback,
}
