//! Check whether first-order modes suffice for a motion.

use std::fmt;

use fuyu_structures::{FIRST_ORDER_RATE, generalized_eigen};

use super::section::Section;
use super::{FlexibleState, FlexibleWorkspace};

/// A deformable body whose motion exceeds the limits of first-order modes. `Display` gives a line for a log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstOrderExcess<'a> {
    /// Name of the body.
    pub name: &'a str,
    /// The quantity that is too large.
    pub quantity: FirstOrderQuantity,
    /// Its value.
    pub value: f64,
    /// Its limit ([`Appendage::first_order_limits`](fuyu_structures::Appendage::first_order_limits)).
    pub limit: f64,
}

/// A quantity that limits the use of first-order modes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FirstOrderQuantity {
    /// Angular velocity of the attachment \[rad/s\]; the centrifugal stiffness is missing.
    Rate,
    /// Displacement of an output point \[m\]; the shortening is missing.
    Deflection,
}

impl FirstOrderQuantity {
    /// Unit of its values.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Rate => "rad/s",
            Self::Deflection => "m",
        }
    }

    /// Description of the excess, as in "the panel turns faster than ...".
    pub fn beyond(self) -> &'static str {
        match self {
            Self::Rate => "turns faster than",
            Self::Deflection => "is deflected by more than",
        }
    }
}

impl fmt::Display for FirstOrderExcess<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            name, value, limit, ..
        } = self;
        let what = match self.quantity {
            FirstOrderQuantity::Rate => "turns at",
            FirstOrderQuantity::Deflection => "is deflected by",
        };
        let unit = self.quantity.unit();
        write!(
            f,
            "{name} {what} {value:.4} {unit}; first-order modes suffice up to {limit:.4} {unit}: set second_order"
        )
    }
}

impl FlexibleWorkspace {
    /// The first deformable body without second-order terms that exceeds the limits of first-order modes, at the state
    /// of the last [`FlexibleWorkspace::set_state`]; `None` if first order suffices. The limit of an elastic link
    /// depends on its lowest frequency with the bodies that it carries in this posture; computing it allocates memory.
    pub fn first_order_excess<'a>(
        &'a self,
        state: &'a FlexibleState,
    ) -> Option<FirstOrderExcess<'a>> {
        let bodies = self.system.modal_bodies().iter().zip(self.system.limits());
        for (i, (body, limits)) in bodies.enumerate() {
            let Some(mut limits) = *limits else { continue };
            if let Some(section) = self.sections.iter().find(|s| s.modal_body == i) {
                limits.rate = limits
                    .rate
                    .min(FIRST_ORDER_RATE * self.loaded_frequency(section));
            }
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

    /// Lowest frequency \[rad/s\] of an elastic link with the bodies that its section carries, with its own joint and
    /// the following ones locked.
    fn loaded_frequency(&self, section: &Section) -> f64 {
        let body = &self.system.modal_bodies()[section.modal_body];
        let mut mass = self.modal[section.modal_body].shape.mass.clone();
        for (k, column) in section.columns.iter().enumerate() {
            let carried = section.composite.momentum(column);
            for (l, other) in section.columns.iter().enumerate() {
                mass[(l, k)] += other.dot(&carried);
            }
        }
        let eigen = generalized_eigen(&body.appendage.modal_stiffness, &mass);
        let lowest = eigen.map(|eigen| eigen.values.iter().copied().fold(f64::INFINITY, f64::min));
        // A state that is not finite has no frequency.
        lowest.map_or(f64::INFINITY, |value| value.max(0.0).sqrt())
    }
}
