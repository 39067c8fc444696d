//! Joints eight side by side: what the sweeps leave of them, and their columns in wide instructions.

use pulp::Simd;

use super::composite_inertia::Composite;
use super::momentum_columns::{Column, Lever, Moves};
use super::momentum_map::{Places, Pose, System, set_places};
use super::tree::Tree;
use super::{Eight, GROUP, Lanes, Sym3, Turn, Vec3};

/// Eight joints side by side: their turns, their levers, and their columns.
#[derive(Debug, Clone)]
pub(crate) struct JointGroup {
    turn: Turn<Eight>,
    axes: [[Eight; 3]; 3],
    p_BK: [Eight; 3],
    across: [Eight; 2],
    inertia: [Eight; 3],
    turning: Eight,
    sliding: Eight,
    is_mixed: bool,
    /// First of the bodies that a joint does not carry any more.
    ends: [u64; GROUP],
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
                turn: Turn::NONE,
                ends: [0; GROUP],
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
                let body = &tree.bodies[group * GROUP + i + 1];
                made.ends[i] = body.subtree_end as u64;
                if hop.slides {
                    made.turning.0[i] = 0.0;
                    made.sliding.0[i] = body.subtree_mass;
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
    fn pose(&self, i: usize) -> Pose<f64> {
        let [x, y, z] = &self.axes;
        Pose {
            axes: [one(x, i), one(y, i), one(z, i)],
            p_BK: one(&self.p_BK, i),
        }
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
    fn set_columns<S: Simd>(&mut self, simd: S, system: &System<Lanes<S>>, per: Lanes<S>) {
        let (p_BC, answer) = (system.p_BC, -system.H_B_inverse);
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

    /// 1 for joints that move a body, 0 for others; `first` is the first joint.
    #[inline(always)]
    fn carries(&self, first: usize, body: usize) -> Eight {
        let (first, body) = (first as u64, body as u64);
        let mut carries = Eight::ZERO;
        for i in 0..GROUP {
            let is_carried = (first + (i as u64) < body) & (body < self.ends[i]);
            carries.0[i] = if is_carried { 1.0 } else { 0.0 };
        }
        carries
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

/// A tree's joints, eight side by side, and scratch of the sweeps.
#[derive(Debug, Clone)]
pub(crate) struct Joints {
    q: Vec<f64>,
    base: Pose<f64>,
    groups: Vec<JointGroup>,
    /// Subtrees as far as gathered, where branches meet.
    gathered: Vec<Composite<f64>>,
}

impl Joints {
    /// Those of `tree`, at no position yet.
    pub(crate) fn new(tree: &Tree) -> Self {
        Self {
            q: vec![f64::NAN; tree.dof()],
            base: Pose::of_base(tree, 0.0),
            groups: JointGroup::of(tree),
            gathered: vec![Composite::constant(0.0, &tree.bodies[0].about_foot); tree.bodies.len()],
        }
    }

    /// The positions that all of this stands for.
    pub(crate) fn q(&self) -> &[f64] {
        &self.q
    }

    /// Takes the joints to `q`: poses and momentum map.
    #[inline(always)]
    pub(crate) fn set<S: Simd>(&mut self, simd: S, tree: &Tree, q: &[f64]) -> System<f64> {
        self.q.copy_from_slice(q);
        let groups = self.groups.iter_mut().zip(q.chunks(GROUP));
        for (g, (group, q)) in groups.enumerate() {
            tree.set_turns(simd, g, q, &mut group.turn);
        }
        let whole = set_places(tree, 0.0, self);
        let (mass, base) = (tree.bodies[0].subtree_mass, &self.base);
        // In lanes that are all alike, for the columns of which each holds one.
        let whole = Composite {
            first_moment: splat(simd, whole.first_moment),
            inertia: Sym3 {
                diagonal: splat(simd, Vec3(whole.inertia.diagonal)).0,
                off: splat(simd, Vec3(whole.inertia.off)).0,
            },
        };
        let [x, y, z] = base.axes;
        let base = Pose {
            axes: [splat(simd, x), splat(simd, y), splat(simd, z)],
            p_BK: splat(simd, base.p_BK),
        };
        let system = System::new(whole, &base, mass);
        let per = Lanes::splat(simd, 1.0 / mass);
        for group in &mut self.groups {
            group.set_columns(simd, &system, per);
        }
        system.first()
    }

    /// The columns of joint `j`.
    #[inline(always)]
    pub(crate) fn column(&self, j: usize) -> Column<f64> {
        self.groups[j / GROUP].column(j % GROUP)
    }

    /// Axes of a body's kernel frame.
    #[inline(always)]
    pub(crate) fn axes(&self, body: usize) -> [Vec3<f64>; 3] {
        self.pose(body).axes
    }

    /// Origin of a body's kernel frame from the base's.
    #[inline(always)]
    pub(crate) fn p_BK(&self, body: usize) -> Vec3<f64> {
        self.pose(body).p_BK
    }

    /// [`super::generalized_jacobian`] from columns side by side.
    #[inline(always)]
    pub(crate) fn set_jacobian<S: Simd>(
        &self,
        simd: S,
        p_BC: Vec3<f64>,
        body: usize,
        p_KE: Vec3<f64>,
        columns: &mut [[f64; 6]],
    ) {
        let end = self.pose(body);
        let p_BE = end.turned(p_KE) + end.p_BK;
        let r_CE = p_BE - p_BC;
        let groups = self.groups.iter().zip(columns.chunks_mut(GROUP));
        for (g, (group, columns)) in groups.enumerate() {
            let carries = group.carries(g * GROUP, body);
            group.jacobian(simd, r_CE, p_BE, &carries, columns);
        }
    }
}

impl Places<f64> for Joints {
    #[inline(always)]
    fn q(&self, body: usize) -> f64 {
        self.q[body - 1]
    }

    #[inline(always)]
    fn turn(&self, body: usize) -> Turn<f64> {
        self.groups[(body - 1) / GROUP].turn.at((body - 1) % GROUP)
    }

    #[inline(always)]
    fn pose(&self, body: usize) -> Pose<f64> {
        match body.checked_sub(1) {
            None => self.base,
            Some(j) => self.groups[j / GROUP].pose(j % GROUP),
        }
    }

    #[inline(always)]
    fn set_pose(&mut self, body: usize, pose: Pose<f64>) {
        let Some(j) = body.checked_sub(1) else { return };
        let (group, i) = (&mut self.groups[j / GROUP], j % GROUP);
        for (rows, axis) in group.axes.iter_mut().zip(pose.axes) {
            put(rows, i, axis);
        }
        put(&mut group.p_BK, i, pose.p_BK);
    }

    #[inline(always)]
    fn set_subtree(&mut self, body: usize, across: [f64; 2], inertia: Vec3<f64>) {
        let (group, i) = (&mut self.groups[(body - 1) / GROUP], (body - 1) % GROUP);
        (group.across[0].0[i], group.across[1].0[i]) = (across[0], across[1]);
        put(&mut group.inertia, i, inertia);
    }

    #[inline(always)]
    fn gathered(&self, body: usize) -> Composite<f64> {
        self.gathered[body]
    }

    #[inline(always)]
    fn set_gathered(&mut self, body: usize, subtree: Composite<f64>) {
        self.gathered[body] = subtree;
    }
}

impl<S: Simd> System<Lanes<S>> {
    /// That of the first lane.
    #[inline(always)]
    fn first(&self) -> System<f64> {
        System {
            p_BC: first(self.p_BC),
            H_B: first_sym(self.H_B),
            H_B_inverse: first_sym(self.H_B_inverse),
        }
    }
}

#[inline(always)]
fn first<S: Simd>(v: Vec3<Lanes<S>>) -> Vec3<f64> {
    Vec3([v[0].first(), v[1].first(), v[2].first()])
}

#[inline(always)]
fn first_sym<S: Simd>(m: Sym3<Lanes<S>>) -> Sym3<f64> {
    Sym3 {
        diagonal: first(Vec3(m.diagonal)).0,
        off: first(Vec3(m.off)).0,
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
