//! ROS package [`visualization_msgs`](https://docs.ros.org/en/jazzy/p/visualization_msgs/).

use super::builtin_interfaces::Duration;
use super::geometry_msgs::{Point, Pose, Vector3};
use super::sensor_msgs::CompressedImage;
use super::std_msgs::{ColorRGBA, Header};

crate::messages! {
    package visualization_msgs;

    /// A place in a texture, as a part of its width and height.
    message UVCoordinate {
        /// To the right.
        u: f32,
        /// Downwards.
        v: f32,
    }

    /// A file with a mesh.
    message MeshFile {
        /// File name; its extension determines the format.
        filename: String,
        /// What is in it.
        data: Vec<u8>,
    }

    /// Something to be drawn.
    message Marker {
        /// Time; the frame that pose and points are in.
        header: Header,
        /// Group that viewers switch on and off as one.
        ns: String,
        /// Number within the group.
        id: i32,
        /// A constant for its shape.
        r#type: i32,
        /// A constant for what is done with it.
        action: i32,
        /// Where it is.
        pose: Pose,
        /// Size \[m\]; of lines x is the width, of arrows between two points x is the diameter of the shaft.
        scale: Vector3,
        /// Colour of all of it.
        color: ColorRGBA,
        /// After what time it vanishes; zero is never.
        lifetime: Duration,
        /// It moves with its frame.
        frame_locked: bool,
        /// Points of lines, lists and arrows.
        points: Vec<Point>,
        /// Colours of the points, or none.
        colors: Vec<ColorRGBA>,
        /// Where the texture is.
        texture_resource: String,
        /// The texture.
        texture: CompressedImage,
        /// Places in the texture.
        uv_coordinates: Vec<UVCoordinate>,
        /// Text to show.
        text: String,
        /// Where the mesh is.
        mesh_resource: String,
        /// The mesh.
        mesh_file: MeshFile,
        /// The mesh has colours.
        mesh_use_embedded_materials: bool,
    }
    constants {
        /// An arrow along x, or between two points.
        ARROW: i32 = 0,
        /// A box.
        CUBE: i32 = 1,
        /// An ellipsoid.
        SPHERE: i32 = 2,
        /// A cylinder along z.
        CYLINDER: i32 = 3,
        /// A line through all points.
        LINE_STRIP: i32 = 4,
        /// A line between every two points.
        LINE_LIST: i32 = 5,
        /// A box at every point.
        CUBE_LIST: i32 = 6,
        /// A ball at every point.
        SPHERE_LIST: i32 = 7,
        /// Points.
        POINTS: i32 = 8,
        /// Text that faces the viewer.
        TEXT_VIEW_FACING: i32 = 9,
        /// A mesh.
        MESH_RESOURCE: i32 = 10,
        /// A triangle of every three points.
        TRIANGLE_LIST: i32 = 11,
        /// Arrows from point to point.
        ARROW_STRIP: i32 = 12,
        /// It is drawn.
        ADD: i32 = 0,
        /// It is changed.
        MODIFY: i32 = 0,
        /// It vanishes.
        DELETE: i32 = 2,
        /// All vanish.
        DELETEALL: i32 = 3,
    }

    /// Several of them.
    message MarkerArray {
        /// Each by itself.
        markers: Vec<Marker>,
    }
}
