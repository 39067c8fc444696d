//! A deformable body on a link: its mass integrals in the link's frame, and their values at one deformation.

use fuyu_structures::{Appendage, Invariants, Kinetics, OutputPoint, cross_moment};
use nalgebra::{DMatrix, Matrix3, Vector3};

use super::composite::Composite;
use crate::spatial::{Pose, Twist, Wrench};

/// A deformable body whose attachment is fixed to a body of the robot.
#[derive(Clone, Debug)]
pub struct ModalBody {
    /// The original description, in its attachment frame A.
    pub appendage: Appendage,
    /// The body that carries it.
    pub body: usize,
    /// Pose of the attachment frame A in the carrying body's frame B.
    pub X_BA: Pose,
    /// Index of its first modal coordinate among those of the robot.
    pub offset: usize,
    /// The output point that carries the following links, if this is an elastic link.
    pub section: Option<usize>,
    /// The same body with B as attachment frame.
    pub(super) in_body: Appendage,
    /// Mass integrals for the recursions, without second order.
    pub(super) integrals: FirstOrderIntegrals,
}

impl ModalBody {
    pub(super) fn new(
        appendage: Appendage,
        body: usize,
        X_BA: Pose,
        offset: usize,
        section: Option<usize>,
    ) -> Self {
        let R = X_BA.rotation.matrix();
        let rotated = |list: &[Vector3<f64>]| list.iter().map(|v| R * v).collect::<Vec<_>>();
        let output = |o: &OutputPoint| OutputPoint {
            name: o.name.clone(),
            position: R * o.position + X_BA.translation.vector,
            translation: rotated(&o.translation),
            rotation: rotated(&o.rotation),
            chi: rotated(&o.chi),
        };
        let in_body = Appendage {
            invariants: placed(&appendage.invariants, &X_BA),
            outputs: appendage.outputs.iter().map(output).collect(),
            ..appendage.clone()
        };
        Self {
            integrals: FirstOrderIntegrals::new(&in_body.invariants),
            in_body,
            appendage,
            body,
            X_BA,
            offset,
            section,
        }
    }

    /// Name of the body.
    pub fn name(&self) -> &str {
        &self.appendage.name
    }

    /// Number of modal coordinates.
    pub fn modes(&self) -> usize {
        self.appendage.modes()
    }

    /// Indices of its modal coordinates among those of the robot.
    pub fn range(&self) -> std::ops::Range<usize> {
        self.offset..self.offset + self.modes()
    }

    /// Whether displacements of second order are computed.
    pub fn second_order(&self) -> bool {
        self.appendage.invariants.second_order()
    }
}

/// The mass integrals of a body in frame B, from those about its attachment frame A.
fn placed(of_A: &Invariants, X_BA: &Pose) -> Invariants {
    let (R, p) = (X_BA.rotation.matrix(), X_BA.translation.vector);
    let mass = of_A.mass();
    let S = R * of_A.first(0);
    let second = p * p.transpose() * mass
        + p * S.transpose()
        + S * p.transpose()
        + R * of_A.second(0, 0) * R.transpose();
    let inertia = Matrix3::identity() * second.trace() - second;
    let order = of_A.second_order();
    let mut of_B = Invariants::rigid(mass, S + p * mass, inertia, of_A.modes(), order);
    for a in 0..of_A.functions() {
        if a > 0 {
            of_B.set_first(a, R * of_A.first(a));
        }
        for b in a.max(1)..of_A.functions() {
            let mut second = R * of_A.second(a, b) * R.transpose();
            if a == 0 {
                second += p * (R * of_A.first(b)).transpose();
            }
            of_B.set_second(a, b, second);
        }
    }
    of_B
}

