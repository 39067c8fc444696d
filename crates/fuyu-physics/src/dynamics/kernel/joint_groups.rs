//! Poses, momentum map and generalized Jacobian of one state by SIMD over joints, in groups of eight.

use pulp::Simd;

use super::composite_inertia::CompositeInertia;
use super::momentum_columns::{JointMotion, JointSubtree, MomentumColumn};
use super::momentum_map::{KernelPose, LinkPlacements, SystemInertia, set_placements};
use super::tree::Tree;
use super::{F64x8, GROUP_SIZE, Lanes, PlanarRotation, Sym3, Vec3};

/// Rotations, poses and columns of eight joints.
#[derive(Debug, Clone)]
pub(crate) struct JointGroup {
    rotation: PlanarRotation<F64x8>,
    axes: [[F64x8; 3]; 3],
    p_BK: [F64x8; 3],
    first_moment_xy: [F64x8; 2],
    inertia_z: [F64x8; 3],
    /// 1 for revolute joints, 0 for prismatic ones.
    is_revolute: F64x8,
    /// Mass of the subtree for prismatic joints, 0 for revolute ones.
    prismatic_mass: F64x8,
    has_prismatic: bool,
    /// One past the last body of each joint's subtree.
    subtree_ends: [u64; GROUP_SIZE],
    angular_momentum: [F64x8; 3],
    linear_momentum: [F64x8; 3],
    J_C: [F64x8; 3],
    H_M: [F64x8; 3],
    H_A: [F64x8; 3],
}

impl JointGroup {
    /// Groups for all joints of a tree.
    pub(crate) fn of(tree: &Tree) -> Vec<Self> {
        let groups = tree
            .joints
            .chunks(GROUP_SIZE)
            .enumerate()
            .map(|(group, joints)| {
                let mut result = Self {
                    rotation: PlanarRotation::IDENTITY,
                    subtree_ends: [0; GROUP_SIZE],
                    axes: [[F64x8::ZERO; 3]; 3],
                    p_BK: [F64x8::ZERO; 3],
                    first_moment_xy: [F64x8::ZERO; 2],
                    inertia_z: [F64x8::ZERO; 3],
                    is_revolute: F64x8([1.0; GROUP_SIZE]),
                    prismatic_mass: F64x8::ZERO,
                    has_prismatic: joints.iter().any(|joint| joint.is_prismatic),
                    angular_momentum: [F64x8::ZERO; 3],
                    linear_momentum: [F64x8::ZERO; 3],
                    J_C: [F64x8::ZERO; 3],
                    H_M: [F64x8::ZERO; 3],
                    H_A: [F64x8::ZERO; 3],
                };
                for (i, joint) in joints.iter().enumerate() {
                    let body = &tree.bodies[group * GROUP_SIZE + i + 1];
                    result.subtree_ends[i] = body.subtree_end as u64;
                    if joint.is_prismatic {
                        result.is_revolute.0[i] = 0.0;
                        result.prismatic_mass.0[i] = body.subtree_mass;
                    }
                }
                result
            });
        groups.collect()
    }

