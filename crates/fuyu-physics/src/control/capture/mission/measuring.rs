//! Measurements of the target, which arrive late.

use nalgebra::{UnitQuaternion, Vector3};

use super::CaptureMission;
use crate::control::capture::RotationForecast;
use crate::spatial::Pose;

/// Time for which measured relative poses are kept \[s\].
const RELATIVE_WINDOW: f64 = 10.0;

impl CaptureMission {
    /// Takes the measurements whose times the robot's own motion covers.
    pub(super) fn take_measurements(&mut self, now: f64) {
        while let Some((time, X_BG)) = self.poses.front().copied() {
            if time > now + 1e-6 {
                break;
            }
            self.poses.pop_front();
            let (Some(X_IB), Some(X_BE)) = (self.own.X_IB_at(time), self.own.X_BE_at(time)) else {
                continue;
            };
            if self.held.is_none() {
                self.track.add_pose(time, &(X_IB * X_BG));
            }
            self.relative
                .push_back((time, X_BE.inverse() * X_BG * self.X_GK()));
            while (self.relative.front()).is_some_and(|(t, _)| *t < time - RELATIVE_WINDOW) {
                self.relative.pop_front();
            }
        }
        while let Some(forecast) = self.forecasts.front() {
            let start = forecast.start;
            if start > now + 1e-6 {
                break;
            }
            let Some(forecast) = self.forecasts.pop_front() else {
                break;
            };
            let Some(X_IB) = self.own.X_IB_at(start) else {
                continue;
            };
            if self.held.is_none() {
                let R_IC = UnitQuaternion::from_rotation_matrix(&X_IB.rotation) * self.R_BC;
                let turned = forecast.attitudes.iter().map(|R_CF| R_IC * R_CF);
                self.track.add_forecast(RotationForecast {
                    attitudes: turned.collect(),
                    ..forecast
                });
            }
        }
    }

    /// Mean measured pose of the grasp frame in the tip's frame from one time to another \[s\]: position and rotation
    /// vector, from at least three frames.
    pub(super) fn mean_relative(&self, from: f64, to: f64) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let within = self.relative.iter().filter(|(t, _)| *t >= from && *t <= to);
        let poses: Vec<_> = within.map(|(_, X)| X).collect();
        if poses.len() < 3 {
            return None;
        }
        let count = poses.len() as f64;
        let mean = |of: fn(&Pose) -> Vector3<f64>| {
            poses.iter().map(|X| of(X)).sum::<Vector3<f64>>() / count
        };
        let turn = |X: &Pose| UnitQuaternion::from(X.rotation).scaled_axis();
        Some((mean(|X| X.translation.vector), mean(turn)))
    }
}
