//! Example 2: a satellite deploys a pantograph with two closed loops (section 3.3).

use nalgebra::{Translation3, Vector3};

use super::{body, hinge};
use crate::dynamics::CutHinge;
use crate::dynamics::newton_euler::{Axis, Freedom, Hinge, INERTIAL, Start, SystemBuilder};
use crate::model::{JointKind, Model, ModelBuilder};
use crate::spatial::{Pose, RigidInertia};

/// Step of the printed solution \[s\], by Runge-Kutta-Gill.
pub const STEP: f64 = 0.025;

/// Joints in the order of [`model`]: the carriages `s2`, `s3` are prismatic, the others revolute.
pub const JOINTS: [&str; 6] = ["s2", "h2", "h5", "s3", "h3", "h4"];

/// A printed row: `θ₂`, `θ₃`, `θ₅` \[rad\] and the rates of `θ₃`, `θ₅` \[rad/s\] (the report labels the last
/// x25 above the table and x24 in it).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Printed {
    /// Time \[s\].
    pub time: f64,
    /// `θ₂`, `θ₃`, `θ₅` \[rad\].
    pub angles: [f64; 3],
    /// Rates of `θ₃`, `θ₅` \[rad/s\].
    pub rates: [f64; 2],
}

const fn printed(time: f64, angles: [f64; 3], rates: [f64; 2]) -> Printed {
    Printed {
        time,
        angles,
        rates,
    }
}

/// The values printed below Table 3.3.4, with all digits. Between the last two rows the pantograph passes its stretched
/// configuration, and the last row no longer satisfies the equations.
pub const PRINTED: [Printed; 6] = [
    printed(0.0, [-1.5358897, 1.5358897, 3.0717795], [0.0, 0.0]),
    printed(
        2.0,
        [-1.4562229, 1.4562229, 2.9124458],
        [-7.6936491e-2, -1.5387298e-1],
    ),
    printed(
        4.0,
        [-1.2357260, 1.2357260, 2.4714520],
        [-1.4320718e-1, -2.8641436e-1],
    ),
    printed(
        6.0,
        [-8.7714958e-1, 8.7714958e-1, 1.7542992],
        [-2.1925056e-1, -4.3850112e-1],
    ),
    printed(
        8.0,
        [-3.3037460e-1, 3.3037460e-1, 6.6074920e-1],
        [-3.3128321e-1, -6.6256642e-1],
    ),
    printed(
        10.0,
        [2.0199499e-1, -2.0199321e-1, -4.0398821e-1],
        [-1.5531763e-1, -3.1063423e-1],
    ),
];

/// A state on the solution branch that the mechanism follows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exact {
    /// Time \[s\].
    pub time: f64,
    /// `θ₂` \[rad\] and `s₂` \[m\]; the other joints follow by [`joints`].
    pub position: [f64; 2],
    /// Their rates \[rad/s, m/s\].
    pub rate: [f64; 2],
}

const fn exact(time: f64, position: [f64; 2], rate: [f64; 2]) -> Exact {
    Exact {
        time,
        position,
        rate,
    }
}

