//! The rigid body whose mass properties are nearest to given mass properties that no rigid body can have.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use super::RigidInertia;

/// Upper bound of the density of a robot's materials (tungsten has 19 300) \[kg/m³\].
const DENSEST: f64 = 2e4;
/// Smallest second moment of mass of a line-shaped body, relative to the largest principal moment of inertia.
const THINNEST: f64 = 1e-3;

impl RigidInertia {
    /// The valid inertia ([`RigidInertia::check`]) nearest to this one in the Frobenius norm, with the same mass and
    /// centre of mass, and the distance \[kg m²\]. `None` if the mass is not positive, if a number is not finite, or if
    /// the nearest valid tensor is zero although this tensor is not.
    ///
    /// A tensor belongs to a mass distribution if and only if `½ tr(I) 1 - I`, the second moment of mass, is positive
    /// semidefinite (Wensing, Kim and Slotine, "Linear matrix inequalities for physically consistent inertial parameter
    /// identification", IEEE RA-L 3 (2018), eqs. (8)-(10)); its eigenvalues are then the second moments along the
    /// principal axes. The nearest such tensor has the same principal axes, so that only three numbers are unknown. If
    /// it is singular, because all mass is in a point or on a line, second moments are at least those of a solid sphere
    /// with this mass and 20 000 kg/m³, and at most a thousandth of the largest principal moment.
    pub fn nearest_valid(&self) -> Option<(Self, f64)> {
        let finite = self.com.iter().chain(&self.about_com);
        if !(self.mass.is_finite() && self.mass > 0.0 && finite.copied().all(f64::is_finite)) {
            return None;
        }
        if self.check().is_ok() {
            return Some((*self, 0.0));
        }
        let SymmetricEigen {
            eigenvalues: given,
            eigenvectors: axes,
        } = SymmetricEigen::new(self.about_com);
        let with = |moments: Vector3<f64>| {
            let about_com = axes * Matrix3::from_diagonal(&moments) * axes.transpose();
            Self {
                about_com: (about_com + about_com.transpose()) * 0.5,
                ..*self
            }
        };
        let radius = (self.mass / (DENSEST * 4.0 / 3.0 * std::f64::consts::PI)).cbrt();
        let sphere = self.mass * radius * radius / 5.0;
        let nearest = nearest_moments(&given, 0.0);
        let mut valid = with(nearest);
        if valid.check().is_err() {
            let largest = nearest.max();
            if largest <= 0.0 && given.amax() > sphere {
                return None;
            }
            let floor = if largest > 0.0 {
                sphere.min(THINNEST * largest)
            } else {
                sphere
            };
            valid = with(nearest_moments(&given, floor));
        }
        let distance = (valid.about_com - self.about_com).norm();
        (valid.check().is_ok() && distance.is_finite()).then_some((valid, distance))
    }
}

