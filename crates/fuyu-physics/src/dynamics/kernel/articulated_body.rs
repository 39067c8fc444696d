//! Forward dynamics by articulated bodies, linear in the number of joints.
//!
//! Featherstone's algorithm in link frames, with three things done otherwise than in the textbook.
//! Accelerations are those of the frames' origins as points, so that linear velocities are never needed. A
//! body's inertia is kept in its three blocks, and what a joint makes zero is not computed. The joint
//! itself takes no part beyond one row: its axis is a coordinate axis.

use super::articulated_inertia::ArticulatedInertia;
use super::joint_transform::{Force, Motion, Path, on_path};
use super::tree::{BENT, Body, Hop, Tree};
use super::vector::others;
use super::{Mat3, Scalar, Sym3, Turn, Vec3};

/// What the sweeps keep of a body and of the joint that moves it, in the body's kernel frame. Slot 0 is the
/// base's, which no joint moves. Numbers as wide as a cache line shall not lie across two.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct Slot<S> {
    /// Joint position \[rad or m\].
    pub q: S,
    /// Joint rate.
    pub qd: S,
    /// Joint effort, springs and dampers included.
    pub effort: S,
    /// Turn of the body's frame against its parent's, before the bend.
    pub turn: Turn<S>,
    /// Joint acceleration: a result.
    pub qdd: S,
    /// Acceleration of the body: a result.
    pub acceleration: Motion<S>,
    /// Angular velocity; the base's is an input.
    pub w: Vec3<S>,
    /// `[w×]²`.
    pub(super) spin: Sym3<S>,
    /// Acceleration that the body has beyond its parent's at zero joint acceleration.
    pub(super) own: Motion<S>,
    /// Force that the body and what hangs on it take, gathered.
    pub(super) force: Force<S>,
    /// Inertia of the body and what hangs on it, gathered.
    inertia: ArticulatedInertia<S>,
    /// What the parent's acceleration takes of the joint's.
    gain: Force<S>,
    /// Joint acceleration while the parent does not accelerate.
    free: S,
}

impl<S: Scalar> Slot<S> {
    /// A slot with nothing in it, numbers of the kind of `like`.
    pub fn new(like: S) -> Self {
        let (zero, none) = (like.constant(0.0), Vec3::zero(like));
        let sym = spin(none);
        Self {
            q: zero,
            qd: zero,
            effort: zero,
            turn: Turn::new(like.constant(1.0), zero),
            qdd: zero,
            acceleration: Motion::zero(like),
            w: none,
            spin: sym,
            own: Motion::zero(like),
            force: Force::zero(like),
            inertia: ArticulatedInertia {
                turning: sym,
                coupling: Mat3([none; 3]),
                mass: sym,
            },
            gain: Force::zero(like),
            free: zero,
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
            let Vec3(off) = Vec3::constant(like, &m.off_diagonal.into());
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
            force: if self.is_heavy {
                spin.times(Vec3::constant(like, &[h.x, h.y, h.z]))
            } else {
                Vec3::zero(like)
            },
        }
    }

    #[inline(always)]
    fn alone<S: Scalar>(&self, like: S) -> ArticulatedInertia<S> {
        let h = &self.inertia.first_moment;
        ArticulatedInertia::rigid(
            like.constant(self.inertia.mass),
            Vec3::constant(like, &[h.x, h.y, h.z]),
            Sym3::constant(like, &self.inertia.about_origin),
        )
    }
}

/// Inertia of a body and what hangs on it, and the force that they take.
type Gathered<S> = (ArticulatedInertia<S>, Force<S>);

impl<S: Scalar> Slot<S> {
    /// Turns the body as positions and rates imply, against a parent that turns at `w`, whose spin this is.
    #[inline(always)]
    pub(super) fn set_motion(&mut self, hop: &Hop, w: Vec3<S>, spin: Sym3<S>) {
        let mut w = on_path!(hop, path => {
            if path.shifts() || hop.slides {
                let centripetal = path.times_origin(hop, self.q, spin);
                self.own.linear = path.back(hop, &self.turn, centripetal);
            }
            path.back(hop, &self.turn, w)
        });
        let across = [w[1] * self.qd, -(w[0] * self.qd)];
        if hop.slides {
            for (own, across) in self.own.linear.0.iter_mut().zip(across) {
                *own = across.times(2.0) + *own;
            }
        } else {
            (self.own.angular[0], self.own.angular[1]) = (across[0], across[1]);
            w[2] = w[2] + self.qd;
        }
        self.w = w;
    }

    /// Begins what is gathered with the body alone.
    #[inline(always)]
    pub(super) fn begin(&mut self, body: &Body, external: Option<&Force<S>>) {
        self.spin = spin(self.w);
        self.force = body.centrifugal(self.spin);
        if let Some(external) = external {
            self.force = Force {
                torque: self.force.torque - external.torque,
                force: self.force.force - external.force,
            };
        }
        self.inertia = body.alone(self.w[0]);
    }

