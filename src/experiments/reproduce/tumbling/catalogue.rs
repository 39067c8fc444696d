//! Names and captions of the figures and tables of chapter 3.

use super::{error_maps, model_tables, pliers, waveforms};
use crate::experiments::reproduce::{Report, Reproduction};

const fn one(
    name: &'static str,
    shows: &'static str,
    compute: fn(Report) -> Report,
) -> Reproduction {
    Reproduction {
        name,
        shows,
        compute,
    }
}

const fn table(name: &'static str, shows: &'static str) -> Reproduction {
    one(name, shows, model_tables::model_table)
}

const fn map(name: &'static str, shows: &'static str) -> Reproduction {
    one(name, shows, error_maps::error_map)
}

/// All reproductions of chapter 3.
pub const TUMBLING: &[Reproduction] = &[
    one(
        "masutani-ch3-pliers",
        "Masutani 1995 sec. 3.2, 3.3, Figs. 3.7-3.13: pliers that turn over as they spin, watched and estimated",
        pliers::pliers,
    ),
    table(
        "masutani-table-3.2",
        "Masutani 1995 Table 3.2: model chosen for each of 294 motions, from true angular velocities",
    ),
    table(
        "masutani-table-3.3",
        "Masutani 1995 Table 3.3: model chosen for each of 294 motions, from true rotations",
    ),
    table(
        "masutani-table-3.4",
        "Masutani 1995 Table 3.4: model chosen for each of 294 motions, from images of 1024 px",
    ),
    table(
        "masutani-table-3.5",
        "Masutani 1995 Table 3.5: model chosen for each of 294 motions, from images of 1024 px (resolution series)",
    ),
    table(
        "masutani-table-3.6",
        "Masutani 1995 Table 3.6: model chosen for each of 294 motions, from images of 512 px",
    ),
    table(
        "masutani-table-3.7",
        "Masutani 1995 Table 3.7: model chosen for each of 294 motions, from images of 256 px",
    ),
    map(
        "masutani-fig-3.18",
        "Masutani 1995 Fig. 3.18: relative error r of the dynamic parameters, from true angular velocities",
    ),
    map(
        "masutani-fig-3.19",
        "Masutani 1995 Fig. 3.19: relative error r of the dynamic parameters, from true rotations",
    ),
    map(
        "masutani-fig-3.20",
        "Masutani 1995 Fig. 3.20: relative error r of the dynamic parameters, from images",
    ),
    map(
        "masutani-fig-3.21",
        "Masutani 1995 Fig. 3.21: largest error Theta of the predicted attitude, from true angular velocities",
    ),
    map(
        "masutani-fig-3.22",
        "Masutani 1995 Fig. 3.22: largest error Theta of the predicted attitude, from true rotations",
    ),
    map(
        "masutani-fig-3.23",
        "Masutani 1995 Fig. 3.23: largest error Theta of the predicted attitude, from images",
    ),
    map(
        "masutani-fig-3.24",
        "Masutani 1995 Fig. 3.24: largest error Phi of the predicted J_z axis, from true angular velocities",
    ),
    map(
        "masutani-fig-3.25",
        "Masutani 1995 Fig. 3.25: largest error Phi of the predicted J_z axis, from true rotations",
    ),
    map(
        "masutani-fig-3.26",
        "Masutani 1995 Fig. 3.26: largest error Phi of the predicted J_z axis, from images",
    ),
    one(
        "masutani-fig-3.27",
        "Masutani 1995 Fig. 3.27: period T of the squared angular velocity",
        waveforms::period_map,
    ),
    one(
        "masutani-fig-3.28",
        "Masutani 1995 Fig. 3.28: amplitude of the squared angular velocity",
        waveforms::amplitude_map,
    ),
    one(
        "masutani-fig-3.29",
        "Masutani 1995 Fig. 3.29: squared angular velocity from images, e = 0.9, s_alpha = -0.8",
        waveforms::buried_wave,
    ),
    one(
        "masutani-fig-3.30",
        "Masutani 1995 Fig. 3.30: spectrum of the squared angular velocity from images, e = 0.9, s_alpha = -0.8",
        waveforms::buried_spectrum,
    ),
    map(
        "masutani-fig-3.31",
        "Masutani 1995 Fig. 3.31: relative error r of the dynamic parameters, resolution 1024",
    ),
    map(
        "masutani-fig-3.32",
        "Masutani 1995 Fig. 3.32: relative error r of the dynamic parameters, resolution 512",
    ),
    map(
        "masutani-fig-3.33",
        "Masutani 1995 Fig. 3.33: relative error r of the dynamic parameters, resolution 256",
    ),
    map(
        "masutani-fig-3.34",
        "Masutani 1995 Fig. 3.34: largest error Phi of the predicted J_z axis, resolution 1024",
    ),
    map(
        "masutani-fig-3.35",
        "Masutani 1995 Fig. 3.35: largest error Phi of the predicted J_z axis, resolution 512",
    ),
    map(
        "masutani-fig-3.36",
        "Masutani 1995 Fig. 3.36: largest error Phi of the predicted J_z axis, resolution 256",
    ),
    map(
        "masutani-fig-3.37",
        "Masutani 1995 Fig. 3.37: relative error r of the dynamic parameters, 40 points",
    ),
    map(
        "masutani-fig-3.38",
        "Masutani 1995 Fig. 3.38: relative error r of the dynamic parameters, 20 points",
    ),
    map(
        "masutani-fig-3.39",
        "Masutani 1995 Fig. 3.39: relative error r of the dynamic parameters, 10 points",
    ),
    map(
        "masutani-fig-3.40",
        "Masutani 1995 Fig. 3.40: largest error Phi of the predicted J_z axis, 40 points",
    ),
    map(
        "masutani-fig-3.41",
        "Masutani 1995 Fig. 3.41: largest error Phi of the predicted J_z axis, 20 points",
    ),
    map(
        "masutani-fig-3.42",
        "Masutani 1995 Fig. 3.42: largest error Phi of the predicted J_z axis, 10 points",
    ),
    map(
        "masutani-fig-3.43",
        "Masutani 1995 Fig. 3.43: relative error r of the dynamic parameters, beta = 0.1",
    ),
    map(
        "masutani-fig-3.44",
        "Masutani 1995 Fig. 3.44: relative error r of the dynamic parameters, beta = 0.2",
    ),
    map(
        "masutani-fig-3.45",
        "Masutani 1995 Fig. 3.45: relative error r of the dynamic parameters, beta = 0.4",
    ),
    map(
        "masutani-fig-3.46",
        "Masutani 1995 Fig. 3.46: relative error r of the dynamic parameters, beta = 0.8",
    ),
    map(
        "masutani-fig-3.47",
        "Masutani 1995 Fig. 3.47: relative error r of the dynamic parameters, beta = 1.6",
    ),
    map(
        "masutani-fig-3.48",
        "Masutani 1995 Fig. 3.48: largest error Phi of the predicted J_z axis, beta = 0.1",
    ),
    map(
        "masutani-fig-3.49",
        "Masutani 1995 Fig. 3.49: largest error Phi of the predicted J_z axis, beta = 0.2",
    ),
    map(
        "masutani-fig-3.50",
        "Masutani 1995 Fig. 3.50: largest error Phi of the predicted J_z axis, beta = 0.4",
    ),
    map(
        "masutani-fig-3.51",
        "Masutani 1995 Fig. 3.51: largest error Phi of the predicted J_z axis, beta = 0.8",
    ),
    map(
        "masutani-fig-3.52",
        "Masutani 1995 Fig. 3.52: largest error Phi of the predicted J_z axis, beta = 1.6",
    ),
];
