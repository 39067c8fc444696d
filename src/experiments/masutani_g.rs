//! Masutani 1995, appendix G: the generalized Jacobian of a serial arm, step by step as printed, with a count of the
//! operations.

use nalgebra::{Matrix3, Rotation3, Translation3, Vector3};

use super::operation_counts::{Counted, Counts, counted};
use crate::dynamics::kernel::{Scalar, Vec3};
use crate::model::{JointKind, Model, ModelBuilder};
use crate::spatial::{Pose, RigidInertia};

/// A link as in section G.1. Its frame Σ_i has its origin on joint i + 1, z along that joint's axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Link length `a_i` \[m\].
    pub a: f64,
    /// Link offset `d_i` \[m\].
    pub d: f64,
    /// Link twist `α_i` \[rad\].
    pub alpha: f64,
    /// Centre of mass from joint i, `ⁱs_i` \[m\].
    pub s: Vector3<f64>,
    /// Mass `m_i` \[kg\].
    pub mass: f64,
    /// Inertia about the centre of mass, `ⁱI_i` \[kg m²\].
    pub inertia: Matrix3<f64>,
}

/// A serial arm of rotary joints on a base whose frame is at its centre of mass.
#[derive(Debug, Clone, PartialEq)]
pub struct SerialArm {
    /// Mass of the base \[kg\].
    pub base_mass: f64,
    /// Inertia of the base, `ᴮI_0` \[kg m²\].
    pub base_inertia: Matrix3<f64>,
    /// Pose of Σ_0 in the base frame: joint 1 and its axis.
    pub X_B0: Pose,
    /// Links, from the base outward.
    pub links: Vec<Link>,
}

impl Link {
    fn twist(&self) -> Rotation3<f64> {
        Rotation3::from_axis_angle(&Vector3::x_axis(), self.alpha)
    }

    /// `ⁱd_{i+1}`: vector from joint i to joint i + 1.
    fn to_next(&self) -> Vector3<f64> {
        Vector3::new(self.a, self.d * self.alpha.sin(), self.d * self.alpha.cos())
    }
}

impl SerialArm {
    /// An arm with this number of links, none of whose parameters is zero.
    pub fn example(links: usize) -> Self {
        let tensor = Matrix3::new(2.0, 0.1, -0.2, 0.1, 1.5, 0.3, -0.2, 0.3, 1.8);
        let link = |k: usize| Link {
            a: 0.4 + 0.05 * k as f64,
            d: 0.1,
            alpha: 1.2 - 0.1 * (k % 3) as f64,
            s: Vector3::new(0.2, 0.01, -0.03),
            mass: 5.0 + k as f64,
            inertia: tensor,
        };
        Self {
            base_mass: 80.0,
            base_inertia: tensor * 10.0,
            X_B0: Pose::from_parts(
                Translation3::new(0.4, 0.1, -0.2),
                Rotation3::from_euler_angles(1.2, 0.1, 0.3),
            ),
            links: (0..links).map(link).collect(),
        }
    }

    /// The same robot as a fuyu model; the frame `tip` is at the end of the last link.
    pub fn model(&self) -> Model {
        let base = RigidInertia {
            mass: self.base_mass,
            com: Vector3::zeros(),
            about_com: self.base_inertia,
        };
        let mut builder = ModelBuilder::new("serial", "base_link", base);
        let (mut up, mut X_PJ) = (0, self.X_B0);
        for (k, link) in self.links.iter().enumerate() {
            let twist = link.twist();
            let inertia = RigidInertia {
                mass: link.mass,
                com: twist * link.s,
                about_com: twist.matrix() * link.inertia * twist.matrix().transpose(),
            };
            let (name, kind) = (format!("link{}", k + 1), JointKind::Continuous);
            up = builder.body(&name, up, kind, Vector3::z_axis(), X_PJ, inertia);
            X_PJ = Pose::from_parts((twist * link.to_next()).into(), twist);
        }
        builder.frame("tip", up, None, X_PJ);
        builder.build()
    }

    /// The generalized Jacobian, one column per joint, linear rows first, by the steps of section G.5, and the number
    /// of operations. Sines and cosines are given, and the preparation of section G.4 is not counted.
    pub fn generalized_jacobian(&self, q: &[f64]) -> (Vec<[f64; 6]>, Counts) {
        let mass: f64 = self.base_mass + self.links.iter().map(|l| l.mass).sum::<f64>();
        let (columns, counts) = counted(|| self.steps(q, mass));
        let plain = |[l, a]: [V; 2]| [l[0].0, l[1].0, l[2].0, a[0].0, a[1].0, a[2].0];
        (columns.into_iter().map(plain).collect(), counts)
    }

