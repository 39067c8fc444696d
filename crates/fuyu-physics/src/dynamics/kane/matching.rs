//! Bipartite matching of constraints with hinges.

/// Matches each constraint with a different hinge among those that move it. If a matching exists, the constraints'
/// gradients are independent except in special positions or mechanisms (such as planar ones); otherwise they never are.
#[derive(Debug)]
pub(super) struct ConstraintMatching {
    /// Hinges that move each constraint.
    movers: Vec<Vec<usize>>,
    /// The constraint that each hinge is matched with.
    matched: Vec<Option<usize>>,
}

impl ConstraintMatching {
    pub(super) fn new(hinges: usize) -> Self {
        Self {
            movers: Vec::new(),
            matched: vec![None; hinges],
        }
    }

    /// Number of constraints so far.
    pub(super) fn count(&self) -> usize {
        self.movers.len()
    }

    /// Adds a constraint.
    ///
    /// # Errors
    /// If there is no matching: the number of hinges that this constraint shares with as many others.
    pub(super) fn add(&mut self, movers: Vec<usize>) -> Result<(), usize> {
        self.movers.push(movers);
        let mut visited = vec![false; self.matched.len()];
        if self.augment(self.movers.len() - 1, &mut visited) {
            Ok(())
        } else {
            Err(visited.iter().filter(|&&visited| visited).count())
        }
    }

    /// Matches `constraint` along an augmenting path: a hinge that is taken is freed if its constraint finds another.
    fn augment(&mut self, constraint: usize, visited: &mut [bool]) -> bool {
        for i in 0..self.movers[constraint].len() {
            let hinge = self.movers[constraint][i];
            if !std::mem::replace(&mut visited[hinge], true)
                && self.matched[hinge].is_none_or(|other| self.augment(other, visited))
            {
                self.matched[hinge] = Some(constraint);
                return true;
            }
        }
        false
    }
}
