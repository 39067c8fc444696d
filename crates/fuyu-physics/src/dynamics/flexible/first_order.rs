//! Whether first-order modes suffice for a motion.

use std::fmt;

use super::{FlexibleState, FlexibleWorkspace};

/// A deformable body whose motion is beyond what first-order modes describe. `Display` gives a line for a log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstOrderExcess<'a> {
    /// Name of the body.
    pub name: &'a str,
    /// What is too large.
    pub quantity: FirstOrderQuantity,
    /// Its value.
    pub value: f64,
    /// Its limit ([`Appendage::first_order_limits`](fuyu_structures::Appendage::first_order_limits)).
    pub limit: f64,
}

/// What limits the use of first-order modes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FirstOrderQuantity {
    /// Angular velocity of the attachment \[rad/s\]; the centrifugal stiffness is missing.
    Rate,
    /// Displacement of an output point \[m\]; the shortening is missing.
    Deflection,
}

impl fmt::Display for FirstOrderExcess<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            name, value, limit, ..
        } = self;
        let (what, unit) = match self.quantity {
            FirstOrderQuantity::Rate => ("turns at", "rad/s"),
            FirstOrderQuantity::Deflection => ("is deflected by", "m"),
        };
        write!(
            f,
            "{name} {what} {value:.4} {unit}; first-order modes suffice up to {limit:.4} {unit}: set second_order"
        )
    }
}

impl FlexibleWorkspace {
    /// The first deformable body without second order that is beyond the limits of first order, at the state of the
    /// last [`FlexibleWorkspace::set_state`]; `None` if first order suffices.
    pub fn first_order_excess<'a>(
        &'a self,
        state: &'a FlexibleState,
    ) -> Option<FirstOrderExcess<'a>> {
        for (body, limits) in (self.system.modal_bodies().iter()).zip(self.system.limits()) {
            let Some(limits) = limits else { continue };
            let rate = self.nodes[body.body].V.angular.norm();
            let mu = &state.mu()[body.range()];
            let outputs = body.appendage.outputs.iter();
            let deflections = outputs.map(|output| output.displacement(mu).norm());
            let deflection = deflections.fold(0.0, f64::max);
            for (quantity, value, limit) in [
                (FirstOrderQuantity::Rate, rate, limits.rate),
                (
                    FirstOrderQuantity::Deflection,
                    deflection,
                    limits.deflection,
                ),
            ] {
                if value > limit {
                    return Some(FirstOrderExcess {
                        name: body.name(),
                        quantity,
                        value,
                        limit,
                    });
                }
            }
        }
        None
    }
}