    /// The columns of joint `i` of the group.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn column(&self, i: usize) -> MomentumColumn<f64> {
        MomentumColumn {
            angular_momentum: get_lane(&self.angular_momentum, i),
            linear_momentum: get_lane(&self.linear_momentum, i),
            J_C: get_lane(&self.J_C, i),
            H_M: get_lane(&self.H_M, i),
            H_A: get_lane(&self.H_A, i),
        }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn pose(&self, i: usize) -> KernelPose<f64> {
        let [x, y, z] = &self.axes;
        KernelPose {
            axes: [get_lane(x, i), get_lane(y, i), get_lane(z, i)],
            p_BK: get_lane(&self.p_BK, i),
        }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn joint_subtree<S: Simd>(&self, simd: S, first: usize) -> JointSubtree<Lanes<S>> {
        let [x, y, z] = &self.axes;
        let [h, k] = &self.first_moment_xy;
        JointSubtree {
            axes: [
                load(simd, x, first),
                load(simd, y, first),
                load(simd, z, first),
            ],
            p_BK: load(simd, &self.p_BK, first),
            first_moment_xy: [
                Lanes::load(simd, &h.0[first..]),
                Lanes::load(simd, &k.0[first..]),
            ],
            inertia_z: load(simd, &self.inertia_z, first),
        }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn set_columns<S: Simd>(
        &mut self,
        simd: S,
        system: &SystemInertia<Lanes<S>>,
        inverse_mass: Lanes<S>,
    ) {
        let (p_BC, minus_H_B_inverse) = (system.p_BC, -system.H_B_inverse);
        for first in (0..GROUP_SIZE).step_by(S::F64_LANES) {
            let joint_subtree = self.joint_subtree(simd, first);
            let motion = if self.has_prismatic {
                JointMotion::Mixed {
                    is_revolute: Lanes::load(simd, &self.is_revolute.0[first..]),
                    prismatic_mass: Lanes::load(simd, &self.prismatic_mass.0[first..]),
                }
            } else {
                JointMotion::Revolute
            };
            let column = MomentumColumn::new(
                &joint_subtree,
                motion,
                p_BC,
                &minus_H_B_inverse,
                inverse_mass,
            );
            store(column.angular_momentum, &mut self.angular_momentum, first);
            store(column.linear_momentum, &mut self.linear_momentum, first);
            store(column.J_C, &mut self.J_C, first);
            store(column.H_M, &mut self.H_M, first);
            store(column.H_A, &mut self.H_A, first);
        }
    }

    /// 1 for joints that move `body`, 0 for others; `first` is the group's first joint.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn moves_point(&self, first: usize, body: usize) -> F64x8 {
        let (first, body) = (first as u64, body as u64);
        let mut moves_point = F64x8::ZERO;
        for i in 0..GROUP_SIZE {
            let is_moved = (first + (i as u64) < body) & (body < self.subtree_ends[i]);
            moves_point.0[i] = if is_moved { 1.0 } else { 0.0 };
        }
        moves_point
    }

    /// Columns of the generalized Jacobian of the point E; `moves_point` is 1 for joints that move it.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn jacobian<S: Simd>(
        &self,
        simd: S,
        r_CE: Vec3<f64>,
        p_BE: Vec3<f64>,
        moves_point: &F64x8,
        columns: &mut [[f64; 6]],
    ) {
        let (r_CE, p_BE) = (splat(simd, r_CE), splat(simd, p_BE));
        let mut rows = [[F64x8::ZERO; 3]; 2];
        for first in (0..GROUP_SIZE).step_by(S::F64_LANES) {
            let column = MomentumColumn {
                angular_momentum: r_CE,
                linear_momentum: r_CE,
                J_C: load(simd, &self.J_C, first),
                H_M: r_CE,
                H_A: load(simd, &self.H_A, first),
            };
            let [mut linear, mut angular] = column.base_motion(r_CE);
            let axis = load(simd, &self.axes[2], first);
            let arm = p_BE - load(simd, &self.p_BK, first);
            let moves_point = Lanes::load(simd, &moves_point.0[first..]);
            if self.has_prismatic {
                let rotates = moves_point * Lanes::load(simd, &self.is_revolute.0[first..]);
                linear = axis.mul_add(moves_point - rotates, linear);
                linear = axis.cross(arm).mul_add(rotates, linear);
                angular = axis.mul_add(rotates, angular);
            } else {
                linear = axis.cross(arm).mul_add(moves_point, linear);
                angular = axis.mul_add(moves_point, angular);
            }
            store(linear, &mut rows[0], first);
            store(angular, &mut rows[1], first);
        }
        let [linear, angular] = &rows;
        for (i, column) in columns.iter_mut().enumerate().take(GROUP_SIZE) {
            let (Vec3([x, y, z]), Vec3([a, b, c])) = (get_lane(linear, i), get_lane(angular, i));
            *column = [x, y, z, a, b, c];
        }
    }
}

