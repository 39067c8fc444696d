//! The tables of Masutani 1995 chapter 3: the model that the thesis chose for each motion of its grid.

use super::{ISOTROPIES, MOMENTA};
use crate::estimation::MotionModel;

/// A table of models over the grid, as printed: a row for each momentum `s_alpha` from +1.0 down to -1.0, a letter
/// for each isotropy `e` from 0.35 up to 1.00. `O` asymmetric, `v` axisymmetric, `/` single-axis.
#[derive(Debug, Clone, Copy)]
pub struct ModelTable {
    /// Number in the thesis, such as `3.2`.
    pub number: &'static str,
    /// Its title.
    pub title: &'static str,
    rows: [&'static str; MOMENTA],
}

impl ModelTable {
    /// The model printed for isotropy number `e` (0: 0.35) and momentum number `s_alpha` (0: -1.0).
    pub fn model(&self, e: usize, s_alpha: usize) -> MotionModel {
        match self.rows[MOMENTA - 1 - s_alpha].as_bytes()[e] {
            b'O' => MotionModel::Asymmetric,
            b'v' => MotionModel::Axisymmetric,
            _ => MotionModel::SingleAxis,
        }
    }

    /// Number of cells in which `models` (in the order of [`super::grid`]) agree with the printed table.
    pub fn agreement(&self, models: &[Option<MotionModel>]) -> usize {
        let cells = (0..ISOTROPIES).flat_map(|e| (0..MOMENTA).map(move |s| (e, s)));
        cells
            .zip(models)
            .filter(|((e, s), model)| **model == Some(self.model(*e, *s)))
            .count()
    }
}

/// Table 3.2, page 53: from true angular velocities.
pub const TABLE_3_2: ModelTable = ModelTable {
    number: "3.2",
    title: "Estimation model used, from true angular velocities",
    rows: [
        "//////////////",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOOv",
        "///vvvv/////v/",
        "OOOOOOOOOOOOOv",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "//////////////",
    ],
};

/// Table 3.3, page 53: from true rotations.
pub const TABLE_3_3: ModelTable = ModelTable {
    number: "3.3",
    title: "Estimation model used, from true rotations",
    rows: [
        "//////////////",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOOv",
        "//////////////",
        "OOOOOOOOOOOOOv",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "//////////////",
    ],
};

/// Table 3.4, page 53: from images of 1024 px.
pub const TABLE_3_4: ModelTable = ModelTable {
    number: "3.4",
    title: "Estimation model used, from images of 1024 px",
    rows: [
        "//////////////",
        "OOOOOOOOvvvv//",
        "OOOOOOOOvvvv//",
        "OOOOOOOOOvvvv/",
        "OOOOOOOOOOvvv/",
        "OOOOOOOOOOOvv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOO/",
        "OOOOOOOOOOOOOv",
        "//////////////",
        "OOOOOOOOOOOOOv",
        "OOOOOOOOOOOOOv",
        "OOOOOOOOOOOOOv",
        "OOOOOOOOOOOOOv",
        "OOOOOOOOOOOOOv",
        "OOOOOOOOOOOOOv",
        "OOOOOOOOOOOOOv",
        "OOOOOOOOOOOOOv",
        "OOOOOOOOvvvvv/",
        "//////////////",
    ],
};

/// Table 3.5, page 60: from images of 1024 px (the same condition as Table 3.4, in another run: 22 cells differ).
pub const TABLE_3_5: ModelTable = ModelTable {
    number: "3.5",
    title: "Estimation model used, from images of 1024 px",
    rows: [
        "//////////////",
        "OOOOOOOOvvvv//",
        "OOOOOOOOvvvv//",
        "OOOOOOOOOvvvv/",
        "OOOOOOOOOOvvv/",
        "OOOOOOOOOOOvv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "//////////////",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOvvvvv//",
        "//////////////",
    ],
};

/// Table 3.6, page 60: from images of 512 px.
pub const TABLE_3_6: ModelTable = ModelTable {
    number: "3.6",
    title: "Estimation model used, from images of 512 px",
    rows: [
        "//////////////",
        "OOOOOOOvvvvv//",
        "OOOOOOOvvvvv//",
        "OOOOOOOOvvvv//",
        "OOOOOOOOOvvv//",
        "OOOOOOOOOOvv//",
        "OOOOOOOOOOOv//",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "//////////////",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOOOOOOOv/",
        "OOOOOOvvvvvv//",
        "//////////////",
    ],
};

/// Table 3.7, page 60: from images of 256 px.
pub const TABLE_3_7: ModelTable = ModelTable {
    number: "3.7",
    title: "Estimation model used, from images of 256 px",
    rows: [
        "//////////////",
        "OOOvvvvvvvvv//",
        "OOOOOvvvvvvv//",
        "OOOOOOvvvvvv//",
        "OOOOOOOvvvvv//",
        "OOOOOOOOvvvv//",
        "OOOOOOOOvvvv//",
        "OOOOOOOOvvvv//",
        "OOOOOOOOvvvv//",
        "OOOOOOOOOvvv//",
        "//////////////",
        "OOOOOOOOvvvv//",
        "OOOOOOOOvvvv//",
        "OOOOOOOOvvvv//",
        "OOOOOOOOvvvv//",
        "OOOOOOOOvvvv//",
        "OOOOOOOOvvvv//",
        "OOOOOOvvvvvv//",
        "OOOOOvvvvvvv//",
        "Ovvvvvvvvvvv//",
        "//////////////",
    ],
};