/// Mass integrals of a body with displacement `X + Σ ψ_k μ_k`, in the form of the equations of motion: the first moment
/// is linear in μ, the moment of inertia quadratic, and the angular momentum of each mode linear.
#[derive(Clone, Debug)]
pub(super) struct FirstOrderIntegrals {
    /// Mass integrals of the undeformed body.
    pub rigid: Composite,
    /// `∫ ψ_k dm` as force, `∫ X × ψ_k dm` as torque.
    pub coupling: Vec<Wrench>,
    /// `∂J/∂μ_k` of the undeformed body.
    pub dJ: Vec<Matrix3<f64>>,
    /// Pairs `k <= l` whose `½ ∂²J/∂μ_k∂μ_l` (twice it if `k < l`) is not zero: coefficient of `μ_k μ_l` in J.
    pub ddJ: Vec<(usize, usize, Matrix3<f64>)>,
    /// Pairs `k != l` whose `∫ ψ_l × ψ_k dm` is not zero: derivative of the torque of `coupling[k]` by μ_l.
    pub dH: Vec<(usize, usize, Vector3<f64>)>,
}

impl FirstOrderIntegrals {
    fn new(of_B: &Invariants) -> Self {
        let n = of_B.modes();
        let moment = |second: Matrix3<f64>| Matrix3::identity() * second.trace() - second;
        let (mut ddJ, mut dH) = (Vec::new(), Vec::new());
        for k in 0..n {
            for l in k..n {
                let D = of_B.second(1 + k, 1 + l);
                let both = if k == l { D } else { D + D.transpose() };
                if both != Matrix3::zeros() {
                    ddJ.push((k, l, moment(both)));
                }
                let H = cross_moment(&of_B.second(1 + l, 1 + k));
                if k != l && H != Vector3::zeros() {
                    dH.push((k, l, H));
                    dH.push((l, k, -H));
                }
            }
        }
        let N = |k: usize| of_B.second(0, 1 + k);
        let coupling = (0..n).map(|k| Wrench {
            torque: cross_moment(&N(k)),
            force: of_B.first(1 + k),
        });
        Self {
            rigid: Composite {
                mass: of_B.mass(),
                S: of_B.first(0),
                J: of_B.inertia(),
            },
            coupling: coupling.collect(),
            dJ: (0..n).map(|k| moment(N(k) + N(k).transpose())).collect(),
            ddJ,
            dH,
        }
    }
}

/// A deformable body at one shape, in the frame of the body that carries it, and about its origin.
#[derive(Clone, Debug)]
pub(super) struct ModalShape {
    /// Composite inertia with all modes locked.
    pub locked: Composite,
    /// Momentum of the modal rates.
    pub momentum: Wrench,
    /// Coupling of each mode to the translation (as force) and the rotation (as torque) of B.
    pub coupling: Vec<Wrench>,
    /// Modal mass, n x n.
    pub mass: DMatrix<f64>,
    /// Convective forces on B, and on the modes.
    pub bias: Wrench,
    pub bias_modes: Vec<f64>,
    /// Rate of J relative to B.
    J_dot: Matrix3<f64>,
    /// `∂J/∂μ_k` at this shape.
    dJ: Vec<Matrix3<f64>>,
    /// Terms of second order, if the body has them.
    kinetics: Option<Box<Kinetics>>,
}

impl ModalShape {
    pub fn new(body: &ModalBody) -> Self {
        let (n, i) = (body.modes(), &body.integrals);
        Self {
            locked: i.rigid,
            momentum: Wrench::ZERO,
            coupling: i.coupling.clone(),
            mass: body.in_body.modal_mass.clone(),
            bias: Wrench::ZERO,
            bias_modes: vec![0.0; n],
            J_dot: Matrix3::zeros(),
            dJ: i.dJ.clone(),
            kinetics: body
                .second_order()
                .then(|| Box::new(Kinetics::new(&body.in_body))),
        }
    }

