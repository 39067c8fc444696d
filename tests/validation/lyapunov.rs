//! The Lyapunov function of Masutani 1995 chapter 5 along the closed loop: it falls with the generalized Jacobian,
//! whatever the robot, and not with the fixed-base one.

use fuyu::control::{
    ControllerConfig, Gains, JacobianKind, LawConfig, LawKind, LyapunovFunction, Saturation,
    Shaping, SingularityEscapeConfig, StraightPathConfig, TransposeJacobianConfig,
};
use fuyu::dynamics::Workspace;
use fuyu::experiments::ContinuousLoop;
use fuyu::experiments::masutani_ch6::{Planar, gains};
use fuyu::model::{JointKind, Model, ModelBuilder};
use fuyu::spatial::{Pose, RigidInertia};
use nalgebra::{DVector, Matrix3, Matrix6xX, Rotation3, Translation3, Unit, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};

struct Chance(StdRng);

impl Chance {
    fn number(&mut self, scale: f64) -> f64 {
        self.0.random_range(-scale..scale)
    }

    fn vector(&mut self, scale: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.number(scale))
    }

    fn body(&mut self, mass: f64, com: f64) -> RigidInertia {
        let axes = Rotation3::new(self.vector(2.0));
        let principal = Matrix3::from_diagonal(&(Vector3::new(0.3, 0.4, 0.5) * (0.3 * mass)));
        let along = Vector3::x() * com;
        RigidInertia {
            mass,
            com: along + self.vector(0.3),
            about_com: axes.matrix() * principal * axes.matrix().transpose(),
        }
    }

    /// A base with an arm of 2 to 4 joints, axes and placements at random.
    fn robot(&mut self) -> Model {
        let base = self.body(60.0, 0.0);
        let mut builder = ModelBuilder::new("random", "base", base);
        let mut up = 0;
        for k in 0..self.0.random_range(2..=4) {
            let axis = Unit::new_normalize(self.vector(1.0) + Vector3::z() * 0.1);
            let offset = self.vector(0.5) + Vector3::x() * 0.5;
            let place =
                Pose::from_parts(Translation3::from(offset), Rotation3::new(self.vector(1.0)));
            let link = self.body(8.0, 0.3);
            up = builder.body(
                &format!("link{k}"),
                up,
                JointKind::Continuous,
                axis,
                place,
                link,
            );
        }
        let tip = Translation3::from(self.vector(0.5));
        builder.frame(
            "tip",
            up,
            None,
            Pose::from_parts(tip, Rotation3::identity()),
        );
        builder.build()
    }

    /// A robot at rest with a goal and gains, all at random, under a law with the generalized Jacobian.
    fn closed_loop(&mut self, law: LawKind) -> (ContinuousLoop, ControllerConfig) {
        let model = self.robot();
        let tip = model.frame("tip").unwrap().clone();
        let n = model.dof();
        let q = DVector::from_fn(n, |_, _| self.number(2.0));
        let mut workspace = Workspace::new(&model);
        workspace.set_positions(&q);
        let X_BE = workspace.X_BF(&tip);
        let goal = Pose::from_parts(
            Translation3::from(X_BE.translation.vector + self.vector(0.8)),
            Rotation3::new(self.vector(1.8)) * X_BE.rotation,
        );
        let inertia = workspace.reduced_inertia();
        let rate = |chance: &mut Self| 0.5 + 4.0 * chance.number(1.0).abs();
        let k_v = (0..n).map(|j| inertia[(j, j)] * rate(self)).collect();
        let saturation = match self.0.random_bool(0.5) {
            true => Saturation::NONE,
            false => Saturation {
                position: 0.05 + self.number(1.0).abs(),
                orientation: 0.05 + self.number(1.0).abs(),
            },
        };
        let gains = Gains {
            k_p: 5.0 + 100.0 * self.number(1.0).abs(),
            k_o: 40.0 * self.number(1.0).abs(),
            k_v,
            saturation,
        };
        let damping = gains.k_p.max(gains.k_o);
        let straight_path = StraightPathConfig {
            shaping: Shaping::Damping,
            d_along: damping,
            d_across: damping * (1.0 + 9.0 * self.number(1.0).abs()),
            d_turn: damping,
            // A load that is heavy compared with the robot.
            period: 0.1,
            ..StraightPathConfig::default()
        };
        let law = match law {
            LawKind::StraightPath => straight_path.into(),
            law => LawConfig::from(law),
        };
        let config = ControllerConfig {
            singularity_escape: SingularityEscapeConfig {
                rate: 0.0,
                ..SingularityEscapeConfig::default()
            },
            ..ControllerConfig::new(law, gains)
        };
        let run = ContinuousLoop::new(model, &tip, config.clone(), &q, goal);
        (run.unwrap(), config)
    }
}

