//! Equations of motion of a robot whose flexible parts are all on its base, with the kernels of rigid robots.
//!
//! The kernels compute a robot whose base contains the undeformed appendages. Deformation enters at the base: in
//! inertia and momentum before the base's angular velocity is computed, and in the articulated inertia before the
//! base's acceleration is computed. Results equal those of the general equations (`acceleration.rs`) up to rounding.

use pulp::{Simd, WithSimd};

use super::acceleration::FlexibleEvaluation;
use super::{FlexibleInput, FlexibleState, FlexibleSystem, ModalBody};
use crate::dynamics::kernel::{
    ArticulatedInertia, Mat3, SpatialForce, SpatialMotion, Sym3, Vec3, articulated_tree,
    propagate_acceleration, whole_tree,
};
use crate::dynamics::scratch_memory::DynamicsScratch;
use crate::spatial::{Twist, Wrench};

/// Entries below this, relative to the largest of their kind, are rounding errors of a change of axes.
const ROUNDING: f64 = 1e-13;

/// Eight numbers that the compiler keeps in one or two registers: three components of a force, one zero, three of a
/// torque, one zero; or the entries xx, yy, zz, yz, xz, xy of a symmetric matrix and two zeros.
type Lanes = [f64; 8];

/// A mode, in the base's kernel frame and about its origin.
#[derive(Clone, Debug)]
#[repr(align(64))]
struct Mode {
    /// `∫ ψ dm`, `∫ X × ψ dm`.
    coupling: Lanes,
    /// `∂J/∂μ` undeformed, and half of `∂²J/∂μ²`.
    dJ: Lanes,
    ddJ: Lanes,
    stiffness: f64,
    damping: f64,
    inverse_mass: f64,
}

/// Equations of motion of a robot with flexible parts on its base only; see the module's description.
#[derive(Clone, Debug)]
pub(super) struct BaseModes {
    scratch: DynamicsScratch,
    system: FlexibleSystem,
    modes: Vec<Mode>,
    /// Axis and inertia of each rotor on the base, and its coordinate.
    rotors: Vec<BaseRotor>,
    /// Reduction of the base's articulated inertia by modes and rotors that move freely.
    taken: ArticulatedInertia<f64>,
    /// `∂J/∂μ` of each mode at this shape.
    dJ: Vec<Lanes>,
    /// Modal accelerations while the base does not accelerate.
    free: Vec<f64>,
    mass: f64,
}

#[derive(Clone, Debug)]
struct BaseRotor {
    axis: Vec3<f64>,
    inertia: f64,
    coordinate: usize,
    ratio: f64,
}

impl BaseModes {
    /// The faster equations for `system`. `None` for robots that they do not cover: flexible parts on other bodies,
    /// second order, modes that are coupled with each other, or elastic links.
    pub fn new(system: &FlexibleSystem) -> Option<Self> {
        let compiled = system.compiled();
        let bodies = system.modal_bodies();
        if bodies.iter().any(|b| b.body != 0 || b.section.is_some())
            || compiled.rotors.iter().any(|r| r.body != 0)
        {
            return None;
        }
        let inertia = system.undeformed_inertia(0);
        let model = system.model().with_body_inertia(0, inertia);
        let scratch = DynamicsScratch::new(&model);
        let X_KB = scratch.tree.bodies[0].X_KB;
        let mut modes = Vec::new();
        for body in bodies {
            let X_KA = X_KB * body.X_BA;
            let in_kernel = ModalBody::new(body.appendage.clone(), 0, X_KA, 0, None);
            modes.extend(uncoupled_modes(&in_kernel)?);
        }
        let rotors = compiled.rotors.iter().map(|rotor| BaseRotor {
            axis: Vec3((X_KB.rotation * rotor.axis).into()),
            inertia: rotor.inertia,
            coordinate: rotor.coordinate,
            ratio: rotor.ratio,
        });
        let rotors: Vec<_> = rotors.collect();
        Some(Self {
            taken: taken_inertia(&modes, &rotors),
            dJ: vec![[0.0; 8]; modes.len()],
            free: vec![0.0; modes.len()],
            mass: system.total_mass(),
            scratch,
            system: system.clone(),
            modes,
            rotors,
        })
    }

