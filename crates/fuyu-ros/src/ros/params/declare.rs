//! Declaration of the parameters of a node.

use std::path::{Path, PathBuf};
use std::sync::{
    Arc,
    atomic::{AtomicU64, Ordering},
};

use super::{
    Descriptor, Override, Parameter, ParameterStore, ParameterValue, Range, Source,
    store::{Check, Entry},
};

/// Errors of a node's parameters: wrong values, unknown parameters, and required parameters without a value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DeclareError(Vec<String>);

impl std::fmt::Display for DeclareError {
    /// One line per parameter.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0.join("\n"))
    }
}

impl std::error::Error for DeclareError {}

/// Declares the parameters of a node, one after the other. Errors in the given values are collected and reported
/// together by [`finish`](Self::finish).
#[must_use = "call `finish` to check the given values"]
#[derive(Debug)]
pub struct Declare {
    store: Arc<ParameterStore>,
    errors: Vec<String>,
}

impl Declare {
    /// Declares parameters in `store`; within a node use [`Node::declare`](crate::ros::Node::declare).
    pub fn new(store: Arc<ParameterStore>) -> Self {
        Self {
            store,
            errors: Vec::new(),
        }
    }

    /// Starts the declaration of a parameter with a default, which also determines the type. The description should
    /// state the unit.
    pub fn param<D: DefaultValue>(
        &mut self,
        name: &str,
        default: D,
        description: &str,
    ) -> Declaration<'_, D::Parameter> {
        Declaration::new(self, name, Some(default.into_parameter()), description)
    }

    /// Starts the declaration of a parameter without default, whose value must be given.
    pub fn required<T: Parameter + Default>(
        &mut self,
        name: &str,
        description: &str,
    ) -> Declaration<'_, T> {
        Declaration::new(self, name, None, description)
    }

    /// Folder of the parameter file that gives the value of `name`: base of relative paths in the value.
    pub fn folder_of(&self, name: &str) -> Option<PathBuf> {
        match self.store.given(name)?.source {
            Source::File { file, .. } => Some(Path::new(&file).parent()?.to_owned()),
            Source::Argument | Source::Program => None,
        }
    }

    /// The distinct first parts of the given parameter names below `prefix`, in order: with `joints.shoulder.kp` given,
    /// `children("joints")` returns `shoulder`.
    pub fn children(&self, prefix: &str) -> Vec<String> {
        let mut children = Vec::new();
        for given in self.store.pending() {
            let rest = given.name.strip_prefix(prefix);
            let child = rest.and_then(|r| r.strip_prefix('.')?.split('.').next());
            if let Some(child) = child
                && !children.iter().any(|c| c == child)
            {
                children.push(child.to_owned());
            }
        }
        children
    }

    /// Adds a check of a combination of parameters, applied now and whenever a parameter is set. The closure reads the
    /// values as they would be after the change.
    pub fn check_together(
        &mut self,
        check: impl Fn(&dyn Fn(&str) -> ParameterValue) -> Result<(), String> + Send + 'static,
    ) {
        if let Err(e) = self.store.add_validator(Box::new(check)) {
            self.errors.push(format!("node {}: {e}", self.store.node()));
        }
    }

    /// Ends the declarations. Every parameter that is given to this node must have been declared; a parameter that is
    /// given to all nodes may be for others.
    ///
    /// # Errors
    /// [`DeclareError`] with all errors: origin, parameter, value, and the allowed values.
    pub fn finish(mut self) -> Result<(), DeclareError> {
        let names = self.store.names();
        for given in self.store.pending() {
            let Override {
                name,
                source,
                shared,
                ..
            } = given;
            if shared {
                let node = self.store.node();
                tracing::debug!("{source}: parameter {name} is not for node {node}");
                continue;
            }
            let near = names
                .iter()
                .map(|n| (strsim::damerau_levenshtein(n, &name), n))
                .min()
                .filter(|(distance, _)| *distance <= 1 + name.len() / 4);
            let hint = near.map_or_else(
                || format!("it has {}", names.join(", ")),
                |(_, n)| format!("did you mean {n}?"),
            );
            let node = self.store.node();
            let error =
                format!("{source}: parameter {name}: node {node} has no such parameter; {hint}");
            if !self.errors.contains(&error) {
                self.errors.push(error);
            }
        }
        if self.errors.is_empty() {
            Ok(())
        } else {
            Err(DeclareError(self.errors))
        }
    }
}

/// One parameter being declared.
#[must_use = "end it with `value` or `live`"]
pub struct Declaration<'a, T> {
    declare: &'a mut Declare,
    descriptor: Descriptor,
    default: Option<T>,
    check: Option<Check>,
}

impl<'a, T: Parameter> Declaration<'a, T> {
    fn new(declare: &'a mut Declare, name: &str, default: Option<T>, description: &str) -> Self {
        Self {
            declare,
            descriptor: Descriptor {
                name: name.to_owned(),
                kind: T::KIND,
                description: description.to_owned(),
                additional_constraints: String::new(),
                read_only: false,
                range: None,
            },
            default,
            check: None,
        }
    }

    /// Makes the parameter read-only once the node runs.
    pub fn read_only(mut self) -> Self {
        self.descriptor.read_only = true;
        self
    }

