//! Forces at a point of contact, with restitution and creep in closed form.

use nalgebra::Vector3;

/// Compliant contact of two surfaces: normal force by Hunt and Crossley, friction by Coulomb's law with a smooth
/// transition.
///
/// With the depth `δ` and its rate `δ'`, the normal force is `k δ^p max(0, 1 + d δ')` (K. Hunt and F. Crossley,
/// Coefficient of restitution interpreted as damping in vibroimpact, J. Applied Mechanics 42, 1975); it never
/// pulls. With the slip `v`, friction is `-μ F v / sqrt(v² + v_s²)`: smooth, dissipative at any slip, and at most
/// `μ F`. A grip under a tangential load `x μ F` therefore creeps at `v_s x / sqrt(1 - x²)`; a [`Bristle`] does
/// not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactLaw {
    /// Stiffness `k` \[N/m^p\].
    pub stiffness: f64,
    /// Exponent `p`: 1 for a linear spring, 1.5 for Hertz's law.
    pub exponent: f64,
    /// Dissipation `d` \[s/m\].
    pub dissipation: f64,
    /// Coefficient of friction `μ`.
    pub friction: f64,
    /// Slip `v_s` \[m/s\] at which friction has reached 71 % of its limit.
    pub stiction_speed: f64,
    /// Where between the two surfaces the forces act, as a fraction of the depth: 0 at the deepest point of the
    /// first shape, 1/2 in the middle.
    pub point_weight: f64,
    /// Elastic deflection instead of creep, if given.
    pub bristle: Option<Bristle>,
}

/// Deflection of asperities under friction: the model of C. Canudas de Wit, H. Olsson, K. Åström and P. Lischinsky (A
/// new model for control of systems with friction, IEEE Trans. Automatic Control 40, 1995), per unit of normal force.
/// The deflection `z` grows with the slip, `z' = v - g σ z / μ`, and friction is `-F (σ z + σ₁ z')`. The cited model
/// has `g = |v|`; here `g = v² / sqrt(v² + v_s² (1 - s²))` with `s = σ |z| / μ`, which is `|v|` where the elastic part
/// `F σ |z|` is `μ F` and less otherwise. So the elastic part is at most `μ F`, and equals `μ F` in steady sliding at
/// any speed. Under a constant load less than `μ F` the slip ends; a varying load causes less creep than with `|v|`.
/// The damping adds to friction only while `z` changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bristle {
    /// Stiffness `σ` \[1/m\]: friction over normal force per deflection.
    pub stiffness: f64,
    /// Damping `σ₁` \[s/m\].
    pub damping: f64,
}

/// What is wrong with a [`ContactLaw`].
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{field} is {value}; it must be {wanted}")]
pub struct LawError {
    /// The field.
    pub field: &'static str,
    /// Its value.
    pub value: f64,
    /// The allowed range.
    pub wanted: &'static str,
}

impl Default for ContactLaw {
    fn default() -> Self {
        Self {
            stiffness: 1e6,
            exponent: 1.0,
            dissipation: 2.0,
            friction: 0.5,
            stiction_speed: 1e-3,
            point_weight: 0.5,
            bristle: None,
        }
    }
}

impl ContactLaw {
    /// Checks the parameters.
    ///
    /// # Errors
    /// [`LawError`] for one outside of its range.
    pub fn check(&self) -> Result<(), LawError> {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let not_negative = |x: f64| x >= 0.0 && x.is_finite();
        let bristle = self.bristle.unwrap_or(Bristle {
            stiffness: 1.0,
            damping: 0.0,
        });
        let (above, from) = ("positive and finite", "zero or positive, and finite");
        for (field, value, is_right, wanted) in [
            ("stiffness", self.stiffness, positive(self.stiffness), above),
            (
                "exponent",
                self.exponent,
                (1.0..=3.0).contains(&self.exponent),
                "from 1 to 3",
            ),
            (
                "dissipation",
                self.dissipation,
                not_negative(self.dissipation),
                from,
            ),
            ("friction", self.friction, not_negative(self.friction), from),
            (
                "stiction_speed",
                self.stiction_speed,
                positive(self.stiction_speed),
                above,
            ),
            (
                "point_weight",
                self.point_weight,
                (0.0..=1.0).contains(&self.point_weight),
                "from 0 to 1",
            ),
            (
                "bristle stiffness",
                bristle.stiffness,
                positive(bristle.stiffness),
                above,
            ),
            (
                "bristle damping",
                bristle.damping,
                not_negative(bristle.damping),
                from,
            ),
        ] {
            if !is_right {
                return Err(LawError {
                    field,
                    value,
                    wanted,
                });
            }
        }
        Ok(())
    }

