//! Whether constraints have enough hinges.

/// Finds every constraint a hinge of its own among those that move it, in which case their gradients are
/// independent except in special positions (or special mechanisms, such as planar ones); otherwise they never are.
#[derive(Debug)]
pub(super) struct Pairing {
    /// Hinges that move each constraint.
    movers: Vec<Vec<usize>>,
    /// The constraint that each hinge was given to.
    given_to: Vec<Option<usize>>,
}

impl Pairing {
    pub(super) fn new(hinges: usize) -> Self {
        Self {
            movers: Vec::new(),
            given_to: vec![None; hinges],
        }
    }

    /// Constraints so far.
    pub(super) fn count(&self) -> usize {
        self.movers.len()
    }

    /// Adds a constraint; otherwise says how many hinges it would have to share with that many others.
    pub(super) fn add(&mut self, movers: Vec<usize>) -> Result<(), usize> {
        self.movers.push(movers);
        let mut asked = vec![false; self.given_to.len()];
        if self.find(self.movers.len() - 1, &mut asked) {
            Ok(())
        } else {
            Err(asked.iter().filter(|&&asked| asked).count())
        }
    }

    /// Gives `constraint` a hinge, if need be one whose present constraint finds another.
    fn find(&mut self, constraint: usize, asked: &mut [bool]) -> bool {
        for i in 0..self.movers[constraint].len() {
            let hinge = self.movers[constraint][i];
            if !std::mem::replace(&mut asked[hinge], true)
                && self.given_to[hinge].is_none_or(|other| self.find(other, asked))
            {
                self.given_to[hinge] = Some(constraint);
                return true;
            }
        }
        false
    }
}
