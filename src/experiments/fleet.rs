//! Fleet: the robots of a scenario, one or several in one world, in a single thread without DDS.

use super::ClosedLoop;
use crate::{
    nodes::{
        dynamics::FreeBody as _,
        scenario::{OtherBody, Scenario},
    },
    spatial::Pose,
};

/// The closed loops of all robots of a scenario. They share the time, and their cameras see bases and targets of the
/// other robots; bodies of different robots do not touch.
pub struct Fleet {
    robots: Vec<Member>,
}

/// A robot with its loop.
struct Member {
    namespace: String,
    closed_loop: ClosedLoop,
    /// Bodies of other robots that its cameras watch, in the order of their names: index of the robot, and of the
    /// target, `None` for the base.
    watched: Vec<(usize, Option<usize>)>,
}

impl Fleet {
    /// The closed loops that `scenario` describes.
    ///
    /// # Errors
    /// A line that names file, node and parameter.
    pub fn new(scenario: &Scenario) -> Result<Self, String> {
        // Without a dynamics node there is no robot.
        scenario.dynamics()?;
        let robots = scenario.robots().into_iter().map(|namespace| {
            Ok(Member {
                namespace: namespace.to_owned(),
                closed_loop: ClosedLoop::new(&scenario.of_robot(namespace))?,
                watched: Vec::new(),
            })
        });
        let mut robots: Vec<Member> = robots.collect::<Result<_, String>>()?;
        for i in 0..robots.len() {
            let names = robots[i].closed_loop.others.names().iter();
            let watched = names.map(|name| {
                let OtherBody { robot, target } = scenario.other_body(name)?;
                let other = robots.iter().position(|r| r.namespace == robot);
                let other = other.ok_or_else(|| format!("no robot is in the namespace {robot}"))?;
                let world = &robots[other].closed_loop.world;
                let target = target
                    .map(|target| world.target_index(&target))
                    .transpose()?;
                Ok((other, target))
            });
            robots[i].watched = watched.collect::<Result<_, String>>()?;
        }
        Ok(Self { robots })
    }

    /// Namespaces and loops of the robots.
    pub fn robots(&self) -> impl Iterator<Item = (&str, &ClosedLoop)> {
        let robots = self.robots.iter();
        robots.map(|robot| (robot.namespace.as_str(), &robot.closed_loop))
    }

    /// The loop of a robot, after the poses of other robots' bodies were updated for its cameras.
    ///
    /// # Panics
    /// If there is no such robot.
    pub fn robot(&mut self, index: usize) -> &mut ClosedLoop {
        for i in 0..self.robots[index].watched.len() {
            let (robot, target) = self.robots[index].watched[i];
            let X_WB = self.pose(robot, target);
            self.robots[index].closed_loop.others.set_pose(i, X_WB);
        }
        &mut self.robots[index].closed_loop
    }

    /// The common time \[s\].
    pub fn time(&self) -> f64 {
        self.robots[0].closed_loop.world.time()
    }

    /// The scenario's duration \[s\], the same for all robots; zero if it has none.
    pub fn duration(&self) -> f64 {
        self.robots[0].closed_loop.duration()
    }

    /// A line on a robot, prefixed with its namespace if there are several.
    pub fn of_robot(&self, index: usize, line: &str) -> String {
        match self.robots.as_slice() {
            [_] => line.to_owned(),
            several => format!("{}: {line}", several[index].namespace),
        }
    }

    /// Advances all robots to the next state.
    ///
    /// # Errors
    /// If a motion has diverged: a line that names the robot.
    pub fn advance(&mut self) -> Result<(), String> {
        for i in 0..self.robots.len() {
            let advanced = self.robots[i].closed_loop.advance();
            advanced.map_err(|problem| self.of_robot(i, &problem))?;
        }
        Ok(())
    }

    /// The loop of the only robot; `None` if there are several.
    pub(super) fn only_robot(&mut self) -> Option<&mut ClosedLoop> {
        match self.robots.as_mut_slice() {
            [one] => Some(&mut one.closed_loop),
            _ => None,
        }
    }

    /// Pose of a robot's base, or of one of its targets, in the world.
    fn pose(&self, robot: usize, target: Option<usize>) -> Pose {
        let world = &self.robots[robot].closed_loop.world;
        match target {
            None => world.robot.X_WB(),
            Some(target) => world.targets[target].body.X_WB(),
        }
    }
}
