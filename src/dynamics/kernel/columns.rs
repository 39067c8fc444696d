//! Columns of the momentum map and of the generalized Jacobian: one joint's, or several joints' side by side.

use pulp::Simd;

use super::composite::{Place, System};
use super::tree::Tree;
use super::{Eight, GROUP, Lanes, Scalar, Sym3, Vec3};

/// A joint with the subtree that it moves: what its columns are made of. Base axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lever<S> {
    /// Axes of the kernel frame of the body that the joint moves.
    pub axes: [Vec3<S>; 3],
    /// Origin of that frame from the base's.
    pub p_BK: Vec3<S>,
    /// First moment of the subtree across the joint's axis, kernel frame.
    pub across: [S; 2],
    /// Row of the subtree's inertia along the joint's axis, kernel frame.
    pub inertia: Vec3<S>,
}

/// How a joint moves.
#[derive(Debug, Clone, Copy)]
pub(super) enum Moves<S> {
    Turning,
    /// Carrying this mass.
    Sliding(S),
    /// Some of several joints turn (1 there) and some slide: the mass that they carry, or 0.
    Mixed {
        turning: S,
        sliding: S,
    },
}

/// A joint's columns of the momentum map and of what follows from it, base axes.
#[derive(Debug, Clone, Copy)]
pub struct Column<S> {
    /// Angular momentum of the subtree at unit joint rate with the base held, about the kernel frame's
    /// origin.
    pub torque: Vec3<S>,
    /// Linear momentum of the subtree at unit joint rate with the base held.
    pub force: Vec3<S>,
    /// Column of `J_C`, eq. (4.12).
    pub J_C: Vec3<S>,
    /// Column of `H_M`, eq. (4.26).
    pub H_M: Vec3<S>,
    /// Column of `H_A = -H_B⁻¹ H_M`, eq. (4.24).
    pub H_A: Vec3<S>,
}

impl<S: Scalar> Column<S> {
    /// A column of zeros, numbers of the kind of `like`.
    pub fn zero(like: S) -> Self {
        let none = Vec3::zero(like);
        Self {
            torque: none,
            force: none,
            J_C: none,
            H_M: none,
            H_A: none,
        }
    }

    /// `answer` is `-H_B⁻¹`, `per` one over the whole mass.
    #[inline(always)]
    pub(super) fn new(
        lever: &Lever<S>,
        moves: Moves<S>,
        p_BC: Vec3<S>,
        answer: &Sym3<S>,
        per: S,
    ) -> Self {
        let ([x, y, z], [h, k], inertia) = (lever.axes, lever.across, lever.inertia);
        let spun = || x.mul_add(inertia[0], y.mul_add(inertia[1], z.scaled(inertia[2])));
        let swept = || y.mul_add(h, x.scaled(-k));
        let (torque, force) = match moves {
            Moves::Turning => (spun(), swept()),
            Moves::Sliding(mass) => (-swept(), z.scaled(mass)),
            Moves::Mixed { turning, sliding } => {
                let swept = swept();
                let slides = turning.mul_sub_from(turning, turning.constant(1.0));
                (
                    spun().mul_add(turning, -swept.scaled(slides)),
                    swept.mul_add(turning, z.scaled(sliding)),
                )
            }
        };
        let H_M = torque + (lever.p_BK - p_BC).cross(force);
        Self {
            torque,
            force,
            J_C: force.scaled(per),
            H_M,
            H_A: answer.times(H_M),
        }
    }

    /// Motion of a point of the base at `r_CE` from the centre of mass, linear part first.
    #[inline(always)]
    pub(super) fn of_base(&self, r_CE: Vec3<S>) -> [Vec3<S>; 2] {
        [self.H_A.cross(r_CE) - self.J_C, self.H_A]
    }
}

/// Eight joints side by side: their levers, and their columns.
#[derive(Debug, Clone)]
pub(crate) struct JointGroup {
    axes: [[Eight; 3]; 3],
    p_BK: [Eight; 3],
    across: [Eight; 2],
    inertia: [Eight; 3],
    turning: Eight,
    sliding: Eight,
    is_mixed: bool,
    torque: [Eight; 3],
    force: [Eight; 3],
    J_C: [Eight; 3],
    H_M: [Eight; 3],
    H_A: [Eight; 3],
}

