//! What a message and its fields know about themselves.

use serde::{Deserialize, Serialize};
use std::fmt;

use super::{Definition, builtin_interfaces::Time, unique_identifier_msgs::UUID};

/// A ROS 2 message (or the request or response of a service): a Rust struct that carries its own
/// ROS definition.
pub trait Interface: ros2_client::Message + Clone + Default + Send + Sync + 'static {
    /// Name, constants and fields.
    const DEFINITION: &'static Definition;
    /// ROS package, `sensor_msgs`.
    const PACKAGE: &'static str = Self::DEFINITION.package;
    /// Name within the package, `JointState`.
    const NAME: &'static str = Self::DEFINITION.name;
}

/// A ROS 2 service: a name and two messages.
pub trait Service: 'static {
    /// ROS package, `std_srvs`.
    const PACKAGE: &'static str;
    /// Name within the package, `SetBool`.
    const NAME: &'static str;
    /// What a client sends.
    type Request: Interface;
    /// What the server answers.
    type Response: Interface;
}

/// A ROS 2 action: a goal, feedback on the way and an outcome, and the messages that carry them.
pub trait Action: 'static {
    /// What a client asks for.
    type Goal: Interface;
    /// What it gets in the end.
    type Outcome: Interface;
    /// What it is told meanwhile.
    type Feedback: Interface;
    /// The service that takes goals.
    type SendGoal: Service;
    /// The service that gives outcomes.
    type GetResult: Service;
    /// Feedback with the goal that it belongs to.
    type FeedbackMessage: Interface;

    /// The goal in a request, with its identity.
    fn goal(request: <Self::SendGoal as Service>::Request) -> (UUID, Self::Goal);
    /// The answer to a goal.
    fn taken(accepted: bool, stamp: Time) -> <Self::SendGoal as Service>::Response;
    /// Which outcome is asked for.
    fn asked(request: <Self::GetResult as Service>::Request) -> UUID;
    /// An outcome with the status of its goal, a constant of `GoalStatus`.
    fn ended(status: i8, outcome: Self::Outcome) -> <Self::GetResult as Service>::Response;
    /// Feedback of a goal.
    fn told(goal: UUID, feedback: Self::Feedback) -> Self::FeedbackMessage;
}

/// A Rust type that a field of a message can have.
pub trait Field {
    /// The ROS type that it stands for.
    const TYPE: FieldType;
}

/// ROS type of a field: an element and how many of it.
#[derive(Debug, Clone, Copy)]
pub struct FieldType {
    /// Type of one element.
    pub base: Base,
    /// How many elements.
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

/// How many elements a field holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// One: `T`.
    One,
    /// Always `n`: `T[n]`.
    Array(usize),
    /// Any number: `T[]`.
    Sequence,
    /// Up to `n`: `T[<=n]`.
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

// Arrays nest, since serde stops at 32 elements: `[[f64; 6]; 6]` is `float64[36]`, with the same bytes.
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

/// ROS `byte`: an octet without arithmetic, a type of its own beside `uint8`.
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

/// A sequence is longer than its type allows.
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
