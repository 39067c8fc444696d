//! The parameters of one node, shared by its program and its services.

use std::{
    collections::BTreeMap,
    fmt,
    sync::{
        Mutex, MutexGuard, OnceLock, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
};

use super::{Descriptor, Kind, Override, ParameterValue};
use crate::ros::NodeName;

/// Check of a value; the error is the reason of the rejection.
pub(super) type Check = Box<dyn Fn(&ParameterValue) -> Result<(), String> + Send>;
/// Check of a combination of values; the error is the reason of the rejection.
type Validator = Box<dyn Fn(&dyn Fn(&str) -> ParameterValue) -> Result<(), String> + Send>;
type Listener = Box<dyn Fn(&[Change]) + Send + Sync>;

/// A new value of a parameter.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::ros) struct Change {
    pub(in crate::ros) name: String,
    pub(in crate::ros) value: ParameterValue,
    /// Whether the parameter is new.
    pub(in crate::ros) new: bool,
}

/// Why a parameter was not set.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("parameter {name}: {reason}")]
pub struct SetError {
    name: String,
    reason: String,
}

pub(super) struct Entry {
    pub(super) descriptor: Descriptor,
    pub(super) value: ParameterValue,
    pub(super) check: Option<Check>,
    /// Number of times that the parameter was set.
    pub(super) version: u64,
}

struct Inner {
    entries: BTreeMap<String, Entry>,
    overrides: Vec<Override>,
    validators: Vec<Validator>,
}

/// The parameters of one node, shared by its program and its services.
///
/// Create one directly for use without a node, such as a simulation without DDS; see
/// [`Declare::new`](super::Declare::new).
pub struct ParameterStore {
    node: NodeName,
    inner: Mutex<Inner>,
    /// Number of declarations and changes of parameters.
    revision: AtomicU64,
    listener: OnceLock<Listener>,
}

impl fmt::Debug for ParameterStore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let inner = self.lock();
        let values = inner.entries.iter().map(|(name, e)| (name, &e.value));
        f.debug_map().entries(values).finish()
    }
}

impl ParameterStore {
    /// A store without declarations. An element of `overrides` applies when its parameter is declared; of several for
    /// the same parameter the last one applies.
    pub fn new(node: NodeName, overrides: Vec<Override>) -> Self {
        Self {
            node,
            inner: Mutex::new(Inner {
                entries: BTreeMap::new(),
                overrides,
                validators: Vec::new(),
            }),
            revision: AtomicU64::new(0),
            listener: OnceLock::new(),
        }
    }

    /// Name of the node that the parameters belong to.
    pub fn node(&self) -> &NodeName {
        &self.node
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the listener, which is called after every change, without the lock. Only the first call has an effect.
    pub(in crate::ros) fn on_change(&self, listener: impl Fn(&[Change]) + Send + Sync + 'static) {
        let _ = self.listener.set(Box::new(listener));
    }

    fn announce(&self, changes: &[Change]) {
        if let Some(listener) = self.listener.get()
            && !changes.is_empty()
        {
            listener(changes);
        }
    }

    /// Overrides of parameters that have not been declared yet.
    pub(super) fn pending(&self) -> Vec<Override> {
        let inner = self.lock();
        let declared = |o: &&Override| !inner.entries.contains_key(&o.name);
        inner.overrides.iter().filter(declared).cloned().collect()
    }

    /// The last override of `name`, if any.
    pub(super) fn given(&self, name: &str) -> Option<Override> {
        let inner = self.lock();
        inner.overrides.iter().rfind(|o| o.name == name).cloned()
    }

    pub(super) fn insert(&self, entry: Entry) {
        let change = Change {
            name: entry.descriptor.name.clone(),
            value: entry.value.clone(),
            new: true,
        };
        self.lock().entries.insert(change.name.clone(), entry);
        self.revision.fetch_add(1, Ordering::Release);
        self.announce(&[change]);
    }

    pub(super) fn add_validator(&self, validator: Validator) -> Result<(), String> {
        let mut inner = self.lock();
        let entries = &inner.entries;
        validator(&|name| {
            entries
                .get(name)
                .map(|e| e.value.clone())
                .unwrap_or_default()
        })?;
        inner.validators.push(validator);
        Ok(())
    }

    pub(super) fn read<R>(&self, name: &str, read: impl FnOnce(&Entry) -> R) -> Option<R> {
        self.lock().entries.get(name).map(read)
    }

    /// Revision of the store: it changes whenever a parameter is declared or set.
    pub(super) fn revision(&self) -> u64 {
        self.revision.load(Ordering::Acquire)
    }

    /// Value of a parameter, if it is declared.
    pub fn get(&self, name: &str) -> Option<ParameterValue> {
        self.read(name, |e| e.value.clone())
    }

    /// Descriptor of a parameter, if it is declared.
    pub fn describe(&self, name: &str) -> Option<Descriptor> {
        self.read(name, |e| e.descriptor.clone())
    }

    /// Names of all declared parameters, in order.
    pub fn names(&self) -> Vec<String> {
        self.lock().entries.keys().cloned().collect()
    }

    /// Sets several parameters, all or none.
    ///
    /// # Errors
    /// [`SetError`] for the first parameter that is rejected: unknown, read-only, of another type, out of range or
    /// rejected by a check.
    pub fn set(&self, values: Vec<(String, ParameterValue)>) -> Result<(), SetError> {
        let changes = self.lock().set(&self.node, values)?;
        self.revision.fetch_add(1, Ordering::Release);
        self.announce(&changes);
        Ok(())
    }
}

impl Inner {
    fn set(
        &mut self,
        node: &NodeName,
        values: Vec<(String, ParameterValue)>,
    ) -> Result<Vec<Change>, SetError> {
        for (name, value) in &values {
            self.check(node, name, value).map_err(|reason| SetError {
                name: name.clone(),
                reason,
            })?;
        }
        let proposed = |name: &str| {
            let set = values.iter().rfind(|(n, _)| n == name).map(|(_, v)| v);
            let value = set.or_else(|| self.entries.get(name).map(|e| &e.value));
            value.cloned().unwrap_or_default()
        };
        for validator in &self.validators {
            validator(&proposed).map_err(|reason| SetError {
                name: values
                    .iter()
                    .map(|(n, _)| n.as_str())
                    .collect::<Vec<_>>()
                    .join(", "),
                reason,
            })?;
        }
        let mut changes = Vec::new();
        for (name, value) in values {
            if let Some(entry) = self.entries.get_mut(&name) {
                entry.value = value.clone();
                entry.version += 1;
                let new = false;
                changes.push(Change { name, value, new });
            }
        }
        Ok(changes)
    }

    fn check(&self, node: &NodeName, name: &str, value: &ParameterValue) -> Result<(), String> {
        let Some(entry) = self.entries.get(name) else {
            return Err(format!("not declared by {node}"));
        };
        let descriptor = &entry.descriptor;
        if descriptor.read_only {
            return Err("read-only, it can only be given when the node starts".to_owned());
        }
        if value.kind() != descriptor.kind {
            let hint = match (value, descriptor.kind) {
                (ParameterValue::Integer(i), Kind::Double) => format!("; write {i}.0"),
                _ => String::new(),
            };
            let (got, expected) = (value.kind(), descriptor.kind);
            return Err(format!("{value} is {got}, expected {expected}{hint}"));
        }
        descriptor.check_range(value)?;
        entry.check.as_ref().map_or(Ok(()), |check| check(value))
    }
}
