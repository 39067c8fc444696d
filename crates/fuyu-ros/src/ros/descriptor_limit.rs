//! Limit of open files of the process.

use nix::sys::resource::{Resource, getrlimit, setrlimit};

/// Raises the soft limit of open files to the hard limit. Every DDS endpoint needs four descriptors. The usual soft
/// limit of 1024 protects programs that use `select`, which rustdds does not.
pub(super) fn raise() {
    let limit = Resource::RLIMIT_NOFILE;
    let raised = getrlimit(limit).and_then(|(soft, hard)| match soft < hard {
        true => setrlimit(limit, hard, hard),
        false => Ok(()),
    });
    if let Err(e) = raised {
        tracing::warn!("the limit of open files stays as it is: {e}");
    }
}
