//! Essential matrices from five points.
//!
//! Nistér, An efficient solution to the five-point relative pose problem, PAMI 26 (2004), in the form of
//! Stewénius, Engels and Nistér (2006): the ten cubic constraints on `E = x E₁ + y E₂ + z E₃ + E₄` are linear in
//! the twenty monomials of x, y, z; eliminating those of degree three gives the multiplication by x as a 10 × 10
//! matrix, whose eigenvectors contain the solutions. Unlike the linear eight-point method, this also works for points
//! in a plane and at the corners of a box.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Exponents of (x, y, z) of the monomials, degree three first: the columns of the constraints.
const MONOMIALS: [[u8; 3]; 20] = [
    [3, 0, 0],
    [2, 1, 0],
    [1, 2, 0],
    [0, 3, 0],
    [2, 0, 1],
    [1, 1, 1],
    [0, 2, 1],
    [1, 0, 2],
    [0, 1, 2],
    [0, 0, 3],
    [2, 0, 0],
    [1, 1, 0],
    [0, 2, 0],
    [1, 0, 1],
    [0, 1, 1],
    [0, 0, 2],
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [0, 0, 0],
];

/// A polynomial in x, y, z of degree at most three.
#[derive(Clone, Copy)]
struct Cubic([f64; 20]);

impl Cubic {
    const ZERO: Self = Self([0.0; 20]);

    fn linear(x: f64, y: f64, z: f64, one: f64) -> Self {
        let mut c = Self::ZERO;
        c.0[16..20].copy_from_slice(&[x, y, z, one]);
        c
    }

    fn plus(mut self, other: &Self, factor: f64) -> Self {
        for (a, b) in self.0.iter_mut().zip(&other.0) {
            *a += factor * b;
        }
        self
    }

    /// Product of two polynomials whose degrees add up to at most three.
    fn times(&self, other: &Self, products: &[[usize; 20]; 20]) -> Self {
        let mut c = Self::ZERO;
        for (a, row) in self.0.iter().zip(products).filter(|(a, _)| **a != 0.0) {
            for (b, &at) in other.0.iter().zip(row).filter(|(b, _)| **b != 0.0) {
                if at < 20 {
                    c.0[at] += a * b;
                }
            }
        }
        c
    }
}

/// Index of the product of two monomials; 20 above degree three.
fn products() -> [[usize; 20]; 20] {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let product: [u8; 3] = std::array::from_fn(|k| MONOMIALS[i][k] + MONOMIALS[j][k]);
            MONOMIALS.iter().position(|m| *m == product).unwrap_or(20)
        })
    })
}

/// Essential matrices with `second · E first = 0` for all five pairs of rays. At most ten; none if the
/// points do not determine them.
pub fn essential_matrices(rays: &[(Vector3<f64>, Vector3<f64>); 5]) -> Vec<Matrix3<f64>> {
    let basis = null_space(rays);
    let products = products();
    let entry = |i: usize, j: usize| {
        let at = |k: usize| basis[k][(i, j)];
        Cubic::linear(at(0), at(1), at(2), at(3))
    };
    let E: [[Cubic; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)));
    let product = |a: &Cubic, b: &Cubic| a.times(b, &products);

    // det E = 0, and E Eᵀ E - ½ tr(E Eᵀ) E = 0.
    let mut constraints = Vec::with_capacity(10);
    let minor =
        |i: usize, j: usize| product(&E[1][i], &E[2][j]).plus(&product(&E[1][j], &E[2][i]), -1.0);
    let determinant = product(&E[0][0], &minor(1, 2))
        .plus(&product(&E[0][1], &minor(0, 2)), -1.0)
        .plus(&product(&E[0][2], &minor(0, 1)), 1.0);
    constraints.push(determinant);
    let along = |a: &[Cubic; 3], b: &[Cubic; 3]| {
        let each = a.iter().zip(b);
        each.fold(Cubic::ZERO, |sum, (a, b)| sum.plus(&product(a, b), 1.0))
    };
    let mut square = E.map(|a| E.map(|b| along(&a, &b)));
    let trace = square[0][0]
        .plus(&square[1][1], 1.0)
        .plus(&square[2][2], 1.0);
    for (i, row) in square.iter_mut().enumerate() {
        row[i] = row[i].plus(&trace, -0.5);
    }
    for row in &square {
        for j in 0..3 {
            constraints.push(along(row, &E.map(|e| e[j])));
        }
    }

    let Some(reduced) = eliminate(&constraints) else {
        return Vec::new();
    };
    solutions(&reduced)
        .into_iter()
        .map(|[x, y, z]| basis[0] * x + basis[1] * y + basis[2] * z + basis[3])
        .map(|E| E / E.norm())
        .filter(|E| E.iter().all(|e| e.is_finite()))
        .collect()
}

