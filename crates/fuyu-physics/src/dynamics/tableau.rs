//! Coefficients of the explicit Runge-Kutta methods.

use std::f64::consts::FRAC_1_SQRT_2;

/// An explicit Runge-Kutta method: lower-triangular `a` (row `i` has the `i` coefficients of stage `i`),
/// weights `b`, nodes `c`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tableau {
    /// Stage coefficients.
    pub a: &'static [&'static [f64]],
    /// Weights.
    pub b: &'static [f64],
    /// Nodes.
    pub c: &'static [f64],
}

impl Tableau {
    /// The classical method of order 4.
    pub const RK4: Self = Self {
        a: &[&[], &[0.5], &[0.0, 0.5], &[0.0, 0.0, 1.0]],
        b: &[1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0],
        c: &[0.0, 0.5, 0.5, 1.0],
    };

    /// The method of order 4 of S. Gill (A process for the step-by-step integration of differential equations in an
    /// automatic digital computing machine, Proc. Cambridge Phil. Soc. 47, 1951, pp. 96-108). Its truncation error
    /// differs from that of [`Tableau::RK4`], which matters for reproducing a published table that was computed with
    /// it.
    pub const RK_GILL: Self = Self {
        a: &[
            &[],
            &[0.5],
            &[FRAC_1_SQRT_2 - 0.5, 1.0 - FRAC_1_SQRT_2],
            &[0.0, -FRAC_1_SQRT_2, 1.0 + FRAC_1_SQRT_2],
        ],
        b: &[
            1.0 / 6.0,
            (1.0 - FRAC_1_SQRT_2) / 3.0,
            (1.0 + FRAC_1_SQRT_2) / 3.0,
            1.0 / 6.0,
        ],
        c: &[0.0, 0.5, 0.5, 1.0],
    };

    /// The order-8 method of Dormand and Prince with 12 stages, coefficients as given by Hairer, Nørsett
    /// and Wanner, Solving Ordinary Differential Equations I, 2nd ed., for DOP853 (nodes and the
    /// method of order 8 only; the step is fixed, so its error estimators are not needed).
    pub const DOP8: Self = Self {
        a: &[
            &[],
            &[0.05260015195876773],
            &[0.0197250569845379, 0.0591751709536137],
            &[0.02958758547680685, 0.0, 0.08876275643042054],
            &[
                0.2413651341592667,
                0.0,
                -0.8845494793282861,
                0.924834003261792,
            ],
            &[
                0.037037037037037035,
                0.0,
                0.0,
                0.17082860872947386,
                0.12546768756682242,
            ],
            &[
                0.037109375,
                0.0,
                0.0,
                0.17025221101954405,
                0.06021653898045596,
                -0.017578125,
            ],
            &[
                0.03709200011850479,
                0.0,
                0.0,
                0.17038392571223998,
                0.10726203044637328,
                -0.015319437748624402,
                0.008273789163814023,
            ],
            &[
                0.6241109587160757,
                0.0,
                0.0,
                -3.3608926294469414,
                -0.868219346841726,
                27.59209969944671,
                20.154067550477894,
                -43.48988418106996,
            ],
            &[
                0.47766253643826434,
                0.0,
                0.0,
                -2.4881146199716677,
                -0.590290826836843,
                21.230051448181193,
                15.279233632882423,
                -33.28821096898486,
                -0.020331201708508627,
            ],
            &[
                -0.9371424300859873,
                0.0,
                0.0,
                5.186372428844064,
                1.0914373489967295,
                -8.149787010746927,
                -18.52006565999696,
                22.739487099350505,
                2.4936055526796523,
                -3.0467644718982196,
            ],
            &[
                2.273310147516538,
                0.0,
                0.0,
                -10.53449546673725,
                -2.0008720582248625,
                -17.9589318631188,
                27.94888452941996,
                -2.8589982771350235,
                -8.87285693353063,
                12.360567175794303,
                0.6433927460157636,
            ],
        ],
        b: &[
            0.054293734116568765,
            0.0,
            0.0,
            0.0,
            0.0,
            4.450312892752409,
            1.8915178993145003,
            -5.801203960010585,
            0.3111643669578199,
            -0.1521609496625161,
            0.20136540080403034,
            0.04471061572777259,
        ],
        c: &[
            0.0,
            0.05260015195876773,
            0.0789002279381516,
            0.1183503419072274,
            0.2816496580927726,
            0.3333333333333333,
            0.25,
            0.3076923076923077,
            0.6512820512820513,
            0.6,
            0.8571428571428571,
            1.0,
        ],
    };

    /// Weights of the stages up to `i` for the next stage, or for the end of the step.
    #[inline(always)]
    pub(super) fn weights_after(&self, i: usize) -> &'static [f64] {
        self.a.get(i + 1).copied().unwrap_or(self.b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_sum_to_the_nodes_and_quadrature_has_the_order() {
        for (tableau, order) in [(Tableau::RK4, 4), (Tableau::RK_GILL, 4), (Tableau::DOP8, 8)] {
            assert_eq!(tableau.a.len(), tableau.c.len());
            for (row, c) in tableau.a.iter().zip(tableau.c) {
                let scale: f64 = row.iter().map(|x| x.abs()).sum::<f64>().max(1.0);
                assert!((row.iter().sum::<f64>() - c).abs() < 1e-15 * scale);
            }
            // Fails for a wrong digit in b or c: sum b c^k = 1/(k+1) for k < order.
            for k in 0..order {
                let sum: f64 = tableau
                    .b
                    .iter()
                    .zip(tableau.c)
                    .map(|(b, c)| b * c.powi(k))
                    .sum();
                assert!(
                    (sum - 1.0 / (f64::from(k) + 1.0)).abs() < 2e-15,
                    "order {order}, k {k}"
                );
            }
        }
    }

    /// The conditions of order 3 and 4 that contain `a`: a wrong digit in a row that still sums to its node violates
    /// one of them.
    #[test]
    fn stage_coefficients_have_the_order() {
        for tableau in [Tableau::RK4, Tableau::RK_GILL, Tableau::DOP8] {
            let times_a = |x: &[f64]| -> Vec<f64> {
                let product = |row: &&[f64]| row.iter().zip(x).map(|(a, x)| a * x).sum();
                tableau.a.iter().map(product).collect()
            };
            let weighted = |x: &[f64]| -> f64 { tableau.b.iter().zip(x).map(|(b, x)| b * x).sum() };
            let c = tableau.c;
            let squared: Vec<f64> = c.iter().map(|c| c * c).collect();
            let ac = times_a(c);
            let c_ac: Vec<f64> = c.iter().zip(&ac).map(|(c, x)| c * x).collect();
            let conditions = [
                (weighted(&ac), 6.0),
                (weighted(&c_ac), 8.0),
                (weighted(&times_a(&squared)), 12.0),
                (weighted(&times_a(&ac)), 24.0),
            ];
            for (sum, denominator) in conditions {
                assert!(
                    (sum - 1.0 / denominator).abs() < 1e-14,
                    "1/{denominator}: {sum}"
                );
            }
        }
    }
}
