//! Traits of messages, services and actions, and the ROS types of fields.

use serde::{Deserialize, Serialize};
use std::fmt;

use super::{Definition, builtin_interfaces::Time, unique_identifier_msgs::UUID};

/// A ROS 2 message (or the request or response of a service): a Rust struct with its ROS definition. Implemented by the
/// macros [`messages`](crate::messages), [`services`](crate::services) and [`action`](crate::action).
pub trait Interface: ros2_client::Message + Clone + Default + Send + Sync + 'static {
    /// Name, constants and fields.
    const DEFINITION: &'static Definition;
    /// ROS package, such as `sensor_msgs`.
    const PACKAGE: &'static str = Self::DEFINITION.package;
    /// Name within the package, such as `JointState`.
    const NAME: &'static str = Self::DEFINITION.name;
}

/// A ROS 2 service: a name, a request and a response. Implemented by [`services`](crate::services).
pub trait Service: 'static {
    /// ROS package, such as `std_srvs`.
    const PACKAGE: &'static str;
    /// Name within the package, such as `SetBool`.
    const NAME: &'static str;
    /// Message from the client to the server.
    type Request: Interface;
    /// Message from the server to the client.
    type Response: Interface;
}

/// A ROS 2 action: goal, feedback and result, and the services and messages that carry them. Implemented by
/// [`action`](crate::action); programs use [`ActionServer`](crate::ros::ActionServer) and
/// [`ActionClient`](crate::ros::ActionClient) rather than the functions below.
pub trait Action: 'static {
    /// Sent by the client.
    type Goal: Interface;
    /// The result, sent by the server at the end.
    type Outcome: Interface;
    /// Progress, published by the server.
    type Feedback: Interface;
    /// Service that receives goals.
    type SendGoal: Service;
    /// Service that replies with results.
    type GetResult: Service;
    /// Feedback with the id of its goal.
    type FeedbackMessage: Interface;

    /// Id and goal in a request of [`Self::SendGoal`].
    fn goal_of(request: <Self::SendGoal as Service>::Request) -> (UUID, Self::Goal);
    /// Response of [`Self::SendGoal`].
    fn goal_response(accepted: bool, stamp: Time) -> <Self::SendGoal as Service>::Response;
    /// Id of the goal in a request of [`Self::GetResult`].
    fn requested_goal(request: <Self::GetResult as Service>::Request) -> UUID;
    /// Response of [`Self::GetResult`]; the status is a constant of `action_msgs/GoalStatus`.
    fn result_response(
        status: i8,
        outcome: Self::Outcome,
    ) -> <Self::GetResult as Service>::Response;
    /// Feedback message of a goal.
    fn feedback_message(goal: UUID, feedback: Self::Feedback) -> Self::FeedbackMessage;

    /// Request of [`Self::SendGoal`].
    fn goal_request(id: UUID, goal: Self::Goal) -> <Self::SendGoal as Service>::Request;
    /// Whether a response of [`Self::SendGoal`] accepts the goal.
    fn is_accepted(response: &<Self::SendGoal as Service>::Response) -> bool;
    /// Request of [`Self::GetResult`].
    fn result_request(id: UUID) -> <Self::GetResult as Service>::Request;
    /// Status and result in a response of [`Self::GetResult`].
    fn result_of(response: <Self::GetResult as Service>::Response) -> (i8, Self::Outcome);
    /// Goal id and feedback in a feedback message.
    fn feedback_of(message: Self::FeedbackMessage) -> (UUID, Self::Feedback);
}

/// A Rust type that a field of a message can have.
pub trait Field {
    /// The corresponding ROS type.
    const TYPE: FieldType;
}

/// ROS type of a field: the type of an element, and the number of elements.
#[derive(Debug, Clone, Copy)]
pub struct FieldType {
    /// Type of one element.
    pub base: Base,
    /// Whether the field is one element, an array or a sequence.
    pub shape: Shape,
}