    /// Sets all terms that do not depend on the motion of the carrying body.
    pub fn set_shape(&mut self, body: &ModalBody, mu: &[f64], mu_dot: &[f64]) {
        if let Some(kinetics) = &mut self.kinetics {
            kinetics.update(&body.in_body, mu, mu_dot, &Vector3::zeros());
            let M = &kinetics.mass_matrix;
            // The block at row 3, column 0 is [S×].
            self.locked.S = Vector3::new(M[(5, 1)], M[(3, 2)], M[(4, 0)]);
            self.locked.J = M.fixed_view::<3, 3>(3, 3).into_owned();
            let n = mu.len();
            for (k, coupling) in self.coupling.iter_mut().enumerate() {
                coupling.force = M.fixed_view::<3, 1>(0, 6 + k).into_owned();
                coupling.torque = M.fixed_view::<3, 1>(3, 6 + k).into_owned();
            }
            self.mass.copy_from(&M.view((6, 6), (n, n)));
        } else {
            self.set_first_order_shape(&body.integrals, mu, mu_dot);
        }
        self.momentum = Wrench::ZERO;
        for (coupling, rate) in self.coupling.iter().zip(mu_dot) {
            self.momentum += *coupling * *rate;
        }
    }

    /// Momentum while B moves with `V`.
    pub fn momentum(&self, V: &Twist) -> Wrench {
        self.locked.momentum(V) + self.momentum
    }

    fn set_first_order_shape(&mut self, i: &FirstOrderIntegrals, mu: &[f64], mu_dot: &[f64]) {
        (self.locked, self.J_dot) = (i.rigid, Matrix3::zeros());
        self.coupling.copy_from_slice(&i.coupling);
        self.dJ.copy_from_slice(&i.dJ);
        for (k, x) in mu.iter().enumerate() {
            self.locked.S += i.coupling[k].force * *x;
            self.locked.J += i.dJ[k] * *x;
        }
        for (k, l, ddJ) in &i.ddJ {
            self.locked.J += ddJ * (mu[*k] * mu[*l]);
            if k == l {
                self.dJ[*k] += ddJ * (2.0 * mu[*k]);
            } else {
                self.dJ[*k] += ddJ * mu[*l];
                self.dJ[*l] += ddJ * mu[*k];
            }
        }
        for (k, l, dH) in &i.dH {
            self.coupling[*k].torque += dH * mu[*l];
        }
        for (dJ, rate) in self.dJ.iter().zip(mu_dot) {
            self.J_dot += dJ * *rate;
        }
    }

