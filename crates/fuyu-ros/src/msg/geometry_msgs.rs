//! ROS package [`geometry_msgs`](https://docs.ros.org/en/jazzy/p/geometry_msgs/).

use super::std_msgs::Header;

crate::messages! {
    package geometry_msgs;

    /// A free vector.
    message Vector3 {
        /// Along x.
        x: f64,
        /// Along y.
        y: f64,
        /// Along z.
        z: f64,
    }

    /// A position.
    message Point {
        /// Along x \[m\].
        x: f64,
        /// Along y \[m\].
        y: f64,
        /// Along z \[m\].
        z: f64,
    }

    /// A rotation; its default is no rotation.
    message Quaternion {
        /// Vector part, x.
        x: f64 = 0.0,
        /// Vector part, y.
        y: f64 = 0.0,
        /// Vector part, z.
        z: f64 = 0.0,
        /// Scalar part.
        w: f64 = 1.0,
    }

    /// Position and orientation.
    message Pose {
        /// Where.
        position: Point,
        /// How turned.
        orientation: Quaternion,
    }

    /// A pose in a frame, at a time.
    message PoseStamped {
        /// Time and frame.
        header: Header,
        /// The pose.
        pose: Pose,
    }

    /// A pose with its uncertainty.
    message PoseWithCovariance {
        /// The pose.
        pose: Pose,
        /// Row by row: x, y, z, then rotation about the fixed axes X, Y, Z.
        covariance: [[f64; 6]; 6],
    }

    /// A vector in a frame, at a time.
    message Vector3Stamped {
        /// Time and frame.
        header: Header,
        /// The vector.
        vector: Vector3,
    }

    /// A point in a frame, at a time.
    message PointStamped {
        /// Time and frame.
        header: Header,
        /// The point.
        point: Point,
    }

    /// A rotation in a frame, at a time.
    message QuaternionStamped {
        /// Time and frame.
        header: Header,
        /// The rotation.
        quaternion: Quaternion,
    }

    /// Velocity of a body.
    message Twist {
        /// Linear part \[m/s\].
        linear: Vector3,
        /// Angular part \[rad/s\].
        angular: Vector3,
    }

    /// A twist in a frame, at a time.
    message TwistStamped {
        /// Time and frame.
        header: Header,
        /// The twist.
        twist: Twist,
    }

    /// A twist with its uncertainty.
    message TwistWithCovariance {
        /// The twist.
        twist: Twist,
        /// Row by row: x, y, z, then rotation about the fixed axes X, Y, Z.
        covariance: [[f64; 6]; 6],
    }

    /// Acceleration of a body.
    message Accel {
        /// Linear part \[m/s²\].
        linear: Vector3,
        /// Angular part \[rad/s²\].
        angular: Vector3,
    }

    /// Force and torque on a body.
    message Wrench {
        /// Force \[N\].
        force: Vector3,
        /// Torque \[N m\].
        torque: Vector3,
    }

    /// A wrench in a frame, at a time.
    message WrenchStamped {
        /// Time and frame.
        header: Header,
        /// The wrench.
        wrench: Wrench,
    }

    /// Where one frame lies in another.
    message Transform {
        /// Position of the child's origin \[m\].
        translation: Vector3,
        /// Orientation of the child's axes.
        rotation: Quaternion,
    }

    /// Transform from the frame `child_frame_id` to the frame `header.frame_id`.
    message TransformStamped {
        /// Time and parent frame.
        header: Header,
        /// Child frame.
        child_frame_id: String,
        /// Pose of the child in the parent.
        transform: Transform,
    }

    /// Mass properties of a body.
    message Inertia {
        /// Mass \[kg\].
        m: f64,
        /// Centre of mass \[m\].
        com: Vector3,
        /// Inertia \[kg m²\], xx.
        ixx: f64,
        /// xy.
        ixy: f64,
        /// xz.
        ixz: f64,
        /// yy.
        iyy: f64,
        /// yz.
        iyz: f64,
        /// zz.
        izz: f64,
    }
}
