//! Kida 1993, "Control of large space structures" (in Japanese): its theorems on random structures, and its direct
//! feedback on the servicer of this repository. Tables and designs are in `fuyu_structures::kida1993` and
//! `fuyu_lti::kida1993`.
//!
//! | module | content |
//! | --- | --- |
//! | [`zero_theorems`] | Theorems 2.1 to 2.6: poles and transmission zeros |
//! | [`shaping_theorems`] | Theorems 3.1 to 3.6: frequency-shaped regulators |
//! | [`feedback_theorems`] | Lemmas 4.2 and 4.4, Theorems 4.1 to 4.3: direct feedback, proof-mass actuators |
//! | [`servicer`] | a servicer with panels, an arm and wheels, as a plant of attitude control |

pub mod feedback_theorems;
mod random;
pub mod servicer;
pub mod shaping_theorems;
pub mod zero_theorems;
