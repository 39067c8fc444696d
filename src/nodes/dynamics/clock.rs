//! The simulation's clock: whether simulated time is stopped, playing or paused, and when the next state is due.

use std::time::{Duration, Instant};

use super::{params::DynamicsParams, real_time_pacing::RealTimePacing};

/// Phase of simulated time; requests for single steps are handled separately.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Not started: time stands still.
    Stopped,
    /// Time advances.
    Playing,
    /// Time stands still.
    Paused,
}

/// Decides whether simulated time may advance, and maps simulated time to the computer's clock. The simulated time
/// itself is stored in the world.
#[derive(Debug)]
pub struct SimulationClock {
    phase: Phase,
    start_on_command: bool,
    /// Whether time no longer waits for a first command.
    is_released: bool,
    /// Simulated time at which playing ends \[s\]; zero is never.
    duration: f64,
    pacing: RealTimePacing,
    /// Whether time has advanced without interruption since pacing was started.
    is_running: bool,
}

impl SimulationClock {
    /// The clock as configured by the parameters.
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

    /// Whether time no longer waits for a first command.
    pub fn is_released(&self) -> bool {
        self.is_released
    }

    /// Ends the wait for a first command: a command has arrived, or a step was requested.
    pub fn release(&mut self) {
        self.is_released = true;
    }

    /// Resets for a new run: with `start_on_command`, time waits for a first command again.
    pub fn restart(&mut self) {
        self.is_released = !self.start_on_command;
        self.is_running = false;
    }

    /// Lets time advance from `time` \[s\]. Starts pacing unless it is already running.
    pub fn run(&mut self, time: f64) {
        if !self.is_running {
            self.is_running = true;
            self.pacing.start(time);
        }
    }

    /// Time stands still: pacing starts again when time advances.
    pub fn interrupt(&mut self) {
        self.is_running = false;
    }

    /// Whether time has not been interrupted or restarted since [`Self::run`].
    pub fn is_running(&self) -> bool {
        self.is_running
    }

    /// Instant at which the simulated `time` \[s\] is due, as [`RealTimePacing::instant`].
    pub fn due(&mut self, time: f64) -> Instant {
        self.pacing.instant(time)
    }

    /// The simulated time of `instant` \[s\].
    pub fn time_of(&self, instant: Instant) -> f64 {
        self.pacing.time(instant)
    }

    /// The real time factor achieved up to `time` \[s\], about once a second; otherwise `None`.
    pub fn achieved(&mut self, time: f64) -> Option<f64> {
        self.pacing.achieved(time)
    }
}

/// Duration of a wait that began at `since`, in whole seconds; `None` up to one second, which needs no warning.
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