/// The law is evaluated at every stage of the integration (order 8, steps of 10 ms against time constants of 0.2 s
/// and more), so that what is left of its error is below 1e-12 of the function. From rest, the function falls by more
/// than that in the very first step. A Jacobian that is not the transpose of what moves the tip, a wrong inertia in
/// the function, a base that does not react as it should, or a saturated error that is not the potential's gradient
/// makes it rise.
fn falls(runs: usize, steps: usize) {
    const STEP: f64 = 0.01;
    let mut chance = Chance(StdRng::seed_from_u64(5));
    for number in 0..runs {
        let (mut run, config) = chance.closed_loop(LawKind::TransposeJacobian);
        let function = LyapunovFunction::new(config.gains);
        let first = run.lyapunov();
        let (mut last, mut falling) = (first, 0.0);
        for k in 0..steps {
            run.step(STEP);
            let now = run.lyapunov();
            let rise = (now - last) / first;
            assert!(rise <= 1e-10, "run {number}, step {k}: {rise:e}");
            last = now;
            // Simpson's rule over pairs of steps.
            let weight = if k + 1 == steps { 1 } else { 4 - 2 * (k % 2) };
            falling += weight as f64 * function.rate(&run.state().qd) * STEP / 3.0;
        }
        // How much it falls is what the joints dissipate, eq. (5.19), within what the rule makes of the kinks of
        // saturation.
        let drop = first - last;
        assert!(drop > 1e-6 * first, "run {number}: {drop} of {first}");
        let off = (drop + falling).abs() / drop;
        assert!(off < 1e-2, "run {number}: {off}");
    }
}

#[test]
fn it_falls_in_a_thousand_random_runs() {
    falls(1000, 100);
}

/// A straight path by damping, with the load that a sampled law needs: the function with the load's kinetic energy falls.
/// A load whose inertial force is off by a part of its velocity terms, or by the efforts that it should know of, makes it
/// rise in some of the runs.
#[test]
fn it_falls_on_straight_paths_with_a_load_too() {
    let mut chance = Chance(StdRng::seed_from_u64(6));
    for number in 0..150 {
        let (mut run, config) = chance.closed_loop(LawKind::StraightPath);
        let LawConfig::StraightPath(law) = &config.law else {
            panic!("{:?}", config.law);
        };
        let load = law.virtual_tip_inertia(config.gains.k_o);
        assert!(load.mass > 0.0 && load.inertia > 0.0);
        let tip = run.model().frame("tip").unwrap().clone();
        let mut jacobian = Matrix6xX::zeros(run.model().dof());
        let mut function = |run: &mut ContinuousLoop| {
            run.workspace().generalized_jacobian(&tip, &mut jacobian);
            let V = &jacobian * &run.state().qd;
            let (v, w) = (V.fixed_rows::<3>(0), V.fixed_rows::<3>(3));
            let carried = load.mass * v.norm_squared() + load.inertia * w.norm_squared();
            run.lyapunov() + 0.5 * carried
        };
        let first = function(&mut run);
        let mut last = first;
        for k in 0..100 {
            run.step(0.01);
            let now = function(&mut run);
            let rise = (now - last) / first;
            assert!(rise <= 1e-10, "run {number}, step {k}: {rise:e}");
            last = now;
        }
        assert!(
            last < (1.0 - 1e-6) * first,
            "run {number}: {last} of {first}"
        );
    }
}

#[test]
#[ignore = "a minute: the same runs for 20 s each"]
fn it_falls_in_a_thousand_long_runs() {
    falls(1000, 2000);
}

/// A search for starts from which the fixed-base Jacobian drives the tip away, among random postures of a planar arm
/// on a base twice its mass. They are those of the unstable region of chapter 6 and no others.
#[test]
fn counter_examples_with_the_approximate_jacobian_are_the_unstable_region() {
    const SECONDS: f64 = 60.0;
    let mut chance = Chance(StdRng::seed_from_u64(8));
    let mut planar = Planar::with_mass_ratio(2.0);
    let law = gains(0.1);
    let (mut leaving, mut arriving) = (0, 0);
    while leaving < 4 || arriving < 12 {
        let q = [chance.number(3.1), 1.5 + chance.number(1.5)];
        let growth = planar.growth_rate(q, &law, JacobianKind::FixedBase);
        // Undecided within the time of a run, or enough of its kind.
        if (growth * SECONDS).abs() < 2.5 || growth < 0.0 && arriving >= 12 {
            continue;
        }
        let [x, y] = planar.tip_at(q);
        let angle = chance.number(3.1);
        let goal = Translation3::new(x + 1e-4 * angle.cos(), y + 1e-4 * angle.sin(), 0.0);
        let config =
            |jacobian| ControllerConfig::new(TransposeJacobianConfig { jacobian }, law.clone());
        let run = |jacobian| {
            let goal = Pose::from_parts(goal, Rotation3::identity());
            let (model, start) = (planar.model.clone(), DVector::from_row_slice(&q));
            let robot = ContinuousLoop::new(model, &planar.tip, config(jacobian), &start, goal);
            let mut robot = robot.unwrap();
            let first = robot.error().position.norm();
            robot.run_to(SECONDS, 0.02);
            robot.error().position.norm() / first
        };
        let (approximate, generalized) =
            (run(JacobianKind::FixedBase), run(JacobianKind::Generalized));
        assert!(generalized < 1.0, "{q:?}: {generalized}");
        assert_eq!(
            approximate > 1.0,
            growth > 0.0,
            "{q:?}: {approximate}, {growth}"
        );
        if growth > 0.0 {
            leaving += 1;
        } else {
            arriving += 1;
        }
    }
}
