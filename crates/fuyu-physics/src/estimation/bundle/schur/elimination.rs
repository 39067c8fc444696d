//! Elimination of the frames' own unknowns from the normal equations.

use std::ops::Range;

use nalgebra::{Cholesky, Const, Matrix3, SMatrix, SVector};
use pulp::{Simd, WithSimd};

use super::super::envelope::{Envelope, mul_add, row_length};
use super::{Coupling, FRAME, LANES, System, own_rows};

/// Number of frames whose products are subtracted at once.
const FRAMES_AT_ONCE: usize = 8;

/// The elimination of the frames, as a SIMD kernel.
pub struct Elimination<'a, const L: usize, const G: usize> {
    pub system: &'a System<L, G>,
    /// Damping, relative to each diagonal entry.
    pub damping: f64,
}

impl<const L: usize, const G: usize> WithSimd for Elimination<'_, L, G> {
    type Output = Option<Eliminated<L>>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Option<Eliminated<L>> {
        let Self { system, damping } = self;
        let mut sums = Sums::new(system, damping);
        let mut frames = Vec::with_capacity(system.frames.len());
        for (i, frame) in system.frames.iter().enumerate() {
            let (reduced, factor) = ReducedFrame::of(simd, system, i, damping)?;
            let couplings = &system.coupling[frame.first..frame.first + frame.count];
            sums.add_couplings(simd, &reduced, couplings);
            sums.add_common(simd, &reduced);
            frames.push(factor);
        }
        let (reduced, rhs) = sums.factored()?;
        Some(Eliminated {
            frames,
            reduced,
            rhs,
        })
    }
}

/// Normal equations of one frame after elimination of its own unknowns. With `H_ll = F Fᵀ` and `V = H_fl F⁻ᵀ` they are
/// `H - V Vᵀ`.
struct ReducedFrame<'a, const L: usize> {
    /// `F⁻¹`.
    inverse: SMatrix<f64, L, L>,
    /// `F⁻¹ g_l`.
    g: SVector<f64, L>,
    V: SMatrix<f64, FRAME, L>,
    /// `H - V Vᵀ`.
    H: SMatrix<f64, FRAME, FRAME>,
    /// `V F⁻¹ g_l`.
    from_own: SVector<f64, FRAME>,
    /// Rotation, and translation unless it is an own unknown: three rows of `B`, and the columns where they are not
    /// zero.
    groups: [(&'a [f64], &'a Range<usize>); 2],
}

impl<'a, const L: usize> ReducedFrame<'a, L> {
    /// The reduced equations of frame `i`, and the factor `F`; `None` if `H_ll` is not positive definite.
    #[inline(always)]
    fn of<S: Simd, const G: usize>(
        _: S,
        system: &'a System<L, G>,
        i: usize,
        damping: f64,
    ) -> Option<(Self, Cholesky<f64, Const<L>>)> {
        let (stride, pose) = (System::<L, G>::STRIDE, System::<L, G>::POSE);
        let frame = &system.frames[i];
        let mut H_ll = SMatrix::<f64, L, L>::from_fn(|a, b| frame.H[(pose + a, pose + b)]);
        for a in 0..L {
            H_ll[(a, a)] += damping * H_ll[(a, a)];
        }
        let factor = Cholesky::new(H_ll)?;
        let inverse = inverse_of_lower(factor.l_dirty());
        let g = lower_product(&inverse, &own_rows::<L, 1>(&frame.g));
        let V = lower_product(&inverse, &own_rows::<L, FRAME>(&frame.H)).transpose();
        let H = frame.H - product::<S, L, FRAME>(&V, &V.transpose());
        let rows = system.pose_rows(i);
        let group = |k: usize| match 3 * k < pose {
            true => (&rows[3 * k * stride..][..3 * stride], &frame.spans[k]),
            false => (&[][..], &frame.spans[k]),
        };
        let reduced = Self {
            inverse,
            g,
            from_own: product::<S, L, 1>(&V, &g),
            V,
            H,
            groups: [group(0), group(1)],
        };
        Some((reduced, factor))
    }

