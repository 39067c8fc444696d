//! Published results beside what fuyu computes: what `fuyu reproduce` prints.

mod report;
mod tumbling;

pub use report::{Report, Row};

/// A published result that can be computed anew.
#[derive(Debug, Clone, Copy)]
pub struct Reproduction {
    /// How it is called on the command line.
    pub name: &'static str,
    /// What it shows, and where it was published.
    pub shows: &'static str,
    compute: fn(Report) -> Report,
}

/// All of them, in the order in which `fuyu reproduce all` computes them.
pub const ALL: &[Reproduction] = &[
    Reproduction {
        name: "masutani-ch3-pliers",
        shows: "Masutani 1995 sec. 3.2, 3.3, Figs. 3.7-3.13: pliers that turn over as they spin, watched and estimated",
        compute: tumbling::pliers,
    },
    Reproduction {
        name: "masutani-table-3.2",
        shows: "Masutani 1995 Table 3.2: model chosen for each of 294 motions, from true angular velocities",
        compute: tumbling::model_table,
    },
    Reproduction {
        name: "masutani-table-3.3",
        shows: "Masutani 1995 Table 3.3: model chosen for each of 294 motions, from true rotations",
        compute: tumbling::model_table,
    },
    Reproduction {
        name: "masutani-table-3.4",
        shows: "Masutani 1995 Table 3.4: model chosen for each of 294 motions, from images of 1024 px",
        compute: tumbling::model_table,
    },
    Reproduction {
        name: "masutani-table-3.5",
        shows: "Masutani 1995 Table 3.5: model chosen for each of 294 motions, from images of 1024 px (resolution series)",
        compute: tumbling::model_table,
    },
    Reproduction {
        name: "masutani-table-3.6",
        shows: "Masutani 1995 Table 3.6: model chosen for each of 294 motions, from images of 512 px",
        compute: tumbling::model_table,
    },
    Reproduction {
        name: "masutani-table-3.7",
        shows: "Masutani 1995 Table 3.7: model chosen for each of 294 motions, from images of 256 px",
        compute: tumbling::model_table,
    },
    Reproduction {
        name: "masutani-fig-3.18",
        shows: "Masutani 1995 Fig. 3.18: relative error r of the dynamic parameters, from true angular velocities",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.19",
        shows: "Masutani 1995 Fig. 3.19: relative error r of the dynamic parameters, from true rotations",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.20",
        shows: "Masutani 1995 Fig. 3.20: relative error r of the dynamic parameters, from images",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.21",
        shows: "Masutani 1995 Fig. 3.21: largest error Theta of the predicted attitude, from true angular velocities",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.22",
        shows: "Masutani 1995 Fig. 3.22: largest error Theta of the predicted attitude, from true rotations",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.23",
        shows: "Masutani 1995 Fig. 3.23: largest error Theta of the predicted attitude, from images",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.24",
        shows: "Masutani 1995 Fig. 3.24: largest error Phi of the predicted J_z axis, from true angular velocities",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.25",
        shows: "Masutani 1995 Fig. 3.25: largest error Phi of the predicted J_z axis, from true rotations",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.26",
        shows: "Masutani 1995 Fig. 3.26: largest error Phi of the predicted J_z axis, from images",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.27",
        shows: "Masutani 1995 Fig. 3.27: period T of the squared angular velocity",
        compute: tumbling::period_map,
    },
    Reproduction {
        name: "masutani-fig-3.28",
        shows: "Masutani 1995 Fig. 3.28: amplitude of the squared angular velocity",
        compute: tumbling::amplitude_map,
    },
    Reproduction {
        name: "masutani-fig-3.29",
        shows: "Masutani 1995 Fig. 3.29: squared angular velocity from images, e = 0.9, s_alpha = -0.8",
        compute: tumbling::buried_wave,
    },
    Reproduction {
        name: "masutani-fig-3.30",
        shows: "Masutani 1995 Fig. 3.30: spectrum of the squared angular velocity from images, e = 0.9, s_alpha = -0.8",
        compute: tumbling::buried_spectrum,
    },
    Reproduction {
        name: "masutani-fig-3.31",
        shows: "Masutani 1995 Fig. 3.31: relative error r of the dynamic parameters, resolution 1024",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.32",
        shows: "Masutani 1995 Fig. 3.32: relative error r of the dynamic parameters, resolution 512",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.33",
        shows: "Masutani 1995 Fig. 3.33: relative error r of the dynamic parameters, resolution 256",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.34",
        shows: "Masutani 1995 Fig. 3.34: largest error Phi of the predicted J_z axis, resolution 1024",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.35",
        shows: "Masutani 1995 Fig. 3.35: largest error Phi of the predicted J_z axis, resolution 512",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.36",
        shows: "Masutani 1995 Fig. 3.36: largest error Phi of the predicted J_z axis, resolution 256",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.37",
        shows: "Masutani 1995 Fig. 3.37: relative error r of the dynamic parameters, 40 points",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.38",
        shows: "Masutani 1995 Fig. 3.38: relative error r of the dynamic parameters, 20 points",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.39",
        shows: "Masutani 1995 Fig. 3.39: relative error r of the dynamic parameters, 10 points",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.40",
        shows: "Masutani 1995 Fig. 3.40: largest error Phi of the predicted J_z axis, 40 points",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.41",
        shows: "Masutani 1995 Fig. 3.41: largest error Phi of the predicted J_z axis, 20 points",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.42",
        shows: "Masutani 1995 Fig. 3.42: largest error Phi of the predicted J_z axis, 10 points",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.43",
        shows: "Masutani 1995 Fig. 3.43: relative error r of the dynamic parameters, beta = 0.1",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.44",
        shows: "Masutani 1995 Fig. 3.44: relative error r of the dynamic parameters, beta = 0.2",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.45",
        shows: "Masutani 1995 Fig. 3.45: relative error r of the dynamic parameters, beta = 0.4",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.46",
        shows: "Masutani 1995 Fig. 3.46: relative error r of the dynamic parameters, beta = 0.8",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.47",
        shows: "Masutani 1995 Fig. 3.47: relative error r of the dynamic parameters, beta = 1.6",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.48",
        shows: "Masutani 1995 Fig. 3.48: largest error Phi of the predicted J_z axis, beta = 0.1",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.49",
        shows: "Masutani 1995 Fig. 3.49: largest error Phi of the predicted J_z axis, beta = 0.2",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.50",
        shows: "Masutani 1995 Fig. 3.50: largest error Phi of the predicted J_z axis, beta = 0.4",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.51",
        shows: "Masutani 1995 Fig. 3.51: largest error Phi of the predicted J_z axis, beta = 0.8",
        compute: tumbling::error_map,
    },
    Reproduction {
        name: "masutani-fig-3.52",
        shows: "Masutani 1995 Fig. 3.52: largest error Phi of the predicted J_z axis, beta = 1.6",
        compute: tumbling::error_map,
    },
];

impl Reproduction {
    /// The one of a name.
    pub fn named(name: &str) -> Option<&'static Self> {
        ALL.iter().find(|r| r.name == name)
    }

    /// Computes the result; takes seconds.
    pub fn compute(&self) -> Report {
        (self.compute)(Report::new(self.name, self.shows))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_file_names_and_differ() {
        for (i, one) in ALL.iter().enumerate() {
            let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-.".contains(c);
            assert!(
                one.name.chars().all(plain) && one.name != "all",
                "{}",
                one.name
            );
            assert!(ALL[i + 1..].iter().all(|other| other.name != one.name));
        }
    }
}
