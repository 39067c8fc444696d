//! Published results compared with computed ones: `fuyu reproduce`.

mod capture;
mod kida;
mod masutani;
mod masutani_ch4;
mod masutani_ch6;
mod masutani_ch7;
mod masutani_g;
mod report;
mod teleoperation;
mod tr942;
mod tracking;
mod tumbling;

use capture::CAPTURE;
use kida::KIDA;
use tumbling::TUMBLING;

pub use report::{Report, Row};

/// A published result that can be reproduced.
#[derive(Debug, Clone, Copy)]
pub struct Reproduction {
    /// Name on the command line.
    pub name: &'static str,
    /// Content and source.
    pub shows: &'static str,
    compute: fn(Report) -> Report,
}

/// All reproductions, in the order of `fuyu reproduce all`.
pub const ALL: &[Reproduction] = &{
    const PARTS: [&[Reproduction]; 4] = [QUICK, CAPTURE, KIDA, TUMBLING];
    const COUNT: usize = QUICK.len() + CAPTURE.len() + KIDA.len() + TUMBLING.len();
    let mut all = [QUICK[0]; COUNT];
    let (mut next, mut part) = (0, 0);
    while part < PARTS.len() {
        let mut i = 0;
        while i < PARTS[part].len() {
            all[next] = PARTS[part][i];
            next += 1;
            i += 1;
        }
        part += 1;
    }
    all
};

/// Reproductions that need only a few runs each.
const QUICK: &[Reproduction] = &[
    Reproduction {
        name: "masutani-fig-4.5",
        shows: "Masutani 1995 Fig. 4.5: manipulability ellipses of a planar arm, base fixed and floating",
        compute: masutani_ch4::fig_4_5,
    },
    Reproduction {
        name: "masutani-fig-5.3",
        shows: "Masutani 1995 Fig. 5.3: joint PD misses the goal, transpose generalized-Jacobian control reaches it",
        compute: masutani::fig_5_3,
    },
    Reproduction {
        name: "masutani-fig-5.4",
        shows: "Masutani 1995 Fig. 5.4: deviation of the tip over time, and drift of the base",
        compute: masutani::fig_5_4,
    },
    Reproduction {
        name: "masutani-fig-5.5",
        shows: "Masutani 1995 Fig. 5.5: angular acceleration of the base, and the corresponding moment",
        compute: masutani::fig_5_5,
    },
    Reproduction {
        name: "masutani-fig-6.1",
        shows: "Masutani 1995 Fig. 6.1: where the fixed-base Jacobian is stable, for six sizes of the base",
        compute: masutani_ch6::fig_6_1,
    },
    Reproduction {
        name: "masutani-fig-6.2",
        shows: "Masutani 1995 Fig. 6.2: in the stable region both Jacobians give similar motions",
        compute: masutani_ch6::fig_6_2,
    },
    Reproduction {
        name: "masutani-fig-6.3",
        shows: "Masutani 1995 Fig. 6.3: in the unstable region the fixed-base Jacobian moves the tip away first",
        compute: masutani_ch6::fig_6_3,
    },
    Reproduction {
        name: "masutani-fig-7.3",
        shows: "Masutani 1995 Fig. 7.3: rotating the tip force straightens the path; twelve further tasks",
        compute: masutani_ch7::fig_7_3,
    },
    Reproduction {
        name: "masutani-table-g.1",
        shows: "Masutani 1995 Table G.1 (6.1): operation counts of the generalized Jacobian",
        compute: masutani_g::table_g_1,
    },
    Reproduction {
        name: "masutani-fig-8.7",
        shows: "Masutani 1995 Fig. 8.7: time that an operator needs to position the tip, for six methods",
        compute: teleoperation::fig_8_7,
    },
    Reproduction {
        name: "masutani-fig-8.10",
        shows: "Masutani 1995 Fig. 8.10: distortion of an operator's commands by a free base over the workspace",
        compute: teleoperation::fig_8_10,
    },
    Reproduction {
        name: "tr942-chain",
        shows: "TR-942 section 3.2: a satellite with a manipulator of four links",
        compute: tr942::chain,
    },
    Reproduction {
        name: "tr942-pantograph",
        shows: "TR-942 section 3.3: a satellite deploys a pantograph with two closed loops",
        compute: tr942::pantograph,
    },
    Reproduction {
        name: "tracking",
        shows: "no publication: tracking a tumbling grasp point, and the tolerated camera latency",
        compute: tracking::tracking,
    },
];

impl Reproduction {
    /// Finds a reproduction by name.
    pub fn named(name: &str) -> Option<&'static Self> {
        ALL.iter().find(|r| r.name == name)
    }

    /// Computes the reproduction; takes seconds.
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