    /// The groups that depend on the common unknowns, each with the index of its first pose quantity.
    #[inline(always)]
    fn groups(&self) -> impl Iterator<Item = (usize, &'a [f64], &'a Range<usize>)> + use<'a, L> {
        let groups = self.groups.into_iter().take(2 - L / 3).enumerate();
        groups.map(|(k, (rows, span))| (3 * k, rows, span))
    }
}

/// Sums over the frames.
struct Sums<const L: usize, const G: usize> {
    /// Normal equations of points and common unknowns.
    reduced: Envelope,
    rhs: Vec<f64>,
    camera: usize,
    points: usize,
    /// Rows of the lower triangle of the common unknowns' block.
    common: Vec<f64>,
    /// Three rows for each point: its block with the common unknowns.
    with_points: Vec<f64>,
    gradient: SVector<f64, G>,
    /// `H B` of one frame.
    products: Vec<f64>,
    /// Rows of `F⁻¹ H_lp` of consecutive frames that show the same points, one after another.
    w: Vec<f64>,
    shown: Vec<usize>,
    line: Vec<f64>,
}

impl<const L: usize, const G: usize> Sums<L, G> {
    const STRIDE: usize = System::<L, G>::STRIDE;

    #[inline(always)]
    fn new(system: &System<L, G>, damping: f64) -> Self {
        let points = system.H_pp.len();
        // The rows of a point begin at the first point with which it shares a frame. Common unknowns fill whole blocks.
        let mut firsts = system.first_coupled.clone();
        firsts.extend(std::iter::repeat_n(0, G.div_ceil(3)));
        let mut reduced = Envelope::new(firsts);
        let mut rhs = vec![0.0; reduced.rows()];
        for (j, (H, g)) in system.H_pp.iter().zip(&system.g_p).enumerate() {
            for a in 0..3 {
                for b in 0..=a {
                    *reduced.at(3 * j + a, 3 * j + b) = H[(a, b)];
                }
                *reduced.at(3 * j + a, 3 * j + a) += damping * H[(a, a)] + f64::MIN_POSITIVE;
                rhs[3 * j + a] = g[a];
            }
        }
        let mut common = vec![0.0; G.next_multiple_of(3) * Self::STRIDE];
        for a in 0..G {
            common[a * Self::STRIDE + a] = system.weights[a] + damping * system.diagonal_gg[a];
        }
        Self {
            reduced,
            rhs,
            camera: system.camera,
            points,
            common,
            with_points: vec![0.0; 3 * points * Self::STRIDE],
            gradient: system.g_g,
            products: vec![0.0; FRAME * Self::STRIDE],
            w: Vec::new(),
            shown: Vec::new(),
            line: Vec::new(),
        }
    }

    /// Adds the couplings of points with each other and with the common unknowns.
    #[inline(always)]
    fn add_couplings<S: Simd>(&mut self, simd: S, frame: &ReducedFrame<L>, couplings: &[Coupling]) {
        let width = row_length(couplings.len());
        let is_same = self.shown.iter().eq(couplings.iter().map(|c| &c.point));
        if !is_same || self.w.len() >= FRAMES_AT_ONCE * L * width {
            self.subtract_points();
            self.shown.clear();
            self.shown.extend(couplings.iter().map(|c| c.point));
        }
        let first = self.w.len();
        self.w.resize(first + L * width, 0.0);
        let w = &mut self.w[first..];
        for (k, c) in couplings.iter().enumerate() {
            let v = lower_product(&frame.inverse, &own_rows::<L, 3>(&c.H_fp));
            let h = c.H_fp - product::<S, L, 3>(&frame.V, &v);
            let into = &mut self.with_points[3 * c.point * Self::STRIDE..][..3 * Self::STRIDE];
            for (first, rows, span) in frame.groups() {
                let factors = h.fixed_view::<3, 3>(first, 0).into_owned();
                add_products(simd, into, &factors, rows, span);
            }
            for b in 0..3 {
                for i in 0..self.camera {
                    into[b * Self::STRIDE + G - self.camera + i] += h[(6 + i, b)];
                }
                let mut sum = 0.0;
                for l in 0..L {
                    w[l * width + 3 * k + b] = v[(l, b)];
                    sum += v[(l, b)] * frame.g[l];
                }
                self.rhs[3 * c.point + b] -= sum;
            }
        }
    }

