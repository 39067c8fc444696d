//! Forward dynamics by articulated bodies, linear in the number of joints.
//!
//! Featherstone's algorithm in link frames, with three things done otherwise than in the textbook.
//! Accelerations are those of the frames' origins as points, so that linear velocities are never needed. A
//! body's inertia is kept in its three blocks, and what a joint makes zero is not computed. The joint
//! itself takes no part beyond one row: its axis is a coordinate axis.

use super::hop::{ArticulatedInertia, Force, Motion};
use super::tree::{Body, Hop, Tree};
use super::vector::others;
use super::{Mat3, Scalar, Sym3, Turn, Vec3};

/// What the sweeps keep of a joint and the body that it moves, in the body's kernel frame.
#[derive(Debug, Clone, Copy)]
pub struct Slot<S> {
    /// Joint position \[rad or m\].
    pub q: S,
    /// Joint rate.
    pub qd: S,
    /// Joint effort, springs and dampers included.
    pub effort: S,
    /// Turn of the body's frame against its parent's, before the bend.
    pub turn: Turn<S>,
    /// Joint acceleration: the result.
    pub qdd: S,
    pub(super) w: Vec3<S>,
    /// `[w×]²`.
    pub(super) spin: Sym3<S>,
    pub(super) bias: Force<S>,
    /// Acceleration that the body has beyond its parent's at zero joint acceleration.
    pub(super) own: Motion<S>,
    /// What a joint acceleration of the parent's motion is worth: `U / d`.
    gain: Force<S>,
    /// Joint acceleration while the parent does not accelerate.
    free: S,
    pub(super) acceleration: Motion<S>,
}

/// What the bodies that branch off a body pass on to it.
#[derive(Debug, Clone, Copy)]
pub struct Branch<S> {
    inertia: ArticulatedInertia<S>,
    force: Force<S>,
}

impl<S: Scalar> Slot<S> {
    /// A slot with nothing in it, numbers of the kind of `like`.
    pub fn new(like: S) -> Self {
        let (zero, none) = (like.constant(0.0), Vec3::zero(like));
        Self {
            q: zero,
            qd: zero,
            effort: zero,
            turn: Turn::new(like.constant(1.0), zero),
            qdd: zero,
            w: none,
            spin: spin(none),
            bias: Force::zero(like),
            own: Motion::zero(like),
            gain: Force::zero(like),
            free: zero,
            acceleration: Motion::zero(like),
        }
    }

    /// Puts the joint of `hop` to position `q`, of which cosine and sine are known.
    #[inline(always)]
    pub(crate) fn place(&mut self, hop: &Hop, q: S, cos: S, sin: S) {
        let [c, s] = hop.home;
        self.q = q;
        let (cos, sin) = if hop.slides {
            (q.constant(c), q.constant(s))
        } else if s == 0.0 && c == 1.0 {
            (cos, sin)
        } else {
            let (c, s) = (q.constant(c), q.constant(s));
            (s.mul_sub_from(sin, c * cos), s.mul_add(cos, c * sin))
        };
        self.turn = Turn::new(cos, sin);
    }
}

impl<S: Scalar> Branch<S> {
    /// Nothing passed on, numbers of the kind of `like`.
    pub fn new(like: S) -> Self {
        let (zero, none) = (like.constant(0.0), Vec3::zero(like));
        let sym = Sym3 {
            diagonal: [zero; 3],
            off: [zero; 3],
        };
        Self {
            inertia: ArticulatedInertia {
                turning: sym,
                coupling: Mat3([none; 3]),
                mass: sym,
            },
            force: Force::zero(like),
        }
    }
}

/// `[w×]²`, the tensor of centripetal acceleration.
#[inline(always)]
pub(super) fn spin<S: Scalar>(w: Vec3<S>) -> Sym3<S> {
    let [x, y, z] = w.0;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    Sym3 {
        diagonal: [-(yy + zz), -(xx + zz), -(xx + yy)],
        off: [y * z, x * z, x * y],
    }
}

