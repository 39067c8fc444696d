//! The instruction set of each kernel, chosen by measurement once per process.
//!
//! Results are bit-identical with every instruction set, so the choice affects speed only. The widest is not always the
//! fastest: the recursions over the links of one state are scalar, and a load of 64 bytes that spans several narrower
//! stores has to wait until they have reached the cache. On Intel's processors with AVX-512, forward dynamics of one
//! state is therefore half as fast again with 256 bits; batches, which load with the width of their stores, are faster
//! with 512 bits. AMD's processors differ. So on a processor with AVX-512, both widths are timed on a robot with six
//! joints when a kernel is first needed, which takes about a millisecond. Other processors have no choice.

use std::{
    fmt,
    sync::OnceLock,
    time::{Duration, Instant},
};

use nalgebra::{DVector, Matrix3, Matrix6xX, UnitQuaternion, Vector3};
use pulp::Arch;

use super::{
    ArticulatedBody, Dissipated, Evaluation, Formulation as _, Input, Momentum, State, Workspace,
};
use crate::model::{Frame, JointKind, Model, ModelBuilder};
use crate::spatial::{Pose, RigidInertia};

/// Rounds of a measurement; the fastest counts.
const ROUNDS: usize = 16;
/// Evaluations per round.
const EVALUATIONS: usize = 16;
/// A narrower instruction set is chosen if it takes at most this fraction of the time of the widest.
const WORTHWHILE: f64 = 0.95;

/// The instruction sets that the kernels use on this processor. The choice does not change results.
///
/// ```
/// // "positions AVX2, forward dynamics AVX2, batches AVX2" on a processor without AVX-512
/// println!("{}", fuyu_physics::dynamics::InstructionSets::of_this_processor());
/// ```
#[derive(Debug, Clone, Copy)]
pub struct InstructionSets {
    /// Poses, momentum map and Jacobians of one state.
    pub(super) positions: Arch,
    /// Forward dynamics and integration of one state.
    pub(super) forward_dynamics: Arch,
    /// Batches of states.
    pub(super) batch: Arch,
}

impl InstructionSets {
    /// The choice for this processor. The first call measures.
    pub fn of_this_processor() -> &'static Self {
        static CHOICE: OnceLock<InstructionSets> = OnceLock::new();
        CHOICE.get_or_init(|| {
            let widest = Arch::new();
            match narrower_than(widest) {
                Some(narrower) => Self::measured(widest, narrower),
                None => Self {
                    positions: widest,
                    forward_dynamics: widest,
                    batch: widest,
                },
            }
        })
    }

    fn measured(widest: Arch, narrower: Arch) -> Self {
        let model = arm();
        let mut positions = Positions::new(&model);
        let mut accelerations = Accelerations::new(&model);
        Self {
            positions: faster(widest, narrower, |arch| positions.time(arch)),
            forward_dynamics: faster(widest, narrower, |arch| accelerations.time(arch)),
            batch: widest,
        }
    }
}

impl fmt::Display for InstructionSets {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [positions, dynamics, batch] =
            [self.positions, self.forward_dynamics, self.batch].map(name);
        write!(
            f,
            "positions {positions}, forward dynamics {dynamics}, batches {batch}"
        )
    }
}

fn name(arch: Arch) -> &'static str {
    match arch {
        Arch::Scalar => "scalar",
        #[cfg(target_arch = "x86_64")]
        Arch::V3(_) => "AVX2",
        #[cfg(target_arch = "x86_64")]
        Arch::V4(_) => "AVX-512",
        #[allow(unreachable_patterns)]
        _ => "SIMD",
    }
}