    /// Adds a condition other than a range: `constraints` describes it to users, `check` rejects values.
    pub fn check(
        mut self,
        constraints: &str,
        check: impl Fn(&T) -> Result<(), String> + Send + 'static,
    ) -> Self {
        self.descriptor.additional_constraints = constraints.to_owned();
        self.check = Some(Box::new(move |value| match T::from_value(value) {
            Some(value) => check(&value),
            // The type is compared before the checks run.
            None => Ok(()),
        }));
        self
    }

    /// Declares the parameter and returns its value.
    pub fn value(self) -> T
    where
        T: Default,
    {
        self.declare().1
    }

    /// Declares the parameter and returns a handle that follows every change.
    pub fn live(self) -> Param<T>
    where
        T: Default,
    {
        let store = Arc::clone(&self.declare.store);
        let (name, fallback) = self.declare();
        Param {
            store,
            name,
            fallback,
            seen: AtomicU64::new(0),
            revision: AtomicU64::new(0),
        }
    }

    /// Adds the parameter to the store. Returns its name and its value; if the value is wrong, the default of its type.
    fn declare(self) -> (String, T)
    where
        T: Default,
    {
        let store = &self.declare.store;
        let name = self.descriptor.name.clone();
        let node = store.node();
        let mut errors = Vec::new();
        if store.get(&name).is_some() {
            errors.push(format!("node {node}: parameter {name} is declared twice"));
        }
        let default = self.default.map(T::into_value);
        let value = match (store.given(&name), default) {
            (None, Some(default)) => Some((format!("node {node}"), Ok(default))),
            (None, None) => {
                errors.push(format!(
                    "node {node}: parameter {name} is not given; expected {} ({})",
                    T::KIND,
                    self.descriptor.description
                ));
                None
            }
            (Some(given), _) => Some((given.source.to_string(), given.value.fit(T::KIND))),
        };
        let value = value.and_then(|(source, value)| {
            let checked = value.and_then(|value| {
                self.descriptor.check_range(&value)?;
                self.check.as_ref().map_or(Ok(()), |check| check(&value))?;
                Ok(value)
            });
            match checked {
                Ok(value) => Some(value),
                Err(e) => {
                    errors.push(format!("{source}: parameter {name} of {node}: {e}"));
                    None
                }
            }
        });
        let typed = value.as_ref().and_then(T::from_value).unwrap_or_default();
        store.insert(Entry {
            descriptor: self.descriptor,
            value: typed.clone().into_value(),
            check: self.check,
            version: 0,
        });
        self.declare.errors.append(&mut errors);
        (name, typed)
    }
}

macro_rules! ranges {
    ($($ty:ty, $number:ty, $range:ident);* $(;)?) => {$(
        impl Declaration<'_, $ty> {
            /// Sets the smallest and largest value (for a list: of every element).
            pub fn range(mut self, from: $number, to: $number) -> Self {
                self.descriptor.range = Some(Range::$range { from, to });
                self
            }
        }
    )*};
}
ranges! {
    f64, f64, Double;
    Vec<f64>, f64, Double;
    i64, i64, Integer;
    Vec<i64>, i64, Integer;
}

/// A parameter that may change while the node runs.
#[derive(Debug)]
pub struct Param<T> {
    store: Arc<ParameterStore>,
    name: String,
    fallback: T,
    seen: AtomicU64,
    /// Revision of the store at the last call of [`Self::changed`].
    revision: AtomicU64,
}

impl<T: Parameter> Param<T> {
    /// Present value of the parameter.
    pub fn get(&self) -> T {
        let value = self.store.read(&self.name, |e| T::from_value(&e.value));
        value.flatten().unwrap_or_else(|| self.fallback.clone())
    }

    /// Whether the parameter was set since the last call; for the first call, since its declaration.
    pub fn changed(&self) -> bool {
        // Fast path of most calls. The revision is read before the version, so the next call finds a change in between.
        let revision = self.revision();
        if self.revision.swap(revision, Ordering::Relaxed) == revision {
            return false;
        }
        let version = self.store.read(&self.name, |e| e.version).unwrap_or(0);
        self.seen.swap(version, Ordering::Relaxed) != version
    }

    /// Revision of the node's parameters: it changes whenever any of them is set.
    pub fn revision(&self) -> u64 {
        self.store.revision()
    }
}

impl<T> Param<T> {
    /// Name of the parameter.
    pub fn name(&self) -> &str {
        &self.name
    }
}

/// A type that a default value can have.
pub trait DefaultValue {
    /// The parameter's Rust type.
    type Parameter: Parameter + Default;
    /// Converts the default to the parameter's type.
    fn into_parameter(self) -> Self::Parameter;
}

macro_rules! defaults {
    ($($ty:ty),* $(,)?) => {$(
        impl DefaultValue for $ty {
            type Parameter = $ty;
            fn into_parameter(self) -> $ty {
                self
            }
        }
    )*};
}
defaults!(
    bool,
    i64,
    f64,
    String,
    Vec<u8>,
    Vec<bool>,
    Vec<i64>,
    Vec<f64>,
    Vec<String>
);

impl DefaultValue for &str {
    type Parameter = String;
    fn into_parameter(self) -> String {
        self.to_owned()
    }
}

impl<const N: usize> DefaultValue for [f64; N] {
    type Parameter = Vec<f64>;
    fn into_parameter(self) -> Vec<f64> {
        self.to_vec()
    }
}

impl<const N: usize> DefaultValue for [&str; N] {
    type Parameter = Vec<String>;
    fn into_parameter(self) -> Vec<String> {
        self.iter().map(|&s| s.to_owned()).collect()
    }
}