    /// Sets the convective forces while B turns with `w` \[rad/s\] and its origin does not accelerate. Call
    /// [`Self::set_shape`] for the same `mu` and `mu_dot` before.
    pub fn set_bias(&mut self, body: &ModalBody, mu: &[f64], mu_dot: &[f64], w: &Vector3<f64>) {
        if let Some(kinetics) = &mut self.kinetics {
            kinetics.update(&body.in_body, mu, mu_dot, w);
            let b = kinetics.bias.as_slice();
            self.bias.force = Vector3::new(b[0], b[1], b[2]);
            self.bias.torque = Vector3::new(b[3], b[4], b[5]);
            self.bias_modes.copy_from_slice(&b[6..]);
            return;
        }
        // Rates in rotating axes; h is the angular momentum of the modal rates. The modal forces are -∂T/∂μ_k of T = ½
        // wᵀ J w + w·h.
        let Composite { S, J, .. } = &self.locked;
        self.bias = Wrench {
            torque: w.cross(&(J * w + self.momentum.torque)) + self.J_dot * w,
            force: w.cross(&(w.cross(S) + self.momentum.force * 2.0)),
        };
        for (bias, dJ) in self.bias_modes.iter_mut().zip(&self.dJ) {
            *bias = -0.5 * w.dot(&(dJ * w));
        }
        for (k, l, dH) in &body.integrals.dH {
            self.bias_modes[*k] += 2.0 * mu_dot[*l] * w.dot(dH);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fuyu_structures::{Beam, Boom, PlateStrip};
    use nalgebra::{Rotation3, Translation3};

    fn boom(second_order: bool) -> Appendage {
        let beam = |EI| Beam::uniform(3.0, 2.0, EI, 6);
        let boom = Boom {
            along_y: beam(400.0),
            along_z: beam(300.0),
            modes: [2, 2],
            damping: 0.01,
            second_order,
        };
        boom.appendage("boom").unwrap()
    }

    fn panel(second_order: bool) -> Appendage {
        let strip = PlateStrip {
            length: 8.0,
            width: 2.0,
            areal_mass: 3.0,
            EI: 3000.0,
            GJ: 800.0,
            bending_modes: 2,
            torsion_modes: 1,
            damping: 0.0,
            second_order,
        };
        strip.appendage("panel").unwrap()
    }

    // `Kinetics` about the attachment, moved to the carrying body's frame by the transform of motions, against the
    // integrals in that frame. A boom that bends in two planes has all terms: without dH the gyroscopic forces are
    // missing.
    #[test]
    fn integrals_in_the_body_frame_give_the_kinetics_of_the_attachment() {
        let X_BA = Pose::from_parts(
            Translation3::new(0.4, -0.7, 1.1),
            Rotation3::from_euler_angles(0.3, -0.8, 1.9),
        );
        for appendage in [boom(false), boom(true), panel(false), panel(true)] {
            let n = appendage.modes();
            let mu: Vec<f64> = (0..n).map(|k| 0.3 - 0.2 * k as f64).collect();
            let mu_dot: Vec<f64> = (0..n).map(|k| 0.5 * k as f64 - 0.4).collect();
            let w = Vector3::new(0.7, -0.3, 0.9);
            let mut kinetics = Kinetics::new(&appendage);
            let R = X_BA.rotation.matrix();
            kinetics.update(&appendage, &mu, &mu_dot, &(R.transpose() * w));

            let body = ModalBody::new(appendage.clone(), 0, X_BA, 0, None);
            let mut shape = ModalShape::new(&body);
            shape.set_shape(&body, &mu, &mu_dot);
            shape.set_bias(&body, &mu, &mu_dot, &w);

            // (v, w, μ') of A from that of B.
            let p = X_BA.translation.vector;
            let mut T = DMatrix::identity(6 + n, 6 + n);
            T.view_mut((0, 0), (3, 3)).copy_from(&R.transpose());
            T.view_mut((3, 3), (3, 3)).copy_from(&R.transpose());
            let arm = -R.transpose() * p.cross_matrix();
            T.view_mut((0, 3), (3, 3)).copy_from(&arm);
            let M = T.transpose() * &kinetics.mass_matrix * &T;
            // The origin of A has a centripetal acceleration.
            let mut acceleration = nalgebra::DVector::zeros(6 + n);
            let centripetal = R.transpose() * w.cross(&w.cross(&p));
            acceleration.rows_mut(0, 3).copy_from(&centripetal);
            let bias = T.transpose() * (&kinetics.bias + &kinetics.mass_matrix * acceleration);

            let mut found = DMatrix::zeros(6 + n, 6 + n);
            let m = body.integrals.rigid.mass;
            found
                .view_mut((0, 0), (3, 3))
                .copy_from(&(Matrix3::identity() * m));
            let S = shape.locked.S.cross_matrix();
            found.view_mut((0, 3), (3, 3)).copy_from(&-S);
            found.view_mut((3, 0), (3, 3)).copy_from(&S);
            found.view_mut((3, 3), (3, 3)).copy_from(&shape.locked.J);
            for k in 0..n {
                let Wrench { torque, force } = &shape.coupling[k];
                found.view_mut((0, 6 + k), (3, 1)).copy_from(force);
                found.view_mut((3, 6 + k), (3, 1)).copy_from(torque);
                let column = found.view((0, 6 + k), (6, 1)).into_owned();
                found
                    .view_mut((6 + k, 0), (1, 6))
                    .copy_from(&column.transpose());
            }
            found.view_mut((6, 6), (n, n)).copy_from(&shape.mass);
            let scale = M.amax();
            assert!((&found - &M).amax() < 1e-13 * scale, "{}", appendage.name);

            let mut found = nalgebra::DVector::zeros(6 + n);
            found.rows_mut(0, 3).copy_from(&shape.bias.force);
            found.rows_mut(3, 3).copy_from(&shape.bias.torque);
            for k in 0..n {
                found[6 + k] = shape.bias_modes[k];
            }
            let error = (&found - &bias).amax() / bias.amax();
            assert!(error < 1e-13, "{}: {error:e}", appendage.name);
        }
    }
}
