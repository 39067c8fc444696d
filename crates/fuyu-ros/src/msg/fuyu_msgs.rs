//! Messages of fuyu's space robot nodes that no ROS package has. The `.msg` files in fuyu's folder `msg/` are the text of
//! these declarations.

use super::geometry_msgs::{Point, Quaternion, Vector3};
use super::std_msgs::Header;

pub mod capture;

crate::messages! {
    package fuyu_msgs;

    /// Momentum and kinetic energy of a free-floating robot as a whole.
    ///
    /// Both momenta stay constant while nothing outside acts on the robot, whatever its joints do.
    message Momentum {
        /// Time of the state; the inertial frame whose axes are used.
        header: Header,
        /// Linear momentum of the system \[N s\], inertial axes.
        linear: Vector3,
        /// Angular momentum about the system's centre of mass \[N m s\], inertial axes.
        angular: Vector3,
        /// Kinetic energy, including that of the system's centre of mass \[J\].
        kinetic_energy: f64,
        /// Energy that damping, friction and stops of the joints, deformation and bearings of wheels have taken since the
        /// start \[J\].
        dissipated_energy: f64,
    }

    /// What external wrenches, thrusters, grasps and contacts have changed since the start of the run.
    ///
    /// The momentum of fuyu_msgs/Momentum less these impulses is constant. Published from the first of them on.
    message ExternalImpulse {
        /// Time of the state; the inertial frame whose axes are used.
        header: Header,
        /// Change of linear momentum \[N s\], inertial axes.
        linear: Vector3,
        /// Change of angular momentum about the system's centre of mass \[N m s\], inertial axes.
        angular: Vector3,
        /// Work done on the robot \[J\].
        work: f64,
    }

    /// Deformation of a robot's appendages and elastic joints.
    message AppendageStates {
        /// Time of the state; the robot's base frame.
        header: Header,
        /// Names of the appendages.
        name: Vec<String>,
        /// Number of modes of each appendage; mu and mud have those of the first one, then those of the next.
        modes: Vec<u32>,
        /// Modal coordinates \[kg^1/2 m if modes are mass-normalised\].
        mu: Vec<f64>,
        /// Their rates.
        mud: Vec<f64>,
        /// Displacement of each appendage's tip, or of its first output point \[m\], in axes of its attachment frame; zero
        /// if it has none.
        tip_displacement: Vec<Vector3>,
        /// Names of the elastic joints.
        joint_name: Vec<String>,
        /// Angles of their motors on the output side of the gear \[rad or m\].
        motor_position: Vec<f64>,
        /// Rates of their motors on the output side of the gear \[rad/s or m/s\].
        motor_velocity: Vec<f64>,
        /// Strain energy of appendages and elastic joints \[J\].
        strain_energy: f64,
    }

    /// Points of a robot's appendages, and how each mode of fuyu_msgs/AppendageStates moves them: for viewers.
    message AppendageOutlines {
        /// The robot's base frame.
        header: Header,
        /// Names of the appendages; an attachment frame has the name of its appendage.
        name: Vec<String>,
        /// Number of modes of each appendage.
        modes: Vec<u32>,
        /// Number of points of each appendage.
        points: Vec<u32>,
        /// Whether the points of each appendage go around a surface, along x on one side and back on the other; otherwise
        /// they are a line.
        is_surface: Vec<bool>,
        /// Undeformed positions of all points \[m\], each in its attachment frame.
        position: Vec<Point>,
        /// Displacement of each point for each mode of its appendage \[m per unit of mu\], all modes of the first point
        /// first.
        shape: Vec<Vector3>,
    }

    /// Opens the valves of thrusters.
    message ThrusterCommands {
        /// Time of the state that the command answers.
        header: Header,
        /// Names of the thrusters; others keep what they do.
        name: Vec<String>,
        /// How long each is on from now \[s\], which replaces what is left of an earlier command; zero closes the valve.
        on_time: Vec<f64>,
    }

    /// What the tip controller saw, decided and sent in one step.
    message ControllerState {
        /// Time of the joint state that was answered; the robot's base frame, whose axes are used.
        header: Header,
        /// Control law in use.
        law: String,
        /// Position of the goal from the tip \[m\], base axes.
        position_error: Vector3,
        /// Rotation from the tip to the goal as half the sum of the cross products of their axes,
        /// tip first \[-\], base axes.
        orientation_error: Vector3,
        /// Length of position_error \[m\].
        position_error_norm: f64,
        /// Angle of the rotation from the tip to the goal, 0 to pi \[rad\].
        attitude_error_angle: f64,
        /// The pull towards the goal's position is at its limit.
        position_saturated: bool,
        /// The pull towards the goal's orientation is at its limit.
        orientation_saturated: bool,
        /// Gain on the position error \[N/m\].
        k_p: f64,
        /// Gain on the orientation error \[N m\].
        k_o: f64,
        /// Names of the joints; k_v and effort follow their order.
        joint_names: Vec<String>,
        /// Gains on the joint velocities \[N m s/rad or N s/m\].
        k_v: Vec<f64>,
        /// Efforts that were commanded \[N m or N\].
        effort: Vec<f64>,
        /// Age of the tip pose that was used \[s\].
        tip_pose_age: f64,
        /// Age of the goal pose that was used \[s\].
        goal_pose_age: f64,
        /// A second tip and its goal are seen; without them the fields below are zero.
        second_tip_seen: bool,
        /// Position of the second goal from the second tip \[m\], base axes.
        second_position_error: Vector3,
        /// As orientation_error, of the second tip.
        second_orientation_error: Vector3,
        /// Length of second_position_error \[m\].
        second_position_error_norm: f64,
        /// As attitude_error_angle, of the second tip \[rad\].
        second_attitude_error_angle: f64,
    }

    /// What the attitude controller estimated, decided and sent in one step.
    ///
    /// Vectors are in axes of the robot's base frame. Torques are on the base.
    message AttitudeState {
        /// Time of the step; the robot's base frame.
        header: Header,
        /// Attitude law in use.
        law: String,
        /// What the torques are: `law`, `rate_damping` (the attitude is not known) or `zero_torque` (there is no gyro).
        mode: String,
        /// Whether a star tracker has measured the attitude, so that orientation and error mean something.
        attitude_known: bool,
        /// Estimated attitude of the base in the world.
        orientation: Quaternion,
        /// Estimated angular velocity of the base \[rad/s\].
        angular_velocity: Vector3,
        /// Estimated bias of the gyro \[rad/s\].
        gyro_bias: Vector3,
        /// Covariance of the attitude's rotation vector \[rad2\] and of the bias \[rad2/s2\], 6 x 6 by rows.
        covariance: Vec<f64>,
        /// Reference of the attitude.
        target: Quaternion,
        /// Rotation vector from the reference to the base, for small angles \[rad\].
        attitude_error: Vector3,
        /// Angle of the rotation from the reference to the base, 0 to pi \[rad\].
        attitude_error_angle: f64,
        /// Torque of the law \[N m\].
        law_torque: Vector3,
        /// Torque for the motion of the arm \[N m\].
        feed_forward_torque: Vector3,
        /// Torque that the wheels are commanded to give \[N m\].
        wheel_torque: Vector3,
        /// Mean torque of the thrusters until the next step \[N m\].
        thruster_torque: Vector3,
        /// Angular momentum of the wheels \[N m s\].
        wheel_momentum: Vector3,
        /// Largest share of its momentum limit that a wheel has; 1 is the limit.
        wheel_load: f64,
        /// Number of wheels that are at a limit.
        saturated_wheels: u32,
        /// Thrusters take momentum from the wheels.
        unloading: bool,
        /// Age of the last measurement of the star tracker that was used \[s\].
        star_tracker_age: f64,
        /// Measurements of the star tracker so far that contradict the estimate.
        outliers: u32,
    }

    /// Feature points of one camera image, each with an identity that lasts from image to image.
    message FeatureTracks {
        /// Time of exposure; the camera's optical frame.
        header: Header,
        /// Identity of each point; it is not used again for another one.
        ids: Vec<u32>,
        /// Horizontal position of each point, to the right \[px\]; pixel centres are at integers.
        u: Vec<f64>,
        /// Vertical position of each point, downwards \[px\]; pixel centres are at integers.
        v: Vec<f64>,
    }

    /// State of a capture mission, and what its phases have done so far.
    ///
    /// The phases are observe, plan, approach, grasp, detumble and identify; then done or aborted.
    message MissionState {
        /// Time of the state; the robot's base frame.
        header: Header,
        /// The present phase.
        phase: String,
        /// What of it is done, from 0 to 1.
        progress: f64,
        /// What it waits for; empty if it does not wait.
        waits_for: String,
        /// Whether an operator has paused it.
        is_held: bool,
        /// Phases so far, the present one last.
        phase_name: Vec<String>,
        /// When each began \[s\].
        phase_start: Vec<f64>,
        /// When each ended \[s\]; of the present one the time of the state.
        phase_end: Vec<f64>,
        /// How each ended; empty of the present one.
        outcome: Vec<String>,
        /// Names of the phases' figures.
        figure_name: Vec<String>,
        /// The phase of each, from 0.
        figure_phase: Vec<u32>,
        /// Their values.
        figure_value: Vec<f64>,
        /// Their units; empty for ratios and counts.
        figure_unit: Vec<String>,
    }

    /// How a body tumbles: the parameters of a free rotation, after Masutani 1995, and how well they fit.
    message MotionEstimate {
        /// The time at which the motion is stated; the camera's optical frame, whose axes at that time are
        /// meant wherever this message says camera axes.
        header: Header,
        /// How it was estimated, `bundle`, `maximum_likelihood` or `masutani1995`.
        method: String,
        /// Solution of Euler's equations that describes it: `asymmetric`, `aperiodic`, `axisymmetric` or
        /// `single_axis`.
        model: String,
        /// The three principal moments of inertia over twice the kinetic energy \[s2\], in the thesis's
        /// order; all zero where the model does not tell them.
        j_x: f64,
        /// Of the middle axis.
        j_y: f64,
        /// Of the third axis.
        j_z: f64,
        /// Square of the angular momentum over four times the square of the energy \[s2\].
        alpha: f64,
        /// Attitude of the body in camera axes; the body's axes are fixed to it, but otherwise arbitrary.
        reference_attitude: Quaternion,
        /// Argument of the elliptic functions \[rad\]; zero for a single axis.
        phase: f64,
        /// Angular velocity in camera axes \[rad/s\].
        angular_velocity: Vector3,
        /// Direction of the angular momentum in camera axes.
        momentum_direction: Vector3,
        /// Root mean square residual of the last frame that was used \[px\], or for masutani1995 of the fit \[rad/s\].
        residual: f64,
        /// Covariance of j_x, j_y, j_z and alpha, row by row \[s4\]; all zero where the method has none.
        covariance: [f64; 16],
        /// Covariance of reference_attitude, as a rotation in camera axes, row by row \[rad2\]; this and the other
        /// covariances are all zero where the method has none.
        attitude_covariance: [f64; 9],
        /// Covariance of angular_velocity, row by row \[rad2/s2\].
        angular_velocity_covariance: [f64; 9],
        /// Covariance of momentum_direction, row by row \[rad2\].
        momentum_direction_covariance: [f64; 9],
        /// Times after header.stamp \[s\] of the predicted rotations whose covariances follow.
        prediction_times: Vec<f64>,
        /// Covariance of the predicted rotation since header.stamp, in camera axes, nine values for each time \[rad2\].
        turn_covariances: Vec<f64>,
        /// Position of the centre of mass in camera axes.
        position: Vector3,
        /// Its velocity, per second.
        velocity: Vector3,
        /// Covariance of position, row by row.
        position_covariance: [f64; 9],
        /// Covariance of velocity, row by row.
        velocity_covariance: [f64; 9],
        /// Unit of length of the four: `m`, or `depth`, that of the centre in the first frame of the batch, where no known
        /// length gives the scale; empty where the centre of mass is not known, and the values are zero.
        centre_unit: String,
        /// Frames that were used.
        frames: u32,
        /// Seconds that they span.
        duration: f64,
    }
}

