//! ROS package [`rcl_interfaces`](https://docs.ros.org/en/jazzy/p/rcl_interfaces/): parameters and logs.

use super::builtin_interfaces::Time;
use super::{Bounded, Byte};

crate::messages! {
    package rcl_interfaces;

    /// Numbers of the parameter types.
    message ParameterType {
        /// ROS sends one octet for an empty message.
        structure_needs_at_least_one_member: u8,
    }
    constants {
        /// No value.
        PARAMETER_NOT_SET: u8 = 0,
        /// Truth value.
        PARAMETER_BOOL: u8 = 1,
        /// 64-bit integer.
        PARAMETER_INTEGER: u8 = 2,
        /// 64-bit floating point number.
        PARAMETER_DOUBLE: u8 = 3,
        /// Text.
        PARAMETER_STRING: u8 = 4,
        /// Octets.
        PARAMETER_BYTE_ARRAY: u8 = 5,
        /// Truth values.
        PARAMETER_BOOL_ARRAY: u8 = 6,
        /// Integers.
        PARAMETER_INTEGER_ARRAY: u8 = 7,
        /// Floating point numbers.
        PARAMETER_DOUBLE_ARRAY: u8 = 8,
        /// Texts.
        PARAMETER_STRING_ARRAY: u8 = 9,
    }

    /// A value of one of the parameter types; only the field of that type counts.
    message ParameterValue {
        /// A constant of `ParameterType`.
        r#type: u8,
        /// Truth value.
        bool_value: bool,
        /// Integer.
        integer_value: i64,
        /// Floating point number.
        double_value: f64,
        /// Text.
        string_value: String,
        /// Octets.
        byte_array_value: Vec<Byte>,
        /// Truth values.
        bool_array_value: Vec<bool>,
        /// Integers.
        integer_array_value: Vec<i64>,
        /// Floating point numbers.
        double_array_value: Vec<f64>,
        /// Texts.
        string_array_value: Vec<String>,
    }

    /// A named value.
    message Parameter {
        /// Name.
        name: String,
        /// Value.
        value: ParameterValue,
    }

    /// Which numbers a floating point parameter accepts.
    message FloatingPointRange {
        /// The least, inclusive.
        from_value: f64,
        /// The greatest, inclusive.
        to_value: f64,
        /// Distance between values; 0 allows all.
        step: f64,
    }

    /// Which numbers an integer parameter accepts.
    message IntegerRange {
        /// The least, inclusive.
        from_value: i64,
        /// The greatest, inclusive.
        to_value: i64,
        /// Distance between values; 0 allows all.
        step: u64,
    }

    /// What a parameter is for and what it accepts.
    message ParameterDescriptor {
        /// Name.
        name: String,
        /// A constant of `ParameterType`.
        r#type: u8,
        /// What it is for.
        description: String,
        /// Constraints in words.
        additional_constraints: String,
        /// It cannot be set after start.
        read_only: bool = false,
        /// It may change its type.
        dynamic_typing: bool = false,
        /// Range, if it is a floating point number.
        floating_point_range: Bounded<FloatingPointRange, 1>,
        /// Range, if it is an integer.
        integer_range: Bounded<IntegerRange, 1>,
    }

    /// Which parameters of a node changed.
    message ParameterEvent {
        /// When.
        stamp: Time,
        /// Full name of the node.
        node: String,
        /// Declared.
        new_parameters: Vec<Parameter>,
        /// Set.
        changed_parameters: Vec<Parameter>,
        /// Gone.
        deleted_parameters: Vec<Parameter>,
    }

    /// Whether a parameter was set.
    message SetParametersResult {
        /// It was.
        successful: bool,
        /// Why not.
        reason: String,
    }

    /// Names of parameters.
    message ListParametersResult {
        /// Full names.
        names: Vec<String>,
        /// Prefixes of the names found.
        prefixes: Vec<String>,
    }

    /// A line of a node's log, as `/rosout` carries it.
    message Log {
        /// When it was written.
        stamp: Time,
        /// One of the constants.
        level: u8,
        /// Logger.
        name: String,
        /// The line.
        msg: String,
        /// Source file.
        file: String,
        /// Function.
        function: String,
        /// Line in the source file.
        line: u32,
    }
    constants {
        /// For developers.
        DEBUG: u8 = 10,
        /// For users.
        INFO: u8 = 20,
        /// Worth a look.
        WARN: u8 = 30,
        /// Something failed.
        ERROR: u8 = 40,
        /// The node cannot go on.
        FATAL: u8 = 50,
    }

    /// Least level that a logger writes.
    message LoggerLevel {
        /// Logger.
        name: String,
        /// One of the constants.
        level: u32,
    }
    constants {
        /// Inherited.
        LOG_LEVEL_UNKNOWN: u8 = 0,
        /// For developers.
        LOG_LEVEL_DEBUG: u8 = 10,
        /// For users.
        LOG_LEVEL_INFO: u8 = 20,
        /// Worth a look.
        LOG_LEVEL_WARN: u8 = 30,
        /// Something failed.
        LOG_LEVEL_ERROR: u8 = 40,
        /// The node cannot go on.
        LOG_LEVEL_FATAL: u8 = 50,
    }

    /// Whether a logger's level was set.
    message SetLoggerLevelsResult {
        /// It was.
        successful: bool,
        /// Why not.
        reason: String,
    }
}

