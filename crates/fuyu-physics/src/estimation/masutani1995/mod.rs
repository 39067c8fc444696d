//! The estimation of Masutani 1995 chapter 2, as published, with misprints corrected.
//!
//! Angular velocities between consecutive views ([`rates_from_tracks`]) lie in the invariable plane. The waveform of
//! `|w|²` and the mean rate of the herpolhode give the moments. One of four models is chosen by comparison with the
//! noise. The method is fast and needs neither initial values nor a body model. It does not tolerate outliers, uneven
//! sampling or a camera that rotates.

mod analysis;
mod error;
mod moments;
mod plane;
mod rates;
mod spectrum;
mod waveform;

pub use analysis::{Analysis, Fit, estimate, from_tracks};
pub use error::MasutaniError;
pub use plane::{InvariablePlane, MeanPrecession};
pub use rates::{Rate, mean_rate, rates_from_tracks};
pub use spectrum::Spectrum;
pub use waveform::{Pulse, Waveform};

/// Thresholds of the algorithm; the defaults are those of Masutani 1995 table 3.1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// `Theta_abs`: a spectral component above this fraction of the main one makes the main one ambiguous.
    pub rival: f64,
    /// `Theta_near`: bins up to this far from the main one belong to it.
    pub neighbourhood: f64,
    /// `Theta_sin`: below this ratio of scatter along the invariable plane to scatter across it, the angular
    /// velocity counts as constant.
    pub single_axis: f64,
    /// `N_p`: with fewer periods than this in the observation, the motion counts as aperiodic.
    pub periods: f64,
    /// Whether the aperiodic model may be chosen; chapter 3 does not use it.
    pub aperiodic: bool,
    /// How the axisymmetric model unwraps the herpolhode's angles, which the text does not specify: each nearest to their
    /// regression line (true), or to the angle before (false), where noise causes slips by whole revolutions.
    pub unwrap_to_line: bool,
    /// `Theta_damp`: factor on a Gauss-Newton step that increased the residual.
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
            unwrap_to_line: false,
            damping: 0.5,
            convergence: 1e-8,
        }
    }
}