    /// The equations of motion at `state`, without external wrenches and thrusters.
    pub fn evaluate(
        &mut self,
        state: &FlexibleState,
        input: &FlexibleInput,
        limits: (f64, &[f64]),
        out: &mut FlexibleEvaluation,
    ) {
        let has_rotors = !out.rotor_torques.is_empty();
        if has_rotors {
            out.set_rotor_torques(&self.system, state, input, limits);
        } else {
            out.clear_power();
        }
        let arch = self.scratch.arch;
        arch.dispatch(Evaluation {
            equations: self,
            state,
            input,
            out,
        });
        out.set_reduced_motors(&self.system);
    }
}

/// The modes of a body if they are coupled only through the base, otherwise `None`.
fn uncoupled_modes(body: &ModalBody) -> Option<Vec<Mode>> {
    let (n, i) = (body.modes(), &body.integrals);
    let appendage = &body.appendage;
    if body.second_order() {
        return None;
    }
    for m in [
        &appendage.modal_mass,
        &appendage.modal_stiffness,
        &appendage.modal_damping,
    ] {
        let largest = m.amax();
        for (k, l) in (0..n).flat_map(|k| (0..n).map(move |l| (k, l))) {
            if k != l && m[(k, l)].abs() > ROUNDING * largest {
                return None;
            }
        }
    }
    // For modes of mass 1, the largest D is about 1.
    let size = appendage.modal_mass.amax();
    if i.dH.iter().any(|(_, _, H)| H.amax() > ROUNDING * size) {
        return None;
    }
    let lanes = |m: &nalgebra::Matrix3<f64>| {
        let mut lanes = [0.0; 8];
        lanes[..6].copy_from_slice(&[
            m[(0, 0)],
            m[(1, 1)],
            m[(2, 2)],
            m[(1, 2)],
            m[(0, 2)],
            m[(0, 1)],
        ]);
        lanes
    };
    let mut modes: Vec<Mode> = (0..n)
        .map(|k| Mode {
            coupling: pair(&i.coupling[k]),
            dJ: lanes(&i.dJ[k]),
            ddJ: [0.0; 8],
            stiffness: appendage.modal_stiffness[(k, k)],
            damping: appendage.modal_damping[(k, k)],
            inverse_mass: 1.0 / appendage.modal_mass[(k, k)],
        })
        .collect();
    for (k, l, ddJ) in &i.ddJ {
        if k == l {
            modes[*k].ddJ = lanes(ddJ);
        } else if ddJ.amax() > ROUNDING * size {
            return None;
        }
    }
    Some(modes)
}

fn pair(wrench: &Wrench) -> Lanes {
    let ([x, y, z], [a, b, c]) = (wrench.force.into(), wrench.torque.into());
    [x, y, z, 0.0, a, b, c, 0.0]
}

/// `Σ Pᵀ P / m` of the modes and `Σ J a aᵀ` of the rotors.
fn taken_inertia(modes: &[Mode], rotors: &[BaseRotor]) -> ArticulatedInertia<f64> {
    let zero = Sym3 {
        diagonal: [0.0; 3],
        off: [0.0; 3],
    };
    let mut sum = ArticulatedInertia {
        rotational: zero,
        coupling: Mat3([Vec3([0.0; 3]); 3]),
        mass: zero,
    };
    let add = |into: &mut Sym3<f64>, v: [f64; 3], k: f64| {
        for i in 0..3 {
            into.diagonal[i] += k * v[i] * v[i];
            into.off[i] += k * v[(i + 1) % 3] * v[(i + 2) % 3];
        }
    };
    for mode in modes {
        let [x, y, z, _, a, b, c, _] = mode.coupling;
        add(&mut sum.mass, [x, y, z], mode.inverse_mass);
        add(&mut sum.rotational, [a, b, c], mode.inverse_mass);
        for (row, torque) in sum.coupling.0.iter_mut().zip([a, b, c]) {
            for (entry, force) in row.0.iter_mut().zip([x, y, z]) {
                *entry += torque * force * mode.inverse_mass;
            }
        }
    }
    for rotor in rotors {
        add(&mut sum.rotational, rotor.axis.0, rotor.inertia);
    }
    sum
}

