//! The built-in attitude laws.

mod dvdfb;
mod hinf;
mod lqr;

pub use dvdfb::Dvdfb;
pub use hinf::{DoubleLoopConfig, DoubleLoopLaw};
pub use lqr::{Lqr, LqrWeights};
