//! Attitude loop: the attitude controller with its model of the robot, stepped once per control period.

use super::{AttitudeParams, params::NamedLaw};
use crate::{
    control::{
        Stamp,
        attitude::{
            AttitudeConfigError, AttitudeController, AttitudeFilter, AttitudeInputError,
            AttitudeLaw, AttitudeLawConfig, AttitudePlant, AttitudeRegulator, AttitudeReport,
            AttitudeTarget, StarTrackerUse, spread_postures,
        },
    },
    dynamics::flexible::FlexibleSystem,
    model::Model,
};
use nalgebra::{Complex, DVector, UnitQuaternion, Vector3};

/// Takes samples, and steps the controller when a control period has passed. Used by the node and by `fuyu simulate`.
///
/// The law is designed for the posture of the first joint state (`hinf` also for further postures); a law that is
/// selected later, for the posture at that time. Samples before the first joint state are ignored, except a reference.
#[derive(Debug)]
pub struct AttitudeLoop {
    params: AttitudeParams,
    system: FlexibleSystem,
    controller: Option<AttitudeController>,
    /// Reference received before the first joint state.
    early_target: Option<UnitQuaternion<f64>>,
    last_step: Option<Stamp>,
    /// Whether the last call of [`Self::step`] was a control step: on-times of thrusters are commanded only then.
    has_stepped: bool,
}

/// Fraction of a control period by which a step may be early.
const EARLY: f64 = 1e-3;

impl AttitudeLoop {
    /// A loop for the robot of `model` with the additional parts in `params`.
    ///
    /// # Errors
    /// A line that names the invalid part.
    pub fn new(params: &AttitudeParams, model: &Model) -> Result<Self, String> {
        Ok(Self {
            system: params.flexible.system(model)?,
            params: params.clone(),
            controller: None,
            early_target: None,
            last_step: None,
            has_stepped: false,
        })
    }

    /// Parameters.
    pub fn params(&self) -> &AttitudeParams {
        &self.params
    }

    /// The robot.
    pub fn system(&self) -> &FlexibleSystem {
        &self.system
    }

    /// The controller; `None` before the first joint state.
    pub fn controller(&self) -> Option<&AttitudeController> {
        self.controller.as_ref()
    }

    /// Designs the law for joint positions `q`, and creates the controller.
    ///
    /// # Errors
    /// A line that says why the law cannot be designed, or which part the robot lacks.
    pub fn design(&mut self, q: &[f64]) -> Result<(), String> {
        let params = &self.params;
        let controller = || {
            let law = self.law_for(q)?;
            let regulator = AttitudeRegulator::new(&self.system, law, params.regulator)?;
            let filter = AttitudeFilter::new(params.filter)?;
            AttitudeController::new(filter, regulator, params.controller)
        };
        let mut controller = controller().map_err(|e| e.to_string())?;
        if let Some(R_WD) = self.early_target.or(params.target) {
            let fixed = AttitudeTarget::fixed(R_WD);
            controller
                .set_target(Stamp::from_nanos(0), &fixed)
                .map_err(|e| e.to_string())?;
        }
        self.controller = Some(controller);
        Ok(())
    }

    /// Designs the selected law for joint positions `q`.
    fn law_for(&self, q: &[f64]) -> Result<Box<dyn AttitudeLaw>, AttitudeConfigError> {
        let params = &self.params;
        let mut plants = vec![AttitudePlant::new(
            &self.system,
            &DVector::from_row_slice(q),
        )?];
        if let AttitudeLawConfig::DoubleLoop(_) = params.law.config {
            for q in spread_postures(self.system.model(), params.hinf_postures) {
                plants.push(AttitudePlant::new(&self.system, &q)?);
            }
        }
        params.law.config.law(&plants, params.regulator.period)
    }

    /// Selects another law while the loop runs (bumpless transfer): the law is designed for the newest joint positions,
    /// and takes over without a step in the torque. Before the first joint state, selects the initial law.
    ///
    /// # Errors
    /// A line that says why the law cannot be designed; the previous law stays active.
    pub fn select_law(&mut self, law: NamedLaw) -> Result<(), String> {
        let before = std::mem::replace(&mut self.params.law, law);
        let q = self.controller.as_ref().and_then(|c| c.joint_positions());
        let Some(q) = q else {
            return Ok(());
        };
        match self.law_for(q) {
            Ok(law) => {
                if let Some(controller) = &mut self.controller {
                    controller.set_law(law);
                }
                Ok(())
            }
            Err(e) => {
                self.params.law = before;
                Err(e.to_string())
            }
        }
    }

    /// Spectral radius of the closed loop at the newest joint positions, without delay; the loop is unstable above 1.
    /// `None` before the first joint state.
    ///
    /// # Errors
    /// A line that says why it cannot be computed.
    pub fn radius(&self) -> Result<Option<f64>, String> {
        let q = self.controller.as_ref().and_then(|c| c.joint_positions());
        q.map(|q| self.radius_at(q, 0.0)).transpose()
    }

    fn radius_at(&self, q: &[f64], delay: f64) -> Result<f64, String> {
        let Some(controller) = &self.controller else {
            return Ok(0.0);
        };
        let law = controller.regulator().law();
        AttitudePlant::new(&self.system, &DVector::from_row_slice(q))
            .and_then(|plant| plant.sampled_radius(law, self.params.regulator.period, delay))
            .map_err(|e| e.to_string())
    }

    /// Sets the torques to zero until the next step.
    pub fn release(&mut self) {
        if let Some(controller) = &mut self.controller {
            controller.release();
        }
        self.last_step = None;
        self.has_stepped = false;
    }