/// Placements and momentum map of one state, by joints in groups of eight.
#[derive(Debug, Clone)]
pub(crate) struct JointKinematics {
    q: Vec<f64>,
    base: KernelPose<f64>,
    groups: Vec<JointGroup>,
    /// Partial sums of subtrees' inertias at branches.
    subtree: Vec<CompositeInertia<f64>>,
}

impl JointKinematics {
    /// Scratch for `tree`, without positions.
    pub(crate) fn new(tree: &Tree) -> Self {
        Self {
            q: vec![f64::NAN; tree.dof()],
            base: KernelPose::base_motion(tree, 0.0),
            groups: JointGroup::of(tree),
            subtree: vec![
                CompositeInertia::constant(0.0, &tree.bodies[0].about_reference);
                tree.bodies.len()
            ],
        }
    }

    /// Joint positions of the present results; NaN before the first.
    pub(crate) fn q(&self) -> &[f64] {
        &self.q
    }

    /// Computes poses and momentum map at positions `q`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn set_positions<S: Simd>(
        &mut self,
        simd: S,
        tree: &Tree,
        q: &[f64],
    ) -> SystemInertia<f64> {
        self.q.copy_from_slice(q);
        let groups = self.groups.iter_mut().zip(q.chunks(GROUP_SIZE));
        for (g, (group, q)) in groups.enumerate() {
            tree.set_rotations(simd, g, q, &mut group.rotation);
        }
        let tree_inertia = set_placements(tree, 0.0, self);
        let (mass, base) = (tree.bodies[0].subtree_mass, &self.base);
        // The same values in all lanes, since each lane computes the columns of another joint.
        let tree_inertia = CompositeInertia {
            first_moment: splat(simd, tree_inertia.first_moment),
            inertia: Sym3 {
                diagonal: splat(simd, Vec3(tree_inertia.inertia.diagonal)).0,
                off: splat(simd, Vec3(tree_inertia.inertia.off)).0,
            },
        };
        let [x, y, z] = base.axes;
        let base = KernelPose {
            axes: [splat(simd, x), splat(simd, y), splat(simd, z)],
            p_BK: splat(simd, base.p_BK),
        };
        let system = SystemInertia::new(tree_inertia, &base, mass);
        let inverse_mass = Lanes::splat(simd, 1.0 / mass);
        for group in &mut self.groups {
            group.set_columns(simd, &system, inverse_mass);
        }
        system.first()
    }

    /// The columns of joint `j`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn column(&self, j: usize) -> MomentumColumn<f64> {
        self.groups[j / GROUP_SIZE].column(j % GROUP_SIZE)
    }

    /// Axes of a body's kernel frame.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn axes(&self, body: usize) -> [Vec3<f64>; 3] {
        self.pose(body).axes
    }

    /// Origin of a body's kernel frame from the base's.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn p_BK(&self, body: usize) -> Vec3<f64> {
        self.pose(body).p_BK
    }

    /// [`super::generalized_jacobian`] of one state, by SIMD over joints.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn set_jacobian<S: Simd>(
        &self,
        simd: S,
        p_BC: Vec3<f64>,
        body: usize,
        p_KE: Vec3<f64>,
        columns: &mut [[f64; 6]],
    ) {
        let end = self.pose(body);
        let p_BE = end.rotate(p_KE) + end.p_BK;
        let r_CE = p_BE - p_BC;
        let groups = self.groups.iter().zip(columns.chunks_mut(GROUP_SIZE));
        for (g, (group, columns)) in groups.enumerate() {
            let moves_point = group.moves_point(g * GROUP_SIZE, body);
            group.jacobian(simd, r_CE, p_BE, &moves_point, columns);
        }
    }
}