/// Services of fuyu.
pub mod services {
    use crate::msg::{
        builtin_interfaces::{Duration, Time},
        geometry_msgs::{Point, Wrench},
    };

    crate::services! {
        package fuyu_msgs;

        /// Applies a wrench to a link for some time. The fields are those of Gazebo's ApplyLinkWrench.
        service ApplyLinkWrench {
            ApplyLinkWrenchRequest {
                /// Link of the robot.
                link_name: String,
                /// Frame of the wrench's axes and of reference_point: a link of the robot or "world"; empty is the
                /// link.
                reference_frame: String,
                /// Point at which the force acts, in reference_frame; in "world" it is relative to the link's origin
                /// \[m\].
                reference_point: Point,
                /// Force \[N\] and torque \[N m\], in the axes of reference_frame.
                wrench: Wrench,
                /// Simulated time from which it acts; a time that is over is at once.
                start_time: Time,
                /// How long it acts; negative is until it is cleared.
                duration: Duration,
            }
            ApplyLinkWrenchResponse {
                /// Whether it acts, or will.
                success: bool,
                /// Why not.
                status_message: String,
            }
        }

        /// Ends the wrenches on a link that ApplyLinkWrench began.
        service ClearLinkWrenches {
            ClearLinkWrenchesRequest {
                /// Link of the robot; empty is all links.
                link_name: String,
            }
            ClearLinkWrenchesResponse {
                /// Whether there is such a link.
                success: bool,
                /// How many have ended, or why none.
                status_message: String,
            }
        }
    }
}
