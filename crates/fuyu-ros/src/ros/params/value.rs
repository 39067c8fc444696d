//! The types of ROS parameters.

use std::fmt;

use super::yaml;
use crate::msg::rcl_interfaces as msg;

/// Type of a parameter, numbered as in `rcl_interfaces/msg/ParameterType`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
#[allow(missing_docs)]
pub enum Kind {
    NotSet = 0,
    Bool = 1,
    Integer = 2,
    Double = 3,
    String = 4,
    ByteArray = 5,
    BoolArray = 6,
    IntegerArray = 7,
    DoubleArray = 8,
    StringArray = 9,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotSet => "nothing",
            Self::Bool => "a bool",
            Self::Integer => "an integer",
            Self::Double => "a double",
            Self::String => "a string",
            Self::ByteArray => "a list of bytes",
            Self::BoolArray => "a list of bools",
            Self::IntegerArray => "a list of integers",
            Self::DoubleArray => "a list of doubles",
            Self::StringArray => "a list of strings",
        })
    }
}

/// Value of a parameter.
#[derive(Debug, Clone, PartialEq, Default)]
#[allow(missing_docs)]
pub enum ParameterValue {
    #[default]
    NotSet,
    Bool(bool),
    Integer(i64),
    Double(f64),
    String(String),
    ByteArray(Vec<u8>),
    BoolArray(Vec<bool>),
    IntegerArray(Vec<i64>),
    DoubleArray(Vec<f64>),
    StringArray(Vec<String>),
}

impl ParameterValue {
    /// Type of the value.
    pub fn kind(&self) -> Kind {
        match self {
            Self::NotSet => Kind::NotSet,
            Self::Bool(_) => Kind::Bool,
            Self::Integer(_) => Kind::Integer,
            Self::Double(_) => Kind::Double,
            Self::String(_) => Kind::String,
            Self::ByteArray(_) => Kind::ByteArray,
            Self::BoolArray(_) => Kind::BoolArray,
            Self::IntegerArray(_) => Kind::IntegerArray,
            Self::DoubleArray(_) => Kind::DoubleArray,
            Self::StringArray(_) => Kind::StringArray,
        }
    }

    /// Parses a value in YAML, such as `30.0`, `[1, 2]` or `hello`, as given by `-p`.
    ///
    /// # Errors
    /// The error says what is wrong with the text and what is allowed.
    pub fn parse_yaml(text: &str) -> Result<Self, String> {
        yaml::parse_value(text)
    }

    /// Converts the value to the type `wanted` where YAML cannot distinguish types: an empty list fits any list type,
    /// and bytes are written as integers.
    ///
    /// # Errors
    /// The reason and the expected type. An integer is not converted to a double: ROS distinguishes them.
    pub(super) fn fit(self, wanted: Kind) -> Result<Self, String> {
        let empty = matches!(&self, Self::IntegerArray(v) if v.is_empty());
        match (self, wanted) {
            (value, wanted) if value.kind() == wanted => Ok(value),
            (_, Kind::BoolArray) if empty => Ok(Self::BoolArray(Vec::new())),
            (_, Kind::DoubleArray) if empty => Ok(Self::DoubleArray(Vec::new())),
            (_, Kind::StringArray) if empty => Ok(Self::StringArray(Vec::new())),
            (Self::IntegerArray(v), Kind::ByteArray) => v
                .iter()
                .map(|&i| u8::try_from(i))
                .collect::<Result<_, _>>()
                .map(Self::ByteArray)
                .map_err(|_| format!("{} holds more than bytes (0 to 255)", Self::IntegerArray(v))),
            (value, wanted) => {
                let hint = match (&value, wanted) {
                    (Self::Integer(i), Kind::Double) => format!("; write {i}.0"),
                    (Self::IntegerArray(v), Kind::DoubleArray) => {
                        let doubles = v.iter().map(|&i| i as f64).collect();
                        format!("; write {}", Self::DoubleArray(doubles))
                    }
                    (Self::Bool(_) | Self::Integer(_) | Self::Double(_), Kind::String) => {
                        format!("; write \"{value}\" in quotes")
                    }
                    _ => String::new(),
                };
                let got = value.kind();
                Err(format!("{value} is {got}, expected {wanted}{hint}"))
            }
        }
    }
}

/// Writes the value as YAML flow text.
impl fmt::Display for ParameterValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fn list<T: fmt::Debug>(f: &mut fmt::Formatter<'_>, items: &[T]) -> fmt::Result {
            f.debug_list().entries(items).finish()
        }
        match self {
            Self::NotSet => f.write_str("null"),
            Self::Bool(v) => write!(f, "{v}"),
            Self::Integer(v) => write!(f, "{v}"),
            Self::Double(v) => write!(f, "{v:?}"),
            Self::String(v) => f.write_str(v),
            Self::ByteArray(v) => list(f, v),
            Self::BoolArray(v) => list(f, v),
            Self::IntegerArray(v) => list(f, v),
            Self::DoubleArray(v) => list(f, v),
            Self::StringArray(v) => list(f, v),
        }
    }
}