impl JointGroup {
    /// Groups for all joints of a tree.
    pub(crate) fn of(tree: &Tree) -> Vec<Self> {
        let groups = tree.hops.chunks(GROUP).enumerate().map(|(group, hops)| {
            let mut made = Self {
                axes: [[Eight::ZERO; 3]; 3],
                p_BK: [Eight::ZERO; 3],
                across: [Eight::ZERO; 2],
                inertia: [Eight::ZERO; 3],
                turning: Eight([1.0; GROUP]),
                sliding: Eight::ZERO,
                is_mixed: hops.iter().any(|hop| hop.slides),
                torque: [Eight::ZERO; 3],
                force: [Eight::ZERO; 3],
                J_C: [Eight::ZERO; 3],
                H_M: [Eight::ZERO; 3],
                H_A: [Eight::ZERO; 3],
            };
            for (i, hop) in hops.iter().enumerate() {
                if hop.slides {
                    made.turning.0[i] = 0.0;
                    made.sliding.0[i] = tree.bodies[group * GROUP + i + 1].subtree_mass;
                }
            }
            made
        });
        groups.collect()
    }

    /// The columns of joint `i` of the group.
    #[inline(always)]
    pub(crate) fn column(&self, i: usize) -> Column<f64> {
        Column {
            torque: one(&self.torque, i),
            force: one(&self.force, i),
            J_C: one(&self.J_C, i),
            H_M: one(&self.H_M, i),
            H_A: one(&self.H_A, i),
        }
    }

    #[inline(always)]
    fn set_lever(&mut self, i: usize, lever: &Lever<f64>) {
        for (rows, axis) in self.axes.iter_mut().zip(lever.axes) {
            put(rows, i, axis);
        }
        put(&mut self.p_BK, i, lever.p_BK);
        put(&mut self.inertia, i, lever.inertia);
        self.across[0].0[i] = lever.across[0];
        self.across[1].0[i] = lever.across[1];
    }

    #[inline(always)]
    fn lever<S: Simd>(&self, simd: S, first: usize) -> Lever<Lanes<S>> {
        let [x, y, z] = &self.axes;
        let [h, k] = &self.across;
        Lever {
            axes: [
                load(simd, x, first),
                load(simd, y, first),
                load(simd, z, first),
            ],
            p_BK: load(simd, &self.p_BK, first),
            across: [
                Lanes::load(simd, &h.0[first..]),
                Lanes::load(simd, &k.0[first..]),
            ],
            inertia: load(simd, &self.inertia, first),
        }
    }

    #[inline(always)]
    fn set_columns<S: Simd>(&mut self, simd: S, system: &System<f64>, mass: f64) {
        let p_BC = splat(simd, system.p_BC);
        let inverse = &system.H_B_inverse;
        let answer = Sym3 {
            diagonal: splat(simd, -Vec3(inverse.diagonal)).0,
            off: splat(simd, -Vec3(inverse.off)).0,
        };
        let per = Lanes::splat(simd, 1.0 / mass);
        for first in (0..GROUP).step_by(S::F64_LANES) {
            let lever = self.lever(simd, first);
            let moves = if self.is_mixed {
                Moves::Mixed {
                    turning: Lanes::load(simd, &self.turning.0[first..]),
                    sliding: Lanes::load(simd, &self.sliding.0[first..]),
                }
            } else {
                Moves::Turning
            };
            let column = Column::new(&lever, moves, p_BC, &answer, per);
            store(column.torque, &mut self.torque, first);
            store(column.force, &mut self.force, first);
            store(column.J_C, &mut self.J_C, first);
            store(column.H_M, &mut self.H_M, first);
            store(column.H_A, &mut self.H_A, first);
        }
    }