/// The services of every node: parameters and log levels.
pub mod services {
    use super::*;

    crate::services! {
        package rcl_interfaces;

        /// What parameters are for and what they accept.
        service DescribeParameters {
            DescribeParametersRequest {
                /// Names.
                names: Vec<String>,
            }
            DescribeParametersResponse {
                /// One for each name.
                descriptors: Vec<ParameterDescriptor>,
            }
        }

        /// Values of parameters.
        service GetParameters {
            GetParametersRequest {
                /// Names.
                names: Vec<String>,
            }
            GetParametersResponse {
                /// One for each name; not set where there is no such parameter.
                values: Vec<ParameterValue>,
            }
        }

        /// Types of parameters.
        service GetParameterTypes {
            GetParameterTypesRequest {
                /// Names.
                names: Vec<String>,
            }
            GetParameterTypesResponse {
                /// Constants of `ParameterType`, one for each name.
                types: Vec<u8>,
            }
        }

        /// Names of parameters.
        service ListParameters {
            ListParametersRequest {
                /// Prefixes to look under; none means all.
                prefixes: Vec<String>,
                /// How many parts of a name below the prefix; 0 means all.
                depth: u64,
            }
            ListParametersResponse {
                /// What was found.
                result: ListParametersResult,
            }
        }

        /// Sets parameters one by one.
        service SetParameters {
            SetParametersRequest {
                /// New values.
                parameters: Vec<Parameter>,
            }
            SetParametersResponse {
                /// One for each parameter.
                results: Vec<SetParametersResult>,
            }
        }

        /// Sets all of the parameters or none.
        service SetParametersAtomically {
            SetParametersAtomicallyRequest {
                /// New values.
                parameters: Vec<Parameter>,
            }
            SetParametersAtomicallyResponse {
                /// One for all.
                result: SetParametersResult,
            }
        }

        /// Levels of loggers.
        service GetLoggerLevels {
            GetLoggerLevelsRequest {
                /// Loggers.
                names: Vec<String>,
            }
            GetLoggerLevelsResponse {
                /// One for each name.
                levels: Vec<LoggerLevel>,
            }
        }

        /// Sets levels of loggers.
        service SetLoggerLevels {
            SetLoggerLevelsRequest {
                /// New levels.
                levels: Vec<LoggerLevel>,
            }
            SetLoggerLevelsResponse {
                /// One for each level.
                results: Vec<SetLoggerLevelsResult>,
            }
        }
    }
}