/// `into += v k`, entry by entry.
#[inline(always)]
fn add_scaled(into: &mut Lanes, v: &Lanes, k: f64) {
    for (into, v) in into.iter_mut().zip(v) {
        *into = v.mul_add(k, *into);
    }
}

#[inline(always)]
fn dot(a: &Lanes, b: &Lanes) -> f64 {
    let mut products = [0.0; 8];
    for i in 0..8 {
        products[i] = a[i] * b[i];
    }
    let [a, b, c, d, e, f, g, h] = products;
    ((a + e) + (b + f)) + ((c + g) + (d + h))
}

#[inline(always)]
fn symmetric(lanes: &Lanes) -> Sym3<f64> {
    let [xx, yy, zz, yz, xz, xy, ..] = *lanes;
    Sym3 {
        diagonal: [xx, yy, zz],
        off: [yz, xz, xy],
    }
}

/// Force and torque of the eight numbers.
#[inline(always)]
fn vectors(lanes: &Lanes) -> (Vec3<f64>, Vec3<f64>) {
    let [x, y, z, _, a, b, c, _] = *lanes;
    (Vec3([x, y, z]), Vec3([a, b, c]))
}

/// One evaluation of the equations; `pulp` compiles it for every instruction set.
struct Evaluation<'a> {
    equations: &'a mut BaseModes,
    state: &'a FlexibleState,
    input: &'a FlexibleInput,
    out: &'a mut FlexibleEvaluation,
}

