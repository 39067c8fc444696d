//! Assembly of a system at given displacements and rates of its hinges.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::axis::Rotations;
use super::hinge_motion::BodyPlacement;
use super::{Axis, BodyState, System, SystemError};

/// Initial displacements and rates of the hinges' free axes; zero by default.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Start {
    values: Vec<(String, Axis, f64, f64)>,
}

impl Start {
    /// All displacements and rates zero.
    pub fn new() -> Self {
        Self::default()
    }

    /// The free axis `axis` of hinge `hinge` starts at `position` \[m or rad\] and `rate` \[m/s or rad/s\].
    /// Two free rotations are successive, with the second axis rotated by the first; three are a rotation vector, and their
    /// rates are the components of the angular velocity along the inner frame's axes.
    pub fn with(mut self, hinge: &str, axis: Axis, position: f64, rate: f64) -> Self {
        self.values.push((hinge.to_owned(), axis, position, rate));
        self
    }
}

/// Gaps and rates up to this \[m, rad, m/s, rad/s\] count as closed; for lengths above 1 m, the fraction of the length.
const CLOSED: f64 = 1e-9;

impl System {
    /// The state with the hinges' displacements and rates of `start`.
    ///
    /// # Errors
    /// [`SystemError`] for a start value of an unknown hinge or constrained axis or that is not finite, if a loop does not
    /// close to 1e-9 or the rates open it, or if constraints are redundant ([`System::leave_out_redundant`] removes these,
    /// [`System::assemble_singular`] accepts them).
    pub fn assemble(&self, start: &Start) -> Result<Vec<f64>, SystemError> {
        let state = self.assemble_singular(start)?;
        self.check_independent(&state)?;
        Ok(state)
    }

    /// [`System::assemble`] for a start in a singular position, such as a stretched linkage, where constraints are
    /// redundant that are independent elsewhere. Forces are not determined there. Such a motion needs
    /// [`super::MatrixMethod::with_tolerance`], and [`super::MatrixMethod::project`] after every step.
    ///
    /// # Errors
    /// As [`System::assemble`], except for redundancy.
    pub fn assemble_singular(&self, start: &Start) -> Result<Vec<f64>, SystemError> {
        let mut position = vec![[0.0; 6]; self.hinges.len()];
        let mut rate = position.clone();
        for (name, axis, x, xd) in &start.values {
            let hinge = || name.clone();
            let Some(i) = self.hinge(name) else {
                return Err(SystemError::UnknownHinge { hinge: hinge() });
            };
            for (what, value) in [("position", *x), ("rate", *xd)] {
                if !value.is_finite() {
                    return Err(SystemError::Value {
                        hinge: hinge(),
                        what: format!("start {what} of {axis}"),
                        value,
                        expected: "finite",
                    });
                }
            }
            if !self.hinges[i].freedom.is_free(*axis) {
                return Err(SystemError::Constrained {
                    hinge: hinge(),
                    axis: *axis,
                    what: "a start value",
                });
            }
            if self.joined[i].closes_loop {
                return Err(SystemError::StartOfLoop { hinge: hinge() });
            }
            position[i][axis.index()] = *x;
            rate[i][axis.index()] = *xd;
        }
        for gear in &self.gears {
            let ((l, l_axis), (f, f_axis)) = (gear.leader, gear.follower);
            let name = &self.hinges[f].name;
            if start.values.iter().any(|(hinge, ..)| hinge == name) {
                return Err(SystemError::Constrained {
                    hinge: name.clone(),
                    axis: f_axis,
                    what: "a start value",
                });
            }
            let (l_axis, f_axis) = (l_axis.index(), f_axis.index());
            position[f][f_axis] = gear.ratio * position[l][l_axis] + gear.offset;
            rate[f][f_axis] = gear.ratio * rate[l][l_axis];
        }
        let mut state = vec![0.0; self.state_len()];
        let mut placed = vec![None; self.bodies.len()];
        for &i in &self.tree {
            self.place(i, &position[i], &rate[i], &mut placed);
        }
        for (b, at) in placed.iter().enumerate() {
            let at = at.expect("the tree reaches every body");
            let body = BodyState {
                p_WC: at.p,
                Q_WB: at.R_WB.into_inner(),
                v_WC_B: at.R.tr_mul(&at.v),
                w_WB_B: at.R.tr_mul(&at.w),
            };
            body.write(&mut state, b);
        }
        self.check_closed(&state)?;
        Ok(state)
    }

