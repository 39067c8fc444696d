//! A deformable body as mass points.

use nalgebra::Vector3;

/// A mass point of a deformable body, in the attachment frame A:
/// `r(μ) = X + Σ psi_k μ_k + ½ Σ chi_kl μ_k μ_l`.
#[derive(Clone, Debug, PartialEq)]
pub struct MassPoint {
    /// Mass \[kg\].
    pub mass: f64,
    /// Undeformed position X \[m\].
    pub position: Vector3<f64>,
    /// Displacement psi_k for each mode: n vectors \[m per unit of μ\].
    pub psi: Vec<Vector3<f64>>,
    /// Second-order displacement chi_kl, one vector for each pair `k <= l` in the order of [`pair_index`], or empty.
    pub chi: Vec<Vector3<f64>>,
}

/// Place of the pair of modes (k, l) among the n (n + 1)/2 pairs: (0, 0), (0, 1), ..., (0, n-1), (1, 1), ...
pub fn pair_index(n: usize, k: usize, l: usize) -> usize {
    let (k, l) = (k.min(l), k.max(l));
    k * n - k * (k + 1) / 2 + l
}

/// The pairs in the order of [`pair_index`].
pub(crate) fn pairs(n: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n).flat_map(move |k| (k..n).map(move |l| (k, l)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_numbered_in_order() {
        for n in 0..6 {
            for (place, (k, l)) in pairs(n).enumerate() {
                assert_eq!(pair_index(n, k, l), place);
                assert_eq!(pair_index(n, l, k), place);
            }
            assert_eq!(pairs(n).count(), n * (n + 1) / 2);
        }
    }
}