/// Element type of a field.
#[derive(Debug, Clone, Copy)]
#[allow(missing_docs)]
pub enum Base {
    Bool,
    Byte,
    Int8,
    Uint8,
    Int16,
    Uint16,
    Int32,
    Uint32,
    Int64,
    Uint64,
    Float32,
    Float64,
    String,
    /// Another message.
    Message(&'static Definition),
}

/// Number of elements of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// One element: `T`.
    One,
    /// Exactly `n` elements: `T[n]`.
    Array(usize),
    /// Any number of elements: `T[]`.
    Sequence,
    /// At most `n` elements: `T[<=n]`.
    Bounded(usize),
}

impl fmt::Display for Base {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Bool => "bool",
            Self::Byte => "byte",
            Self::Int8 => "int8",
            Self::Uint8 => "uint8",
            Self::Int16 => "int16",
            Self::Uint16 => "uint16",
            Self::Int32 => "int32",
            Self::Uint32 => "uint32",
            Self::Int64 => "int64",
            Self::Uint64 => "uint64",
            Self::Float32 => "float32",
            Self::Float64 => "float64",
            Self::String => "string",
            Self::Message(d) => return write!(f, "{}/{}", d.package, d.name),
        })
    }
}

impl fmt::Display for FieldType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.shape {
            Shape::One => write!(f, "{}", self.base),
            Shape::Array(n) => write!(f, "{}[{n}]", self.base),
            Shape::Sequence => write!(f, "{}[]", self.base),
            Shape::Bounded(n) => write!(f, "{}[<={n}]", self.base),
        }
    }
}

macro_rules! primitive_fields {
    ($($rust:ty => $base:ident),* $(,)?) => {$(
        impl Field for $rust {
            const TYPE: FieldType = FieldType { base: Base::$base, shape: Shape::One };
        }
    )*};
}
primitive_fields! {
    bool => Bool, Byte => Byte,
    i8 => Int8, u8 => Uint8, i16 => Int16, u16 => Uint16,
    i32 => Int32, u32 => Uint32, i64 => Int64, u64 => Uint64,
    f32 => Float32, f64 => Float64, String => String,
}

impl<T: Field> Field for Vec<T> {
    const TYPE: FieldType = FieldType {
        base: element::<T>(),
        shape: Shape::Sequence,
    };
}

// serde supports arrays of at most 32 elements, so longer ones are nested here and flat in ROS: `[[f64; 6]; 6]` is
// `float64[36]`, with the same bytes.
impl<T: Field, const N: usize> Field for [T; N] {
    const TYPE: FieldType = FieldType {
        base: T::TYPE.base,
        shape: Shape::Array(match T::TYPE.shape {
            Shape::One => N,
            Shape::Array(inner) => inner * N,
            Shape::Sequence | Shape::Bounded(_) => panic!("ROS has no arrays of sequences"),
        }),
    };
}

impl<T: Field, const N: usize> Field for Bounded<T, N> {
    const TYPE: FieldType = FieldType {
        base: element::<T>(),
        shape: Shape::Bounded(N),
    };
}

const fn element<T: Field>() -> Base {
    assert!(
        matches!(T::TYPE.shape, Shape::One),
        "ROS has no sequences of arrays or sequences"
    );
    T::TYPE.base
}

/// ROS `byte`: an octet, distinct from `uint8`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Byte(pub u8);

impl fmt::Display for Byte {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// ROS `T[<=N]`: a sequence of at most `N` elements. A longer one cannot be built, received or sent.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<T>", bound(deserialize = "T: Deserialize<'de>"))]
#[serde(into = "Vec<T>", bound(serialize = "T: Serialize + Clone"))]
pub struct Bounded<T, const N: usize>(Vec<T>);

/// A sequence that is longer than its type allows.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{len} elements where at most {max} are allowed")]
pub struct TooLong {
    len: usize,
    max: usize,
}

impl<T, const N: usize> TryFrom<Vec<T>> for Bounded<T, N> {
    type Error = TooLong;
    fn try_from(v: Vec<T>) -> Result<Self, TooLong> {
        if v.len() > N {
            return Err(TooLong {
                len: v.len(),
                max: N,
            });
        }
        Ok(Self(v))
    }
}

impl<T, const N: usize> From<Bounded<T, N>> for Vec<T> {
    fn from(b: Bounded<T, N>) -> Self {
        b.0
    }
}

impl<T, const N: usize> std::ops::Deref for Bounded<T, N> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        &self.0
    }
}
