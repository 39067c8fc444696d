//! Counts of floating-point operations.

use std::cell::Cell;
use std::ops::{Add, Mul, Neg, Sub};

use crate::dynamics::kernel::{
    LinkPlacement, MomentumColumn, PlanarRotation, Scalar, Tree, generalized_jacobian, momentum_map,
};
use crate::model::Model;

thread_local! {
    static COUNTS: Cell<Counts> = const { Cell::new(Counts { multiplications: 0, additions: 0, divisions: 0 }) };
}

/// Numbers of operations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Multiplications.
    pub multiplications: usize,
    /// Additions and subtractions.
    pub additions: usize,
    /// Divisions.
    pub divisions: usize,
}

/// Counts the operations on [`Counted`] numbers in `calculate`, on this thread.
pub fn counted<T>(calculate: impl FnOnce() -> T) -> (T, Counts) {
    COUNTS.set(Counts::default());
    (calculate(), COUNTS.get())
}

fn count(what: fn(&mut Counts) -> &mut usize) {
    let mut counts = COUNTS.get();
    *what(&mut counts) += 1;
    COUNTS.set(counts);
}

/// A number that counts the operations on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Counted(pub f64);

impl Add for Counted {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        count(|c| &mut c.additions);
        Self(self.0 + other.0)
    }
}

impl Sub for Counted {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        count(|c| &mut c.additions);
        Self(self.0 - other.0)
    }
}

impl Mul for Counted {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        count(|c| &mut c.multiplications);
        Self(self.0 * other.0)
    }
}

impl Neg for Counted {
    type Output = Self;
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl Scalar for Counted {
    fn constant(self, value: f64) -> Self {
        Self(value)
    }

    fn recip(self) -> Self {
        count(|c| &mut c.divisions);
        Self(1.0 / self.0)
    }
}

/// Operation counts of fuyu's recursion for the generalized Jacobian of a point of the last body, including the
/// momentum map. Evaluations of sine and cosine are not counted; multiplications with them are.
pub fn recursion(model: &Model) -> Counts {
    let tree = Tree::new(model);
    let zero = Counted(0.0);
    let mut placements = vec![LinkPlacement::new(zero); model.dof() + 1];
    let mut map = vec![MomentumColumn::zero(zero); model.dof()];
    let mut columns = vec![[zero; 6]; model.dof()];
    let ((), counts) = counted(|| {
        for placement in &mut placements[1..] {
            placement.rotation = PlanarRotation::new(Counted(0.8), Counted(0.6));
        }
        let system = momentum_map(&tree, &mut placements, &mut map);
        let (end, tip) = (model.dof(), [0.3, 0.1, 0.2]);
        generalized_jacobian(&tree, &placements, &map, &system, end, &tip, &mut columns);
    });
    counts
}
