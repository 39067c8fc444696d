//! Choice of an attitude law, with its settings.

use super::{
    AttitudeConfigError, AttitudeLaw, AttitudePlant, DoubleLoopConfig, DoubleLoopLaw, Dvdfb, Lqr,
    LqrWeights,
};

/// A law and its settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AttitudeLawConfig {
    /// Direct feedback of attitude and rate.
    Dvdfb(Dvdfb),
    /// Linear-quadratic regulator for the rigid robot.
    Lqr(LqrWeights),
    /// Rate feedback inside an H-infinity loop.
    DoubleLoop(DoubleLoopConfig),
}

impl AttitudeLawConfig {
    /// The law for torques held for `period` \[s\]. It is designed for the first of `plants`; the double loop covers
    /// the model error of all.
    ///
    /// # Errors
    /// As the constructors of the laws.
    ///
    /// # Panics
    /// If there is no plant.
    pub fn law(
        &self,
        plants: &[AttitudePlant],
        period: f64,
    ) -> Result<Box<dyn AttitudeLaw>, AttitudeConfigError> {
        Ok(match self {
            Self::Dvdfb(law) => Box::new(*law),
            Self::Lqr(weights) => Box::new(Lqr::new(&plants[0].inertia(), weights, period)?),
            Self::DoubleLoop(config) => Box::new(DoubleLoopLaw::new(plants, config, period)?),
        })
    }
}