    /// Subtracts the collected products of points with points.
    fn subtract_points(&mut self) {
        self.reduced
            .subtract_product(&self.shown, &self.w, &mut self.line);
        self.w.clear();
    }

    /// Adds `Bᵀ H B` and its gradient.
    #[inline(always)]
    fn add_common<S: Simd>(&mut self, simd: S, frame: &ReducedFrame<L>) {
        let Self {
            products, common, ..
        } = self;
        products.fill(0.0);
        for a in (0..6 - L).chain(6..6 + self.camera) {
            let into = &mut products[a * Self::STRIDE..][..Self::STRIDE];
            for (first, rows, span) in frame.groups() {
                let factors = [0, 1, 2].map(|k| frame.H[(a, first + k)]);
                add_sum(simd, into, factors, rows, span);
            }
            for k in 0..self.camera {
                into[G - self.camera + k] += frame.H[(a, 6 + k)];
            }
        }
        for (first, rows, span) in frame.groups() {
            let products = &products[first * Self::STRIDE..][..3 * Self::STRIDE];
            for a in (span.start / 3 * 3..span.end.min(G)).step_by(3) {
                let factors = Matrix3::from_fn(|k, b| rows[k * Self::STRIDE + a + b]);
                let columns = 0..(a + 3).next_multiple_of(LANES).min(Self::STRIDE);
                let into = &mut common[a * Self::STRIDE..][..3 * Self::STRIDE];
                add_products(simd, into, &factors, products, &columns);
            }
            for k in 0..3 {
                let factor = frame.from_own[first + k];
                for column in span.start..span.end.min(G) {
                    self.gradient[column] -= factor * rows[k * Self::STRIDE + column];
                }
            }
        }
        for k in 0..self.camera {
            let a = G - self.camera + k;
            self.gradient[a] -= frame.from_own[6 + k];
            let into = &mut common[a * Self::STRIDE..][..=a];
            for (sum, product) in into.iter_mut().zip(&products[(6 + k) * Self::STRIDE..]) {
                *sum += product;
            }
        }
    }

    /// The factor of the reduced matrix, and the reduced gradient.
    #[inline(always)]
    fn factored(mut self) -> Option<(Envelope, Vec<f64>)> {
        self.subtract_points();
        let c = 3 * self.points;
        for a in 0..G {
            let (_, row) = self.reduced.row_mut(c + a);
            let columns = self.with_points.chunks_exact(Self::STRIDE);
            for (into, from) in row.iter_mut().zip(columns) {
                *into = from[a];
            }
            row[c..=c + a].copy_from_slice(&self.common[a * Self::STRIDE..][..=a]);
            self.rhs[c + a] = self.gradient[a];
        }
        // Padding to whole blocks: identity rows.
        for a in c + G..self.reduced.rows() {
            *self.reduced.at(a, a) = 1.0;
        }
        self.reduced.factor().then_some((self.reduced, self.rhs))
    }
}

/// Factored system of points and common unknowns after elimination of the frames.
pub struct Eliminated<const L: usize> {
    /// Factors of the frames' blocks.
    pub frames: Vec<Cholesky<f64, Const<L>>>,
    /// Factor of the reduced matrix.
    pub reduced: Envelope,
    /// Reduced gradient.
    pub rhs: Vec<f64>,
}