/// The motion without cut loops, by an independent program (Python): five smooth coordinates (base in its plane, `θ₂`,
/// `s₂`), DOP853 at a tolerance of 1e-13. `θ₂` crosses zero at 9.03428, 18.87113, 29.35100 and 38.23616 s; there the
/// pantograph is stretched and the constraints of the cuts lose rank.
pub const EXACT: [Exact; 21] = [
    exact(0.0, [-1.53588974175501, 0.9993908270190958], [0.0, 0.0]),
    exact(
        2.0,
        [-1.4562229044549682, 0.9192470265430558],
        [0.07693648826240448, -0.07061954821203681],
    ),
    exact(
        4.0,
        [-1.2357260607754696, 0.7455810311058563],
        [0.14320717088571455, -0.09676303902425135],
    ),
    exact(
        6.0,
        [-0.877149637649779, 0.5458956467476916],
        [0.21925054893949725, -0.10378996655129419],
    ),
    exact(
        8.0,
        [-0.3303746632685937, 0.3191345650129178],
        [0.3312831928053415, -0.11551088941081966],
    ),
    exact(
        10.0,
        [0.2019830067501579, 0.29508064298921527],
        [0.1553088984217897, 0.06022597792848681],
    ),
    exact(
        12.0,
        [0.3630941615544238, 0.36832677086204796],
        [0.01998316668255192, 0.0104061313951818],
    ),
    exact(
        14.0,
        [0.3204389610791444, 0.35880543572750295],
        [-0.05467145918473197, -0.014056041701915436],
    ),
    exact(
        16.0,
        [0.17834404399244033, 0.3226408848334927],
        [-0.07790985116871443, -0.023024713534802416],
    ),
    exact(
        18.0,
        [0.0414389949598468, 0.26210482017716974],
        [-0.05458794280490267, -0.03611398089727343],
    ),
    exact(
        20.0,
        [-0.03622544045667152, 0.1897854121900856],
        [-0.023964292807364156, -0.03382135923193491],
    ),
    exact(
        22.0,
        [-0.060218650687777805, 0.131463411539249],
        [-0.001789092313612235, -0.024201404429857076],
    ),
    exact(
        24.0,
        [-0.050787133795897645, 0.09258809746723487],
        [0.00941625801515941, -0.015005902397705514],
    ),
    exact(
        26.0,
        [-0.028817215103699997, 0.06965988999141064],
        [0.011318147679953627, -0.00843127363128937],
    ),
    exact(
        28.0,
        [-0.008916324450256608, 0.0568454696535609],
        [0.008101636926961042, -0.0048419041521697015],
    ),
    exact(
        30.0,
        [0.0028536849989566453, 0.04880270528193961],
        [0.0037179708213393755, -0.0034764616969749167],
    ),
    exact(
        32.0,
        [0.006708773978706837, 0.042206930312734925],
        [0.00040824294649986943, -0.0032214861920551235],
    ),
    exact(
        34.0,
        [0.005637005154052281, 0.03574490323153894],
        [-0.0012076438546551643, -0.0032392854990107526],
    ),
    exact(
        36.0,
        [0.002788146681231918, 0.029351042746500633],
        [-0.0014679206005751796, -0.003116319853430622],
    ),
    exact(
        38.0,
        [0.00023306012653189346, 0.023434381780025264],
        [-0.0010222871195332836, -0.0027667701111642046],
    ),
    exact(
        40.0,
        [-0.0012051298022018977, 0.018379245919002005],
        [-0.00042393971739319977, -0.002275325713568529],
    ),
];

/// All joint positions of the closed pantograph with `θ₂` and `s₂`, in the order of [`model`]: `s₃ = s₂ + 2 sin θ₂`,
/// `θ₃ = -θ₂`, `θ₄ = 2 θ₂`, `θ₅ = -2 θ₂`.
pub fn joints([theta_2, s_2]: [f64; 2]) -> [f64; 6] {
    let s_3 = s_2 + 2.0 * theta_2.sin();
    [s_2, theta_2, -2.0 * theta_2, s_3, -theta_2, 2.0 * theta_2]
}

/// Initial joint positions, Table 3.3.3: folded to 2°. All rates are zero.
pub fn initial() -> [f64; 6] {
    let theta_2 = f64::to_radians(-88.0);
    joints([theta_2, f64::to_radians(2.0).cos()])
}

/// The robot of Tables 3.3.1 and 3.3.2 with its loops cut at hinges 6 and 7. The carriages between the two freedoms of
/// hinges 2 and 3 are massless; in `urdf/tr942_pantograph.urdf` they have some of their neighbours' mass.
pub fn model() -> Model {
    let base = body(200.0, [20.0; 3], [0.0; 3]);
    let long = body(20.0, [1.0, 5.0, 5.0], [1.0, 0.0, 0.0]);
    let short = body(10.0, [0.2, 1.0, 1.0], [0.5, 0.0, 0.0]);
    let at = |x: f64| Pose::from(Translation3::new(x, 0.0, 0.0));
    let slide = |name, control| {
        hinge(
            name,
            JointKind::Prismatic,
            Vector3::y_axis(),
            at(1.0),
            control,
        )
    };
    let turn = |name, x, control| {
        hinge(
            name,
            JointKind::Continuous,
            Vector3::z_axis(),
            at(x),
            control,
        )
    };
    let free = [0.0; 2];
    let mut robot = ModelBuilder::new("tr942_pantograph", "base_link", base);
    let carriage = robot.joint(
        "carriage2",
        0,
        slide("s2", [1.0, 10.0]),
        RigidInertia::zero(),
    );
    let body2 = robot.joint("body2", carriage, turn("h2", 0.0, [4.0, 10.0]), long);
    robot.joint("body5", body2, turn("h5", 2.0, free), short);
    let carriage = robot.joint("carriage3", 0, slide("s3", free), RigidInertia::zero());
    let body3 = robot.joint("body3", carriage, turn("h3", 0.0, free), long);
    robot.joint("body4", body3, turn("h4", 2.0, free), short);
    robot.build()
}