/// The principal moments nearest to `given` whose second moments of mass are at least `floor`. Moments are `A p` for
/// second moments `p`, with `A = 1 1ᵀ - E`, so this is a least-squares problem with bounds. For three variables all 8
/// sets of active bounds can be tried.
fn nearest_moments(given: &Vector3<f64>, floor: f64) -> Vector3<f64> {
    let map = Matrix3::from_element(1.0) - Matrix3::identity();
    let wanted = given - map * Vector3::repeat(floor);
    let (normal, right) = (map.tr_mul(&map), map.tr_mul(&wanted));
    let mut best = (f64::INFINITY, Vector3::zeros());
    for set in 0..8_u8 {
        let is_free = |i: usize| set & (1 << i) != 0;
        let (mut matrix, mut vector) = (Matrix3::identity(), Vector3::zeros());
        for i in (0..3).filter(|&i| is_free(i)) {
            vector[i] = right[i];
            for j in (0..3).filter(|&j| is_free(j)) {
                matrix[(i, j)] = normal[(i, j)];
            }
        }
        let Some(above) = matrix.lu().solve(&vector) else {
            continue;
        };
        let distance = (map * above - wanted).norm_squared();
        if above.min() >= 0.0 && distance < best.0 {
            best = (distance, above);
        }
    }
    map * (best.1 + Vector3::repeat(floor))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;
    use rand::{RngExt, SeedableRng, rngs::StdRng};

    fn body(moments: [f64; 3]) -> RigidInertia {
        let turn = Rotation3::from_euler_angles(0.3, -0.7, 1.1).into_inner();
        RigidInertia {
            mass: 2.0,
            com: Vector3::new(0.1, 0.2, 0.3),
            about_com: turn * Matrix3::from_diagonal(&moments.into()) * turn.transpose(),
        }
    }

    fn moments(body: &RigidInertia) -> [f64; 3] {
        let mut moments: [f64; 3] = body.about_com.symmetric_eigenvalues().into();
        moments.sort_by(f64::total_cmp);
        moments
    }

    #[test]
    fn a_violated_triangle_inequality_is_shared_among_the_moments() {
        // 4 > 1 + 2 by 1: the nearest point of the plane a + b = c is 1/3 away in each, 1/√3 in all.
        let (valid, distance) = body([1.0, 2.0, 4.0]).nearest_valid().unwrap();
        for (found, expected) in moments(&valid)
            .iter()
            .zip([4.0 / 3.0, 7.0 / 3.0, 11.0 / 3.0])
        {
            assert!((found - expected).abs() < 1e-12, "{found}");
        }
        assert!((distance - 1.0 / 3.0_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn no_other_valid_inertia_is_nearer() {
        let mut random = StdRng::seed_from_u64(3);
        for _ in 0..200 {
            let given = body(std::array::from_fn(|_| random.random_range(-0.3..1.0)));
            let Some((valid, distance)) = given.nearest_valid() else {
                continue;
            };
            assert_eq!(valid.check(), Ok(()));
            for _ in 0..200 {
                // Any tensor with a positive second moment of mass, turned away from the principal axes.
                let second = Vector3::from_fn(|_, _| random.random_range(0.0..0.6));
                let turn = Rotation3::new(Vector3::from_fn(|_, _| random.random_range(-0.3..0.3)));
                let own = SymmetricEigen::new(given.about_com).eigenvectors;
                let axes = turn.into_inner() * own;
                let other = Vector3::repeat(second.sum()) - second;
                let other = axes * Matrix3::from_diagonal(&other) * axes.transpose();
                // The floor of a line keeps the result at most this far inside of the boundary.
                let inside = 4.0 * THINNEST;
                assert!((other - given.about_com).norm() >= distance - inside);
            }
        }
    }

    #[test]
    fn points_and_lines_get_the_size_of_a_dense_sphere() {
        let (valid, _) = body([0.0; 3]).nearest_valid().unwrap();
        // A sphere of 2 kg with 20 000 kg/m³ has a radius of 28.8 mm, and 2/5 m r² = 6.63e-4 kg m².
        for moment in moments(&valid) {
            assert!((moment - 6.63e-4).abs() < 1e-6, "{moment}");
        }
        let (valid, distance) = body([0.0, 1.0, 1.0]).nearest_valid().unwrap();
        assert!(distance < 1e-3 && moments(&valid)[0] > 1e-4);
    }

    #[test]
    fn what_has_nothing_of_a_rigid_body_is_refused() {
        assert_eq!(body([-1.0, -2.0, -1.0]).nearest_valid(), None);
        let mut negative = body([1.0; 3]);
        negative.mass = -1.0;
        assert_eq!(negative.nearest_valid(), None);
        let mut broken = body([1.0; 3]);
        broken.about_com[(0, 1)] = f64::NAN;
        assert_eq!(broken.nearest_valid(), None);
    }

    #[test]
    fn valid_bodies_stay_as_they_are() {
        let given = body([1.0, 1.2, 1.5]);
        assert_eq!(given.nearest_valid(), Some((given, 0.0)));
    }
}
