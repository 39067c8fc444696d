//! Free-floating space robots as ROS 2 nodes: simulation and control without a ROS installation.
//!
//! fuyu (浮遊, floating) is a program; `README.md` describes it. This is its library.
//!
//! # Layers
//!
//! This package uses and re-exports `fuyu-physics` and `fuyu-ros`, which do not depend on each other. The other packages,
//! of which `fuyu-structures` is re-exported, know neither robots nor ROS.
//!
//! | package | module | contains |
//! | --- | --- | --- |
//! | `fuyu-physics` | [`spatial`] | rotations, twists, wrenches, inertias |
//! | | [`model`] | a URDF compiled into bodies, joints and frames |
//! | | [`dynamics`] | kinematics, momentum, generalized Jacobian, forward dynamics, integrators |
//! | | [`vision`] | what a camera on the moving base measures |
//! | | [`estimation`] | the motion of an unknown tumbling body |
//! | | [`control`] | control laws, the controller, guidance of captures |
//! | `fuyu-ros` | `msg` | ROS 2 messages and services, CDR, schemas |
//! | | `ros` | nodes over DDS: endpoints, parameters, lifecycle, actions |
//! | | `bag` | rosbag2 recordings |
//! | `fuyu` | `nodes` | the ROS 2 nodes, and scenario files |
//! | | `experiments` | closed loops without DDS (`fuyu simulate`), campaigns, evaluation of recorded runs, published examples |
//! | | `cli` | the command line |
//! | `fuyu-lti` | | linear systems, design of attitude control |
//! | `fuyu-structures` | | deformable bodies: modes, transmission zeros |
//! | `fuyu-campaign` | | distributions, designs and statistics of campaigns |
//! | `fuyu-render` | | images of spacecraft |
//! | `fuyu-track` | | points of a body in images |
//!
//! `fuyu-physics` has no ROS and reads no files; `fuyu-ros` has no physics. Inside a package, a module imports only
//! modules above it in the table; `ARCHITECTURE.md` has the diagram, `docs/symbols.md` the symbols and terms.
//!
//! # Features
//!
//! `ros` (default) adds `fuyu-ros`, the nodes and the command line. Without it fuyu contains only the physics and those
//! published examples that need nothing else:
//!
//! ```toml
//! fuyu = { version = "0.1", default-features = false }
//! ```
//!
//! ```
//! use fuyu::{dynamics::Workspace, model::Model};
//! use nalgebra::{DVector, Matrix6xX};
//!
//! let urdf = r#"
//!     <robot name="boom">
//!       <link name="base_link"><inertial><mass value="100"/>
//!         <inertia ixx="10" iyy="10" izz="10" ixy="0" ixz="0" iyz="0"/></inertial></link>
//!       <link name="arm"><inertial><origin xyz="0.5 0 0"/><mass value="10"/>
//!         <inertia ixx="0.1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
//!       <link name="tool0"/>
//!       <joint name="shoulder" type="continuous"><parent link="base_link"/><child link="arm"/>
//!         <origin xyz="1 0 0"/><axis xyz="0 0 1"/></joint>
//!       <joint name="flange" type="fixed"><parent link="arm"/><child link="tool0"/>
//!         <origin xyz="1 0 0"/></joint>
//!     </robot>"#;
//! let model = Model::from_urdf(urdf, "boom.urdf")?;
//! let tip = model.frame("tool0").expect("a link of the robot");
//!
//! let mut workspace = Workspace::new(&model);
//! workspace.set_positions(&DVector::from_element(1, 0.3));
//! let mut fixed = Matrix6xX::zeros(model.dof());
//! let mut generalized = Matrix6xX::zeros(model.dof());
//! workspace.fixed_base_jacobian(tip, &mut fixed);
//! workspace.generalized_jacobian(tip, &mut generalized);
//!
//! // The base turns the other way, so the tip turns less than the joint.
//! assert_eq!(fixed[(5, 0)], 1.0);
//! assert!(generalized[(5, 0)] > 0.0 && generalized[(5, 0)] < 1.0);
//! # Ok::<(), fuyu::model::UrdfError>(())
//! ```
//!
//! # Notation, units, sources
//!
//! Names of quantities contain their frames, in monogram notation (`X_AB`, `R_WB`, `w_WB_B`); [`spatial`] defines it.
//! Units are SI, frames and axes those of REP-103 and REP-105.
//!
//! Every formula that is not from a textbook cites its source, such as "Masutani 1995 eq. (4.36)": Y. Masutani
//! (升谷 保博), 浮遊型宇宙ロボットによる物体捕捉のための計測と制御 (measurement and control for the capture of objects
//! by floating space robots), doctoral thesis, Osaka University, 1995,
//! [doi:10.11501/3105001](https://doi.org/10.11501/3105001). Misprints are corrected, and the comment says so. Modules
//! that reproduce a part of it are named after the part: `masutani_ch5` (chapter 5), `masutani_g` (appendix G). "TR-942" is
//! Y. Ohkami (狼 嘉彰) et al., Formulation methods of rigid multibody systems for large space structures and some results
//! of computer simulation (多剛体宇宙構造物のモデリング手法とシミュレーション結果), Technical Report TR-942, National Aerospace Laboratory, 1987.

pub use fuyu_physics::{control, dynamics, estimation, model, spatial, vision};
#[cfg(feature = "ros")]
pub use fuyu_ros::{bag, input_file, msg, ros};
/// Flexible structures: modes, transmission zeros, and deformable bodies for the equations of motion.
pub use fuyu_structures as structures;

#[cfg(feature = "ros")]
pub mod cli;
#[cfg(feature = "ros")]
pub mod experiments;
/// Published examples; with the feature `ros` also closed loops and the evaluation of recorded runs.
#[cfg(not(feature = "ros"))]
pub mod experiments {
    mod continuous_loop;
    pub mod kida1993;
    pub mod masutani_ch3;
    pub mod masutani_ch5;
    pub mod masutani_ch6;
    pub mod masutani_ch7;
    pub mod masutani_ch8;
    pub mod masutani_g;
    pub mod operation_counts;
    pub mod tr942;
    pub mod tracking;

    pub use continuous_loop::ContinuousLoop;
}
#[cfg(feature = "ros")]
pub mod nodes;

/// Compiles the Rust code of README.md.
#[cfg(all(doctest, feature = "batch"))]
#[doc = include_str!("../README.md")]
struct Readme;
