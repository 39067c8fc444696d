//! Detection whether a gripper holds something, from the joint that moves its fingers.

/// Fraction of the stroke near its closed end in which no object can be between the fingers.
const CLOSED: f64 = 0.03;
/// Fraction of the stroke that the fingers must have moved before a standstill is evaluated.
const BEGUN: f64 = 0.03;
/// Rate below which the fingers stand still, in strokes per second.
const SLOW: f64 = 0.01;

/// Watches a closing gripper: fingers that stop before they are closed hold something; closed fingers hold nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct GripWatch {
    open: f64,
    closed: f64,
    press_time: f64,
    still_since: Option<f64>,
    holds: Option<bool>,
}

impl GripWatch {
    /// For a joint that moves from `open` to `closed` \[m or rad\], and a gripper that presses with its full effort
    /// `press_time` \[s\] after its fingers have been stopped: only from then on the object is held.
    pub fn new(open: f64, closed: f64, press_time: f64) -> Self {
        Self {
            open,
            closed,
            press_time,
            still_since: None,
            holds: None,
        }
    }

    /// Restarts: the gripper is about to close, or has opened.
    pub fn restart(&mut self) {
        self.still_since = None;
        self.holds = None;
    }

    /// Takes position and rate of the joint at `time` \[s\]. Returns whether the gripper holds something, once that is
    /// known.
    pub fn see(&mut self, time: f64, position: f64, rate: f64) -> Option<bool> {
        let stroke = self.closed - self.open;
        let share = (position - self.open) / stroke;
        let is_still = (rate / stroke).abs() < SLOW && share > BEGUN;
        if !is_still {
            self.still_since = None;
        }
        if share > 1.0 - CLOSED {
            self.holds = Some(false);
        } else if is_still {
            let since = *self.still_since.get_or_insert(time);
            if time - since >= self.press_time {
                self.holds = Some(true);
            }
        }
        self.holds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fingers_that_stop_early_hold_and_closed_ones_do_not() {
        let mut watch = GripWatch::new(0.0, 0.06, 0.5);
        // The fingers have not moved yet.
        for k in 0..100 {
            assert_eq!(watch.see(0.01 * f64::from(k), 0.0, 0.0), None);
        }
        assert_eq!(watch.see(1.0, 0.01, 0.005), None);
        assert_eq!(watch.see(2.0, 0.02, 0.0), None);
        assert_eq!(watch.see(2.6, 0.02, 0.0), Some(true));
        // The held object has slipped out.
        assert_eq!(watch.see(3.0, 0.03, 0.01), Some(true));
        assert_eq!(watch.see(4.0, 0.0595, 0.0), Some(false));
        watch.restart();
        assert_eq!(watch.see(5.0, 0.03, 0.005), None);
    }
}
