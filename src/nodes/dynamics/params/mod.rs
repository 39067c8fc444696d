//! Parameters of the dynamics node.

mod appendages;
mod bodies;
mod contact;
mod elastic_joints;
mod elastic_links;
mod excitations;
mod flexible;
mod grasps;
mod grippers;
mod joint_physics;
mod lockstep;
mod mass_scale;
mod motions;
mod numbers;
mod package_folders;
mod robots;
mod thrusters;
mod velocity_servo;
mod wheels;

pub(super) use bodies::joint_vector;
pub use bodies::{Description, InitialJoints, InitialMotion, TargetParams};

use super::imu::ImuParams;
use super::joint_drive::{DriveConfig, step_count};
use super::loops::LoopParams;
use super::star_tracker::declare_star_tracker;
use super::wrist::WristParams;
use crate::{
    dynamics::{FormulationKind, IntegrationMethod, JointPhysics},
    nodes::{choice, resource::AllowedFolders},
    ros::{Declare, Lifecycle},
    vision::StarTrackerConfig,
};
pub use appendages::AppendageParams;
use bodies::finite_list;
use contact::declare_contact;
pub use contact::{ContactPairParams, ContactParams};
use excitations::declare_excitations;
pub use excitations::{ExcitationParams, Excited};
pub use flexible::FlexibleParams;
pub use grasps::GraspParams;
use grasps::declare_grasps;
pub use grippers::GripperParams;
use grippers::declare_grippers;
use joint_physics::declare_joint_physics;
pub use lockstep::LockstepOn;
use mass_scale::{declare_mass_scale, with_scaled_masses};
pub use motions::{BaseReaction, LiveBaseReaction, MotionParams};
use motions::{declare_base_reaction, declare_motions, declare_position_servo};
use package_folders::PackageFolders;
use robots::declare_robots;
pub use thrusters::ThrusterParams;
use velocity_servo::declare_servo;
pub use wheels::WheelParams;

/// Parameters of the dynamics node. All but `base_reaction` are read once, at the start.
#[derive(Debug, Clone)]
pub struct DynamicsParams {
    /// The robot's description.
    pub robot: Description,
    /// Initial joint positions \[rad or m\]; empty means zero.
    pub initial_joint_positions: Vec<f64>,
    /// Initial joint rates \[rad/s or m/s\]; empty means zero.
    pub initial_joint_velocities: Vec<f64>,
    /// Loop closures, which make closed loops of the robot's tree.
    pub loop_closures: Vec<LoopParams>,
    /// Largest initial gap of a loop closure that is closed by moving the joints \[m or rad\]; the same for rates.
    pub loop_tolerance: f64,
    /// Initial pose and motion of the base.
    pub base: InitialMotion,
    /// The robot's flexible parts, wheels and thrusters.
    pub flexible: FlexibleParams,
    /// Sine waves and pulses on joints, wheels and links.
    pub excitations: Vec<ExcitationParams>,
    /// Other free-floating bodies.
    pub targets: Vec<TargetParams>,
    /// Grasps by which the robot can hold targets.
    pub grasps: Vec<GraspParams>,
    /// The robot's grippers.
    pub grippers: Vec<GripperParams>,
    /// Contact between bodies; `None` if they pass through each other.
    pub contact: Option<ContactParams>,
    /// Namespaces of all robots of this world, if there are several; the node of the first one owns the time.
    pub robots: Vec<String>,
    /// Folders below which other nodes may name files to spawn.
    pub resource_folders: AllowedFolders,
    /// The base's inertial measurement unit.
    pub imu: ImuParams,
    /// The force and torque sensor.
    pub wrist: WristParams,
    /// The base's star tracker, if it has one.
    pub star_tracker: Option<StarTrackerConfig>,
    /// Integration method.
    pub method: IntegrationMethod,
    /// Formulation of forward dynamics.
    pub formulation: FormulationKind,
    /// Largest integration step \[s\].
    pub time_step: f64,
    /// States published per second of simulated time \[Hz\].
    pub state_rate: f64,
    /// Simulated seconds per second of real time; zero means as fast as possible.
    pub real_time_factor: f64,
    /// Lockstep: whether every state waits for the command that answers it ([`Self::lockstep_on`]).
    pub lockstep: bool,
    /// The commands for which every state waits in lockstep.
    pub lockstep_on: LockstepOn,
    /// Whether time stands still until the first command.
    pub start_on_command: bool,
    /// Whether the simulation is paused at the start.
    pub start_paused: bool,
    /// Whether the node configures and activates itself.
    pub autostart: bool,
    /// Simulated time at which time stops \[s\]; zero means never.
    pub duration: f64,
    /// Age of the last command above which efforts and driven rates become zero \[s\].
    pub command_timeout: f64,
    /// How long the next state waits beyond its due time for the answer to the last one, if the commander answers
    /// states \[s\].
    pub answer_timeout: f64,
    /// Largest effort in a command \[N m or N\].
    pub max_effort: f64,
    /// Acceleration from which effort limits are derived for joints whose description has none \[rad/s² or m/s²\];
    /// zero: no limits.
    pub default_joint_acceleration: f64,
    /// Friction, stops and speed limits of the joints.
    pub joint_physics: JointPhysics,
    /// The servos that drive joint rates and positions.
    pub(super) drive: DriveConfig,
    /// Settings of trajectories, paths, twists and external wrenches.
    pub motions: MotionParams,
    /// How redundant joints reduce the reaction on the base.
    pub base_reaction: LiveBaseReaction,
    /// Largest rate in a command \[rad/s or m/s\].
    pub max_rate: f64,
}