/// Adds `factorsᵀ rows` to three rows, in the columns `span`: whole registers.
#[inline(always)]
fn add_products<S: Simd>(
    simd: S,
    into: &mut [f64],
    factors: &Matrix3<f64>,
    rows: &[f64],
    span: &Range<usize>,
) {
    let stride = rows.len() / 3;
    let (first, others) = into.split_at_mut(stride);
    let (second, third) = others.split_at_mut(stride);
    let first = S::as_mut_simd_f64s(&mut first[span.clone()]).0;
    let count = first.len();
    let second = &mut S::as_mut_simd_f64s(&mut second[span.clone()]).0[..count];
    let third = &mut S::as_mut_simd_f64s(&mut third[span.clone()]).0[..count];
    let x = &S::as_simd_f64s(&rows[span.clone()]).0[..count];
    let y = &S::as_simd_f64s(&rows[stride..][span.clone()]).0[..count];
    let z = &S::as_simd_f64s(&rows[2 * stride..][span.clone()]).0[..count];
    let mut f = [[simd.splat_f64s(0.0); 3]; 3];
    for (b, f) in f.iter_mut().enumerate() {
        for (k, f) in f.iter_mut().enumerate() {
            *f = simd.splat_f64s(factors[(k, b)]);
        }
    }
    for c in 0..count {
        let sum = simd.mul_add_e_f64s(f[0][0], x[c], first[c]);
        let sum = simd.mul_add_e_f64s(f[0][1], y[c], sum);
        first[c] = simd.mul_add_e_f64s(f[0][2], z[c], sum);
        let sum = simd.mul_add_e_f64s(f[1][0], x[c], second[c]);
        let sum = simd.mul_add_e_f64s(f[1][1], y[c], sum);
        second[c] = simd.mul_add_e_f64s(f[1][2], z[c], sum);
        let sum = simd.mul_add_e_f64s(f[2][0], x[c], third[c]);
        let sum = simd.mul_add_e_f64s(f[2][1], y[c], sum);
        third[c] = simd.mul_add_e_f64s(f[2][2], z[c], sum);
    }
}

/// Adds the sum of three rows with `factors` to `into`, in the columns `span`: whole registers.
#[inline(always)]
fn add_sum<S: Simd>(
    simd: S,
    into: &mut [f64],
    factors: [f64; 3],
    rows: &[f64],
    span: &Range<usize>,
) {
    let stride = rows.len() / 3;
    let into = S::as_mut_simd_f64s(&mut into[span.clone()]).0;
    let count = into.len();
    let x = &S::as_simd_f64s(&rows[span.clone()]).0[..count];
    let y = &S::as_simd_f64s(&rows[stride..][span.clone()]).0[..count];
    let z = &S::as_simd_f64s(&rows[2 * stride..][span.clone()]).0[..count];
    let f0 = simd.splat_f64s(factors[0]);
    let f1 = simd.splat_f64s(factors[1]);
    let f2 = simd.splat_f64s(factors[2]);
    for c in 0..count {
        let sum = simd.mul_add_e_f64s(f0, x[c], into[c]);
        let sum = simd.mul_add_e_f64s(f1, y[c], sum);
        into[c] = simd.mul_add_e_f64s(f2, z[c], sum);
    }
}

/// `V X` without the rows that are not needed: the pose, if all of it is own unknowns.
#[inline(always)]
fn product<S: Simd, const L: usize, const C: usize>(
    V: &SMatrix<f64, FRAME, L>,
    X: &SMatrix<f64, L, C>,
) -> SMatrix<f64, FRAME, C> {
    let first = if L == 6 { 6 } else { 0 };
    let mut product = SMatrix::<f64, FRAME, C>::zeros();
    for (b, column) in product.as_mut_slice().chunks_exact_mut(FRAME).enumerate() {
        for l in 0..L {
            for a in first..FRAME {
                column[a] = mul_add::<S>(V[(a, l)], X[(l, b)], column[a]);
            }
        }
    }
    product
}

/// The inverse of a lower-triangular matrix.
#[inline(always)]
fn inverse_of_lower<const L: usize>(factor: &SMatrix<f64, L, L>) -> SMatrix<f64, L, L> {
    let mut inverse = SMatrix::<f64, L, L>::zeros();
    for i in 0..L {
        let pivot = 1.0 / factor[(i, i)];
        inverse[(i, i)] = pivot;
        for c in 0..i {
            let mut sum = 0.0;
            for j in c..i {
                sum -= factor[(i, j)] * inverse[(j, c)];
            }
            inverse[(i, c)] = sum * pivot;
        }
    }
    inverse
}

/// `lower X` for a lower-triangular matrix.
#[inline(always)]
fn lower_product<const L: usize, const C: usize>(
    lower: &SMatrix<f64, L, L>,
    X: &SMatrix<f64, L, C>,
) -> SMatrix<f64, L, C> {
    let mut product = SMatrix::<f64, L, C>::zeros();
    for c in 0..C {
        for i in 0..L {
            for j in 0..=i {
                product[(i, c)] += lower[(i, j)] * X[(j, c)];
            }
        }
    }
    product
}