impl Body {
    /// Force that keeps the body's origin from accelerating while it spins.
    #[inline(always)]
    pub(super) fn centrifugal<S: Scalar>(&self, spin: Sym3<S>) -> Force<S> {
        let like = spin.off[0];
        let m = &self.inertia.about_origin;
        let mut torque = Vec3([like; 3]);
        for i in 0..3 {
            let (j, k) = others(i);
            // w × I w in terms of the same products of w.
            torque[i] = spin.off[i].times(m.diagonal[k] - m.diagonal[j]);
        }
        if self.is_oblique {
            let off = [0, 1, 2].map(|i| like.constant(m.off_diagonal[i]));
            for i in 0..3 {
                let (j, k) = others(i);
                let squares = spin.diagonal[j] - spin.diagonal[k];
                let sum = squares.mul_add(off[i], spin.off[k].mul_add(off[j], torque[i]));
                torque[i] = spin.off[j].mul_sub_from(off[k], sum);
            }
        }
        let h = &self.inertia.first_moment;
        Force {
            torque,
            force: spin.mul(Vec3::constant(like, &[h.x, h.y, h.z])),
        }
    }

    #[inline(always)]
    fn alone<S: Scalar>(&self, like: S) -> ArticulatedInertia<S> {
        let (zero, m) = (like.constant(0.0), like.constant(self.inertia.mass));
        let h = &self.inertia.first_moment;
        let [x, y, z] = [h.x, h.y, h.z].map(|h| like.constant(h));
        ArticulatedInertia {
            turning: Sym3::constant(like, &self.inertia.about_origin),
            coupling: Mat3([
                Vec3([zero, -z, y]),
                Vec3([z, zero, -x]),
                Vec3([-y, x, zero]),
            ]),
            mass: Sym3 {
                diagonal: [m; 3],
                off: [zero; 3],
            },
        }
    }

    /// This body with what hangs on it.
    #[inline(always)]
    fn with<S: Scalar>(&self, carried: ArticulatedInertia<S>) -> ArticulatedInertia<S> {
        let h = &self.inertia.first_moment;
        let ArticulatedInertia {
            turning,
            coupling: Mat3([mut x, mut y, mut z]),
            mut mass,
        } = carried;
        if self.is_heavy {
            x = Vec3([x[0], x[1].plus(-h.z), x[2].plus(h.y)]);
            y = Vec3([y[0].plus(h.z), y[1], y[2].plus(-h.x)]);
            z = Vec3([z[0].plus(-h.y), z[1].plus(h.x), z[2]]);
        }
        mass.diagonal = mass.diagonal.map(|m| m.plus(self.inertia.mass));
        ArticulatedInertia {
            turning: turning.plus(&self.inertia.about_origin),
            coupling: Mat3([x, y, z]),
            mass,
        }
    }
}

impl<S: Scalar> Slot<S> {
    /// Motion that positions and rates imply, for a parent that turns with `w` (and its `[w×]²`).
    #[inline(always)]
    fn set_motion(&mut self, hop: &Hop, body: &Body, w: Vec3<S>, parent_spin: Sym3<S>) {
        let mut w = hop.back(&self.turn, w);
        let across = [w[1] * self.qd, -(w[0] * self.qd)];
        let zero = self.qd.constant(0.0);
        self.own = if hop.shifts || hop.slides {
            Motion {
                angular: Vec3([zero; 3]),
                linear: hop.back(&self.turn, parent_spin.mul(hop.p_PK(self.q))),
            }
        } else {
            Motion::zero(zero)
        };
        if hop.slides {
            for (own, across) in self.own.linear.0.iter_mut().zip(across) {
                *own = across.times(2.0) + *own;
            }
        } else {
            self.own.angular = Vec3([across[0], across[1], zero]);
            w[2] = w[2] + self.qd;
        }
        self.w = w;
        self.spin = spin(w);
        self.bias = body.centrifugal(self.spin);
    }

