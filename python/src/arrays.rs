//! Numbers from and to numpy.

use fuyu::dynamics::Workspace;
use fuyu::model::Model;
use nalgebra::{DVector, Vector3};
use numpy::ndarray::{CowArray, IxDyn};
use numpy::{
    AllowTypeChange, PyArray1, PyArrayDyn, PyArrayLikeDyn, PyArrayMethods, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::error::input;

/// Numbers that a caller gives: an array of float64 is read where it is; lists and other types are converted.
pub type Given<'py> = PyArrayLikeDyn<'py, f64, AllowTypeChange>;

/// Rows of numbers: the last axis is a row, those before it count the rows.
pub struct Rows<'a> {
    values: CowArray<'a, f64, IxDyn>,
}

impl<'a> Rows<'a> {
    /// Rows of one number per joint, all finite.
    pub fn of_joints(name: &str, given: &'a Given<'_>, model: &Model) -> PyResult<Self> {
        let array = given.as_array();
        let rows = Self {
            values: match array.is_standard_layout() {
                true => CowArray::from(array),
                false => CowArray::from(array.as_standard_layout().into_owned()),
            },
        };
        let shape = rows.values.shape();
        let last = shape.last().copied().unwrap_or(0);
        if shape.is_empty() || last != model.dof() {
            return Err(input(format!(
                "`{name}` has {last} elements, but robot `{}` has {} joints",
                model.name(),
                model.dof()
            )));
        }
        check_finite(name, rows.values()?)?;
        Ok(rows)
    }

    /// The axes that count the rows.
    pub fn leading(&self) -> &[usize] {
        let shape = self.values.shape();
        &shape[..shape.len() - 1]
    }

    /// Number of rows.
    pub fn count(&self) -> usize {
        self.leading().iter().product()
    }

    /// All numbers, row by row.
    pub fn values(&self) -> PyResult<&[f64]> {
        let values = self.values.as_slice();
        values.ok_or_else(|| input("an array has no standard layout"))
    }
}

/// Refuses numbers that are NaN or infinite.
pub fn check_finite(name: &str, values: &[f64]) -> PyResult<()> {
    match values.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(at) => Err(input(format!(
            "`{name}[{at}]` is {}; it must be finite",
            values[at]
        ))),
    }
}

/// One number per joint; `None` is zero.
pub fn joints(name: &str, given: Option<&Given<'_>>, model: &Model) -> PyResult<DVector<f64>> {
    let Some(given) = given else {
        return Ok(DVector::zeros(model.dof()));
    };
    let rows = Rows::of_joints(name, given, model)?;
    if !rows.leading().is_empty() {
        let shape = given.shape();
        return Err(input(format!(
            "`{name}` has the shape {shape:?}; it must be ({},)",
            model.dof()
        )));
    }
    Ok(DVector::from_column_slice(rows.values()?))
}

/// `N` numbers; `None` is the default.
pub fn numbers<const N: usize>(
    name: &str,
    given: Option<&Given<'_>>,
    default: [f64; N],
) -> PyResult<[f64; N]> {
    let Some(given) = given else {
        return Ok(default);
    };
    if given.shape() != [N] {
        let shape = given.shape();
        return Err(input(format!(
            "`{name}` has the shape {shape:?}; it must be ({N},)"
        )));
    }
    let array = given.as_array();
    let values: Vec<f64> = array.iter().copied().collect();
    check_finite(name, &values)?;
    let mut found = default;
    found.copy_from_slice(&values);
    Ok(found)
}

/// Three numbers; `None` is zero.
pub fn vector(name: &str, given: Option<&Given<'_>>) -> PyResult<Vector3<f64>> {
    numbers(name, given, [0.0; 3]).map(Vector3::from)
}

/// A new array of one axis.
pub fn array<'py>(py: Python<'py>, values: &[f64]) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, values)
}

/// A new array of any shape, row by row.
pub fn shaped<'py>(
    py: Python<'py>,
    values: Vec<f64>,
    shape: Vec<usize>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    PyArray1::from_vec(py, values).reshape(shape)
}

/// A new array with the result of `compute` for each row of `q`, of shape `(..., *shape)`. Many rows are computed on all processors,
/// without the interpreter's lock.
pub fn for_each_posture<'py>(
    py: Python<'py>,
    model: &Model,
    q: &Given<'py>,
    shape: &[usize],
    compute: impl Fn(&mut Workspace, &mut [f64]) + Sync,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let rows = Rows::of_joints("q", q, model)?;
    let full: Vec<usize> = rows.leading().iter().chain(shape).copied().collect();
    let out = PyArrayDyn::zeros(py, full, false);
    let length = shape.iter().product::<usize>();
    let (dof, values) = (model.dof(), rows.values()?);
    if rows.count() == 0 || length == 0 {
        return Ok(out);
    }
    {
        let mut writable = out.readwrite();
        let results = writable.as_slice_mut()?;
        py.detach(|| {
            let start = || (Workspace::new(model), DVector::zeros(dof));
            let one =
                |(workspace, q): &mut (Workspace, DVector<f64>), index: usize, out: &mut [f64]| {
                    q.as_mut_slice()
                        .copy_from_slice(&values[index * dof..][..dof]);
                    workspace.set_positions(q);
                    compute(workspace, out);
                };
            if results.len() == length {
                one(&mut start(), 0, results);
            } else {
                let chunks = results.par_chunks_mut(length).enumerate();
                chunks.for_each_init(start, |scratch, (index, out)| one(scratch, index, out));
            }
        });
    }
    Ok(out)
}

/// Writes a matrix (columns first) row by row.
pub fn write_rows(matrix: &nalgebra::DMatrix<f64>, out: &mut [f64]) {
    for (row, out) in out.chunks_exact_mut(matrix.ncols()).enumerate() {
        for (column, value) in out.iter_mut().enumerate() {
            *value = matrix[(row, column)];
        }
    }
}
