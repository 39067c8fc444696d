//! The estimation of Masutani 1995 chapter 2, as published, with misprints corrected.
//!
//! Angular velocities between consecutive views ([`rates_from_tracks`]) end in the invariable plane; the waveform
//! of `|w|²` and the mean turn of the herpolhode give the moments; one of four models is chosen by what the noise
//! leaves visible. It is fast, needs no start and no body model; what it cannot stand is outliers, uneven
//! sampling and a camera that turns.

mod analysis;
mod error;
mod moments;
mod plane;
mod rates;
mod spectrum;
mod waveform;

pub use analysis::{Analysis, Fit, estimate, from_tracks};
pub use error::EstimateError;
pub use plane::{InvariablePlane, MeanPrecession};
pub use rates::{Rate, mean_rate, rates_from_tracks};
pub use spectrum::Spectrum;
pub use waveform::{Pulse, Waveform};

/// Thresholds of the algorithm; those of Masutani 1995 table 3.1 by default.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// `Theta_abs`: a spectral component above this share of the main one contests it.
    pub rival: f64,
    /// `Theta_near`: bins up to this far from the main one belong to it.
    pub neighbourhood: f64,
    /// `Theta_sin`: below this ratio of scatter along the invariable plane to scatter across it, the angular
    /// velocity counts as constant.
    pub single_axis: f64,
    /// `N_p`: with fewer periods than this in the observation, the motion counts as aperiodic.
    pub periods: f64,
    /// Whether the aperiodic model may be chosen; chapter 3 does without.
    pub aperiodic: bool,
    /// How the axisymmetric model takes the herpolhode's angles, which the text does not say: each as the turn nearest
    /// to their common line rather than to the angle before, from which some slip in noise.
    pub steady_turns: bool,
    /// `Theta_damp`: factor on a Gauss-Newton step that made things worse.
    pub damping: f64,
    /// `Theta_eps`: the fit ends when the sum of squares falls by less than this share.
    pub convergence: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            rival: 0.333,
            neighbourhood: 2.0,
            single_axis: 2.0,
            periods: 2.0,
            aperiodic: true,
            steady_turns: false,
            damping: 0.5,
            convergence: 1e-8,
        }
    }
}
