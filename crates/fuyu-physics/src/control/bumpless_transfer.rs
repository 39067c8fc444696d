//! From one law or set of gains to another without a step in the efforts.

use nalgebra::DVector;

/// What a change of settings leaves behind, and how it decays.
///
/// At a change, the pull of the new settings differs from that of the old ones by `d`. The difference is kept
/// and decays, `d exp(-t/T)`, and the gains in force follow the new `K_V` with the same time constant. So the
/// efforts are continuous, and the joints are damped by a positive definite matrix at any time.
///
/// The proof of stability survives: with the Lyapunov function of the new settings,
/// `dW/dt = -q̇ᵀ K q̇ + q̇ᵀ d exp(-t/T) ≤ |d|² exp(-2t/T) / 4k`, where `k` is the least damping in force. All that a
/// change can add to `W` is therefore `T |d|² / 8k`, after which `W` falls as before.
#[derive(Debug, Clone)]
pub(super) struct BumplessTransfer {
    /// `T` \[s\].
    pub time_constant: f64,
    /// Of the last step; `None` before the first.
    time: Option<f64>,
    /// Whether settings have changed since the last step.
    changed: bool,
    /// The pull of the last step, difference included.
    pull: DVector<f64>,
    /// What is left of the difference.
    difference: DVector<f64>,
    /// The diagonal of `K_V` in force.
    k_v: DVector<f64>,
}

impl BumplessTransfer {
    pub fn new(joints: usize, time_constant: f64) -> Self {
        let zeros = DVector::zeros(joints);
        Self {
            time_constant,
            time: None,
            changed: false,
            pull: zeros.clone(),
            difference: zeros.clone(),
            k_v: zeros,
        }
    }

    /// From the next step on other settings pull.
    pub fn begin(&mut self) {
        self.changed = true;
    }

    /// Damping alone acts at `time`: nothing is left over from what pulled before.
    pub fn release(&mut self, time: f64, k_v: &[f64]) {
        self.follow(time, k_v, 1.0);
        self.changed = false;
        self.pull.fill(0.0);
        self.difference.fill(0.0);
    }

    /// Adds to `pull`, of the settings in force, what is left of those before.
    pub fn blend(&mut self, time: f64, pull: &mut DVector<f64>, k_v: &[f64], part: f64) {
        let decay = self.follow(time, k_v, part);
        if std::mem::take(&mut self.changed) {
            for j in 0..pull.len() {
                self.difference[j] = self.pull[j] - pull[j];
            }
        } else {
            self.difference *= decay;
        }
        *pull += &self.difference;
        self.pull.copy_from(pull);
    }

    /// Damping of joint `j` in force \[N m s/rad or N s/m\].
    pub fn k_v(&self, j: usize) -> f64 {
        self.k_v[j]
    }

    /// Lets the gains go on towards `part * k_v`; returns what is left of a difference after this step.
    fn follow(&mut self, time: f64, k_v: &[f64], part: f64) -> f64 {
        let elapsed = self.time.replace(time).map(|last| time - last);
        let decay = match elapsed {
            Some(dt) if dt >= 0.0 && self.time_constant > 0.0 => (-dt / self.time_constant).exp(),
            Some(dt) if dt >= 0.0 => 0.0,
            // The first step, or time that began anew: nothing went before.
            _ => {
                self.changed = false;
                self.difference.fill(0.0);
                0.0
            }
        };
        for (held, wanted) in self.k_v.iter_mut().zip(k_v) {
            let wanted = part * wanted;
            *held = wanted + (*held - wanted) * decay;
        }
        decay
    }
}
