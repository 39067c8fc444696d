//! Drives that damp the joints of many states to given rates.

use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::arrays::check_finite;
use crate::batch::not_contiguous;
use crate::error::input;

/// Rates \[rad/s or m/s\] and gains of the drives of many states, in the caller's arrays.
#[derive(Clone, Copy)]
pub struct Drives<'a> {
    rates: &'a [f64],
    gains: &'a [f64],
    dof: usize,
    /// Whether the gains are matrices.
    is_coupled: bool,
}

impl<'a> Drives<'a> {
    /// `rates` of shape (count, dof), `gains` of that shape or (count, dof, dof).
    pub fn new(
        rates: &'a PyReadonlyArrayDyn<'_, f64>,
        gains: &'a PyReadonlyArrayDyn<'_, f64>,
        count: usize,
        dof: usize,
    ) -> PyResult<Self> {
        if rates.shape() != [count, dof] {
            return Err(input(format!(
                "`rates` has the shape {:?}; it must be ({count}, {dof})",
                rates.shape()
            )));
        }
        let is_coupled = gains.shape() == [count, dof, dof];
        if !is_coupled && gains.shape() != [count, dof] {
            return Err(input(format!(
                "`gains` has the shape {:?}; it must be ({count}, {dof}) or ({count}, {dof}, {dof})",
                gains.shape()
            )));
        }
        for (name, array) in [("rates", rates), ("gains", gains)] {
            if !array.is_c_contiguous() {
                return Err(not_contiguous(name));
            }
            check_finite(name, array.as_slice()?)?;
        }
        Ok(Self {
            rates: rates.as_slice()?,
            gains: gains.as_slice()?,
            dof,
            is_coupled,
        })
    }

    /// Efforts of state `index`, whose joints move with `qd`: its gains times the errors of its rates.
    pub fn efforts(&self, index: usize, qd: &[f64], efforts: &mut [f64]) {
        let dof = self.dof;
        let rates = &self.rates[index * dof..][..dof];
        let errors = rates.iter().zip(qd).map(|(rate, qd)| rate - qd);
        if self.is_coupled {
            let gains = &self.gains[index * dof * dof..][..dof * dof];
            for (row, effort) in gains.chunks_exact(dof).zip(efforts) {
                *effort = row.iter().zip(errors.clone()).map(|(g, e)| g * e).sum();
            }
        } else {
            let gains = &self.gains[index * dof..][..dof];
            for ((gain, error), effort) in gains.iter().zip(errors).zip(efforts) {
                *effort = error * gain;
            }
        }
    }
}
