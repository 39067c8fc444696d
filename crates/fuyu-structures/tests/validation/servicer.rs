//! The servicer of Masutani 1995 figure 5.2 as a rigid tree, for tests: its mass matrix by summing `Jᵀ M J` over the bodies.

use fuyu_structures::{Appendage, Attachment};
use nalgebra::{DMatrix, Matrix3, Rotation3, Vector3};

/// Axis, origin in the parent link \[m\], mass \[kg\], centre of mass along x \[m\] and moments of inertia about it \[kg m²\].
type LinkData = ([f64; 3], [f64; 3], f64, f64, [f64; 3]);

/// Joints and links 1 to 6.
pub const LINKS: [LinkData; 6] = [
    (
        [1.0, 0.0, 0.0],
        [0.0, 1.5, 0.0],
        20.0,
        0.125,
        [0.1, 0.15, 0.15],
    ),
    (
        [0.0, 0.0, 1.0],
        [0.25, 0.0, 0.0],
        50.0,
        1.25,
        [0.25, 26.0, 26.0],
    ),
    (
        [0.0, 0.0, 1.0],
        [2.5, 0.0, 0.0],
        50.0,
        1.25,
        [0.25, 26.0, 26.0],
    ),
    (
        [0.0, 0.0, 1.0],
        [2.5, 0.0, 0.0],
        10.0,
        0.125,
        [0.05, 0.075, 0.075],
    ),
    (
        [0.0, 1.0, 0.0],
        [0.25, 0.0, 0.0],
        5.0,
        0.1,
        [0.019, 0.025, 0.025],
    ),
    (
        [1.0, 0.0, 0.0],
        [0.2, 0.0, 0.0],
        5.0,
        0.1,
        [0.025, 0.025, 0.025],
    ),
];

/// Pose and motion of one link's frame in the base frame.
pub struct Link {
    pub R: Rotation3<f64>,
    pub p: Vector3<f64>,
    /// 6 x 12 in base axes: velocity of the frame's origin and angular velocity, for rates of (base, joints).
    pub jacobian: DMatrix<f64>,
}

/// The base as a link, then links 1 to 6.
pub fn links(q: &[f64]) -> Vec<Link> {
    let mut list = vec![Link {
        R: Rotation3::identity(),
        p: Vector3::zeros(),
        jacobian: DMatrix::zeros(6, 12),
    }];
    list[0]
        .jacobian
        .view_mut((0, 0), (6, 6))
        .fill_with_identity();
    for (i, (axis, origin, ..)) in LINKS.iter().enumerate() {
        let parent = &list[i];
        let half_turn = std::f64::consts::FRAC_PI_2;
        let mount = if i == 0 {
            Rotation3::from_euler_angles(half_turn, 0.0, half_turn)
        } else {
            Rotation3::identity()
        };
        let step = parent.R * Vector3::from(*origin);
        let axis = Vector3::from(*axis);
        let R = parent.R * mount * Rotation3::new(axis * q[i]);
        let mut jacobian = moved(&parent.jacobian, &step);
        let turn = parent.R * mount * axis;
        (0..3).for_each(|row| jacobian[(3 + row, 6 + i)] = turn[row]);
        list.push(Link {
            R,
            p: parent.p + step,
            jacobian,
        });
    }
    list
}

/// The Jacobian of a point `step` away on the same body.
pub fn moved(jacobian: &DMatrix<f64>, step: &Vector3<f64>) -> DMatrix<f64> {
    let mut result = jacobian.clone();
    let turned = -step.cross_matrix() * jacobian.rows(3, 3);
    let mut linear = result.rows_mut(0, 3);
    linear += turned;
    result
}

/// Adds a body: mass, centre of mass relative to a frame and moments of inertia about it, in the frame's axes.
pub fn add_body(
    M: &mut DMatrix<f64>,
    link: &Link,
    mass: f64,
    centre: Vector3<f64>,
    inertia: Matrix3<f64>,
) {
    let J = moved(&link.jacobian, &(link.R * centre));
    let (v, w) = (J.rows(0, 3), J.rows(3, 3));
    let I = link.R.matrix() * inertia * link.R.matrix().transpose();
    *M += v.transpose() * v * mass + w.transpose() * I * w;
}

/// Mass matrix (12 x 12) of the robot without panels. `left_out` are links whose mass is not counted.
pub fn mass_matrix(q: &[f64], left_out: &[usize]) -> DMatrix<f64> {
    let list = links(q);
    let mut M = DMatrix::zeros(12, 12);
    add_body(
        &mut M,
        &list[0],
        2000.0,
        Vector3::zeros(),
        Matrix3::from_diagonal(&Vector3::new(1400.0, 1400.0, 2040.0)),
    );
    for (i, (_, _, mass, x, inertia)) in LINKS
        .iter()
        .enumerate()
        .filter(|(i, _)| !left_out.contains(&(i + 1)))
    {
        add_body(
            &mut M,
            &list[i + 1],
            *mass,
            Vector3::new(*x, 0.0, 0.0),
            Matrix3::from_diagonal(&Vector3::from(*inertia)),
        );
    }
    M
}

/// Panels on both sides of the base, turned by `alpha` about its x axis: the second by half a turn about z before.
pub fn attachments<'a>(panel: &'a Appendage, alpha: f64) -> [Attachment<'a>; 2] {
    let array = Rotation3::new(Vector3::x() * alpha);
    let half_turn = Rotation3::new(Vector3::z() * std::f64::consts::PI);
    [
        Attachment::on_base(panel, &array, &Vector3::new(1.2, 0.0, 0.0), 12),
        Attachment::on_base(
            panel,
            &(array * half_turn),
            &Vector3::new(-1.2, 0.0, 0.0),
            12,
        ),
    ]
}

/// Mass matrix of the robot with the undeformed panels.
pub fn with_panels(q: &[f64], panels: &[Attachment]) -> DMatrix<f64> {
    let mut M = mass_matrix(q, &[]);
    for a in panels {
        M += a.jacobian.transpose() * a.appendage.rigid_mass_matrix() * &a.jacobian;
    }
    M
}

/// Base only: joints locked.
pub fn locked(M: &DMatrix<f64>) -> DMatrix<f64> {
    M.view((0, 0), (6, 6)).into_owned()
}
