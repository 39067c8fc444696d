//! Checks of a rendezvous: limits of the joints, distances, and whether the arm can continue to follow the target.

use nalgebra::{DVector, UnitQuaternion};

use super::clearance::Distances;
use super::frame_motion::FrameMotion;
use super::plan::{Plan, PlanError, Reserve, SINGULAR, point};
use super::rendezvous::{Rendezvous, RendezvousPlanner};
use super::shooting::{End, PIECES, Shot};
use super::tip_mobility::effective_mass;
use crate::control::commander::JointPoint;

impl RendezvousPlanner {
    /// Checks that the tip can continue to follow `goals`, frames at later times \[s\]: that the arm reaches them one
    /// after the other within its rate limits and clear of singular postures. The base is assumed to stay where it is
    /// at the arrival.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn check_following(
        &mut self,
        plan: &Plan,
        goals: &[(f64, FrameMotion)],
    ) -> Result<(), PlanError> {
        let (mut q, mut time) = (plan.q.clone(), plan.arrival);
        for (at, goal) in goals {
            let before = q.clone();
            if !self.descend(&plan.R_IB, goal, &mut q) {
                let error = self.pose_error(&plan.R_IB, goal);
                return Err(PlanError::NotReached {
                    arrival: *at,
                    position: error.fixed_rows::<3>(0).norm(),
                    angle: error.fixed_rows::<3>(3).norm(),
                });
            }
            self.check_singular(&q, *at)?;
            for (j, joint) in self.model.joints().iter().enumerate() {
                let (value, limit) = ((q[j] - before[j]).abs() / (at - time), self.fastest(j));
                if value > limit {
                    return Err(PlanError::Joint {
                        joint: joint.name.clone(),
                        what: "rate",
                        value,
                        limit,
                    });
                }
            }
            time = *at;
        }
        Ok(())
    }

    pub(super) fn check_singular(
        &mut self,
        q: &DVector<f64>,
        arrival: f64,
    ) -> Result<(), PlanError> {
        self.workspace.set_positions(q);
        self.workspace
            .generalized_jacobian(&self.tip, &mut self.jacobian);
        let value = self.jacobian.clone().singular_values().min();
        match self.jacobian.ncols() >= 6 && value < SINGULAR {
            true => Err(PlanError::Singular { arrival, value }),
            false => Ok(()),
        }
    }

    /// Largest rate of joint `j` in a plan.
    pub(super) fn fastest(&self, j: usize) -> f64 {
        let limit = self.model.joints()[j].limits.velocity;
        match limit.is_finite() {
            true => limit * self.limits.velocity,
            false => self.limits.default_velocity,
        }
    }

    /// The plan, if it respects the limits with `reserve` to spare.
    pub(super) fn checked(
        &mut self,
        task: &Rendezvous,
        shot: Shot,
        bumps: DVector<f64>,
        reserve: Reserve,
    ) -> Result<Plan, PlanError> {
        let T = task.duration();
        self.check_singular(&shot.end.q, task.arrival)?;
        let mut distances = Distances {
            keep_out: f64::INFINITY,
            own: f64::INFINITY,
        };
        let mut R_IB = task.start.state.R_WB;
        let mut squares = 0.0;
        for piece in 0..PIECES {
            let (after, rate) = self.turned(task, (&shot.polynomials, &bumps), &R_IB, piece);
            R_IB = after;
            squares += rate.norm_squared() / PIECES as f64;
            let here = self.distances(task, &shot, &bumps, &R_IB, piece + 1);
            distances = distances.least(here);
            self.check_joints(task, (&shot, &bumps), &R_IB, piece + 1, reserve)?;
        }
        let closest = [
            (
                "the keep-out sphere of the target",
                distances.keep_out - reserve.distance,
            ),
            (
                "another part of the robot",
                distances.own - self.clearance.config().margin - reserve.distance,
            ),
        ];
        if let Some((what, distance)) = closest.into_iter().find(|(_, d)| *d < 0.0) {
            return Err(PlanError::Clearance { what, distance });
        }
        self.workspace.set_positions(&shot.end.q);
        let along = self.workspace.X_BF(&self.tip).rotation * self.approach_axis;
        let tip = (&self.tip, &mut self.jacobian);
        let effective_mass = effective_mass(&mut self.workspace, tip, &along);
        let start = task.start.state.time;
        Ok(Plan {
            start,
            arrival: start + T,
            q: shot.end.q,
            base_rate: squares.sqrt(),
            base_turn: task.start.state.R_WB.angle_to(&R_IB),
            effective_mass,
            distances,
            R_IB,
            polynomials: shot.polynomials,
            bumps,
        })
    }

    /// Checks positions, rates, accelerations and efforts of the joints at the end of a piece of the path.
    pub(super) fn check_joints(
        &mut self,
        task: &Rendezvous,
        (shot, bumps): (&Shot, &DVector<f64>),
        R_IB: &UnitQuaternion<f64>,
        piece: usize,
        reserve: Reserve,
    ) -> Result<(), PlanError> {
        let (s, T) = (piece as f64 / PIECES as f64, task.duration());
        let n = self.model.dof();
        let points: Vec<JointPoint> = (0..n)
            .map(|j| point(&shot.polynomials[j], bumps[j], s, T))
            .collect();
        let of =
            |value: fn(&JointPoint) -> f64| DVector::from_iterator(n, points.iter().map(value));
        let here = End {
            q: of(|p| p.position),
            qd: of(|p| p.rate),
            qdd: of(|p| p.acceleration),
        };
        let state = self.state(task, *R_IB, &here);
        self.workspace.set_positions(&state.q);
        self.workspace.set_motion(&state);
        (self.workspace).accelerations(&state, &self.no_input, &mut self.free);
        let added = &here.qdd - &self.free;
        let efforts = self.workspace.reduced_inertia() * added;
        for (j, joint) in self.model.joints().iter().enumerate() {
            let limits = &joint.limits;
            let exceeds = |what, value: f64, limit: f64| {
                (value > limit).then(|| PlanError::Joint {
                    joint: joint.name.clone(),
                    what,
                    value,
                    limit,
                })
            };
            let left = 1.0 - reserve.share;
            let fastest = self.fastest(j);
            let violated = exceeds("position", here.q[j], limits.upper)
                .or(exceeds("position", -here.q[j], -limits.lower))
                .or(exceeds("rate", here.qd[j].abs(), fastest * left))
                .or(exceeds(
                    "acceleration",
                    here.qdd[j].abs(),
                    self.limits.acceleration * left,
                ))
                .or(exceeds(
                    "effort",
                    efforts[j].abs(),
                    limits.effort * self.limits.effort * left,
                ));
            if let Some(error) = violated {
                return Err(error);
            }
        }
        Ok(())
    }
}