    /// If the closed loop is unstable at joint positions `q` with torques delayed by `delay` \[s\]: the reason.
    ///
    /// # Errors
    /// As [`AttitudeLoop::design`].
    pub fn instability(&mut self, q: &[f64], delay: f64) -> Result<Option<String>, String> {
        self.design(q)?;
        let period = self.params.regulator.period;
        let radius = self.radius_at(q, delay)?;
        Ok((radius > 1.0).then(|| {
            let late = match delay > 0.0 {
                true => format!(" and torques that act {delay} s late"),
                false => String::new(),
            };
            format!(
                "the law {} with a period of {period} s{late} makes the robot vibrate (spectral radius {radius:.4}); lower period or the gains",
                self.params.law.name
            )
        }))
    }

    /// Poles of the continuous closed loop at joint positions `q` \[rad/s\], sorted by real part.
    ///
    /// # Errors
    /// As [`AttitudeLoop::design`].
    pub fn poles(&mut self, q: &[f64]) -> Result<Vec<Complex<f64>>, String> {
        self.design(q)?;
        let plant = AttitudePlant::new(&self.system, &DVector::from_row_slice(q));
        let plant = plant.map_err(|e| e.to_string())?;
        let Some(controller) = &self.controller else {
            return Ok(Vec::new());
        };
        let poles = plant.poles(controller.regulator().law());
        let mut poles = poles.map_err(|e| e.to_string())?;
        poles.sort_by(|a, b| b.re.total_cmp(&a.re).then(b.im.total_cmp(&a.im)));
        Ok(poles)
    }

    /// Adds joint positions and rates. The first ones create the controller.
    ///
    /// # Errors
    /// A line that says what is invalid.
    pub fn add_joint_state(&mut self, stamp: Stamp, q: &[f64], qd: &[f64]) -> Result<(), String> {
        if self.controller.is_none() {
            self.design(q)?;
        }
        self.add(|controller| controller.add_joint_state(stamp, q, qd))
            .map_err(|e| e.to_string())
    }

    /// Adds a gyro sample, base axes \[rad/s\]. A stamp earlier than the last one starts a new run.
    ///
    /// # Errors
    /// If a value is not finite.
    pub fn add_gyro(&mut self, stamp: Stamp, w: Vector3<f64>) -> Result<(), AttitudeInputError> {
        self.add(|controller| controller.add_gyro(stamp, w).map(drop))
    }

    /// Adds a sample, which may start a new run. Ignored before the first joint state.
    fn add(
        &mut self,
        add: impl FnOnce(&mut AttitudeController) -> Result<(), AttitudeInputError>,
    ) -> Result<(), AttitudeInputError> {
        let Some(controller) = &mut self.controller else {
            return Ok(());
        };
        let runs = controller.restarts();
        add(controller)?;
        if controller.restarts() != runs {
            self.last_step = None;
            if let Some(R_WD) = self.params.target {
                controller.set_target(Stamp::from_nanos(0), &AttitudeTarget::fixed(R_WD))?;
            }
        }
        Ok(())
    }

    /// Adds a measurement of the star tracker. Returns how it was used.
    ///
    /// # Errors
    /// If a value is not finite.
    pub fn add_star_tracker(
        &mut self,
        stamp: Stamp,
        R_WB: &UnitQuaternion<f64>,
    ) -> Result<Option<StarTrackerUse>, AttitudeInputError> {
        let controller = self.controller.as_mut();
        controller
            .map(|controller| controller.add_star_tracker(stamp, R_WB))
            .transpose()
    }

    /// Adds wheel speeds in the order of the parameters \[rad/s\].
    ///
    /// # Errors
    /// If the number of values is wrong, or a value is not finite.
    pub fn add_wheel_speeds(
        &mut self,
        stamp: Stamp,
        speeds: &[f64],
    ) -> Result<(), AttitudeInputError> {
        match &mut self.controller {
            Some(controller) => controller.add_wheel_speeds(stamp, speeds),
            None => Ok(()),
        }
    }

    /// Sets the reference attitude.
    ///
    /// # Errors
    /// If a value is not finite.
    pub fn set_target(
        &mut self,
        stamp: Stamp,
        R_WD: UnitQuaternion<f64>,
    ) -> Result<(), AttitudeInputError> {
        match &mut self.controller {
            Some(controller) => controller.set_target(stamp, &AttitudeTarget::fixed(R_WD)),
            None => {
                self.early_target = Some(R_WD);
                Ok(())
            }
        }
    }

    /// Steps the controller at `now` if its period has passed since the last step.
    pub fn step(&mut self, now: Stamp) -> Option<AttitudeReport> {
        self.has_stepped = false;
        let controller = self.controller.as_mut()?;
        let period = self.params.regulator.period;
        let is_due = self.last_step.is_none_or(|last| {
            let passed = now.seconds_since(last);
            passed < 0.0 || passed >= period * (1.0 - EARLY)
        });
        if !is_due {
            return None;
        }
        self.last_step = Some(now);
        self.has_stepped = true;
        Some(controller.step(now))
    }

    /// Motor torques of the wheels to hold now \[N m\].
    pub fn wheel_torques(&self) -> &[f64] {
        self.controller.as_ref().map_or(&[], |c| c.wheel_torques())
    }

    /// On-times commanded by the last call of [`AttitudeLoop::step`] \[s\]; `None` if that was not a control step, or
    /// thrusters are not used.
    pub fn on_times(&self) -> Option<&[f64]> {
        let on_times = self.controller.as_ref()?.on_times();
        (self.has_stepped && !on_times.is_empty()).then_some(on_times)
    }
}