/// The cuts of [`model`]'s loops: the pin in the middle of bodies 2 and 3, and that at the ends of bodies 4
/// and 5. In its plane a pin constrains two translations.
pub fn cuts(model: &Model) -> [CutHinge; 2] {
    [("body2", "body3"), ("body4", "body5")].map(|(k, l)| {
        let body = |name| model.frame(name).expect("a body of the pantograph").body;
        let end = Pose::from(Translation3::new(1.0, 0.0, 0.0));
        CutHinge {
            body_k: body(k),
            X_KH: end,
            body_l: body(l),
            X_LH: end,
            translations: [true, true, false],
            rotations: [false; 3],
        }
    })
}

/// The same robot for the matrix method, its loops closed by hinges 6 and 7 with the freedom `closing`: [`IN_PLANE`],
/// or full revolute hinges, which are redundant in a plane.
pub fn system(closing: Freedom) -> SystemBuilder {
    const SLIDING: Freedom = Freedom::REVOLUTE.and(Axis::TranslationY);
    let base = body(200.0, [20.0; 3], [0.0; 3]);
    let long = body(20.0, [1.0, 5.0, 5.0], [1.0, 0.0, 0.0]);
    let short = body(10.0, [0.2, 1.0, 1.0], [0.5, 0.0, 0.0]);
    let x = |x| Pose::translation(x, 0.0, 0.0);
    let hinge = Hinge::new;
    let mut system = SystemBuilder::new();
    system
        .body("1", base)
        .body("2", long)
        .body("3", long)
        .body("4", short)
        .body("5", short)
        .hinge(hinge("h1", INERTIAL, "1", Freedom::FREE))
        .hinge(
            hinge("h2", "1", "2", SLIDING)
                .at(x(1.0), x(0.0))
                .spring(Axis::RotationZ, 4.0, 0.0)
                .damper(Axis::RotationZ, 10.0)
                .spring(Axis::TranslationY, 1.0, 0.0)
                .damper(Axis::TranslationY, 10.0),
        )
        .hinge(hinge("h3", "1", "3", SLIDING).at(x(1.0), x(0.0)))
        .hinge(hinge("h4", "3", "4", Freedom::REVOLUTE).at(x(2.0), x(0.0)))
        .hinge(hinge("h5", "2", "5", Freedom::REVOLUTE).at(x(2.0), x(0.0)))
        .hinge(hinge("h6", "2", "3", closing).at(x(1.0), x(1.0)))
        .hinge(hinge("h7", "4", "5", closing).at(x(1.0), x(1.0)));
    system
}

/// Freedom of a pin that constrains only the plane of motion.
pub const IN_PLANE: Freedom = Freedom::SPHERICAL.and(Axis::TranslationZ);

/// [`initial`] for [`system`].
pub fn start() -> Start {
    let [s_2, theta_2, theta_5, s_3, theta_3, theta_4] = initial();
    Start::new()
        .with("h2", Axis::RotationZ, theta_2, 0.0)
        .with("h2", Axis::TranslationY, s_2, 0.0)
        .with("h3", Axis::RotationZ, theta_3, 0.0)
        .with("h3", Axis::TranslationY, s_3, 0.0)
        .with("h4", Axis::RotationZ, theta_4, 0.0)
        .with("h5", Axis::RotationZ, theta_5, 0.0)
}