/// Rust type of a parameter.
pub trait Parameter: Clone + Send + 'static {
    /// The ROS type.
    const KIND: Kind;
    /// Converts to a ROS parameter value.
    fn into_value(self) -> ParameterValue;
    /// Converts from a ROS parameter value; `None` if it is of another type.
    fn from_value(value: &ParameterValue) -> Option<Self>;
}

macro_rules! parameter {
    ($($rust:ty => $kind:ident),* $(,)?) => {$(
        impl Parameter for $rust {
            const KIND: Kind = Kind::$kind;
            fn into_value(self) -> ParameterValue {
                ParameterValue::$kind(self)
            }
            fn from_value(value: &ParameterValue) -> Option<Self> {
                match value {
                    ParameterValue::$kind(v) => Some(v.clone()),
                    _ => None,
                }
            }
        }
    )*};
}
parameter! {
    bool => Bool, i64 => Integer, f64 => Double, String => String, Vec<u8> => ByteArray,
    Vec<bool> => BoolArray, Vec<i64> => IntegerArray, Vec<f64> => DoubleArray,
    Vec<String> => StringArray,
}

impl From<ParameterValue> for msg::ParameterValue {
    fn from(value: ParameterValue) -> Self {
        let mut m = Self {
            r#type: value.kind() as u8,
            ..Self::default()
        };
        match value {
            ParameterValue::NotSet => {}
            ParameterValue::Bool(v) => m.bool_value = v,
            ParameterValue::Integer(v) => m.integer_value = v,
            ParameterValue::Double(v) => m.double_value = v,
            ParameterValue::String(v) => m.string_value = v,
            ParameterValue::ByteArray(v) => {
                m.byte_array_value = v.into_iter().map(crate::msg::Byte).collect();
            }
            ParameterValue::BoolArray(v) => m.bool_array_value = v,
            ParameterValue::IntegerArray(v) => m.integer_array_value = v,
            ParameterValue::DoubleArray(v) => m.double_array_value = v,
            ParameterValue::StringArray(v) => m.string_array_value = v,
        }
        m
    }
}

impl TryFrom<msg::ParameterValue> for ParameterValue {
    type Error = String;

    fn try_from(m: msg::ParameterValue) -> Result<Self, String> {
        Ok(match m.r#type {
            0 => Self::NotSet,
            1 => Self::Bool(m.bool_value),
            2 => Self::Integer(m.integer_value),
            3 => Self::Double(m.double_value),
            4 => Self::String(m.string_value),
            5 => Self::ByteArray(m.byte_array_value.into_iter().map(|b| b.0).collect()),
            6 => Self::BoolArray(m.bool_array_value),
            7 => Self::IntegerArray(m.integer_array_value),
            8 => Self::DoubleArray(m.double_array_value),
            9 => Self::StringArray(m.string_array_value),
            other => {
                return Err(format!(
                    "type {other} is none of the parameter types 0 to 9"
                ));
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // A common mistake with ROS parameters: `gain: 1` for a parameter of type double.
    #[test]
    fn an_integer_is_no_double_and_the_message_says_so() {
        let text = ParameterValue::Integer(1).fit(Kind::Double).unwrap_err();
        assert_eq!(text, "1 is an integer, expected a double; write 1.0");
        let list = ParameterValue::IntegerArray(vec![1, 2]);
        let text = list.fit(Kind::DoubleArray).unwrap_err();
        assert!(text.ends_with("write [1.0, 2.0]"), "{text}");
        let text = ParameterValue::Integer(7).fit(Kind::String).unwrap_err();
        assert!(text.ends_with("write \"7\" in quotes"), "{text}");
    }

    #[test]
    fn yaml_cannot_tell_empty_lists_and_bytes_apart() {
        let empty = ParameterValue::IntegerArray(Vec::new());
        let fitted = empty.fit(Kind::StringArray).unwrap();
        assert_eq!(fitted, ParameterValue::StringArray(Vec::new()));
        let bytes = ParameterValue::IntegerArray(vec![0, 255]);
        let fitted = bytes.fit(Kind::ByteArray).unwrap();
        assert_eq!(fitted, ParameterValue::ByteArray(vec![0, 255]));
        let bytes = ParameterValue::IntegerArray(vec![256]);
        assert!(bytes.fit(Kind::ByteArray).is_err());
    }

    #[test]
    fn every_type_survives_the_message() {
        for value in [
            ParameterValue::NotSet,
            ParameterValue::Bool(true),
            ParameterValue::Integer(-7),
            ParameterValue::Double(0.5),
            ParameterValue::String("a".into()),
            ParameterValue::ByteArray(vec![1]),
            ParameterValue::BoolArray(vec![true, false]),
            ParameterValue::IntegerArray(vec![1]),
            ParameterValue::DoubleArray(vec![1.5]),
            ParameterValue::StringArray(vec!["b".into()]),
        ] {
            let m = msg::ParameterValue::from(value.clone());
            assert_eq!(ParameterValue::try_from(m), Ok(value));
        }
    }
}