impl DynamicsParams {
    /// Length of the integration steps between two published states without commands in between \[s\].
    pub fn longest_step(&self) -> f64 {
        let period = 1.0 / self.state_rate;
        period / step_count(period, self.time_step) as f64
    }

    /// The repairs made to the descriptions of robot and targets, one line per kind.
    pub fn repairs(&self) -> Vec<String> {
        let targets = self.targets.iter().map(|target| &target.description);
        let descriptions = std::iter::once(&self.robot).chain(targets);
        let mut lines: Vec<String> = descriptions.flat_map(Description::warnings).collect();
        lines.dedup();
        lines
    }

    /// Declares and reads the parameters. The caller must call `declare.finish`.
    ///
    /// # Errors
    /// A line that names the parameter whose file cannot be read or whose value does not fit the others.
    pub fn declare(declare: &mut Declare) -> Result<Self, String> {
        let xml = (declare.param(
            "robot_description",
            "",
            "The robot as URDF text; instead of urdf",
        ))
        .read_only()
        .value();
        let packages = PackageFolders::declare(declare);
        let strict = declare
            .param(
                "strict",
                false,
                "Refuse a robot description that needs repairs",
            )
            .read_only()
            .value();
        let lookup = |declare: &Declare, name: &str| packages.lookup(declare, name);
        let of_robot = lookup(declare, "urdf");
        let urdf = declare
            .param(
                "urdf",
                "package://fuyu/urdf/servicer.urdf",
                "File with the robot's URDF: a path (relative to the parameter file) or package://PACKAGE/PATH",
            )
            .read_only()
            .value();
        let initial_joint_positions = finite_list(
            declare,
            "initial_joint_positions",
            "Joint positions at the start, in the robot's joint order [rad or m]; empty is zero",
        );
        let initial_joint_velocities = finite_list(
            declare,
            "initial_joint_velocities",
            "Joint rates at the start [rad/s or m/s]; empty is zero",
        );
        let loop_closures = LoopParams::declare(declare);
        let loop_tolerance = declare
            .param(
                "loop_tolerance",
                1e-3,
                "Largest gap of a loop closure at the start that is closed by moving the joints [m or rad]; the same for rates",
            )
            .range(1e-12, 1.0)
            .read_only()
            .value();
        let base = InitialMotion::declare(declare, "base", "base frame");
        let flexible = FlexibleParams::declare(declare, &lookup);
        let excitations = declare_excitations(declare);
        let names = declare
            .param(
                "targets",
                Vec::<String>::new(),
                "Names of the other free bodies (targets)",
            )
            .read_only()
            .value();
        let resource_folders = declare
            .param(
                "resource_folders",
                vec!["package://fuyu/urdf".to_owned()],
                "Folders from which peers may name URDF files to spawn: paths or package://PACKAGE/FOLDER",
            )
            .read_only()
            .value();
        let robots = declare_robots(declare);
        let mut targets = Vec::new();
        for name in names {
            let key = format!("{name}.urdf");
            let lookup = lookup(declare, &key);
            let file = declare
                .param(
                    &key,
                    "package://fuyu/urdf/target.urdf",
                    "File with the target's URDF",
                )
                .read_only()
                .value();
            let mass_scale = declare_mass_scale(declare, &name);
            let motion = InitialMotion::declare(declare, &name, "target's frame");
            let joints = InitialJoints::declare(declare, &name);
            targets.push((name, key, file, lookup, mass_scale, motion, joints));
        }
        let grasps = declare_grasps(declare);
        let grippers = declare_grippers(declare);
        let contact = declare_contact(declare, &packages.0);
        let imu = ImuParams::declare(declare);
        let wrist = WristParams::declare(declare);
        let star_tracker = declare_star_tracker(declare);
        let method = choice::declare(
            declare,
            "integrator",
            &IntegrationMethod::NAMES,
            "Integration method",
        )
        .read_only()
        .value();
        let formulations = choice::list(&FormulationKind::NAMES);
        // Closed loops need the reduced inertia.
        let default = match &loop_closures {
            Ok(closures) if !closures.is_empty() => FormulationKind::Reduced,
            _ => FormulationKind::default(),
        };
        let formulation = declare
            .param(
                "formulation",
                choice::name_of(&FormulationKind::NAMES, &default),
                &format!(
                    "Formulation of forward dynamics: {formulations}; reduced with loop_closures"
                ),
            )
            .check(&format!("one of {formulations}"), |text| {
                choice::find(&FormulationKind::NAMES, text).map(|_| ())
            })
            .read_only()
            .value();
        let time_step = declare
            .param("time_step", 0.01, "Largest integration step [s]")
            .range(1e-6, 1.0)
            .read_only()
            .value();
        let state_rate = declare
            .param(
                "state_rate",
                100.0,
                "States published per simulated second [Hz]",
            )
            .range(0.1, 1000.0)
            .read_only()
            .value();
        let real_time_factor = declare
            .param(
                "real_time_factor",
                1.0,
                "Simulated seconds per second; 0 is as fast as possible",
            )
            .check("0.0, or 0.001 to 1000000.0", |factor| {
                if *factor == 0.0 || (1e-3..=1e6).contains(factor) {
                    Ok(())
                } else {
                    Err(format!(
                        "{factor} is out of range, expected 0.0 or 0.001 to 1000000.0"
                    ))
                }
            })
            .read_only()
            .value();
        let lockstep = declare
            .param(
                "lockstep",
                false,
                "Wait after every state for the command that answers it",
            )
            .read_only()
            .value();
        let lockstep_on = LockstepOn::declare(declare);
        let start_on_command = declare
            .param(
                "start_on_command",
                false,
                "Hold time at zero until the first command arrives",
            )
            .read_only()
            .value();
        let start_paused = declare
            .param(
                "start_paused",
                false,
                "Begin paused, until set_simulation_state or step_simulation advances time",
            )
            .read_only()
            .value();
        let autostart = Lifecycle::declare_autostart(declare);
        let duration = declare
            .param(
                "duration",
                0.0,
                "Simulated time at which time stops [s]; 0 is never",
            )
            .range(0.0, 1e9)
            .read_only()
            .value();
        let command_timeout = declare
            .param(
                "command_timeout",
                0.5,
                "Age of the last command above which efforts and driven rates become zero [s]",
            )
            .range(1e-3, 1e6)
            .read_only()
            .value();
        let answer_timeout = declare
            .param(
                "answer_timeout",
                0.5,
                "How long time waits for the answer to the last state, from a commander that answers states [s of the computer's clock]; 0 never waits",
            )
            .range(0.0, 60.0)
            .read_only()
            .value();
        let max_effort = declare
            .param(
                "max_effort",
                1e6,
                "Largest joint effort in a command; a command with a larger one is refused [N m or N]",
            )
            .range(1e-9, 1e9)
            .read_only()
            .value();
        let default_joint_acceleration = declare
            .param(
                "default_joint_acceleration",
                1000.0,
                "Joints whose URDF gives no effort limit get one: this acceleration times the largest inertia that they have to move, with the arm outstretched [rad/s2 or m/s2]; 0 is no limit",
            )
            .range(0.0, 1e9)
            .read_only()
            .value();
        let joint_physics = declare_joint_physics(declare);
        let drive = DriveConfig {
            velocity: declare_servo(declare),
            position_bandwidth: declare_position_servo(declare),
        };
        let motions = declare_motions(declare);
        let base_reaction = declare_base_reaction(declare);
        let max_rate = declare
            .param(
                "velocity_servo.max_rate",
                100.0,
                "Largest joint rate in a command; a command with a larger one is refused [rad/s or m/s]",
            )
            .range(1e-9, 1e9)
            .read_only()
            .value();
        if real_time_factor == 0.0 && !lockstep {
            return Err(
                "parameter real_time_factor is 0.0 (as fast as possible), which needs lockstep: true; without it commands would arrive too late"
                    .to_owned(),
            );
        }

        let (base, loop_closures, flexible, grasps) = (base?, loop_closures?, flexible?, grasps?);
        // Any other text has been refused by the declaration.
        let formulation = choice::find(&FormulationKind::NAMES, &formulation).unwrap_or_default();
        if !loop_closures.is_empty() && formulation != FormulationKind::Reduced {
            let name = choice::name_of(&FormulationKind::NAMES, &formulation);
            return Err(format!(
                "parameter formulation is '{name}', which does not support closed loops; loop_closures need 'reduced'"
            ));
        }
        if !flexible.is_empty() && !loop_closures.is_empty() {
            return Err(
                "parameter loop_closures: closed loops of robots with appendages, elastic joints, wheels or thrusters are not simulated; remove one of the two"
                    .to_owned(),
            );
        }
        if !flexible.is_empty() && formulation != FormulationKind::default() {
            let name = choice::name_of(&FormulationKind::NAMES, &formulation);
            let usual = choice::name_of(&FormulationKind::NAMES, &FormulationKind::default());
            return Err(format!(
                "parameter formulation is '{name}'; robots with appendages, elastic joints, wheels or thrusters need '{usual}'"
            ));
        }
        if !flexible.is_empty() && contact.is_some() {
            return Err(
                "parameter contact: a robot with appendages, elastic joints, wheels or thrusters cannot touch other bodies yet; remove one of the two"
                    .to_owned(),
            );
        }
        if !loop_closures.is_empty() && contact.is_some() {
            return Err(
                "parameter contact: a robot with loop_closures cannot touch other bodies; remove one of the two"
                    .to_owned(),
            );
        }
        let robot = if xml.is_empty() {
            Description::read("urdf", &urdf, &of_robot, strict)?
        } else {
            Description::new(xml, "parameter robot_description".to_owned(), strict)
        };
        let targets = (targets.into_iter())
            .map(|(name, key, file, lookup, mass_scale, motion, joints)| {
                let mut description = Description::read(&key, &file, &lookup, strict)?;
                if mass_scale != 1.0 {
                    description.xml = with_scaled_masses(&description.xml, mass_scale);
                }
                Ok(TargetParams {
                    name,
                    description,
                    motion: motion?,
                    joints,
                })
            })
            .collect::<Result<_, String>>()?;
        Ok(Self {
            robot,
            initial_joint_positions,
            initial_joint_velocities,
            loop_closures,
            loop_tolerance,
            base,
            flexible,
            excitations: excitations?,
            targets,
            grasps,
            grippers: grippers?,
            contact,
            robots,
            resource_folders: AllowedFolders::new(resource_folders),
            imu,
            wrist,
            star_tracker,
            // Any other text has been refused by the declaration.
            method: choice::find(&IntegrationMethod::NAMES, &method).unwrap_or_default(),
            formulation,
            time_step,
            state_rate,
            real_time_factor,
            lockstep,
            lockstep_on,
            start_on_command,
            start_paused,
            autostart,
            duration,
            command_timeout,
            answer_timeout,
            max_effort,
            default_joint_acceleration,
            joint_physics,
            drive,
            motions: motions?,
            base_reaction,
            max_rate,
        })
    }
}