    /// Lets the joint give way: what is left of inertia and force for the parent, in this frame.
    #[inline(always)]
    fn release(
        &mut self,
        hop: &Hop,
        inertia: ArticulatedInertia<S>,
        force: Force<S>,
    ) -> (ArticulatedInertia<S>, Force<S>) {
        if hop.slides {
            self.release_slide(inertia, force)
        } else {
            self.release_turn(hop, inertia, force)
        }
    }

    #[inline(always)]
    fn release_turn(
        &mut self,
        hop: &Hop,
        inertia: ArticulatedInertia<S>,
        force: Force<S>,
    ) -> (ArticulatedInertia<S>, Force<S>) {
        let ArticulatedInertia {
            turning: mut J,
            coupling: Mat3([mut hx, mut hy, u]),
            mass: mut M,
        } = inertia;
        let (ux, uy) = (J.off[1], J.off[0]);
        let inverse = J.diagonal[2].recip();
        let (kx, ky, k) = (ux * inverse, uy * inverse, u.scaled(inverse));
        J.diagonal[0] = ux.mul_sub_from(kx, J.diagonal[0]);
        J.diagonal[1] = uy.mul_sub_from(ky, J.diagonal[1]);
        J.off[2] = ux.mul_sub_from(ky, J.off[2]);
        for c in 0..3 {
            hx[c] = kx.mul_sub_from(u[c], hx[c]);
            hy[c] = ky.mul_sub_from(u[c], hy[c]);
        }
        take_product(&mut M, u, k);
        let zero = inverse.constant(0.0);
        (J.off[0], J.off[1], J.diagonal[2]) = (zero, zero, zero);

        let effort = self.effort - force.torque[2];
        self.free = effort * inverse;
        self.gain = Force {
            torque: Vec3([kx, ky, zero]),
            force: k,
        };
        let ([ax, ay, _], a) = (self.own.angular.0, self.own.linear);
        let mut left = Force {
            torque: Vec3([
                J.diagonal[0].mul_add(ax, J.off[2].mul_add(ay, force.torque[0])),
                J.off[2].mul_add(ax, J.diagonal[1].mul_add(ay, force.torque[1])),
                self.effort,
            ]),
            force: hx.mul_add(ax, hy.mul_add(ay, force.force)),
        };
        left.torque[0] = kx.mul_add(effort, left.torque[0]);
        left.torque[1] = ky.mul_add(effort, left.torque[1]);
        left.force = k.mul_add(effort, left.force);
        if hop.shifts {
            left.torque[0] = left.torque[0] + hx.dot(a);
            left.torque[1] = left.torque[1] + hy.dot(a);
            left.force = left.force + M.mul(a);
        }
        let rest = ArticulatedInertia {
            turning: J,
            coupling: Mat3([hx, hy, Vec3([zero; 3])]),
            mass: M,
        };
        (rest, left)
    }