    /// Elastic part `k δ^p` of the normal force \[N\], continued smoothly to negative depths, which an integrator may
    /// try.
    pub(super) fn elastic_force(&self, depth: f64) -> f64 {
        let size = depth.abs();
        let power = if self.exponent == 1.0 {
            size
        } else if self.exponent == 1.5 {
            size * size.sqrt()
        } else {
            size.powf(self.exponent)
        };
        (self.stiffness * power).copysign(depth)
    }

    /// Normal force \[N\] at depth `depth` \[m\] that grows at `rate` \[m/s\].
    pub fn normal_force(&self, depth: f64, rate: f64) -> f64 {
        if depth <= 0.0 {
            return 0.0;
        }
        self.elastic_force(depth) * (1.0 + self.dissipation * rate).max(0.0)
    }

    /// Energy \[J\] that is stored at depth `depth` \[m\].
    pub fn stored_energy(&self, depth: f64) -> f64 {
        self.elastic_force(depth.max(0.0)) * depth.max(0.0) / (self.exponent + 1.0)
    }

    /// Friction \[N\] at slip `slip` \[m/s\] under normal force `normal` \[N\], without bristle.
    pub(super) fn friction_force(&self, normal: f64, slip: &Vector3<f64>) -> Vector3<f64> {
        let speed = (slip.norm_squared() + self.stiction_speed * self.stiction_speed).sqrt();
        slip * (-self.friction * normal / speed)
    }

    /// Rate of the deflection `z`, see [`Bristle`].
    pub(super) fn deflection_rate(
        &self,
        bristle: &Bristle,
        slip: &Vector3<f64>,
        z: &Vector3<f64>,
    ) -> Vector3<f64> {
        if self.friction == 0.0 {
            return -z * slip.norm();
        }
        let per_deflection = bristle.stiffness / self.friction;
        let below = (1.0 - z.norm_squared() * per_deflection * per_deflection).max(0.0);
        let squared = slip.norm_squared();
        let smoothed = (squared + self.stiction_speed * self.stiction_speed * below).sqrt();
        let speed = if smoothed > 0.0 {
            squared / smoothed
        } else {
            0.0
        };
        slip - z * (speed * per_deflection)
    }

    /// Slip \[m/s\] at which a contact without bristle creeps under a tangential load of `fraction` times `μ F`;
    /// infinite for fractions of 1 and above.
    pub fn creep(&self, fraction: f64) -> f64 {
        if fraction < 1.0 {
            self.stiction_speed * fraction / (1.0 - fraction * fraction).sqrt()
        } else {
            f64::INFINITY
        }
    }

    /// Coefficient of restitution of a head-on impact at `speed` \[m/s\], which depends on `a = d v` alone: the
    /// root of `a (1 + e) = ln((1 + a) / (1 - a e))`, from the energy lost in the two halves of the impact.
    pub fn restitution(&self, speed: f64) -> f64 {
        restitution(self.dissipation * speed)
    }
}