    /// Computes the placement of the outward body of hinge `i` from that of the inward one.
    fn place(&self, i: usize, x: &[f64; 6], xd: &[f64; 6], placed: &mut [Option<BodyPlacement>]) {
        let joined = &self.joined[i];
        let known = |body: Option<usize>| body.map_or(Some(BodyPlacement::INERTIAL), |b| placed[b]);
        let translation = Vector3::new(x[0], x[1], x[2]);
        let speed = Vector3::new(xd[0], xd[1], xd[2]);
        let (R_MN, turning) = self.rotation(i, x, xd);
        if let (Some(m), Some(outer)) = (
            known(joined.inner),
            joined.outer.filter(|_| known(joined.outer).is_none()),
        ) {
            let R_WM = m.R_WB * joined.R_BM;
            let R_WB = R_WM * R_MN * joined.R_BN.inverse();
            let (d, e_m, e_n) = (
                R_WM * translation,
                m.R_WB * joined.e_inner,
                R_WB * joined.e_outer,
            );
            let w = m.w + R_WM * turning;
            let dd = R_WM * speed + m.w.cross(&d);
            placed[outer] = Some(BodyPlacement {
                p: m.p + e_m + d - e_n,
                R_WB,
                R: R_WB.to_rotation_matrix().into_inner(),
                v: m.v + m.w.cross(&e_m) + dd - w.cross(&e_n),
                w,
            });
        } else if let (Some(n), Some(inner)) = (known(joined.outer), joined.inner) {
            let R_WM = n.R_WB * joined.R_BN * R_MN.inverse();
            let R_WB = R_WM * joined.R_BM.inverse();
            let (d, e_m, e_n) = (
                R_WM * translation,
                R_WB * joined.e_inner,
                n.R_WB * joined.e_outer,
            );
            let w = n.w - R_WM * turning;
            let dd = R_WM * speed + w.cross(&d);
            placed[inner] = Some(BodyPlacement {
                p: n.p + e_n - d - e_m,
                R_WB,
                R: R_WB.to_rotation_matrix().into_inner(),
                v: n.v + n.w.cross(&e_n) - dd - w.cross(&e_m),
                w,
            });
        }
    }

    /// Attitude of N in M and relative angular velocity in M's axes. The quaternion's sign distinguishes whole turns.
    fn rotation(
        &self,
        i: usize,
        x: &[f64; 6],
        xd: &[f64; 6],
    ) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let turn = |k: usize| {
            let (s, c) = (0.5 * x[3 + k]).sin_cos();
            let q = Quaternion::from_parts(c, Vector3::ith(k, s));
            UnitQuaternion::new_unchecked(q)
        };
        let rate = |k: usize| Vector3::ith(k, xd[3 + k]);
        match self.hinges[i].freedom.rotations() {
            Rotations::None => (UnitQuaternion::identity(), Vector3::zeros()),
            Rotations::One(a) => (turn(a), rate(a)),
            Rotations::Two(a, b) => (turn(a) * turn(b), rate(a) + turn(a) * rate(b)),
            Rotations::Three => (
                UnitQuaternion::from_scaled_axis(Vector3::new(x[3], x[4], x[5])),
                Vector3::new(xd[3], xd[4], xd[5]),
            ),
        }
    }

    fn check_closed(&self, state: &[f64]) -> Result<(), SystemError> {
        for (i, hinge) in self.hinges.iter().enumerate() {
            let joined = &self.joined[i];
            if !joined.closes_loop {
                continue;
            }
            let motion = self.hinge_motion(state, i);
            let size = 1.0_f64
                .max(joined.e_inner.norm())
                .max(joined.e_outer.norm());
            let constrained = || Axis::ALL.into_iter().filter(|a| !hinge.freedom.is_free(*a));
            let limit = |axis: Axis| CLOSED * if axis.is_rotation() { 1.0 } else { size };
            let worst = |values: &nalgebra::Vector6<f64>| {
                let excess = |a: &Axis| values[a.index()].abs() / limit(*a);
                let axis = constrained().max_by(|a, b| excess(a).total_cmp(&excess(b)))?;
                (excess(&axis) > 1.0).then_some((axis, values[axis.index()]))
            };
            if let Some((axis, residual)) = worst(&motion.displacement) {
                let hinge = hinge.name.clone();
                return Err(SystemError::Open {
                    hinge,
                    axis,
                    residual,
                });
            }
            if let Some((axis, residual)) = worst(&motion.rate) {
                let hinge = hinge.name.clone();
                return Err(SystemError::Opening {
                    hinge,
                    axis,
                    residual,
                });
            }
        }
        Ok(())
    }
}
