//! ROS package [`std_msgs`](https://docs.ros.org/en/jazzy/p/std_msgs/).

use super::builtin_interfaces::Time;

crate::messages! {
    package std_msgs;

    /// When and in which frame data hold.
    message Header {
        /// Time of the data.
        stamp: Time,
        /// Frame the data are expressed in.
        frame_id: std::string::String,
    }

    /// A truth value.
    message Bool {
        /// The value.
        data: bool,
    }

    /// A text.
    message String {
        /// The text.
        data: std::string::String,
    }

    /// A number.
    message Float64 {
        /// The number.
        data: f64,
    }

    /// A signed 32-bit integer.
    message Int32 {
        /// The integer.
        data: i32,
    }

    /// A signed 64-bit integer.
    message Int64 {
        /// The integer.
        data: i64,
    }

    /// An unsigned 32-bit integer.
    message UInt32 {
        /// The integer.
        data: u32,
    }

    /// Extent of one dimension of an array.
    message MultiArrayDimension {
        /// What the dimension is.
        label: std::string::String,
        /// Number of elements along it.
        size: u32,
        /// Elements from one index to the next, times `size`.
        stride: u32,
    }

    /// How an array lies in its data.
    message MultiArrayLayout {
        /// Dimensions, slowest first.
        dim: Vec<MultiArrayDimension>,
        /// Elements before the array begins.
        data_offset: u32,
    }

    /// An array of numbers.
    message Float64MultiArray {
        /// How the array lies in `data`.
        layout: MultiArrayLayout,
        /// Its elements.
        data: Vec<f64>,
    }

    /// A colour; components from 0 to 1.
    message ColorRGBA {
        /// Red.
        r: f32,
        /// Green.
        g: f32,
        /// Blue.
        b: f32,
        /// Opacity.
        a: f32,
    }

    /// Nothing but the fact that it was sent.
    message Empty {
        /// ROS sends one octet for an empty message.
        structure_needs_at_least_one_member: u8,
    }
}