/// See [`ContactLaw::restitution`].
fn restitution(a: f64) -> f64 {
    if a < 1e-4 {
        return 1.0 - 2.0 / 3.0 * a * (1.0 - 2.0 / 3.0 * a);
    }
    // ln(1 + x) - x falls from 0 at x = 0 on either side: x = -a e has the value of x = a. With f(x) = x - ln(1 +
    // x), Newton's method for f(-y) = f(a), y in (0, 1), from below converges monotonically, as f(-y) is convex.
    let target = a - a.ln_1p();
    let f = |y: f64| -y - (-y).ln_1p();
    let (mut low, mut high) = (0.0, 1.0);
    let mut y = a / (1.0 + a);
    for _ in 0..200 {
        let error = f(y) - target;
        if error > 0.0 {
            high = y
        } else {
            low = y
        }
        let next = y - error * (1.0 - y) / y;
        let next = if next > low && next < high {
            next
        } else {
            0.5 * (low + high)
        };
        if (next - y).abs() <= 1e-16 * y {
            break;
        }
        y = next;
    }
    y / a
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of Lambert's function with 12 digits: `e = (1 + W0(-(1 + a) exp(-(1 + a)))) / a`.
    #[test]
    fn restitution_is_that_of_the_closed_form() {
        for (a, e) in [
            (0.001, 0.999_333_777_452_1),
            (0.01, 0.993_377_454_399),
            (0.05, 0.967_738_578_531),
            (0.1, 0.937_475_579_950),
            (0.5, 0.748_434_931_597),
            (1.0, 0.593_624_260_040),
            (2.0, 0.410_719_686_061),
            (5.0, 0.196_980_245_281),
            (10.0, 0.099_981_624_753),
        ] {
            assert!(
                (restitution(a) - e).abs() < 1e-12,
                "{a}: {}",
                restitution(a)
            );
        }
        // Across the change between the two formulas; the slope is -2/3.
        let step = restitution(0.99e-4) - restitution(1.01e-4);
        assert!((step - 1.3331e-6).abs() < 1e-9, "{step}");
        assert!((restitution(1e3) - 1e-3).abs() < 1e-12);
    }

    #[test]
    fn parameters_out_of_range_are_named() {
        let law = ContactLaw {
            friction: -0.1,
            ..ContactLaw::default()
        };
        let message = law.check().unwrap_err().to_string();
        assert_eq!(
            message,
            "friction is -0.1; it must be zero or positive, and finite"
        );
    }

    #[test]
    fn contacts_never_pull() {
        let law = ContactLaw::default();
        assert_eq!(law.normal_force(-1e-3, 1.0), 0.0);
        assert_eq!(law.normal_force(1e-3, -10.0), 0.0);
        assert!((law.normal_force(1e-3, 0.0) - 1e3).abs() < 1e-9);
        assert!((law.stored_energy(1e-3) - 0.5).abs() < 1e-12);
    }

    // With |v| made smooth as v² / sqrt(v² + v_s²), friction at a tenth of v_s is ten times Coulomb's.
    #[test]
    fn bristles_slide_at_the_limit_of_coulomb_at_any_speed() {
        let law = ContactLaw::default();
        let bristle = Bristle {
            stiffness: 1e4,
            damping: 0.0,
        };
        for speed in [0.1, 1.0, 10.0].map(|part| part * law.stiction_speed) {
            let slip = Vector3::new(0.6, 0.8, 0.0) * speed;
            let mut z = Vector3::zeros();
            let dt = 1e-3 * law.friction / (bristle.stiffness * speed);
            for _ in 0..20_000 {
                z += law.deflection_rate(&bristle, &slip, &z) * dt;
                assert!(bristle.stiffness * z.norm() <= law.friction * (1.0 + 1e-9));
            }
            let friction = bristle.stiffness * z.norm() / law.friction;
            assert!((friction - 1.0).abs() < 1e-3, "{speed}: {friction}");
        }
    }

    // A load of 1.2 times the limit accelerates a body by the excess; with more friction than Coulomb's it would creep
    // at 1.5 v_s for ever. A load of 0.9 times the limit stops moving it.
    #[test]
    fn a_load_above_the_limit_slips_and_one_below_does_not() {
        let law = ContactLaw::default();
        let bristle = Bristle {
            stiffness: 1e4,
            damping: 60.0,
        };
        // Mass 1 kg under a normal force of 10 N: speed and distance after a time.
        let run = |load: f64, duration: f64| {
            let (mut v, mut x, mut z) = (Vector3::<f64>::zeros(), 0.0, Vector3::zeros());
            let dt = 2e-6;
            for _ in 0..(duration / dt) as usize {
                let rate = law.deflection_rate(&bristle, &v, &z);
                let friction = (z * bristle.stiffness + rate * bristle.damping) * 10.0;
                v.x += (load * law.friction * 10.0 - friction.x) * dt;
                z += rate * dt;
                x += v.x * dt;
            }
            (v.x, x)
        };
        let (v, _) = run(1.2, 0.5);
        assert!((v - 0.2 * 5.0 * 0.5).abs() < 0.02, "{v}");
        let (v, x) = run(0.9, 0.5);
        assert!(v.abs() < 1e-6 && x < 3e-4, "{v} {x}");
    }
}
