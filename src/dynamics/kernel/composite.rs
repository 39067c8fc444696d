//! Poses, composite inertias, momentum map and generalized Jacobian, linear in the number of joints.
//!
//! Masutani 1995 eqs. (4.9)-(4.26), (4.36), (4.37), and what App. G does with matrices. A body's inertia
//! with its whole subtree is gathered in link frames, where the momentum that a joint gives to its subtree
//! is a row of it and costs nothing. Only these columns are brought to the base's axes.

use super::columns::{Column, Lever, Moves};
use super::hop::{Path, on_path};
use super::inertia::ArticulatedInertia;
use super::tree::{Body, Hop, QUARTER, STRAIGHT, Tree};
use super::vector::others;
use super::{Scalar, Sym3, Turn, Vec3};

/// What positions imply for a body and the joint that moves it. Axes are the base's (frame B) where
/// nothing else is said.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct Place<S> {
    /// Joint position: an input.
    pub q: S,
    /// Turn of the body's frame against its parent's, before the bend: an input.
    pub turn: Turn<S>,
    /// Axes of the body's kernel frame.
    pub axes: [Vec3<S>; 3],
    /// Origin of the kernel frame from the base's.
    pub p_BK: Vec3<S>,
    /// First moment of the subtree, kernel frame.
    first_moment: Vec3<S>,
    /// Moment of inertia of the subtree about the kernel frame's origin, kernel frame.
    inertia: Sym3<S>,
}

/// What positions imply for the whole tree, base axes.
#[derive(Debug, Clone, Copy)]
pub struct System<S> {
    /// Centre of mass from the base frame's origin.
    pub p_BC: Vec3<S>,
    /// Inertia about the centre of mass, `H_B` of eq. (4.25).
    pub H_B: Sym3<S>,
    /// `H_B⁻¹`.
    pub H_B_inverse: Sym3<S>,
}

/// Axes and origin of a kernel frame, base axes.
type Pose<S> = ([Vec3<S>; 3], Vec3<S>);

impl<S: Scalar> Place<S> {
    /// A place with nothing in it, numbers of the kind of `like`.
    pub fn new(like: S) -> Self {
        let (zero, none) = (like.constant(0.0), Vec3::zero(like));
        Self {
            q: zero,
            turn: Turn::new(like.constant(1.0), zero),
            axes: [none; 3],
            p_BK: none,
            first_moment: none,
            inertia: Sym3 {
                diagonal: [zero; 3],
                off: [zero; 3],
            },
        }
    }

    /// A vector of the kernel frame in the base's axes.
    #[inline(always)]
    pub fn turned(&self, v: Vec3<S>) -> Vec3<S> {
        let [x, y, z] = self.axes;
        x.mul_add(v[0], y.mul_add(v[1], z.scaled(v[2])))
    }

    /// The base's inertia with all joints locked, kernel frame.
    #[inline(always)]
    pub(crate) fn inertia_of(&self, tree: &Tree) -> ArticulatedInertia<S> {
        let mass = self.q.constant(tree.bodies[0].subtree_mass);
        ArticulatedInertia::rigid(mass, self.first_moment, self.inertia)
    }

    /// Begins what is gathered with the body alone.
    #[inline(always)]
    fn begin(&mut self, body: &Body, like: S) {
        let h = &body.inertia.first_moment;
        self.first_moment = Vec3::constant(like, &[h.x, h.y, h.z]);
        self.inertia = Sym3::constant(like, &body.inertia.about_origin);
    }

    #[inline(always)]
    fn follow(&mut self, hop: &Hop, parent: Pose<S>) -> Pose<S> {
        on_path!(hop, path => (self.axes, self.p_BK) = path.place(hop, &self.turn, self.q, parent));
        (self.axes, self.p_BK)
    }

    /// First moment and inertia of the subtree, which are these in the body's frame, as the parent feels
    /// them.
    #[inline(always)]
    fn gather(&mut self, hop: &Hop, mass: f64, (h, J): (Vec3<S>, Sym3<S>)) -> (Vec3<S>, Sym3<S>) {
        (self.first_moment, self.inertia) = (h, J);
        on_path!(hop, path => path.composite_out(hop, &self.turn, self.q, mass, h, J))
    }

    /// What the joint's columns are made of.
    #[inline(always)]
    pub(super) fn lever(&self) -> Lever<S> {
        Lever {
            axes: self.axes,
            p_BK: self.p_BK,
            across: [self.first_moment[0], self.first_moment[1]],
            inertia: self.inertia.row(2),
        }
    }
}

impl<const GENERAL: bool, const BEND: u8, const D: bool, const A: bool> Path<GENERAL, BEND, D, A> {
    /// Axes and origin of a body from its parent's.
    #[inline(always)]
    fn place<S: Scalar>(
        self,
        hop: &Hop,
        turn: &Turn<S>,
        q: S,
        ([mut x, mut y, mut z], mut origin): Pose<S>,
    ) -> Pose<S> {
        let Vec3([p0, p1, p2]) = Vec3::constant(q, &hop.p);
        if GENERAL {
            (x, y) = columns(&Turn::constant(q, &hop.swing), x, y);
            origin = y.mul_add(p1, z.mul_add(p2, origin));
        }
        if A || GENERAL {
            origin = x.mul_add(p0, origin);
        }
        match BEND {
            STRAIGHT => {}
            QUARTER => (y, z) = (z, -y),
            _ => (y, z) = columns(&Turn::constant(q, &hop.bend), y, z),
        }
        (x, y) = columns(turn, x, y);
        if D || GENERAL {
            origin = z.mul_add(hop.distance(q), origin);
        }
        ([x, y, z], origin)
    }

