//! Parameters: declared with a descriptor, set by file or argument, read as Rust values, accessible to every ROS tool.

mod declare;
mod descriptor;
mod services;
mod store;
mod value;
pub(super) mod yaml;

#[cfg(test)]
mod tests;

pub use declare::{Declaration, Declare, DeclareError, Param};
pub use descriptor::{Descriptor, Range};
pub use store::{ParameterStore, SetError};
pub use value::{Kind, Parameter, ParameterValue};

pub(super) use services::serve;
pub(super) use store::Change;

/// The parameter that selects `/clock` as the time of a node; every node has it.
pub const USE_SIM_TIME: &str = "use_sim_time";

/// Value of one parameter of one node from outside the node's program.
#[derive(Debug, Clone, PartialEq)]
pub struct Override {
    /// Name of the parameter, dotted.
    pub name: String,
    /// The value.
    pub value: ParameterValue,
    /// Origin of the value.
    pub source: Source,
    /// Whether the value is for all nodes that have such a parameter (`/**` in a file, `-p` without a node). Otherwise
    /// it is for this node, which must have the parameter.
    pub shared: bool,
}

/// Origin of a parameter value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// `-p` on the command line.
    Argument,
    /// A line of a parameter file.
    File {
        /// Name of the file as given.
        file: String,
        /// Line number, from 1.
        line: u64,
    },
    /// The program that starts the node.
    Program,
}

impl std::fmt::Display for Source {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Argument => f.write_str("argument -p"),
            Self::File { file, line } => write!(f, "{file}:{line}"),
            Self::Program => f.write_str("start of the node"),
        }
    }
}