    /// Columns of the generalized Jacobian; `carries` is 1 for joints that move the point.
    #[inline(always)]
    fn jacobian<S: Simd>(
        &self,
        simd: S,
        r_CE: Vec3<f64>,
        p_BE: Vec3<f64>,
        carries: &Eight,
        columns: &mut [[f64; 6]],
    ) {
        let (r_CE, p_BE) = (splat(simd, r_CE), splat(simd, p_BE));
        let mut rows = [[Eight::ZERO; 3]; 2];
        for first in (0..GROUP).step_by(S::F64_LANES) {
            let column = Column {
                torque: r_CE,
                force: r_CE,
                J_C: load(simd, &self.J_C, first),
                H_M: r_CE,
                H_A: load(simd, &self.H_A, first),
            };
            let [mut linear, mut angular] = column.of_base(r_CE);
            let axis = load(simd, &self.axes[2], first);
            let arm = p_BE - load(simd, &self.p_BK, first);
            let carries = Lanes::load(simd, &carries.0[first..]);
            if self.is_mixed {
                let turns = carries * Lanes::load(simd, &self.turning.0[first..]);
                linear = axis.mul_add(carries - turns, linear);
                linear = axis.cross(arm).mul_add(turns, linear);
                angular = axis.mul_add(turns, angular);
            } else {
                linear = axis.cross(arm).mul_add(carries, linear);
                angular = axis.mul_add(carries, angular);
            }
            store(linear, &mut rows[0], first);
            store(angular, &mut rows[1], first);
        }
        let [linear, angular] = &rows;
        for (i, column) in columns.iter_mut().enumerate().take(GROUP) {
            let (Vec3([x, y, z]), Vec3([a, b, c])) = (one(linear, i), one(angular, i));
            *column = [x, y, z, a, b, c];
        }
    }
}

/// The columns of the momentum map of a tree whose places are set.
#[inline(always)]
pub(crate) fn set_columns<S: Simd>(
    simd: S,
    tree: &Tree,
    places: &[Place<f64>],
    groups: &mut [JointGroup],
) -> System<f64> {
    let mass = tree.bodies[0].subtree_mass;
    // First, since all columns wait for it, and while it waits for itself levers can be set.
    let system = System::new(&places[0], mass);
    for (group, places) in groups.iter_mut().zip(places[1..].chunks(GROUP)) {
        for (i, place) in places.iter().enumerate().take(GROUP) {
            group.set_lever(i, &place.lever());
        }
    }
    for group in groups {
        group.set_columns(simd, &system, mass);
    }
    system
}

/// [`super::generalized_jacobian`] from columns side by side; `p_BE` is the point, from the base's origin.
#[inline(always)]
pub(crate) fn set_jacobian<S: Simd>(
    simd: S,
    tree: &Tree,
    groups: &[JointGroup],
    system: &System<f64>,
    body: usize,
    p_BE: Vec3<f64>,
    columns: &mut [[f64; 6]],
) {
    let r_CE = p_BE - system.p_BC;
    let mut body = body;
    // Parents come before their children, so one walk down from the tip meets the groups in turn.
    for (g, (group, columns)) in groups
        .iter()
        .zip(columns.chunks_mut(GROUP))
        .enumerate()
        .rev()
    {
        let mut path = 0_u64;
        while body > g * GROUP {
            path |= 1 << (body - 1 - g * GROUP);
            body = tree.hops[body - 1].parent;
        }
        let mut carries = Eight::ZERO;
        for (i, carries) in carries.0.iter_mut().enumerate() {
            *carries = if path & (1 << i) == 0 { 0.0 } else { 1.0 };
        }
        group.jacobian(simd, r_CE, p_BE, &carries, columns);
    }
}

#[inline(always)]
fn one(rows: &[Eight; 3], i: usize) -> Vec3<f64> {
    Vec3([rows[0].0[i], rows[1].0[i], rows[2].0[i]])
}

#[inline(always)]
fn put(rows: &mut [Eight; 3], i: usize, v: Vec3<f64>) {
    (rows[0].0[i], rows[1].0[i], rows[2].0[i]) = (v[0], v[1], v[2]);
}

#[inline(always)]
fn splat<S: Simd>(simd: S, v: Vec3<f64>) -> Vec3<Lanes<S>> {
    Vec3([
        Lanes::splat(simd, v[0]),
        Lanes::splat(simd, v[1]),
        Lanes::splat(simd, v[2]),
    ])
}

#[inline(always)]
fn load<S: Simd>(simd: S, rows: &[Eight; 3], first: usize) -> Vec3<Lanes<S>> {
    Vec3([
        Lanes::load(simd, &rows[0].0[first..]),
        Lanes::load(simd, &rows[1].0[first..]),
        Lanes::load(simd, &rows[2].0[first..]),
    ])
}

#[inline(always)]
fn store<S: Simd>(v: Vec3<Lanes<S>>, rows: &mut [Eight; 3], first: usize) {
    v[0].store(&mut rows[0].0[first..]);
    v[1].store(&mut rows[1].0[first..]);
    v[2].store(&mut rows[2].0[first..]);
}
