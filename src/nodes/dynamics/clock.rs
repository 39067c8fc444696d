//! The simulation's clock: stopped, playing or paused; whether and when simulated time may advance.

use std::time::{Duration, Instant};

use super::{params::DynamicsParams, real_time_pacing::RealTimePacing};

/// State of simulated time without requests for single steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// It stands still at the start.
    Stopped,
    /// It advances.
    Playing,
    /// It stands still.
    Paused,
}

/// Decides whether simulated time may advance, and maps it to the computer's clock. It does not hold the time itself:
/// that is the world's.
#[derive(Debug)]
pub struct SimulationClock {
    phase: Phase,
    start_on_command: bool,
    /// Whether time need not wait for a first command any more.
    is_released: bool,
    /// Simulated time at which playing ends \[s\]; zero is never.
    duration: f64,
    pacing: RealTimePacing,
    /// Whether time has advanced without interruption since the pacing was started.
    is_running: bool,
}

impl SimulationClock {
    /// The clock as the parameters describe it.
    pub fn new(params: &DynamicsParams) -> Self {
        let phase = match params.start_paused {
            true => Phase::Paused,
            false => Phase::Playing,
        };
        let pacing = RealTimePacing::new(params.real_time_factor);
        Self::with(phase, params.start_on_command, params.duration, pacing)
    }

    fn with(phase: Phase, start_on_command: bool, duration: f64, pacing: RealTimePacing) -> Self {
        Self {
            phase,
            start_on_command,
            is_released: !start_on_command,
            duration,
            pacing,
            is_running: false,
        }
    }

    /// The phase.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Enters a phase.
    pub fn set_phase(&mut self, phase: Phase) {
        self.phase = phase;
    }

    /// Simulated time at which playing ends \[s\]; zero is never.
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// Whether the duration is over at `time` \[s\].
    pub fn is_over(&self, time: f64) -> bool {
        self.duration > 0.0 && time >= self.duration - 1e-9
    }

    /// Whether time need not wait for a first command any more.
    pub fn is_released(&self) -> bool {
        self.is_released
    }

    /// A command has arrived, or a step was requested: time need not wait for a first command any more.
    pub fn release(&mut self) {
        self.is_released = true;
    }

    /// Time begins again: it waits for a first command if it did at the start.
    pub fn restart(&mut self) {
        self.is_released = !self.start_on_command;
        self.is_running = false;
    }

    /// Time advances from `time` \[s\] on. Starts the pacing unless it runs.
    pub fn run(&mut self, time: f64) {
        if !self.is_running {
            self.is_running = true;
            self.pacing.start(time);
        }
    }

    /// Time stands still: its pacing starts again when it advances.
    pub fn interrupt(&mut self) {
        self.is_running = false;
    }

    /// Whether time has not been interrupted or restarted since [`Self::run`].
    pub fn is_running(&self) -> bool {
        self.is_running
    }

    /// When the simulated `time` \[s\] is due, as [`RealTimePacing::instant`].
    pub fn due(&mut self, time: f64) -> Instant {
        self.pacing.instant(time)
    }

    /// The simulated time of `instant` \[s\].
    pub fn time_of(&self, instant: Instant) -> f64 {
        self.pacing.time(instant)
    }

    /// About once a second: the real time factor achieved up to `time` \[s\].
    pub fn achieved(&mut self, time: f64) -> Option<f64> {
        self.pacing.achieved(time)
    }
}

/// How long a wait that began at `since` has lasted, in whole seconds, if that is worth a warning.
pub fn long_wait(since: Instant) -> Option<u64> {
    let waited = since.elapsed();
    (waited > Duration::from_secs(1)).then_some(waited.as_secs())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clock(start_on_command: bool) -> SimulationClock {
        let pacing = RealTimePacing::new(1.0);
        SimulationClock::with(Phase::Playing, start_on_command, 10.0, pacing)
    }

    #[test]
    fn the_duration_ends_at_its_last_tick() {
        let clock = clock(false);
        assert!(!clock.is_over(9.99));
        // A sum of a thousand periods may be a rounding error short.
        assert!(clock.is_over(10.0 - 1e-12));
        let endless = SimulationClock::with(Phase::Playing, false, 0.0, RealTimePacing::new(1.0));
        assert!(!endless.is_over(1e9));
    }

    // Would break if a second run began without waiting for its commander, or at the pace of the first.
    #[test]
    fn a_restart_waits_for_the_first_command_again() {
        let mut clock = clock(true);
        assert!(!clock.is_released());
        clock.release();
        clock.run(0.0);
        assert!(clock.is_released() && clock.is_running());
        clock.restart();
        assert!(!clock.is_released() && !clock.is_running());
        assert_eq!(clock.phase(), Phase::Playing);
    }

    #[test]
    fn an_interruption_is_not_caught_up_with() {
        let mut clock = clock(false);
        clock.run(0.0);
        clock.interrupt();
        std::thread::sleep(Duration::from_millis(20));
        clock.run(1.0);
        let now = Instant::now();
        assert!((clock.time_of(now) - 1.0).abs() < 0.01);
        // Without an interruption the pacing continues.
        clock.run(5.0);
        assert!(clock.time_of(now) < 2.0);
    }
}
