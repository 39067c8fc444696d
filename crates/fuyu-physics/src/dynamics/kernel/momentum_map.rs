//! Poses, composite inertias, momentum map and generalized Jacobian, linear in the number of joints.
//!
//! Masutani 1995 eqs. (4.9)-(4.26), (4.36), (4.37), and what App. G does with matrices. A body's inertia
//! with its whole subtree is gathered in link frames, where the momentum that a joint gives to its subtree
//! is a row of it and costs nothing. Only these columns are brought to the base's axes.

use super::composite_inertia::Composite;
use super::joint_transform::{Path, on_path};
use super::momentum_columns::{Column, Lever, Moves};
use super::tree::{Hop, QUARTER, STRAIGHT, Tree};
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
    /// First moment of the subtree across the joint's axis, kernel frame.
    across: [S; 2],
    /// Row of the subtree's inertia along the joint's axis, kernel frame.
    inertia: Vec3<S>,
    /// The subtree, as far as gathered, where branches meet.
    subtree: Composite<S>,
}

/// Where the sweeps find turns and leave what they find, body by body.
pub(super) trait Places<S> {
    /// Position of the joint that moves a body.
    fn q(&self, body: usize) -> S;
    /// The body's turn.
    fn turn(&self, body: usize) -> Turn<S>;
    fn pose(&self, body: usize) -> Pose<S>;
    fn set_pose(&mut self, body: usize, pose: Pose<S>);
    /// What the columns need of a joint's subtree: the first moment across its axis and the inertia along it.
    fn set_subtree(&mut self, body: usize, across: [S; 2], inertia: Vec3<S>);
    /// The subtree, as far as gathered.
    fn gathered(&self, body: usize) -> Composite<S>;
    fn set_gathered(&mut self, body: usize, subtree: Composite<S>);
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
#[derive(Debug, Clone, Copy)]
pub(super) struct Pose<S> {
    pub axes: [Vec3<S>; 3],
    pub p_BK: Vec3<S>,
}

impl<S: Scalar> Pose<S> {
    /// The base's.
    #[inline(always)]
    pub(super) fn of_base(tree: &Tree, like: S) -> Self {
        let R_BK = tree.base_axes().matrix();
        let axis = |i| [R_BK[(0, i)], R_BK[(1, i)], R_BK[(2, i)]];
        Self {
            axes: [
                Vec3::constant(like, &axis(0)),
                Vec3::constant(like, &axis(1)),
                Vec3::constant(like, &axis(2)),
            ],
            p_BK: Vec3::zero(like),
        }
    }

    /// A vector of the kernel frame in the base's axes.
    #[inline(always)]
    pub(super) fn turned(&self, v: Vec3<S>) -> Vec3<S> {
        let [x, y, z] = self.axes;
        x.mul_add(v[0], y.mul_add(v[1], z.scaled(v[2])))
    }
}

impl<S: Scalar> Place<S> {
    /// A place with nothing in it, numbers of the kind of `like`.
    pub fn new(like: S) -> Self {
        let (zero, none) = (like.constant(0.0), Vec3::zero(like));
        Self {
            q: zero,
            turn: Turn::new(like.constant(1.0), zero),
            axes: [none; 3],
            p_BK: none,
            across: [zero; 2],
            inertia: none,
            subtree: Composite {
                first_moment: none,
                inertia: Sym3 {
                    diagonal: [zero; 3],
                    off: [zero; 3],
                },
            },
        }
    }

    /// What the joint's columns are made of.
    #[inline(always)]
    fn lever(&self) -> Lever<S> {
        Lever {
            axes: self.axes,
            p_BK: self.p_BK,
            across: self.across,
            inertia: self.inertia,
        }
    }
}

impl<S: Scalar> Places<S> for [Place<S>] {
    #[inline(always)]
    fn q(&self, body: usize) -> S {
        self[body].q
    }

    #[inline(always)]
    fn turn(&self, body: usize) -> Turn<S> {
        self[body].turn
    }

