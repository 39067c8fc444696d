//! ROS package [`sensor_msgs`](https://docs.ros.org/en/jazzy/p/sensor_msgs/).

use super::geometry_msgs::{Quaternion, Vector3};
use super::std_msgs::Header;

crate::messages! {
    package sensor_msgs;

    /// State of joints, by name; a list that does not apply is empty.
    message JointState {
        /// Time of the state.
        header: Header,
        /// Joint names; the other lists follow their order.
        name: Vec<String>,
        /// Positions \[rad or m\].
        position: Vec<f64>,
        /// Velocities \[rad/s or m/s\].
        velocity: Vec<f64>,
        /// Efforts \[N m or N\].
        effort: Vec<f64>,
    }

    /// A window of an image; all zero is the whole image.
    message RegionOfInterest {
        /// Leftmost pixel.
        x_offset: u32,
        /// Topmost pixel.
        y_offset: u32,
        /// Height \[px\].
        height: u32,
        /// Width \[px\].
        width: u32,
        /// Whether a rectified window should be cut from this one.
        do_rectify: bool,
    }

    /// Calibration of a camera.
    message CameraInfo {
        /// Time of the image; the camera's optical frame.
        header: Header,
        /// Height of the image \[px\].
        height: u32,
        /// Width of the image \[px\].
        width: u32,
        /// Distortion model, `plumb_bob`.
        distortion_model: String,
        /// Distortion parameters.
        d: Vec<f64>,
        /// Intrinsic matrix, row by row.
        k: [f64; 9],
        /// Rectification, row by row.
        r: [f64; 9],
        /// Projection, row by row.
        p: [f64; 12],
        /// Horizontal binning; 0 and 1 mean none.
        binning_x: u32,
        /// Vertical binning; 0 and 1 mean none.
        binning_y: u32,
        /// The window of the full image that is sent.
        roi: RegionOfInterest,
    }

    /// An image, row by row.
    message Image {
        /// Time of exposure; the camera's optical frame.
        header: Header,
        /// Rows.
        height: u32,
        /// Columns.
        width: u32,
        /// Meaning of the pixels, `mono8`, `rgb8`.
        encoding: String,
        /// 1 if the data are big-endian.
        is_bigendian: u8,
        /// Bytes in a row.
        step: u32,
        /// `step * height` bytes.
        data: Vec<u8>,
    }

    /// A compressed image.
    message CompressedImage {
        /// Time of exposure; the camera's optical frame.
        header: Header,
        /// `png`, `jpeg`.
        format: String,
        /// The compressed bytes.
        data: Vec<u8>,
    }

    /// Layout of one value of the points of a cloud.
    message PointField {
        /// `x`, `y`, `z`.
        name: String,
        /// Bytes from the beginning of a point.
        offset: u32,
        /// Type of the values, one of the constants.
        datatype: u8,
        /// Number of values.
        count: u32,
    }
    constants {
        /// Integers of 8 bits.
        INT8: u8 = 1,
        /// The same without sign.
        UINT8: u8 = 2,
        /// Integers of 16 bits.
        INT16: u8 = 3,
        /// The same without sign.
        UINT16: u8 = 4,
        /// Integers of 32 bits.
        INT32: u8 = 5,
        /// The same without sign.
        UINT32: u8 = 6,
        /// Floating-point numbers of 32 bits.
        FLOAT32: u8 = 7,
        /// Floating-point numbers of 64 bits.
        FLOAT64: u8 = 8,
    }

    /// Points in space, row by row.
    message PointCloud2 {
        /// Time of the measurement; the frame of the coordinates.
        header: Header,
        /// Rows; 1 if the points have no order.
        height: u32,
        /// Points in a row.
        width: u32,
        /// Layout of a point.
        fields: Vec<PointField>,
        /// Whether the data are big-endian.
        is_bigendian: bool,
        /// Bytes of a point.
        point_step: u32,
        /// Bytes of a row.
        row_step: u32,
        /// `row_step * height` bytes.
        data: Vec<u8>,
        /// Whether all points are finite.
        is_dense: bool,
    }

    /// State of a joystick.
    message Joy {
        /// Time of the reading.
        header: Header,
        /// Axes, -1 to 1.
        axes: Vec<f32>,
        /// Buttons, 1 is pressed.
        buttons: Vec<i32>,
    }

    /// Inertial measurement. A covariance whose first element is -1 marks what is not measured.
    message Imu {
        /// Time of the measurement; the sensor's frame.
        header: Header,
        /// Orientation of the sensor.
        orientation: Quaternion,
        /// About x, y, z, row by row \[rad²\].
        orientation_covariance: [f64; 9],
        /// Angular velocity \[rad/s\].
        angular_velocity: Vector3,
        /// About x, y, z, row by row.
        angular_velocity_covariance: [f64; 9],
        /// Acceleration \[m/s²\].
        linear_acceleration: Vector3,
        /// Along x, y, z, row by row.
        linear_acceleration_covariance: [f64; 9],
    }
}
