//! The six directions of a hinge, and which of them are free.

use std::fmt;

/// One of the six relative motions that a hinge frees or constrains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// Translation along the hinge's x axis \[m\].
    TranslationX,
    /// Translation along the hinge's y axis \[m\].
    TranslationY,
    /// Translation along the hinge's z axis \[m\].
    TranslationZ,
    /// Rotation about the hinge's x axis \[rad\].
    RotationX,
    /// Rotation about the hinge's y axis \[rad\].
    RotationY,
    /// Rotation about the hinge's z axis \[rad\].
    RotationZ,
}

impl Axis {
    /// All six axes, translations first: the order of every array of six.
    pub const ALL: [Self; 6] = [
        Self::TranslationX,
        Self::TranslationY,
        Self::TranslationZ,
        Self::RotationX,
        Self::RotationY,
        Self::RotationZ,
    ];

    /// Index in every array of six.
    pub fn index(self) -> usize {
        self as usize
    }

    /// Whether the axis is one of the three rotations.
    pub fn is_rotation(self) -> bool {
        self.index() >= 3
    }

    /// `"m"` or `"rad"`.
    pub fn unit(self) -> &'static str {
        if self.is_rotation() { "rad" } else { "m" }
    }
}

impl fmt::Display for Axis {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::TranslationX => "translation x",
            Self::TranslationY => "translation y",
            Self::TranslationZ => "translation z",
            Self::RotationX => "rotation x",
            Self::RotationY => "rotation y",
            Self::RotationZ => "rotation z",
        })
    }
}

/// The relative motions that a hinge leaves free: the diagonals of `S` and `W` in TR-942 eq. (2.2.5). The others are
/// constrained, `S̄` and `W̄` of eqs. (2.2.3)-(2.2.4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Freedom([bool; 6]);

impl Freedom {
    /// Nothing is free: the two bodies move as one.
    pub const LOCKED: Self = Self([false; 6]);
    /// Everything is free: only springs, dampers and efforts act between the bodies.
    pub const FREE: Self = Self([true; 6]);
    /// Rotation about z.
    pub const REVOLUTE: Self = Self::LOCKED.and(Axis::RotationZ);
    /// Translation along z.
    pub const PRISMATIC: Self = Self::LOCKED.and(Axis::TranslationZ);
    /// Rotation about x, then y: a Hooke joint, its x axis fixed to the inner body and its y axis to
    /// the outer.
    pub const UNIVERSAL: Self = Self::LOCKED.and(Axis::RotationX).and(Axis::RotationY);
    /// All rotations.
    pub const SPHERICAL: Self = Self::UNIVERSAL.and(Axis::RotationZ);

    /// The same freedom with `axis` free too.
    pub const fn and(mut self, axis: Axis) -> Self {
        self.0[axis as usize] = true;
        self
    }

    /// The same freedom with `axis` constrained.
    pub const fn without(mut self, axis: Axis) -> Self {
        self.0[axis as usize] = false;
        self
    }

    /// Whether `axis` is free.
    pub fn is_free(self, axis: Axis) -> bool {
        self.0[axis.index()]
    }

    /// Number of free axes, 0 to 6.
    pub fn degrees(self) -> usize {
        self.0.iter().filter(|free| **free).count()
    }

    /// The free rotations.
    pub(super) fn rotations(self) -> Rotations {
        let free = |k: usize| self.0[3 + k];
        match (free(0), free(1), free(2)) {
            (false, false, false) => Rotations::None,
            (true, false, false) => Rotations::One(0),
            (false, true, false) => Rotations::One(1),
            (false, false, true) => Rotations::One(2),
            (true, true, false) => Rotations::Two(0, 1),
            (false, true, true) => Rotations::Two(1, 2),
            (true, false, true) => Rotations::Two(0, 2),
            (true, true, true) => Rotations::Three,
        }
    }
}

/// The free rotations of a hinge, by the numbers of their axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rotations {
    None,
    One(usize),
    /// The first axis is fixed to the inner body, the second to the outer.
    Two(usize, usize),
    Three,
}