    #[inline(always)]
    fn release_slide(
        &mut self,
        inertia: ArticulatedInertia<S>,
        force: Force<S>,
    ) -> (ArticulatedInertia<S>, Force<S>) {
        let ArticulatedInertia {
            turning: mut J,
            coupling: mut H,
            mass: mut M,
        } = inertia;
        let u = H.column(2);
        let (ux, uy) = (M.off[1], M.off[0]);
        let inverse = M.diagonal[2].recip();
        let (kx, ky, k) = (ux * inverse, uy * inverse, u.scaled(inverse));
        M.diagonal[0] = ux.mul_sub_from(kx, M.diagonal[0]);
        M.diagonal[1] = uy.mul_sub_from(ky, M.diagonal[1]);
        M.off[2] = ux.mul_sub_from(ky, M.off[2]);
        let zero = inverse.constant(0.0);
        for r in 0..3 {
            H.0[r][0] = u[r].mul_sub_from(kx, H.0[r][0]);
            H.0[r][1] = u[r].mul_sub_from(ky, H.0[r][1]);
            H.0[r][2] = zero;
        }
        take_product(&mut J, u, k);
        (M.off[0], M.off[1], M.diagonal[2]) = (zero, zero, zero);

        let effort = self.effort - force.force[2];
        self.free = effort * inverse;
        self.gain = Force {
            torque: k,
            force: Vec3([kx, ky, zero]),
        };
        let [ax, ay, _] = self.own.linear.0;
        let mut left = Force {
            torque: H
                .column(0)
                .mul_add(ax, H.column(1).mul_add(ay, force.torque)),
            force: Vec3([
                M.diagonal[0].mul_add(ax, M.off[2].mul_add(ay, force.force[0])),
                M.off[2].mul_add(ax, M.diagonal[1].mul_add(ay, force.force[1])),
                self.effort,
            ]),
        };
        left.torque = k.mul_add(effort, left.torque);
        left.force[0] = kx.mul_add(effort, left.force[0]);
        left.force[1] = ky.mul_add(effort, left.force[1]);
        let rest = ArticulatedInertia {
            turning: J,
            coupling: H,
            mass: M,
        };
        (rest, left)
    }

    /// Joint acceleration for the parent's, and the body's own.
    #[inline(always)]
    fn accelerate(&mut self, hop: &Hop, parent: Motion<S>) {
        let mut m = hop.motion_into(&self.turn, self.q, parent);
        let (g, own) = (&self.gain, &self.own);
        if hop.slides {
            m.linear = m.linear + own.linear;
            let along = g.force[0].mul_add(m.linear[0], g.force[1] * m.linear[1]);
            self.qdd = (self.free - m.linear[2]) - (along + g.torque.dot(m.angular));
            m.linear[2] = m.linear[2] + self.qdd;
        } else {
            m.angular[0] = m.angular[0] + own.angular[0];
            m.angular[1] = m.angular[1] + own.angular[1];
            if hop.shifts {
                m.linear = m.linear + own.linear;
            }
            let along = g.torque[0].mul_add(m.angular[0], g.torque[1] * m.angular[1]);
            self.qdd = (self.free - m.angular[2]) - (along + g.force.dot(m.linear));
            m.angular[2] = m.angular[2] + self.qdd;
        }
        self.acceleration = m;
    }
}

/// `m -= u kᵀ`, which is symmetric.
#[inline(always)]
fn take_product<S: Scalar>(m: &mut Sym3<S>, u: Vec3<S>, k: Vec3<S>) {
    for i in 0..3 {
        let (a, b) = others(i);
        m.diagonal[i] = u[i].mul_sub_from(k[i], m.diagonal[i]);
        m.off[i] = u[a].mul_sub_from(k[b], m.off[i]);
    }
}

