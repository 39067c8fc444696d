//! Scenarios with several robots in one world: dynamics nodes in different namespaces.

use super::{DynamicsParams, Scenario};
use crate::nodes::topics::BASE;

/// A body of a robot's world: one of its targets, or its base.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OtherBody {
    /// Namespace of the robot.
    pub robot: String,
    /// The robot's target; `None` for its base.
    pub target: Option<String>,
}

/// Checks that the dynamics nodes of `scenario` agree on their common time. A single dynamics node may share a world
/// with robots that another process simulates.
///
/// # Errors
/// A line that names file, node and parameter.
pub(super) fn check(scenario: &Scenario) -> Result<(), String> {
    let robots = scenario.robots();
    let params = robots.iter().map(|robot| scenario.dynamics_of(robot));
    // Invalid parameters have been reported already.
    let Some(params) = params.collect::<Option<Vec<_>>>() else {
        return Ok(());
    };
    let node = |i: usize| match robots[i] {
        "/" => "/dynamics".to_owned(),
        robot => format!("{robot}/dynamics"),
    };
    let at = |i: usize, problem: String| {
        Err(format!(
            "{}: node {}: {problem}",
            scenario.path().display(),
            node(i)
        ))
    };
    let same = |key: &str, of: fn(&DynamicsParams) -> String| {
        let different = params.iter().position(|p| of(p) != of(&params[0]));
        match different {
            None => Ok(()),
            Some(i) => at(
                i,
                format!(
                    "parameter {key} is {} but that of {} is {}; robots of one world need the same",
                    of(&params[i]),
                    node(0),
                    of(&params[0])
                ),
            ),
        }
    };
    for (i, params) in params.iter().enumerate() {
        let sorted = |names: &mut dyn Iterator<Item = &str>| {
            let mut names: Vec<_> = names.map(str::to_owned).collect();
            names.sort_unstable();
            names
        };
        let named = sorted(&mut params.robots.iter().map(String::as_str));
        let (expected, said) = (
            sorted(&mut robots.iter().copied()),
            params.robots.join(", "),
        );
        if robots.len() > 1 && named != expected {
            return at(
                i,
                format!(
                    "parameter robots is [{said}], but the scenario has {}; give all of them to each dynamics node, the owner of the time first",
                    robots.join(", ")
                ),
            );
        }
    }
    if let Some(i) = params.iter().position(|p| p.robots != params[0].robots) {
        return at(
            i,
            format!(
                "parameter robots is [{}] but that of {} is [{}]; the first one of the list owns the time, so all need the same",
                params[i].robots.join(", "),
                node(0),
                params[0].robots.join(", ")
            ),
        );
    }
    same("state_rate", |p| p.state_rate.to_string())?;
    same("lockstep", |p| p.lockstep.to_string())?;
    same("duration", |p| p.duration.to_string())?;
    same("real_time_factor", |p| p.real_time_factor.to_string())?;
    same("start_paused", |p| p.start_paused.to_string())
}

/// The body of another robot given by an absolute name, `/NAMESPACE/base_link` or `/NAMESPACE/TARGET`.
///
/// # Errors
/// A line that lists the known bodies.
pub(super) fn other_body(scenario: &Scenario, name: &str) -> Result<OtherBody, String> {
    let robots = scenario.robots();
    let (namespace, last) = name.rsplit_once('/').unwrap_or_default();
    let namespace = match namespace {
        "" => "/",
        namespace => namespace,
    };
    let elsewhere = |robot: &&str| {
        let params = scenario.dynamics_of(robot);
        params.is_some_and(|params| params.robots.iter().any(|r| r == namespace))
    };
    if !robots.contains(&namespace) && robots.iter().any(elsewhere) {
        // Its targets are known only to another process.
        return Ok(OtherBody {
            robot: namespace.to_owned(),
            target: (last != BASE).then(|| last.to_owned()),
        });
    }
    if !robots.contains(&namespace) {
        let bases: Vec<_> = robots
            .iter()
            .map(|robot| format!("{}/{BASE}", robot.trim_end_matches('/')))
            .collect();
        return Err(format!(
            "'{name}' belongs to no robot of the scenario; their bases are {}",
            bases.join(", ")
        ));
    }
    let robot = namespace.to_owned();
    if last == BASE {
        return Ok(OtherBody {
            robot,
            target: None,
        });
    }
    let targets = scenario.dynamics_of(namespace).map(|p| p.targets);
    let targets = targets.unwrap_or_default();
    match targets.iter().any(|target| target.name == last) {
        true => Ok(OtherBody {
            robot,
            target: Some(last.to_owned()),
        }),
        false => {
            let names = targets.iter().map(|target| target.name.as_str());
            let known: Vec<_> = std::iter::once(BASE).chain(names).collect();
            Err(format!(
                "'{name}' is not there; the robot {namespace} has {}",
                known.join(", ")
            ))
        }
    }
}
