//! The longest stable step of an explicit method for the robot's vibrations and dampers.

use fuyu_structures::{Eigen, generalized_eigen};
use nalgebra::{Complex, DMatrix, DVector};

use super::error::require;
use super::{FlexibleError, FlexibleSystem, LinearModel, Wheel};
use crate::dynamics::{IntegrationMethod, Tableau};

impl FlexibleSystem {
    /// Checks that `method` is stable with steps of `step` \[s\] for every vibration and every damper at joint
    /// positions `q`.
    ///
    /// # Errors
    /// [`FlexibleError::Unstable`] names the part and its frequency, [`FlexibleError::StiffDamping`] the part and its
    /// decay rate; [`FlexibleError::Structure`] for a mass matrix that is not positive definite;
    /// [`FlexibleError::Value`] for a step that is not positive.
    ///
    /// # Panics
    /// If `q` does not have one element per joint.
    pub fn check_step(
        &self,
        q: &DVector<f64>,
        method: IntegrationMethod,
        step: f64,
    ) -> Result<(), FlexibleError> {
        let is_positive = step > 0.0 && step.is_finite();
        require(|| "step [s]".to_owned(), step, is_positive, "positive")?;
        let linear = LinearModel::new(self, q);
        self.check_damping(&linear, method, step)?;
        let eigen = generalized_eigen(&linear.stiffness, &linear.mass)?;
        let Some(highest) = eigen.values.iter().copied().reduce(f64::max) else {
            return Ok(());
        };
        let rate = highest.max(0.0).sqrt();
        let limit = method
            .tableau()
            .vibration_limit(rate, self.fastest_decay(&linear)?);
        if step <= limit {
            return Ok(());
        }
        // The part with most of this vibration's strain energy.
        Err(FlexibleError::Unstable {
            part: self.most_of(&linear, &linear.stiffness, &eigen),
            frequency_hz: rate / std::f64::consts::TAU,
            step,
            limit,
        })
    }

    /// Largest eigenvalue of `M⁻¹ D` \[1/s\].
    fn fastest_decay(&self, linear: &LinearModel) -> Result<f64, FlexibleError> {
        let eigen = generalized_eigen(&linear.damping, &linear.mass)?;
        Ok(eigen.values.iter().copied().fold(0.0, f64::max))
    }

    /// Checks that `method` is stable for the fastest decay, including wheels near rest, where Coulomb friction is
    /// steep. No pole decays faster than the largest eigenvalue of `M⁻¹ D`.
    fn check_damping(
        &self,
        linear: &LinearModel,
        method: IntegrationMethod,
        step: f64,
    ) -> Result<(), FlexibleError> {
        let mut damping = linear.damping.clone();
        let first = damping.nrows() - self.wheels().len();
        for (i, wheel) in self.wheels().iter().enumerate() {
            damping[(first + i, first + i)] += wheel.coulomb_friction / Wheel::FRICTION_SPEED;
        }
        let eigen = generalized_eigen(&damping, &linear.mass)?;
        let Some(rate) = eigen.values.iter().copied().reduce(f64::max) else {
            return Ok(());
        };
        let limit = method.tableau().decay_limit() / rate.max(0.0);
        if step <= limit {
            return Ok(());
        }
        Err(FlexibleError::StiffDamping {
            part: self.most_of(linear, &damping, &eigen),
            rate,
            step,
            limit,
        })
    }

    /// Name of the part with most of `xᵀ m x` in the last eigenvector.
    fn most_of(&self, linear: &LinearModel, m: &DMatrix<f64>, eigen: &Eigen) -> String {
        let shape = eigen.vectors.column(eigen.vectors.ncols() - 1);
        let energy = (m * shape).component_mul(&shape);
        let place = energy.imax();
        let first_mode = 6 + linear.joints;
        let first_motor = first_mode + linear.modes;
        let first_wheel = first_motor + linear.motors;
        if place < 6 {
            "the base".to_owned()
        } else if place < first_mode {
            self.model().joints()[place - 6].name.clone()
        } else if place < first_motor {
            let mut bodies = self.modal_bodies().iter();
            let body = bodies.find(|body| body.range().contains(&(place - first_mode)));
            body.map_or_else(String::new, |body| body.name().to_owned())
        } else if place < first_wheel {
            self.elastic_joints()[place - first_motor].joint.clone()
        } else {
            format!("wheel {}", self.wheels()[place - first_wheel].name)
        }
    }
}