/// Accelerations of a free-floating tree. `slots` hold positions (with their turns), rates and efforts of
/// the joints, and receive the joint accelerations; `branches` is scratch, one per body; `w` is the base's
/// angular velocity; `external` gives wrenches on the bodies in their kernel frames. Returns the base's
/// acceleration. All in kernel frames.
///
/// # Panics
/// If a slice is shorter than the tree needs.
#[inline(always)]
pub fn forward_dynamics<S: Scalar>(
    tree: &Tree,
    slots: &mut [Slot<S>],
    branches: &mut [Branch<S>],
    w: Vec3<S>,
    external: Option<&[Force<S>]>,
) -> Motion<S> {
    let n = tree.dof();
    let (slots, branches) = (&mut slots[..n], &mut branches[..=n]);
    let like = w[0];
    let base = &tree.bodies[0];
    let base_spin = spin(w);

    let (mut w_before, mut spin_before) = (w, base_spin);
    for (j, (hop, body)) in tree.hops.iter().zip(&tree.bodies[1..]).enumerate() {
        if !hop.follows {
            (w_before, spin_before) = match hop.parent.checked_sub(1) {
                None => (w, base_spin),
                Some(p) => (slots[p].w, slots[p].spin),
            };
        }
        let slot = &mut slots[j];
        slot.set_motion(hop, body, w_before, spin_before);
        (w_before, spin_before) = (slot.w, slot.spin);
    }

    let mut carried: Option<(ArticulatedInertia<S>, Force<S>)> = None;
    for (j, (hop, body)) in tree.hops.iter().zip(&tree.bodies[1..]).enumerate().rev() {
        let slot = &mut slots[j];
        let (inertia, force) = load(body, carried, slot.bias, &branches[j + 1], like);
        let force = unloaded(force, external, j + 1);
        let (rest, left) = slot.release(hop, inertia, force);
        let rest = hop.inertia_out(&slot.turn, slot.q, rest);
        let left = hop.force_out(&slot.turn, slot.q, left);
        carried = if hop.follows {
            Some((rest, left))
        } else {
            let branch = &mut branches[hop.parent];
            *branch = if hop.is_last {
                Branch {
                    inertia: rest,
                    force: left,
                }
            } else {
                Branch {
                    inertia: branch.inertia.plus(rest),
                    force: branch.force.plus(left),
                }
            };
            None
        };
    }

    let bias = base.centrifugal(base_spin);
    let (inertia, force) = load(base, carried, bias, &branches[0], like);
    let base_motion = inertia.answer(unloaded(force, external, 0));

    let mut before = base_motion;
    for (j, hop) in tree.hops.iter().enumerate() {
        if !hop.follows {
            before = match hop.parent.checked_sub(1) {
                None => base_motion,
                Some(p) => slots[p].acceleration,
            };
        }
        slots[j].accelerate(hop, before);
        before = slots[j].acceleration;
    }
    base_motion
}

/// A body's articulated inertia and the force that it takes, with all that hangs on it.
#[inline(always)]
fn load<S: Scalar>(
    body: &Body,
    carried: Option<(ArticulatedInertia<S>, Force<S>)>,
    bias: Force<S>,
    branch: &Branch<S>,
    like: S,
) -> (ArticulatedInertia<S>, Force<S>) {
    let (inertia, force) = match carried {
        None => (body.alone(like), bias),
        Some((inertia, force)) => (body.with(inertia), bias.plus(force)),
    };
    if body.branches {
        (inertia.plus(branch.inertia), force.plus(branch.force))
    } else {
        (inertia, force)
    }
}

/// `force` less the wrench that acts on `body`.
#[inline(always)]
fn unloaded<S: Scalar>(force: Force<S>, external: Option<&[Force<S>]>, body: usize) -> Force<S> {
    match external {
        None => force,
        Some(external) => Force {
            torque: force.torque - external[body].torque,
            force: force.force - external[body].force,
        },
    }
}

impl<S: Scalar> ArticulatedInertia<S> {
    /// Acceleration of a free body with this inertia that needs `force` to stay where it is.
    #[inline(always)]
    fn answer(&self, force: Force<S>) -> Motion<S> {
        let (H, inverse) = (self.coupling, self.mass.inverse());
        let eliminated = Mat3(H.0.map(|row| inverse.mul(row)));
        let mut left = self.turning;
        for i in 0..3 {
            let (j, k) = others(i);
            left.diagonal[i] = left.diagonal[i] - eliminated.0[i].dot(H.0[i]);
            left.off[i] = left.off[i] - eliminated.0[j].dot(H.0[k]);
        }
        let angular = left
            .inverse()
            .mul(eliminated.mul(force.force) - force.torque);
        let linear = -inverse.mul(force.force + H.tr_mul(angular));
        Motion { angular, linear }
    }
}
