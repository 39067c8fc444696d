//! Transmission zeros by the reduction of Emami-Naeini & Van Dooren (Automatica 18, 1982).

use crate::eigen::balance;
use crate::matrix::{Complex, ComplexMatrix, Matrix, blocks, complex, full_svd, shifted, solve};
use crate::{LtiError, StateSpace, eigenvalues};

/// Relative size below which a singular value counts as zero in the reduction.
const RANK_TOLERANCE: f64 = 1e-11;

impl StateSpace {
    /// Finite invariant zeros: where the rank of the system matrix `[A - s I, B; C, D]` falls below its usual value. They are the transmission
    /// zeros and, of a square system that can be inverted, also the modes that no input moves or no output sees.
    ///
    /// Any numbers of inputs and outputs. Orthogonal transformations remove the infinite zeros, until D is square and regular; the rest
    /// is an eigenvalue problem, whose values are refined on the original system matrix.
    ///
    /// ```
    /// use fuyu_lti::TransferFunction;
    /// let g = TransferFunction::new(&[1.0, 3.0], &[1.0, 0.0, 0.0])?.to_state_space()?;
    /// assert!((g.zeros()?[0].re + 3.0).abs() < 1e-12);
    /// # Ok::<(), fuyu_lti::LtiError>(())
    /// ```
    pub fn zeros(&self) -> Result<Vec<Complex>, LtiError> {
        let scaled = equilibrated(self);
        // Twice on dual systems: first the rows of D become independent, then its columns.
        let Some(once) = reduced(&scaled)? else {
            return Ok(Vec::new());
        };
        let Some(core) = reduced(&once.dual())? else {
            return Ok(Vec::new());
        };
        let core = core.dual();
        let (n, r) = (core.order(), core.inputs());
        if r == 0 {
            return eigenvalues(&core.a);
        }
        // Columns [V1 V2] with [C D] V1 = 0: the zeros are the eigenvalues of the pencil [A B] V1 - s [I 0] V1.
        let (_, _, v) = full_svd(&blocks(&[&[&core.c, &core.d]]))?;
        let kernel = v.columns(r, n);
        let top = &core.a * kernel.rows(0, n) + &core.b * kernel.rows(n, r);
        let pencil = solve("the zero pencil", &kernel.rows(0, n).into_owned(), &top)?;
        let system = complex(&blocks(&[&[&scaled.a, &scaled.b], &[&scaled.c, &scaled.d]]));
        Ok(eigenvalues(&pencil)?
            .into_iter()
            .map(|z| refined_zero(&system, scaled.order(), z))
            .collect())
    }
}

/// Newton's method on the scaled system matrix P(s) of order n, given at s = 0: with left and right null vectors u, v of the smallest singular
/// value sigma, `s + sigma / (u^H E v)`. Kept only if sigma falls; a square system only, as other pencils have no such isolated minimum.
fn refined_zero(system: &ComplexMatrix, n: usize, start: Complex) -> Complex {
    if !system.is_square() {
        return start;
    }
    let mut best = (start, f64::INFINITY);
    let mut z = start;
    for _ in 0..4 {
        let Some((left, sigma, right)) = smallest_triplet(shifted(system, n, z)) else {
            break;
        };
        if sigma >= best.1 {
            break;
        }
        best = (z, sigma);
        // dP/ds = -diag(I, 0)
        let slope: Complex = (0..n).map(|i| left[i].conj() * right[i]).sum();
        if slope.norm() < 1e-6 {
            break;
        }
        z += Complex::new(sigma, 0.0) / slope;
    }
    // A real zero stays real, and a conjugate pair stays a pair, because start is one.
    if start.im == 0.0 {
        Complex::new(best.0.re, 0.0)
    } else {
        best.0
    }
}

fn smallest_triplet(p: ComplexMatrix) -> Option<(Vec<Complex>, f64, Vec<Complex>)> {
    let size = p.nrows();
    let svd = nalgebra::SVD::try_new(p, true, true, f64::EPSILON, 1000 * size)?;
    let k = (0..size).min_by(|&a, &b| svd.singular_values[a].total_cmp(&svd.singular_values[b]))?;
    let left = svd.u?.column(k).iter().copied().collect();
    let right = svd.v_t?.row(k).iter().map(|v| v.conj()).collect();
    Some((left, svd.singular_values[k], right))
}

/// States, inputs and outputs in units that make the entries of the system matrix alike; zeros do not change.
fn equilibrated(sys: &StateSpace) -> StateSpace {
    let mut out = sys.clone();
    let scales = balance(&mut out.a);
    for (i, &d) in scales.iter().enumerate() {
        out.b.row_mut(i).scale_mut(1.0 / d);
        out.c.column_mut(i).scale_mut(d);
    }
    let size = if out.a.amax() > 0.0 {
        out.a.amax()
    } else {
        1.0
    };
    for j in 0..out.inputs() {
        let largest = out.b.column(j).amax().max(out.d.column(j).amax());
        if largest > 0.0 {
            out.b.column_mut(j).scale_mut(size / largest);
            out.d.column_mut(j).scale_mut(size / largest);
        }
    }
    for i in 0..out.outputs() {
        let largest = out.c.row(i).amax().max(out.d.row(i).amax());
        if largest > 0.0 {
            out.c.row_mut(i).scale_mut(size / largest);
            out.d.row_mut(i).scale_mut(size / largest);
        }
    }
    out
}

/// Removes infinite zeros and rows until D has independent rows; `None` if no state is left.
fn reduced(sys: &StateSpace) -> Result<Option<StateSpace>, LtiError> {
    let size = sys.a.norm() + sys.b.norm() + sys.c.norm() + sys.d.norm();
    let tolerance = RANK_TOLERANCE * size;
    let rank = |values: &[f64]| values.iter().filter(|&&v| v > tolerance).count();
    let (mut a, mut b, mut c, mut d) = (sys.a.clone(), sys.b.clone(), sys.c.clone(), sys.d.clone());
    // Every pass removes at least one state or ends.
    for _ in 0..=sys.order() {
        let n = a.nrows();
        if n == 0 {
            return Ok(None);
        }
        let (u, values, _) = full_svd(&d)?;
        let tau = rank(&values);
        let p = d.nrows();
        let (ct, dt) = (u.transpose() * &c, u.transpose() * &d);
        if tau == p {
            (c, d) = (ct, dt);
            break;
        }
        let rest = ct.rows(tau, p - tau).into_owned();
        let (_, values, v) = full_svd(&rest)?;
        let sigma = rank(&values);
        if sigma == 0 {
            c = ct.rows(0, tau).into_owned();
            d = dt.rows(0, tau).into_owned();
            break;
        }
        // States in the order: those that the rest of the outputs does not see, those that it sees.
        let order: Vec<usize> = (sigma..n).chain(0..sigma).collect();
        let v = v.select_columns(&order);
        let nu = n - sigma;
        let (av, bv, cv) = (v.transpose() * &a * &v, v.transpose() * &b, ct * &v);
        let part = |m: &Matrix, row: usize, rows: usize, columns: usize| {
            m.view((row, 0), (rows, columns)).into_owned()
        };
        let m = b.ncols();
        (a, b, c, d) = (
            part(&av, 0, nu, nu),
            part(&bv, 0, nu, m),
            blocks(&[&[&part(&cv, 0, tau, nu)], &[&part(&av, nu, sigma, nu)]]),
            blocks(&[&[&part(&dt, 0, tau, m)], &[&part(&bv, nu, sigma, m)]]),
        );
    }
    Ok(Some(StateSpace {
        a,
        b,
        c,
        d,
        sampling_time: sys.sampling_time,
    }))
}
