//! Errors that prevent the start of a node, or end the node.

use super::{
    CallError, args::ArgsError, context::DomainError, names::NameError, params::DeclareError,
    params_file::ParamsFileError,
};

/// Why a node cannot start or continue. The text is for the user who started it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NodeError {
    /// A ROS argument is wrong.
    #[error(transparent)]
    Args(#[from] ArgsError),
    /// A parameter file is wrong.
    #[error(transparent)]
    ParamsFile(#[from] ParamsFileError),
    /// A parameter is unknown, of the wrong type or out of range.
    #[error(transparent)]
    Params(#[from] DeclareError),
    /// The name of a node, topic or service is against the rules.
    #[error(transparent)]
    Name(#[from] NameError),
    /// An environment variable such as `ROS_DOMAIN_ID` is wrong.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// The input of the node's program is wrong.
    #[error("{0}")]
    Input(String),
    /// A service call without a response.
    #[error(transparent)]
    Call(#[from] CallError),
    /// An operation of DDS failed.
    #[error("node {node}: cannot {what}: {reason}")]
    Dds {
        /// The node.
        node: String,
        /// The operation.
        what: String,
        /// Message of DDS.
        reason: String,
    },
    /// The program failed while it ran.
    #[error("{0}")]
    Failed(String),
}

impl NodeError {
    /// Exit code of a process that ends with this error: 2 for wrong input, 1 for all others.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Dds { .. } | Self::Call(_) | Self::Failed(_) => 1,
            _ => 2,
        }
    }

    pub(super) fn dds(
        node: impl ToString,
        what: impl Into<String>,
        reason: impl std::fmt::Display,
    ) -> Self {
        Self::Dds {
            node: node.to_string(),
            what: what.into(),
            reason: reason.to_string(),
        }
    }
}