    /// First moment and inertia of a subtree of mass `mass` as its parent sees them.
    #[inline(always)]
    pub(super) fn composite_out<S: Scalar>(
        self,
        hop: &Hop,
        turn: &Turn<S>,
        q: S,
        mass: f64,
        h: Vec3<S>,
        J: Sym3<S>,
    ) -> (Vec3<S>, Sym3<S>) {
        let (mut h, mut J) = (h, J);
        if hop.slides {
            let p = hop.distance(q);
            let moment = p.times(mass);
            let (twice, square) = (p + p, p * moment);
            let shift = Shift {
                p,
                twice,
                moment,
                square,
            };
            (h, J) = shift.apply::<2>(h, J);
        } else if D || GENERAL {
            (h, J) = Shift::by(q, hop.d, mass).apply::<2>(h, J);
        }
        (h, J) = (turn.out::<2>(h), turn.sym::<2>(J));
        if BEND != STRAIGHT {
            (h, J) = (self.bent_out(hop, h), self.bent_sym_out(hop, J));
        }
        if A || GENERAL {
            (h, J) = Shift::by(q, hop.p[0], mass).apply::<0>(h, J);
        }
        if GENERAL {
            (h, J) = Shift::by(q, hop.p[1], mass).apply::<1>(h, J);
            (h, J) = Shift::by(q, hop.p[2], mass).apply::<2>(h, J);
            let swing = Turn::constant(q, &hop.swing);
            (h, J) = (swing.out::<2>(h), swing.sym::<2>(J));
        }
        (h, J)
    }
}

/// Two columns of a rotation after a turn in their plane.
#[inline(always)]
fn columns<S: Scalar>(turn: &Turn<S>, x: Vec3<S>, y: Vec3<S>) -> (Vec3<S>, Vec3<S>) {
    (
        x.mul_add(turn.cos, y.scaled(turn.sin)),
        y.mul_add(turn.cos, x.scaled(-turn.sin)),
    )
}

/// To a point from which the present one lies at `p` along one axis, of a mass `m`.
struct Shift<S> {
    p: S,
    /// `2 p`.
    twice: S,
    /// `m p`.
    moment: S,
    /// `m p²`.
    square: S,
}

impl<S: Scalar> Shift<S> {
    #[inline(always)]
    fn by(like: S, p: f64, mass: f64) -> Self {
        Self {
            p: like.constant(p),
            twice: like.constant(p + p),
            moment: like.constant(mass * p),
            square: like.constant(mass * p * p),
        }
    }

    /// First moment and inertia about that point.
    #[inline(always)]
    fn apply<const AXIS: usize>(&self, mut h: Vec3<S>, mut J: Sym3<S>) -> (Vec3<S>, Sym3<S>) {
        let (i, (j, k)) = (AXIS, others(AXIS));
        let more = self.twice.mul_add(h[i], self.square);
        J.diagonal[j] = J.diagonal[j] + more;
        J.diagonal[k] = J.diagonal[k] + more;
        J.off[k] = self.p.mul_sub_from(h[j], J.off[k]);
        J.off[j] = self.p.mul_sub_from(h[k], J.off[j]);
        h[i] = h[i] + self.moment;
        (h, J)
    }
}

/// Poses and composite inertias. `places`, one per body, hold positions and turns.
///
/// # Panics
/// If `places` is shorter than the tree needs.
#[inline(always)]
pub(crate) fn set_places<S: Scalar>(tree: &Tree, places: &mut [Place<S>]) {
    let count = tree.bodies.len();
    let (places, bodies) = (&mut places[..count], &tree.bodies[..count]);
    let like = places[0].q;
    let R_BK = bodies[0].X_BK.rotation.matrix();
    places[0].axes = [
        Vec3::constant(like, &R_BK.column(0).into_owned().into()),
        Vec3::constant(like, &R_BK.column(1).into_owned().into()),
        Vec3::constant(like, &R_BK.column(2).into_owned().into()),
    ];
    places[0].p_BK = Vec3::zero(like);
    for (place, body) in places.iter_mut().zip(bodies) {
        place.begin(body, like);
    }
    // Poses go outward while inertias are gathered inward: neither has to wait for the other.
    let mut pose = (places[0].axes, places[0].p_BK);
    let last = &places[tree.outward.last().map_or(0, |j| j + 1)];
    let mut gathered = (last.first_moment, last.inertia);
    for (&outward, &inward) in tree.outward.iter().zip(tree.outward.iter().rev()) {
        let hop = &tree.hops[outward];
        if !hop.follows {
            pose = (places[hop.parent].axes, places[hop.parent].p_BK);
        }
        pose = places[outward + 1].follow(hop, pose);
        let (hop, mass) = (&tree.hops[inward], bodies[inward + 1].subtree_mass);
        let (h, J) = places[inward + 1].gather(hop, mass, gathered);
        let parent = &mut places[hop.parent];
        gathered = (parent.first_moment + h, parent.inertia + J);
        if !hop.follows {
            (parent.first_moment, parent.inertia) = gathered;
            let next = &places[hop.before];
            gathered = (next.first_moment, next.inertia);
        }
    }
    (places[0].first_moment, places[0].inertia) = gathered;
}

