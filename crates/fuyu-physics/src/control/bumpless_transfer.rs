//! Bumpless transfer: changes of law or gains without a step in the efforts.

use nalgebra::DVector;

/// The difference in the efforts due to a change of settings, and its decay.
///
/// At a change, let `d` be the law's efforts under the old settings minus those under the new ones. The controller adds
/// `d exp(-t/T)` to the new efforts, and the effective velocity gains follow the new `K_V` with the same time constant.
/// So the efforts are continuous, and the joints are damped by a positive definite matrix at all times.
///
/// The proof of stability remains valid: with the Lyapunov function of the new settings,
/// `dW/dt = -q̇ᵀ K q̇ + q̇ᵀ d exp(-t/T) ≤ |d|² exp(-2t/T) / 4k`, where `k` is the smallest effective velocity gain. A
/// change therefore adds at most `T |d|² / 8k` to `W`, after which `W` decreases as before.
#[derive(Debug, Clone)]
pub(super) struct BumplessTransfer {
    /// `T` \[s\].
    pub time_constant: f64,
    /// Time of the last step \[s\]; `None` before the first.
    time: Option<f64>,
    /// Whether settings have changed since the last step.
    changed: bool,
    /// Efforts of the last step, including the difference, without joint damping.
    efforts: DVector<f64>,
    /// The remaining difference.
    difference: DVector<f64>,
    /// The diagonal of the effective `K_V`.
    k_v: DVector<f64>,
}

impl BumplessTransfer {
    pub fn new(joints: usize, time_constant: f64) -> Self {
        let zeros = DVector::zeros(joints);
        Self {
            time_constant,
            time: None,
            changed: false,
            efforts: zeros.clone(),
            difference: zeros.clone(),
            k_v: zeros,
        }
    }

    /// Starts a transfer: new settings apply from the next step on.
    pub fn start(&mut self) {
        self.changed = true;
    }

    /// Ends any transfer at `time`, because only damping acts.
    pub fn cancel(&mut self, time: f64, k_v: &[f64]) {
        self.advance(time, k_v, 1.0);
        self.changed = false;
        self.efforts.fill(0.0);
        self.difference.fill(0.0);
    }

    /// Adds the remaining difference to `efforts`, those of the present settings; their joint damping is `fraction` of
    /// `k_v`.
    pub fn apply(&mut self, time: f64, efforts: &mut DVector<f64>, k_v: &[f64], fraction: f64) {
        let decay = self.advance(time, k_v, fraction);
        if std::mem::take(&mut self.changed) {
            for j in 0..efforts.len() {
                self.difference[j] = self.efforts[j] - efforts[j];
            }
        } else {
            self.difference *= decay;
        }
        *efforts += &self.difference;
        self.efforts.copy_from(efforts);
    }

    /// Effective damping of joint `j` \[N m s/rad or N s/m\].
    pub fn k_v(&self, j: usize) -> f64 {
        self.k_v[j]
    }

    /// Moves the velocity gains towards `fraction * k_v`; returns the decay factor of a difference in this step.
    fn advance(&mut self, time: f64, k_v: &[f64], fraction: f64) -> f64 {
        let elapsed = self.time.replace(time).map(|last| time - last);
        let decay = match elapsed {
            Some(dt) if dt >= 0.0 && self.time_constant > 0.0 => (-dt / self.time_constant).exp(),
            Some(dt) if dt >= 0.0 => 0.0,
            // The first step, or one after a jump back in time: there is no previous step.
            _ => {
                self.changed = false;
                self.difference.fill(0.0);
                0.0
            }
        };
        for (in_force, gain) in self.k_v.iter_mut().zip(k_v) {
            let gain = fraction * gain;
            *in_force = gain + (*in_force - gain) * decay;
        }
        decay
    }
}