impl Tableau {
    /// Largest `ω h` of an undamped vibration that the method does not amplify by more than 1e-6 a step.
    pub fn stability_limit(&self) -> f64 {
        self.longest_step(1e-6, |wh| Complex::new(0.0, wh))
    }

    /// Longest step \[s\] with which vibrations of undamped frequencies up to `omega` \[rad/s\] are not amplified, if
    /// `xᵀ D x / xᵀ M x` is at most `decay` \[1/s\].
    ///
    /// A pole `λ` with `|λ| <= omega` has the real part `-d/2`, `d <= decay`, so at the angle `θ` from the imaginary axis
    /// its magnitude is `decay / (2 sin θ)` at most.
    fn vibration_limit(&self, omega: f64, decay: f64) -> f64 {
        let damped = (1..=45).map(|i| 2.0 * f64::from(i)).map(|degrees| {
            let theta = degrees.to_radians();
            let longest = self.longest_step(1e-6, |r| {
                Complex::from_polar(r, std::f64::consts::FRAC_PI_2 + theta)
            });
            longest / omega.min(0.5 * decay / theta.sin())
        });
        damped.fold(self.stability_limit() / omega, f64::min)
    }

    /// Largest `a h` of a decay `y' = -a y` that the method does not amplify.
    pub fn decay_limit(&self) -> f64 {
        self.longest_step(0.0, |ah| Complex::new(-ah, 0.0))
    }

    /// Length of the first interval on which the method amplifies `y' = z(h) y` by at most `tolerance` a step, in steps
    /// of .005 up to 50.
    fn longest_step(&self, tolerance: f64, z: impl Fn(f64) -> Complex<f64>) -> f64 {
        let steps = (1..10_000).map(|i| 0.005 * f64::from(i));
        steps
            .take_while(|h| self.amplification(z(*h)) <= 1.0 + tolerance)
            .last()
            .unwrap_or(0.0)
    }

    /// Magnitude of a step's result for `y' = λ y`, `y = 1`, at `λ h = z`.
    fn amplification(&self, z: Complex<f64>) -> f64 {
        let mut slopes: Vec<Complex<f64>> = Vec::with_capacity(self.c.len());
        for row in self.a {
            let sum: Complex<f64> = row.iter().zip(&slopes).map(|(a, k)| k * *a).sum();
            slopes.push(z * (sum + 1.0));
        }
        let sum: Complex<f64> = self.b.iter().zip(&slopes).map(|(b, k)| k * *b).sum();
        (sum + 1.0).norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // The region of the classical method is dented: at 121 degrees its radius is 2.62, although it is 2.83 and 2.79 on
    // the axes. A vibration with ω h = 2.78 and a damping ratio of one half grows by 1.216 a step.
    #[test]
    fn damped_vibrations_between_the_axes_are_limited() {
        let z = Complex::from_polar(2.78, 120.0_f64.to_radians());
        assert!((Tableau::RK4.amplification(z) - 1.216).abs() < 1e-3);
        assert!(Tableau::RK4.vibration_limit(1.0, 1.0) < 2.65);
        assert!(Tableau::RK4.vibration_limit(1.0, 0.01) > 2.8);
        assert!(Tableau::RK4.vibration_limit(2.0, 2.0) < 0.5 * 2.65);
        assert!(Tableau::RK4.vibration_limit(1.0, 0.0) > 2.8);
    }

    // RK4: 2 sqrt 2 on the imaginary axis, from |1 + z + z²/2 + z³/6 + z⁴/24|² = 1 - y⁶/72 + y⁸/576.
    #[test]
    fn the_stability_limit_of_the_classical_method_is_known() {
        let limit = Tableau::RK4.stability_limit();
        assert!((limit - 8.0_f64.sqrt()).abs() < 0.006, "{limit}");
        // The method of order 8 has 12 stages and a longer interval.
        let limit = Tableau::DOP8.stability_limit();
        assert!(limit > 2.0 && limit < 12.0, "{limit}");
        // The negative root of 1 + z/2 + z²/6 + z³/24.
        let limit = Tableau::RK4.decay_limit();
        assert!((limit - 2.785_293_563).abs() < 0.006, "{limit}");
    }
}