/// AVX2, if that is narrower than the widest instruction set.
#[cfg(target_arch = "x86_64")]
fn narrower_than(widest: Arch) -> Option<Arch> {
    match widest {
        Arch::V4(_) => pulp::x86::V3::try_new().map(Arch::V3),
        _ => None,
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn narrower_than(_: Arch) -> Option<Arch> {
    None
}

/// The faster one of two instruction sets by `time`, which evaluates a kernel a few times; the widest if there is little
/// difference.
fn faster(widest: Arch, narrower: Arch, mut time: impl FnMut(Arch) -> Duration) -> Arch {
    let mut fastest = [Duration::MAX; 2];
    // Alternating, so that other load on the machine affects both.
    for _ in 0..ROUNDS {
        for (fastest, arch) in fastest.iter_mut().zip([widest, narrower]) {
            *fastest = time(arch).min(*fastest);
        }
    }
    let [of_widest, of_narrower] = fastest;
    if of_narrower.as_secs_f64() <= WORTHWHILE * of_widest.as_secs_f64() {
        narrower
    } else {
        widest
    }
}

/// Poses, momentum map and generalized Jacobian.
struct Positions {
    workspace: Workspace,
    jacobian: Matrix6xX<f64>,
    tip: Frame,
}

impl Positions {
    fn new(model: &Model) -> Self {
        Self {
            workspace: Workspace::with_instruction_set(model, Arch::Scalar),
            jacobian: Matrix6xX::zeros(model.dof()),
            // The last frame, after those of the bodies.
            tip: model.frames()[JOINTS + 1].clone(),
        }
    }

    fn time(&mut self, arch: Arch) -> Duration {
        self.workspace.arch = arch;
        let mut q = [0.0; JOINTS];
        let start = Instant::now();
        for k in 0..EVALUATIONS {
            q.fill(0.1 * (k + 1) as f64);
            self.workspace.set_positions_from(&q);
            self.workspace
                .generalized_jacobian(&self.tip, &mut self.jacobian);
        }
        start.elapsed()
    }
}

/// Forward dynamics of a free-floating state.
struct Accelerations {
    dynamics: ArticulatedBody,
    workspace: Workspace,
    state: State,
    input: Input,
    out: Evaluation,
}

impl Accelerations {
    fn new(model: &Model) -> Self {
        Self {
            dynamics: ArticulatedBody::with_instruction_set(model, Arch::Scalar),
            workspace: Workspace::with_instruction_set(model, Arch::Scalar),
            state: State {
                time: 0.0,
                R_WB: UnitQuaternion::identity(),
                p_WC: Vector3::zeros(),
                momentum_W: Momentum::default(),
                q: DVector::from_element(JOINTS, 0.5),
                qd: DVector::from_element(JOINTS, 0.1),
                work: 0.0,
                dissipated: Dissipated::default(),
            },
            input: Input::zero(model),
            out: Evaluation::zero(model),
        }
    }

    fn time(&mut self, arch: Arch) -> Duration {
        let Self {
            dynamics,
            workspace,
            state,
            input,
            out,
        } = self;
        dynamics.scratch.arch = arch;
        let start = Instant::now();
        for _ in 0..EVALUATIONS {
            dynamics.evaluate(state, workspace, input, out);
            // The next evaluation depends on this one, as in a simulation.
            state.q[0] += 1e-9 * out.acceleration.qdd[0];
        }
        start.elapsed()
    }
}

/// Joints of the robot that is timed.
const JOINTS: usize = 6;

/// An arm with axes in turns along z and y.
fn arm() -> Model {
    let body = |mass: f64| RigidInertia {
        mass,
        com: Vector3::new(0.3, 0.0, 0.02),
        about_com: Matrix3::from_diagonal(&Vector3::new(0.1, 0.2, 0.25)) * mass,
    };
    let mut builder = ModelBuilder::new("arm", "base_link", body(2000.0));
    let mut parent = 0;
    for k in 0..JOINTS {
        let axis = if k % 2 == 0 {
            Vector3::z_axis()
        } else {
            Vector3::y_axis()
        };
        let placement = Pose::translation(0.6, 0.0, 0.1);
        let name = format!("link{k}");
        parent = builder.body(
            &name,
            parent,
            JointKind::Continuous,
            axis,
            placement,
            body(20.0),
        );
    }
    builder.frame("tip", parent, None, Pose::identity());
    builder.build()
}

#[cfg(test)]
mod tests {
    use super::*;

    // Fails if the slower one is chosen, if one noisy round decides, or if a difference within the noise rejects the
    // wider one.
    #[test]
    fn the_fastest_round_decides_and_the_widest_wins_if_in_doubt() {
        let (widest, narrower) = (Arch::new(), Arch::Scalar);
        let is_chosen = |of_widest: u64, of_narrower: u64| {
            let mut round = 0;
            let chosen = faster(widest, narrower, |arch| {
                round += 1;
                let noise = if round < 2 * ROUNDS - 3 { 1000 } else { 0 };
                Duration::from_nanos(
                    noise
                        + if name(arch) == name(narrower) {
                            of_narrower
                        } else {
                            of_widest
                        },
                )
            });
            name(chosen) == name(narrower)
        };
        assert!(is_chosen(100, 70));
        assert!(!is_chosen(100, 98));
        assert!(!is_chosen(100, 160));
    }

    // Fails if a kernel cannot be timed, or results are not those of a robot that moves.
    #[test]
    fn kernels_are_timed_on_a_robot_that_moves() {
        let sets = InstructionSets::measured(Arch::new(), Arch::Scalar);
        assert_eq!(name(sets.batch), name(Arch::new()));
        let model = arm();
        let mut positions = Positions::new(&model);
        positions.time(Arch::new());
        assert!(
            positions.jacobian.iter().all(|x| x.is_finite()) && positions.jacobian.norm() > 1.0
        );
        let mut accelerations = Accelerations::new(&model);
        accelerations.time(Arch::new());
        let qdd = &accelerations.out.acceleration.qdd;
        assert!(qdd.iter().all(|x| x.is_finite()) && qdd.norm() > 0.0);
    }
}