    #[inline(always)]
    fn pose(&self, body: usize) -> Pose<S> {
        let Place { axes, p_BK, .. } = self[body];
        Pose { axes, p_BK }
    }

    #[inline(always)]
    fn set_pose(&mut self, body: usize, pose: Pose<S>) {
        (self[body].axes, self[body].p_BK) = (pose.axes, pose.p_BK);
    }

    #[inline(always)]
    fn set_subtree(&mut self, body: usize, across: [S; 2], inertia: Vec3<S>) {
        (self[body].across, self[body].inertia) = (across, inertia);
    }

    #[inline(always)]
    fn gathered(&self, body: usize) -> Composite<S> {
        self[body].subtree
    }

    #[inline(always)]
    fn set_gathered(&mut self, body: usize, subtree: Composite<S>) {
        self[body].subtree = subtree;
    }
}

impl<const GENERAL: bool, const BEND: u8, const D: bool, const A: bool> Path<GENERAL, BEND, D, A> {
    /// Axes and origin of a body from its parent's.
    #[inline(always)]
    fn place<S: Scalar>(self, hop: &Hop, turn: &Turn<S>, q: S, parent: Pose<S>) -> Pose<S> {
        let ([mut x, mut y, mut z], mut origin) = (parent.axes, parent.p_BK);
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
        Pose {
            axes: [x, y, z],
            p_BK: origin,
        }
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

/// Poses and composite inertias. `places` hold positions and turns. Returns the inertia of the whole tree, about
/// the base's origin in the axes of its kernel frame.
#[inline(always)]
pub(super) fn set_places<S: Scalar>(
    tree: &Tree,
    like: S,
    places: &mut (impl Places<S> + ?Sized),
) -> Composite<S> {
    let bodies = &tree.bodies[..];
    for &leaf in &tree.leaves {
        places.set_gathered(leaf, Composite::constant(like, &bodies[leaf].about_foot));
    }
    // Poses go outward while inertias are gathered inward: neither has to wait for the other.
    let mut pose = Pose::of_base(tree, like);
    places.set_pose(0, pose);
    let joints = tree.dof();
    let mut subtree = places.gathered(joints);
    for outward in 0..joints {
        let (hop, body) = (&tree.hops[outward], outward + 1);
        if hop.parent != outward {
            pose = places.pose(hop.parent);
        }
        let (turn, q) = (places.turn(body), places.q(body));
        pose = on_path!(hop, path => path.place(hop, &turn, q, pose));
        places.set_pose(body, pose);

        // Inward, the body that is next is always the one with the next lower number; if it is not the parent, it
        // is the tip of another branch.
        let inward = joints - 1 - outward;
        let (hop, body) = (&tree.hops[inward], inward + 1);
        let across = [subtree.first_moment[0], subtree.first_moment[1]];
        places.set_subtree(body, across, subtree.along_axis(bodies[body].rise));
        let (turn, q) = (places.turn(body), places.q(body));
        subtree = subtree.handed_on(hop, &turn, q, bodies[body].subtree_mass);
        if !hop.arrives_first {
            subtree = subtree.plus(places.gathered(hop.parent));
        }
        if hop.parent != inward {
            places.set_gathered(hop.parent, subtree);
            subtree = places.gathered(inward);
        }
    }
    subtree
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
    let (count, like) = (tree.dof(), places[0].q);
    let whole = set_places(tree, like, places);
    let (levers, columns) = (&places[1..=count], &mut columns[..count]);
    let system = System::new(whole, &places.pose(0), tree.bodies[0].subtree_mass);
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
    pub(super) fn new(whole: Composite<S>, base: &Pose<S>, mass: f64) -> Self {
        let (p, J) = about_com(whole, mass);
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
pub(super) fn about_com<S: Scalar>(whole: Composite<S>, mass: f64) -> (Vec3<S>, Sym3<S>) {
    let (h, mut J) = (whole.first_moment, whole.inertia);
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
    let end = places.pose(body);
    let p_BE = end.turned(Vec3::constant(places[body].q, p_KE)) + end.p_BK;
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