impl WithSimd for Evaluation<'_> {
    type Output = ();
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn with_simd<V: Simd>(self, simd: V) {
        let Self {
            equations,
            state,
            input,
            out,
        } = self;
        let BaseModes {
            scratch,
            system,
            modes,
            rotors,
            taken,
            dJ,
            free,
            mass,
        } = equations;
        let DynamicsScratch {
            tree,
            links,
            subtrees,
            ..
        } = scratch;
        let n = tree.dof();
        let (q, qd) = (&state.tree.q.as_slice()[..n], state.tree.qd.as_slice());
        tree.for_each_rotation(simd, q, |j, q, turn| {
            (links[j + 1].q, links[j + 1].rotation) = (q, turn);
        });
        if out.link_efforts.is_empty() {
            let efforts = &input.tree.efforts.as_slice()[..n];
            for (j, link) in links[1..].iter_mut().enumerate() {
                link.qd = qd[j];
                link.effort = tree.total_effort(j, efforts[j], q[j], qd[j]);
                out.tree.power += link.effort * qd[j];
            }
        } else {
            for (j, link) in links[1..].iter_mut().enumerate() {
                link.qd = qd[j];
                link.effort = out.joint_effort(system, state, input, j);
            }
        }

        // Changes of first moment and inertia due to deformation, and the modes' momentum.
        let count = modes.len();
        let (mu, mu_dot) = (&state.mu()[..count], &state.mu_dot()[..count]);
        let (mut moment, mut momentum) = ([0.0; 8], [0.0; 8]);
        let (mut J, mut J_dot) = ([0.0; 8], [0.0; 8]);
        for (k, (mode, slope)) in modes.iter().zip(dJ.iter_mut()).enumerate() {
            let (x, rate) = (mu[k], mu_dot[k]);
            add_scaled(&mut moment, &mode.coupling, x);
            add_scaled(&mut momentum, &mode.coupling, rate);
            let mut at = mode.dJ;
            add_scaled(&mut at, &mode.ddJ, x);
            add_scaled(&mut J, &at, x);
            add_scaled(&mut at, &mode.ddJ, x);
            add_scaled(&mut J_dot, &at, rate);
            *slope = at;
        }
        let (S, _) = vectors(&moment);
        let (S_dot, mut h) = vectors(&momentum);
        let (J, J_dot) = (symmetric(&J), symmetric(&J_dot));
        let mut rotor_torque = Vec3([0.0; 3]);
        for rotor in rotors.iter() {
            let spin = state.xd[count + rotor.coordinate] * rotor.ratio;
            let torque = out.rotor_torques[rotor.coordinate] / rotor.ratio;
            h = rotor.axis.mul_add(rotor.inertia * spin, h);
            rotor_torque = rotor.axis.mul_add(torque, rotor_torque);
        }

        let mut whole = whole_tree(tree, links, subtrees);
        whole.subtree.first_moment = whole.subtree.first_moment + S;
        whole.subtree.inertia = whole.subtree.inertia + J;
        whole.momentum.force = whole.momentum.force + S_dot;
        whole.momentum.torque = whole.momentum.torque + h;
        let m = &state.tree.momentum_W;
        let angular = state.tree.R_WB.inverse_transform_vector(&m.angular);
        let angular = tree.to_base_kernel(Vec3(angular.into()));
        let w = whole.base_angular_velocity(*mass, angular);
        links[0].w = w;
        let (inertia, force) = articulated_tree(tree, links, None);

        // Convective forces on the base, and the modes' forces.
        let mut torque = w.cross(J.times(w) + h) + J_dot.times(w) + rotor_torque;
        let mut linear = w.cross(w.cross(S) + S_dot.scaled(2.0));
        let [x, y, z] = w.0;
        let half = [
            0.5 * x * x,
            0.5 * y * y,
            0.5 * z * z,
            y * z,
            x * z,
            x * y,
            0.0,
            0.0,
        ];
        let (mut on_base, mut lost) = ([0.0; 8], 0.0);
        for (k, (mode, slope)) in modes.iter().zip(dJ.iter()).enumerate() {
            let damping = mode.damping * mu_dot[k];
            let force = dot(slope, &half) - mode.stiffness.mul_add(mu[k], damping);
            lost = damping.mul_add(mu_dot[k], lost);
            free[k] = force * mode.inverse_mass;
            add_scaled(&mut on_base, &mode.coupling, free[k]);
        }
        let (of_modes, moment_of_modes) = vectors(&on_base);
        linear = linear + of_modes;
        torque = torque + moment_of_modes;
        out.losses.modal_damping = lost;

        let articulated = with_deformation(inertia, S, J, taken);
        let acceleration = articulated.free_acceleration(SpatialForce {
            torque: force.torque + torque,
            force: force.force + linear,
        });
        propagate_acceleration(tree, links, acceleration);
        let SpatialMotion { angular, linear } = acceleration;
        let [ax, ay, az] = linear.0;
        let [bx, by, bz] = angular.0;
        let lanes = [ax, ay, az, 0.0, bx, by, bz, 0.0];
        for (k, mode) in modes.iter().enumerate() {
            out.xdd[k] = dot(&mode.coupling, &lanes).mul_add(-mode.inverse_mass, free[k]);
        }
        for rotor in rotors.iter() {
            let relative = out.rotor_torques[rotor.coordinate] / (rotor.inertia * rotor.ratio)
                - rotor.axis.dot(angular);
            out.xdd[count + rotor.coordinate] = relative / rotor.ratio;
        }
        for (qdd, link) in (out.tree.acceleration.qdd.as_mut_slice().iter_mut()).zip(&links[1..]) {
            *qdd = link.qdd;
        }
        out.tree.w_WB_B = tree.to_base_frame(w).0.into();
        out.tree.external = None;
        out.tree.acceleration.A_WB_B = Twist::new(
            tree.to_base_frame(angular).0.into(),
            tree.to_base_frame(linear).0.into(),
        );
    }
}

/// The articulated inertia with first moment `S` and inertia `J` of the deformation added, and `taken` subtracted.
#[inline(always)]
fn with_deformation(
    mut inertia: ArticulatedInertia<f64>,
    S: Vec3<f64>,
    J: Sym3<f64>,
    taken: &ArticulatedInertia<f64>,
) -> ArticulatedInertia<f64> {
    inertia.rotational = inertia.rotational + J + -taken.rotational;
    inertia.mass = inertia.mass + -taken.mass;
    let [x, y, z] = S.0;
    let cross = Mat3([Vec3([0.0, -z, y]), Vec3([z, 0.0, -x]), Vec3([-y, x, 0.0])]);
    let coupling = inertia.coupling + cross;
    for i in 0..3 {
        inertia.coupling.0[i] = coupling.0[i] - taken.coupling.0[i];
    }
    inertia
}