impl LinkPlacements<f64> for JointKinematics {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn q(&self, body: usize) -> f64 {
        self.q[body - 1]
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn rotation(&self, body: usize) -> PlanarRotation<f64> {
        self.groups[(body - 1) / GROUP_SIZE]
            .rotation
            .lane((body - 1) % GROUP_SIZE)
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn pose(&self, body: usize) -> KernelPose<f64> {
        match body.checked_sub(1) {
            None => self.base,
            Some(j) => self.groups[j / GROUP_SIZE].pose(j % GROUP_SIZE),
        }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn set_pose(&mut self, body: usize, pose: KernelPose<f64>) {
        let Some(j) = body.checked_sub(1) else { return };
        let (group, i) = (&mut self.groups[j / GROUP_SIZE], j % GROUP_SIZE);
        for (rows, axis) in group.axes.iter_mut().zip(pose.axes) {
            set_lane(rows, i, axis);
        }
        set_lane(&mut group.p_BK, i, pose.p_BK);
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn set_joint_terms(&mut self, body: usize, first_moment_xy: [f64; 2], inertia_z: Vec3<f64>) {
        let (group, i) = (
            &mut self.groups[(body - 1) / GROUP_SIZE],
            (body - 1) % GROUP_SIZE,
        );
        (group.first_moment_xy[0].0[i], group.first_moment_xy[1].0[i]) =
            (first_moment_xy[0], first_moment_xy[1]);
        set_lane(&mut group.inertia_z, i, inertia_z);
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn subtree(&self, body: usize) -> CompositeInertia<f64> {
        self.subtree[body]
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn set_subtree(&mut self, body: usize, subtree: CompositeInertia<f64>) {
        self.subtree[body] = subtree;
    }
}

impl<S: Simd> SystemInertia<Lanes<S>> {
    /// Values of the first lane.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn first(&self) -> SystemInertia<f64> {
        SystemInertia {
            p_BC: first(self.p_BC),
            H_B: first_sym(self.H_B),
            H_B_inverse: first_sym(self.H_B_inverse),
        }
    }
}

#[cfg_attr(not(debug_assertions), inline(always))]
fn first<S: Simd>(v: Vec3<Lanes<S>>) -> Vec3<f64> {
    Vec3([v[0].first(), v[1].first(), v[2].first()])
}

#[cfg_attr(not(debug_assertions), inline(always))]
fn first_sym<S: Simd>(m: Sym3<Lanes<S>>) -> Sym3<f64> {
    Sym3 {
        diagonal: first(Vec3(m.diagonal)).0,
        off: first(Vec3(m.off)).0,
    }
}

#[cfg_attr(not(debug_assertions), inline(always))]
fn get_lane(rows: &[F64x8; 3], i: usize) -> Vec3<f64> {
    Vec3([rows[0].0[i], rows[1].0[i], rows[2].0[i]])
}

#[cfg_attr(not(debug_assertions), inline(always))]
fn set_lane(rows: &mut [F64x8; 3], i: usize, v: Vec3<f64>) {
    (rows[0].0[i], rows[1].0[i], rows[2].0[i]) = (v[0], v[1], v[2]);
}

#[cfg_attr(not(debug_assertions), inline(always))]
fn splat<S: Simd>(simd: S, v: Vec3<f64>) -> Vec3<Lanes<S>> {
    Vec3([
        Lanes::splat(simd, v[0]),
        Lanes::splat(simd, v[1]),
        Lanes::splat(simd, v[2]),
    ])
}

#[cfg_attr(not(debug_assertions), inline(always))]
fn load<S: Simd>(simd: S, rows: &[F64x8; 3], first: usize) -> Vec3<Lanes<S>> {
    Vec3([
        Lanes::load(simd, &rows[0].0[first..]),
        Lanes::load(simd, &rows[1].0[first..]),
        Lanes::load(simd, &rows[2].0[first..]),
    ])
}

#[cfg_attr(not(debug_assertions), inline(always))]
fn store<S: Simd>(v: Vec3<Lanes<S>>, rows: &mut [F64x8; 3], first: usize) {
    v[0].store(&mut rows[0].0[first..]);
    v[1].store(&mut rows[1].0[first..]);
    v[2].store(&mut rows[2].0[first..]);
}