/// Poses, composite inertias and momentum map. `places`, one per body, hold positions and turns; `columns`,
/// one per joint, receive the map.
///
/// # Panics
/// If a slice is shorter than the tree needs.
#[inline(always)]
pub fn momentum_map<S: Scalar>(
    tree: &Tree,
    places: &mut [Place<S>],
    columns: &mut [Column<S>],
) -> System<S> {
    set_places(tree, places);
    let (count, like) = (tree.dof(), places[0].q);
    let (levers, columns) = (&places[1..=count], &mut columns[..count]);
    let system = System::new(&places[0], tree.bodies[0].subtree_mass);
    let per = like.constant(1.0 / tree.bodies[0].subtree_mass);
    let answer = -system.H_B_inverse;
    for (j, (place, column)) in levers.iter().zip(columns).enumerate() {
        let moves = if tree.hops[j].slides {
            Moves::Sliding(like.constant(tree.bodies[j + 1].subtree_mass))
        } else {
            Moves::Turning
        };
        *column = Column::new(&place.lever(), moves, system.p_BC, &answer, per);
    }
    system
}

impl<S: Scalar> System<S> {
    #[inline(always)]
    pub(super) fn new(base: &Place<S>, mass: f64) -> Self {
        let (p, J) = about_com(base.first_moment, base.inertia, mass);
        let H_B = rotated(J, &base.axes);
        Self {
            p_BC: base.turned(p),
            H_B,
            H_B_inverse: H_B.inverse(),
        }
    }
}

/// Centre of mass, and the inertia about it instead of about the origin.
#[inline(always)]
pub(super) fn about_com<S: Scalar>(h: Vec3<S>, mut J: Sym3<S>, mass: f64) -> (Vec3<S>, Sym3<S>) {
    let p = h.scaled(h[0].constant(1.0 / mass));
    let squares = [p[0] * h[0], p[1] * h[1], p[2] * h[2]];
    for i in 0..3 {
        let (j, k) = others(i);
        J.diagonal[i] = J.diagonal[i] - (squares[j] + squares[k]);
        J.off[i] = p[j].mul_add(h[k], J.off[i]);
    }
    (p, J)
}

/// A tensor of the kernel frame in the axes in which those of the frame are given.
#[inline(always)]
fn rotated<S: Scalar>(m: Sym3<S>, axes: &[Vec3<S>; 3]) -> Sym3<S> {
    let [x, y, z] = *axes;
    let rows = [
        Vec3([x[0], y[0], z[0]]),
        Vec3([x[1], y[1], z[1]]),
        Vec3([x[2], y[2], z[2]]),
    ];
    let images = [m.times(rows[0]), m.times(rows[1]), m.times(rows[2])];
    let mut turned = m;
    for i in 0..3 {
        let (j, k) = others(i);
        turned.diagonal[i] = rows[i].dot(images[i]);
        turned.off[i] = rows[j].dot(images[k]);
    }
    turned
}

/// Generalized Jacobian of a point fixed to `body` at `p_KE` in its kernel frame: one column per joint,
/// linear rows first, after [`momentum_map`]. Masutani 1995 eqs. (4.36), (4.37).
///
/// # Panics
/// If a slice is shorter than the tree needs.
#[inline(always)]
pub fn generalized_jacobian<S: Scalar>(
    tree: &Tree,
    places: &[Place<S>],
    columns: &[Column<S>],
    system: &System<S>,
    body: usize,
    p_KE: &[f64; 3],
    out: &mut [[S; 6]],
) {
    let end = &places[body];
    let p_BE = end.turned(Vec3::constant(end.q, p_KE)) + end.p_BK;
    let r_CE = p_BE - system.p_BC;
    for (column, out) in columns.iter().zip(out.iter_mut()) {
        let [Vec3([x, y, z]), Vec3([a, b, c])] = column.of_base(r_CE);
        *out = [x, y, z, a, b, c];
    }
    let mut body = body;
    while body > 0 {
        let (place, out) = (&places[body], &mut out[body - 1]);
        let hop = &tree.hops[body - 1];
        let axis = place.axes[2];
        let linear = if hop.slides {
            axis
        } else {
            for (entry, axis) in out[3..].iter_mut().zip(axis.0) {
                *entry = *entry + axis;
            }
            axis.cross(p_BE - place.p_BK)
        };
        for (entry, linear) in out[..3].iter_mut().zip(linear.0) {
            *entry = *entry + linear;
        }
        body = hop.parent;
    }
}
