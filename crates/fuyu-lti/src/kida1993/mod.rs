//! The designs of chapters 3 and 4 of Kida, "Control system design for large space structures" (1993), as plain data.
//!
//! Each function returns plants, weights, gains, poles, margins, step responses or samples of diagrams, so that tests and programs that print tables
//! and figures share one computation. Misprints are corrected where the functions say so.
//!
//! | module | sections | contents |
//! | --- | --- | --- |
//! | [`air_table`] | 3.4, Table 3.1 | the one-axis air table: modal and hybrid model |
//! | [`designs`] | 3.4, Figs. 3.6 to 3.10 | designs 1 to 5 with reduced-order synthesis, verdicts on the seven-mode plant |
//! | [`loop_shaping`] | 3.5.3, Figs. 3.12 to 3.15 | loop-shaping examples 1 to 4 |
//! | [`truss`] | 3.6, Figs. 3.18 to 3.25 | the truss with three inputs and outputs, on a surrogate geometry |
//! | [`proof_mass`] | 4.3, Figs. 4.4 to 4.12 | rate feedback by a proof-mass actuator and its limits |
//! | [`double_loop`] | 4.4.1, Figs. 4.15 to 4.20 | direct rate feedback inside of an H-infinity loop |
//! | [`two_degrees`] | 4.4.2, Figs. 4.22 to 4.25 | model matching with two degrees of freedom |

pub mod air_table;
pub mod designs;
pub mod double_loop;
pub mod loop_shaping;
pub mod proof_mass;
pub mod truss;
pub mod two_degrees;
