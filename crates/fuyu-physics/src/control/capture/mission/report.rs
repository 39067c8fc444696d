//! Phases of a mission, and the reported quantities of each.

/// A phase.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Observes the target until its motion can be predicted accurately enough.
    Observe,
    /// Searches for a rendezvous.
    Plan,
    /// Moves the arm to the rendezvous, at a distance from the grasp frame.
    Approach,
    /// Final approach, grasp, and test pull to check whether the target is held.
    Grasp,
    /// Stops the rotation of robot and target.
    Detumble,
    /// Moves the arm and identifies the target's inertia.
    Identify,
    /// All phases have ended.
    Done,
    /// Ended early.
    Aborted,
}

impl Phase {
    /// The phases of a mission that succeeds, in order.
    pub const IN_ORDER: [Self; 6] = [
        Self::Observe,
        Self::Plan,
        Self::Approach,
        Self::Grasp,
        Self::Detumble,
        Self::Identify,
    ];

    /// Name of the phase.
    pub fn name(self) -> &'static str {
        match self {
            Self::Observe => "observe",
            Self::Plan => "plan",
            Self::Approach => "approach",
            Self::Grasp => "grasp",
            Self::Detumble => "detumble",
            Self::Identify => "identify",
            Self::Done => "done",
            Self::Aborted => "aborted",
        }
    }

    /// Whether the mission is over.
    pub fn is_over(self) -> bool {
        matches!(self, Self::Done | Self::Aborted)
    }
}

/// A number that a phase reports.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhaseFigure {
    /// Its name.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// Its unit.
    pub unit: &'static str,
}

/// Report of a phase.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseReport {
    /// The phase.
    pub phase: Phase,
    /// When it began \[s\].
    pub start: f64,
    /// When it ended \[s\]; `None` while it lasts.
    pub end: Option<f64>,
    /// Result of the phase, as a line; empty while it lasts.
    pub outcome: String,
    /// Figures.
    pub figures: Vec<PhaseFigure>,
}

impl PhaseReport {
    pub(super) fn begin(phase: Phase, start: f64) -> Self {
        Self {
            phase,
            start,
            end: None,
            outcome: String::new(),
            figures: Vec::new(),
        }
    }

    /// Sets a figure.
    pub(super) fn set(&mut self, name: &'static str, value: f64, unit: &'static str) {
        match self.figures.iter_mut().find(|f| f.name == name) {
            Some(figure) => figure.value = value,
            None => self.figures.push(PhaseFigure { name, value, unit }),
        }
    }

    /// Sets a figure if it is larger than before.
    pub(super) fn raise(&mut self, name: &'static str, value: f64, unit: &'static str) {
        let before = self.figure(name).unwrap_or(f64::NEG_INFINITY);
        if value > before {
            self.set(name, value, unit);
        }
    }

    /// The figure with this name.
    pub fn figure(&self, name: &str) -> Option<f64> {
        let found = self.figures.iter().find(|f| f.name == name);
        found.map(|f| f.value)
    }
}
