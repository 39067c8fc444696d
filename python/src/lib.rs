//! The Python module `fuyu._fuyu`: one file per class. Every result is that of the Rust library, to the bit.

mod arrays;
mod bag;
mod batch;
mod campaign;
mod controller;
mod drives;
mod error;
mod estimate;
mod integrator;
mod latches;
mod model;
mod poses;
mod scenario;
mod state;

use pyo3::prelude::*;

#[pymodule]
mod _fuyu {
    #[pymodule_export]
    use super::bag::{bag_topics, convert_bag};
    #[pymodule_export]
    use super::batch::Batch;
    #[pymodule_export]
    use super::campaign::{CampaignFile, campaign_plots, campaign_summary, campaign_worker};
    #[pymodule_export]
    use super::controller::Controller;
    #[pymodule_export]
    use super::error::{InputError, RunError};
    #[pymodule_export]
    use super::estimate::{MotionEstimate, estimate, estimate_rates};
    #[pymodule_export]
    use super::integrator::Integrator;
    #[pymodule_export]
    use super::latches::Latches;
    #[pymodule_export]
    use super::model::Model;
    #[pymodule_export]
    use super::scenario::Scenario;
    #[pymodule_export]
    use super::state::State;

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