    fn steps(&self, q: &[f64], mass: f64) -> Vec<[V; 2]> {
        let n = self.links.len();
        let mut m_r_sum = zero();
        let mut A = vec![matrix(self.X_B0.rotation.matrix())];
        let mut p = vec![vector(&self.X_B0.translation.vector)];
        let (mut r, mut m_r, mut I) = (Vec::new(), Vec::new(), Vec::new());
        for (i, link) in self.links.iter().enumerate() {
            let (sin, cos) = (Counted(q[i].sin()), Counted(q[i].cos()));
            let (sin_a, cos_a) = (Counted(link.alpha.sin()), Counted(link.alpha.cos()));
            let turn = [
                Vec3([cos, -(cos_a * sin), sin_a * sin]),
                Vec3([sin, cos_a * cos, -(sin_a * cos)]),
                Vec3([Counted(0.0), sin_a, cos_a]),
            ];
            A.push(product(&A[i], &turn));
            let d = times(&A[i + 1], vector(&link.to_next()));
            let s = times(&A[i + 1], vector(&link.s));
            I.push(transform_tensor(&A[i + 1], &link.inertia));
            r.push(p[i] + s);
            p.push(p[i] + d);
            m_r.push(r[i].scaled(Counted(link.mass)));
            m_r_sum = m_r_sum + m_r[i];
        }
        let r_C = m_r_sum.scaled(Counted(1.0 / mass));
        // H_B
        let mut H_B = less(&symmetric(&self.base_inertia), &D(r_C, mass.sqrt()));
        for (i, link) in self.links.iter().enumerate() {
            H_B = more(&more(&H_B, &I[i]), &D(r[i], link.mass.sqrt()));
        }
        // Jacobians, H_M and J_C
        let Z: Vec<V> = A[..n].iter().map(third_column).collect();
        let J_L: Vec<V> = (0..n).map(|j| Z[j].cross(p[n] - p[j])).collect();
        let (mut H_M, mut J_C) = (vec![zero(); n], vec![zero(); n]);
        for i in 0..n {
            for j in 0..=i {
                let J_Li = Z[j].cross(r[i] - p[j]);
                H_M[j] = H_M[j] + (tensor_times(&I[i], Z[j]) + m_r[i].cross(J_Li));
                J_C[j] = J_C[j] + J_Li.scaled(Counted(self.links[i].mass));
            }
        }
        for j in 0..n {
            H_M[j] = H_M[j] - r_C.cross(J_C[j]);
            J_C[j] = J_C[j].scaled(Counted(1.0 / mass));
        }
        let r_EC = p[n] - r_C;
        let (L, D_inverse) = cholesky_1(&H_B);
        (0..n)
            .map(|j| {
                let X = cholesky_2(&L, &D_inverse, H_M[j]);
                let Y = r_EC.cross(X);
                [J_L[j] - J_C[j] + Y, Z[j] - X]
            })
            .collect()
    }
}

type V = Vec3<Counted>;
/// A matrix by rows.
type M = [V; 3];
/// A symmetric matrix: xx, yy, zz, yz, xz, xy.
type S = [Counted; 6];

fn zero() -> V {
    Vec3([Counted(0.0); 3])
}

fn vector(v: &Vector3<f64>) -> V {
    Vec3([Counted(v.x), Counted(v.y), Counted(v.z)])
}

fn matrix(m: &Matrix3<f64>) -> M {
    [0, 1, 2].map(|r| vector(&m.row(r).transpose()))
}

fn symmetric(m: &Matrix3<f64>) -> S {
    [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)].map(|at| Counted(m[at]))
}

fn times(m: &M, v: V) -> V {
    Vec3(m.map(|row| row.dot(v)))
}

fn third_column(m: &M) -> V {
    Vec3(m.map(|row| row[2]))
}

fn product(a: &M, b: &M) -> M {
    let columns = [0, 1, 2].map(|c| Vec3(b.map(|row| row[c])));
    a.map(|row| Vec3(columns.map(|column| row.dot(column))))
}

/// `A P Aᵀ`, symmetric: only six entries are computed.
fn transform_tensor(A: &M, P: &Matrix3<f64>) -> S {
    let AP = product(A, &matrix(P));
    [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)].map(|(r, c)| AP[r].dot(A[c]))
}

fn tensor_times([xx, yy, zz, yz, xz, xy]: &S, v: V) -> V {
    times(
        &[
            Vec3([*xx, *xy, *xz]),
            Vec3([*xy, *yy, *yz]),
            Vec3([*xz, *yz, *zz]),
        ],
        v,
    )
}

/// The inertia tensor of a point mass at `r`; `root` is the square root of the mass.
fn D(r: V, root: f64) -> S {
    let Vec3([x, y, z]) = r.scaled(Counted(root));
    let [xx, yy, zz] = [x * x, y * y, z * z];
    [yy + zz, xx + zz, xx + yy, -(y * z), -(x * z), -(x * y)]
}

fn more(a: &S, b: &S) -> S {
    std::array::from_fn(|k| a[k] + b[k])
}

fn less(a: &S, b: &S) -> S {
    std::array::from_fn(|k| a[k] - b[k])
}

/// `L21, L31, L32` and the inverses of `D1, D2, D3`.
fn cholesky_1([xx, yy, zz, yz, xz, xy]: &S) -> ([Counted; 3], [Counted; 3]) {
    let d1 = xx.recip();
    let (l21, l31) = (*xy * d1, *xz * d1);
    let d2 = (*yy - l21 * *xy).recip();
    let t = *yz - l31 * *xy;
    let l32 = t * d2;
    let d3 = (*zz - l31 * *xz - l32 * t).recip();
    ([l21, l31, l32], [d1, d2, d3])
}

fn cholesky_2([l21, l31, l32]: &[Counted; 3], d: &[Counted; 3], v: V) -> V {
    let y1 = v[0];
    let y2 = v[1] - *l21 * y1;
    let y3 = v[2] - *l31 * y1 - *l32 * y2;
    let z = y3 * d[2];
    let y = y2 * d[1] - *l32 * z;
    let x = y1 * d[0] - *l21 * y - *l31 * z;
    Vec3([x, y, z])
}
