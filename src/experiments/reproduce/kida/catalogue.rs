//! Names and captions of the reproductions of Kida 1993.

use super::{
    air_table, designs, double_loop, feedback, loop_shaping, proof_mass, servicer, shaping, tables,
    truss_control, truss_modes, two_degrees, zero_theorems,
};
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
    one(name, shows, tables::chapter_2)
}

/// All reproductions of Kida 1993.
pub const KIDA: &[Reproduction] = &[
    one(
        "kida-theorems-2",
        "Kida 1993 Theorems 2.1-2.6: poles and transmission zeros of 200 random structures, by two methods",
        zero_theorems::theorems,
    ),
    one(
        "kida-fig-2.2",
        "Kida 1993 Fig. 2.2: poles and mode shapes of a free plane truss",
        truss_modes::fig_2_2,
    ),
    one(
        "kida-fig-2.3",
        "Kida 1993 Fig. 2.3: zeros and mode shapes of the truss held at three inputs",
        truss_modes::fig_2_3,
    ),
    one(
        "kida-fig-2.4",
        "Kida 1993 Fig. 2.4: zeros and mode shapes of the truss held at four inputs",
        truss_modes::fig_2_4,
    ),
    table(
        "kida-table-2.1",
        "Kida 1993 Table 2.1: transmission zeros of the truss, 3 inputs, 12 modes",
    ),
    table(
        "kida-table-2.2",
        "Kida 1993 Table 2.2: transmission zeros of the truss, 3 inputs, 9 modes",
    ),
    table(
        "kida-table-2.3",
        "Kida 1993 Table 2.3: transmission zeros of the truss, 3 inputs, 6 modes",
    ),
    table(
        "kida-table-2.4",
        "Kida 1993 Table 2.4: transmission zeros of the truss, 4 inputs, 12 modes",
    ),
    table(
        "kida-table-2.5",
        "Kida 1993 Table 2.5: frequencies of a clamped solar panel of ETS-VI",
    ),
    table(
        "kida-table-2.6",
        "Kida 1993 Table 2.6: poles of the satellite ETS-VI, 14 modes",
    ),
    table(
        "kida-table-2.7",
        "Kida 1993 Table 2.7: transmission zeros of ETS-VI, 6 inputs, 14 modes, panels at 180 deg",
    ),
    table(
        "kida-table-2.8",
        "Kida 1993 Table 2.8: transmission zeros of ETS-VI, 6 inputs, 6 modes, panels at 180 deg",
    ),
    table(
        "kida-table-2.9",
        "Kida 1993 Table 2.9: transmission zeros of ETS-VI, 6 inputs, 14 modes, panels at 45 deg",
    ),
    table(
        "kida-table-2.10",
        "Kida 1993 Table 2.10: transmission zeros of ETS-VI, 6 inputs, 6 modes, panels at 45 deg",
    ),
    table(
        "kida-table-2.11",
        "Kida 1993 Table 2.11: poles of ETS-VI without translation, 14 modes",
    ),
    table(
        "kida-table-2.12",
        "Kida 1993 Table 2.12: transmission zeros of ETS-VI, 3 torques and angles, 14 modes",
    ),
    one(
        "kida-theorems-3",
        "Kida 1993 Theorems 3.1-3.6: frequency-shaped regulators of 100 random structures",
        shaping::theorems,
    ),
    one(
        "kida-table-3.1",
        "Kida 1993 Table 3.1: modes of an air table with a flexible panel, from its hybrid model",
        air_table::table_3_1,
    ),
    one(
        "kida-fig-3.5",
        "Kida 1993 Fig. 3.5: frequency response of the air table, torque to angle",
        air_table::fig_3_5,
    ),
    one(
        "kida-fig-3.6",
        "Kida 1993 Fig. 3.6: design 1, standard regulator of the rigid mode; unstable",
        designs::fig_3_6,
    ),
    one(
        "kida-fig-3.7",
        "Kida 1993 Fig. 3.7: design 2, frequency-shaped regulator of the rigid mode",
        designs::fig_3_7,
    ),
    one(
        "kida-fig-3.8",
        "Kida 1993 Fig. 3.8: design 3, frequency-shaped regulator of two modes",
        designs::fig_3_8,
    ),
    one(
        "kida-fig-3.9",
        "Kida 1993 Fig. 3.9: design 4, the same with loop transfer recovery",
        designs::fig_3_9,
    ),
    one(
        "kida-fig-3.10",
        "Kida 1993 Fig. 3.10: design 5, frequency-shaped regulator of three modes",
        designs::fig_3_10,
    ),
    one(
        "kida-fig-3.12",
        "Kida 1993 Fig. 3.12: loop shaping, example 1: low-pass",
        loop_shaping::example,
    ),
    one(
        "kida-fig-3.13",
        "Kida 1993 Fig. 3.13: loop shaping, example 2: slow low-pass",
        loop_shaping::example,
    ),
    one(
        "kida-fig-3.14",
        "Kida 1993 Fig. 3.14: loop shaping, example 3: lead-lag",
        loop_shaping::example,
    ),
    one(
        "kida-fig-3.15",
        "Kida 1993 Fig. 3.15: loop shaping, example 4: both weights",
        loop_shaping::example,
    ),
    one(
        "kida-fig-3.17",
        "Kida 1993 Figs. 3.16, 3.17: a truss of 99 bars and its modes, on a surrogate geometry",
        truss_control::fig_3_17,
    ),
    one(
        "kida-fig-3.18",
        "Kida 1993 Fig. 3.18: singular values of plant, design model and model error of that truss",
        truss_control::fig_3_18,
    ),
    one(
        "kida-fig-3.20",
        "Kida 1993 Figs. 3.20, 3.21: the truss with a standard regulator; unstable",
        truss_control::fig_3_20,
    ),
    one(
        "kida-fig-3.22",
        "Kida 1993 Figs. 3.22, 3.23: the truss with a weight that grows with frequency on the forces",
        truss_control::fig_3_22,
    ),
    one(
        "kida-fig-3.24",
        "Kida 1993 Figs. 3.24, 3.25: the truss with weights on forces and displacements",
        truss_control::fig_3_24,
    ),
    one(
        "kida-theorems-4",
        "Kida 1993 Lemmas 4.2, 4.4, Theorems 4.1-4.3: direct feedback and proof masses on random structures",
        feedback::theorems,
    ),
    one(
        "kida-fig-4.4",
        "Kida 1993 Fig. 4.4: root locus of rate feedback by a proof mass, on the ground",
        proof_mass::root_locus,
    ),
    one(
        "kida-fig-4.5",
        "Kida 1993 Fig. 4.5: the same with ten times the actuator's damping",
        proof_mass::root_locus,
    ),
    one(
        "kida-fig-4.6",
        "Kida 1993 Fig. 4.6: the same without gravity",
        proof_mass::root_locus,
    ),
    one(
        "kida-fig-4.9",
        "Kida 1993 Figs. 4.8-4.10: vibration without control and with a compensated proof mass",
        proof_mass::fig_4_9,
    ),
    one(
        "kida-fig-4.15",
        "Kida 1993 Fig. 4.15: the air table with and without direct rate feedback",
        double_loop::fig_4_15,
    ),
    one(
        "kida-fig-4.16",
        "Kida 1993 Figs. 4.16, 4.18: model error and the weight that covers it, with and without rate feedback",
        double_loop::fig_4_16,
    ),
    one(
        "kida-fig-4.17",
        "Kida 1993 Fig. 4.17: the double loop, H-infinity control around rate feedback",
        double_loop::fig_4_17,
    ),
    one(
        "kida-fig-4.19",
        "Kida 1993 Fig. 4.19: H-infinity control without rate feedback",
        double_loop::fig_4_19,
    ),
    one(
        "kida-fig-4.20",
        "Kida 1993 Fig. 4.20: step and disturbance responses with and without rate feedback",
        double_loop::fig_4_20,
    ),
    one(
        "kida-fig-4.22",
        "Kida 1993 Fig. 4.22: root loci of direct feedback of angle and rate, three cases",
        two_degrees::fig_4_22,
    ),
    one(
        "kida-fig-4.23",
        "Kida 1993 Fig. 4.23: step and disturbance responses of direct feedback",
        two_degrees::fig_4_23,
    ),
    one(
        "kida-fig-4.24",
        "Kida 1993 Fig. 4.24: step and disturbance responses with two degrees of freedom",
        two_degrees::fig_4_24,
    ),
    one(
        "kida-fig-4.25",
        "Kida 1993 Fig. 4.25: frequency responses matched to a reference model",
        two_degrees::fig_4_25,
    ),
    one(
        "kida-servicer-zeros",
        "no publication: Kida's theorems on a servicer with an arm; its poles move with the arm, its zeros do not",
        servicer::zeros,
    ),
    one(
        "kida-servicer-feedback",
        "no publication: direct feedback on that servicer in any posture, sampled and delayed",
        servicer::feedback,
    ),
    one(
        "kida-servicer-double-loop",
        "no publication: the double loop on that servicer",
        servicer::double_loop,
    ),
];