/// Four orthonormal matrices that span the null space of the five epipolar constraints.
fn null_space(rays: &[(Vector3<f64>, Vector3<f64>); 5]) -> [Matrix3<f64>; 4] {
    let mut rows: Vec<SVector<f64, 9>> = Vec::with_capacity(9);
    let against = |v: &mut SVector<f64, 9>, rows: &[SVector<f64, 9>]| {
        for _ in 0..2 {
            for row in rows {
                *v -= row * row.dot(v);
            }
        }
    };
    for (first, second) in rays {
        let mut v = SVector::<f64, 9>::from_fn(|k, _| second[k / 3] * first[k % 3]);
        let size = v.norm();
        against(&mut v, &rows);
        if v.norm() > 1e-9 * size {
            rows.push(v.normalize());
        }
    }
    let constraints = rows.len();
    // Complete to a basis with the axes that have the smallest projection on the rows so far.
    while rows.len() < 9 {
        let projection = |k: usize| rows.iter().map(|r| r[k] * r[k]).sum::<f64>();
        let axis = (0..9)
            .min_by(|a, b| projection(*a).total_cmp(&projection(*b)))
            .unwrap_or(0);
        let mut v = SVector::<f64, 9>::zeros();
        v[axis] = 1.0;
        against(&mut v, &rows);
        rows.push(v.normalize());
    }
    let free = &rows[constraints.min(5)..];
    std::array::from_fn(|k| Matrix3::from_fn(|i, j| free[k][3 * i + j]))
}

/// Solves the constraints for the monomials of degree three; returns the coefficients of the other ten.
fn eliminate(constraints: &[Cubic]) -> Option<SMatrix<f64, 10, 10>> {
    let left = SMatrix::<f64, 10, 10>::from_fn(|i, j| constraints[i].0[j]);
    let right = SMatrix::<f64, 10, 10>::from_fn(|i, j| constraints[i].0[10 + j]);
    left.full_piv_lu().solve(&right)
}

/// Real (x, y, z) from the eigenvectors of multiplication by x in the monomials of degree two and less.
fn solutions(reduced: &SMatrix<f64, 10, 10>) -> Vec<[f64; 3]> {
    let mut action = SMatrix::<f64, 10, 10>::zeros();
    // x times x², xy, y², xz, yz, z² is of degree three: rows 0, 1, 2, 4, 5, 7 of `reduced`.
    for (row, cubic) in [0, 1, 2, 4, 5, 7].into_iter().enumerate() {
        action.set_row(row, &(-reduced.row(cubic)));
    }
    for (row, column) in [(6, 0), (7, 1), (8, 3), (9, 6)] {
        action[(row, column)] = 1.0;
    }
    if !action.iter().all(|a| a.is_finite()) {
        return Vec::new();
    }
    let Some(schur) = nalgebra::Schur::try_new(action, 1e-12, 300) else {
        return Vec::new();
    };
    let scale = action.norm().max(1.0);
    let values = schur.complex_eigenvalues();
    let real = values
        .iter()
        .filter(|v| v.im.abs() < 1e-6 * scale)
        .map(|v| v.re);
    real.filter_map(|x| {
        // Inverse iteration: two solves from a generic start.
        let mut shifted = action;
        for i in 0..10 {
            shifted[(i, i)] -= x + 1e-9 * scale;
        }
        let lu = shifted.lu();
        let mut v = SVector::<f64, 10>::from_fn(|i, _| 1.0 + 0.1 * i as f64);
        for _ in 0..2 {
            v = lu.solve(&v)?.normalize();
        }
        (v[9].abs() > 1e-12).then(|| [v[6] / v[9], v[7] / v[9], v[8] / v[9]])
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    #[test]
    fn the_true_matrix_is_among_the_solutions() {
        let R = Rotation3::from_scaled_axis(Vector3::new(0.2, -0.3, 0.5));
        let T = Vector3::new(0.3, 0.1, -0.2);
        let truth = T.cross_matrix() * R.matrix();
        let truth = truth / truth.norm();
        for plane in [0.0, 1.0] {
            let rays = std::array::from_fn(|j| {
                let a = j as f64;
                let depth = 1.5 + plane * 0.5 * (2.7 * a).sin();
                let x = Vector3::new(0.4 * (1.3 * a).cos(), 0.4 * (2.1 * a).sin(), depth);
                let y = R * x + T;
                (x / x.z, y / y.z)
            });
            let all = essential_matrices(&rays);
            assert!(all.len() <= 10);
            let nearest = all
                .iter()
                .map(|E| (E - truth).norm().min((E + truth).norm()))
                .fold(f64::INFINITY, f64::min);
            assert!(nearest < 1e-6, "plane {plane}: {nearest} of {}", all.len());
            for E in &all {
                let constraint = E * E.transpose() * E - E * (0.5 * E.norm_squared());
                assert!(constraint.norm() < 1e-6, "{constraint}");
            }
        }
    }

    #[test]
    fn five_equal_points_give_no_infinite_solution() {
        let ray = Vector3::new(0.1, 0.2, 1.0);
        for E in essential_matrices(&[(ray, ray); 5]) {
            assert!(E.iter().all(|e| e.is_finite()));
        }
    }
}