    /// Lets the joint give way; what is left of inertia and force, as the parent feels it.
    #[inline(always)]
    fn release(&mut self, hop: &Hop, gathered: Gathered<S>) -> Gathered<S> {
        if hop.slides {
            let (inertia, force) = self.release_slide(gathered);
            let path = Path::<true, BENT, true, true>;
            let inertia = path.inertia_out::<S, true>(hop, &self.turn, self.q, inertia);
            (inertia, path.force_out(hop, &self.turn, self.q, force))
        } else {
            on_path!(hop, path => {
                let (inertia, force) = self.release_turn(path.shifts(), gathered);
                let inertia = path.inertia_out::<S, false>(hop, &self.turn, self.q, inertia);
                (inertia, path.force_out(hop, &self.turn, self.q, force))
            })
        }
    }

    #[inline(always)]
    fn release_turn(&mut self, shifts: bool, (inertia, force): Gathered<S>) -> Gathered<S> {
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
        if shifts {
            left.torque[0] = left.torque[0] + hx.dot(a);
            left.torque[1] = left.torque[1] + hy.dot(a);
            left.force = left.force + M.times(a);
        }
        let rest = ArticulatedInertia {
            turning: J,
            coupling: Mat3([hx, hy, Vec3([zero; 3])]),
            mass: M,
        };
        (rest, left)
    }

    #[inline(always)]
    fn release_slide(&mut self, (inertia, force): Gathered<S>) -> Gathered<S> {
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
    fn accelerate(&mut self, hop: &Hop, parent: &Motion<S>) -> Motion<S> {
        if hop.slides {
            let path = Path::<true, BENT, true, true>;
            let mut m = path.motion_back(hop, &self.turn, self.q, *parent);
            m.linear = m.linear + self.own.linear;
            let g = &self.gain;
            let along = g.force[0].mul_add(m.linear[0], g.force[1] * m.linear[1]);
            self.qdd = (self.free - m.linear[2]) - (along + g.torque.dot(m.angular));
            m.linear[2] = m.linear[2] + self.qdd;
            self.acceleration = m;
            m
        } else {
            on_path!(hop, path => {
                let m = path.motion_back(hop, &self.turn, self.q, *parent);
                self.turn_free(path.shifts(), m)
            })
        }
    }

    #[inline(always)]
    fn turn_free(&mut self, shifts: bool, mut m: Motion<S>) -> Motion<S> {
        let (g, own) = (&self.gain, &self.own);
        m.angular[0] = m.angular[0] + own.angular[0];
        m.angular[1] = m.angular[1] + own.angular[1];
        if shifts {
            m.linear = m.linear + own.linear;
        }
        let along = g.torque[0].mul_add(m.angular[0], g.torque[1] * m.angular[1]);
        self.qdd = (self.free - m.angular[2]) - (along + g.force.dot(m.linear));
        m.angular[2] = m.angular[2] + self.qdd;
        self.acceleration = m;
        m
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

/// Accelerations of a free-floating tree. `slots`, one per body, hold positions (with their turns), rates
/// and efforts of the joints and the base's angular velocity, and receive the accelerations. `external`
/// gives wrenches on the bodies. All in kernel frames.
///
/// # Panics
/// If a slice is shorter than the tree needs.
#[inline(always)]
pub fn forward_dynamics<S: Scalar>(
    tree: &Tree,
    slots: &mut [Slot<S>],
    external: Option<&[Force<S>]>,
) {
    let count = tree.bodies.len();
    let (slots, bodies) = (&mut slots[..count], &tree.bodies[..count]);
    let external = external.map(|e| &e[..count]);
    slots[0].begin(&bodies[0], external.map(|e| &e[0]));
    let mut before = (slots[0].w, slots[0].spin);
    for &j in &tree.outward {
        let hop = &tree.hops[j];
        if !hop.follows {
            before = (slots[hop.parent].w, slots[hop.parent].spin);
        }
        let slot = &mut slots[j + 1];
        slot.set_motion(hop, before.0, before.1);
        slot.begin(&bodies[j + 1], external.map(|e| &e[j + 1]));
        before = (slot.w, slot.spin);
    }
    let last = &slots[tree.outward.last().map_or(0, |j| j + 1)];
    let mut gathered = (last.inertia, last.force);
    for &j in tree.outward.iter().rev() {
        let hop = &tree.hops[j];
        let (inertia, force) = slots[j + 1].release(hop, gathered);
        let parent = &mut slots[hop.parent];
        gathered = (parent.inertia.plus(inertia), parent.force.plus(force));
        if !hop.follows {
            (parent.inertia, parent.force) = gathered;
            let next = &slots[hop.before];
            gathered = (next.inertia, next.force);
        }
    }
    let (inertia, force) = gathered;
    let mut acceleration = inertia.answer(force);
    slots[0].acceleration = acceleration;
    for &j in &tree.outward {
        let hop = &tree.hops[j];
        if !hop.follows {
            acceleration = slots[hop.parent].acceleration;
        }
        acceleration = slots[j + 1].accelerate(hop, &acceleration);
    }
}
