//! Mode shapes along a line, as of a beam or strip, and their mass points with second-order displacements.

use nalgebra::Vector3;

use crate::{
    Deflection, Invariants, MassPoint, Outline, OutputPoint, StructureError,
    appendage::pairs,
    quadrature::{Gauss, POINTS},
};

/// Deformation of a slender body at one place along x: deflection v along y, w along z, and twist θ about x with its slope.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sample {
    pub(crate) v: Deflection,
    pub(crate) w: Deflection,
    pub(crate) theta: (f64, f64),
}

/// A slender body along x of the attachment frame.
pub(crate) struct Line<'a> {
    /// Limits of the pieces within which shapes and mass are smooth \[m\].
    pub(crate) breaks: Vec<f64>,
    /// Mass per length \[kg/m\] at x.
    pub(crate) mass_per_length: Box<dyn Fn(f64) -> f64 + 'a>,
    /// Width along y over which the mass is spread evenly \[m\]; zero for a beam.
    pub(crate) width: f64,
    /// One for each mode.
    pub(crate) modes: Vec<Box<dyn Fn(f64) -> Sample + 'a>>,
}

/// Integrals from the root of the products of two modes.
#[derive(Clone, Copy, Default)]
struct Running {
    /// `∫ (v_k' v_l' + w_k' w_l') dx`: shortening.
    slopes: f64,
    /// `∫ (w_k' θ_l' + w_l' θ_k') dx`: turning of the chord in the plane.
    chord: f64,
    /// `∫ (θ_k w_l'' + θ_l w_k'') dx` and its integral: deflection in the plane of a strip that is bent and twisted.
    lateral: [f64; 2],
}

impl Running {
    fn rates(k: &Sample, l: &Sample) -> [f64; 3] {
        [
            k.v.slope * l.v.slope + k.w.slope * l.w.slope,
            k.w.slope * l.theta.1 + l.w.slope * k.theta.1,
            k.theta.0 * l.w.curvature + l.theta.0 * k.w.curvature,
        ]
    }

    /// The second-order displacement of the point at `y` of the chord, for the modes sampled.
    ///
    /// A rod that keeps its length and cross sections that turn without deforming: sections turn by θ about x, -w' about
    /// y and ψ about z with `ψ' = -θ w''`, because a strip does not bend in its plane. Then `u_x = -½∫w'² - y∫w'θ'`,
    /// `u_y = -∫∫θw'' - ½ y θ²` to second order; chi_kl is the second derivative by μ_k and μ_l.
    fn chi(&self, y: f64, k: &Sample, l: &Sample) -> Vector3<f64> {
        Vector3::new(
            -self.slopes - y * self.chord,
            -self.lateral[1] - y * k.theta.0 * l.theta.0,
            0.0,
        )
    }
}

impl Line<'_> {
    /// Mass points at the stations of a Gauss-Legendre rule, and output points `tip` (the middle of the chord), and
    /// `tip_left` (+y) and `tip_right` if there is a chord.
    pub(crate) fn points(&self, second_order: bool) -> (Vec<MassPoint>, Vec<OutputPoint>) {
        let gauss = Gauss::new();
        let n = self.modes.len();
        let mut running = vec![Running::default(); if second_order { n * (n + 1) / 2 } else { 0 }];
        let mut points = Vec::new();
        // The mass of a chord acts as two points: all integrands are quadratic in y at most.
        let chord: &[f64] = if self.width > 0.0 {
            &[-1.0, 1.0]
        } else {
            &[0.0]
        };
        let half = self.width / 12.0_f64.sqrt();
        for piece in self.breaks.windows(2) {
            let (start, h) = (piece[0], piece[1] - piece[0]);
            let stations = gauss.points.map(|p| start + p * h);
            let samples: Vec<Vec<Sample>> = stations.iter().map(|x| self.sample(*x)).collect();
            let inside = within(&running, &samples, &gauss, h);
            for (i, x) in stations.into_iter().enumerate() {
                let mass = (self.mass_per_length)(x) * h * gauss.weights[i] / chord.len() as f64;
                for side in chord {
                    points.push(mass_point(
                        mass,
                        x,
                        side * half,
                        &samples[i],
                        &inside.at_points[i],
                    ));
                }
            }
            running = inside.at_end;
        }
        (points, self.outputs(&running))
    }

    /// Mass integrals and output points.
    pub(crate) fn invariants(
        &self,
        second_order: bool,
    ) -> Result<(Invariants, Vec<OutputPoint>), StructureError> {
        let (points, outputs) = self.points(second_order);
        Ok((Invariants::from_points(&points)?, outputs))
    }

    fn sample(&self, x: f64) -> Vec<Sample> {
        self.modes.iter().map(|mode| mode(x)).collect()
    }

    fn outputs(&self, running: &[Running]) -> Vec<OutputPoint> {
        let tip = self.breaks[self.breaks.len() - 1];
        let samples = self.sample(tip);
        let mut places = vec![("tip", 0.0)];
        if self.width > 0.0 {
            places.extend([
                ("tip_left", self.width / 2.0),
                ("tip_right", -self.width / 2.0),
            ]);
        }
        let output = |(name, y): (&str, f64)| output_point(name, tip, y, &samples, running);
        places.into_iter().map(output).collect()
    }

    /// The edges of the chord, or the line if there is none, at the ends of `parts` equal parts of the length. First
    /// order.
    pub(crate) fn outline(&self, parts: usize) -> Outline {
        let length = self.breaks[self.breaks.len() - 1];
        let along = |y: f64| {
            (0..=parts).map(move |i| {
                let x = length * i as f64 / parts as f64;
                output_point(&format!("edge{i}"), x, y, &self.sample(x), &[])
            })
        };
        let half = self.width / 2.0;
        let is_surface = half > 0.0;
        Outline {
            points: match is_surface {
                true => along(half).chain(along(-half).rev()).collect(),
                false => along(0.0).collect(),
            },
            is_surface,
        }
    }
}

/// The output point at `x`, `y`, where the modes have `samples`.
fn output_point(
    name: &str,
    x: f64,
    y: f64,
    samples: &[Sample],
    running: &[Running],
) -> OutputPoint {
    let point = mass_point(0.0, x, y, samples, running);
    OutputPoint {
        name: name.to_owned(),
        position: point.position,
        translation: point.psi,
        rotation: samples
            .iter()
            .map(|s| Vector3::new(s.theta.0, -s.w.slope, s.v.slope))
            .collect(),
        chi: point.chi,
    }
}

fn mass_point(mass: f64, x: f64, y: f64, samples: &[Sample], running: &[Running]) -> MassPoint {
    let chi = running.iter().zip(pairs(samples.len()));
    MassPoint {
        mass,
        position: Vector3::new(x, y, 0.0),
        psi: samples
            .iter()
            .map(|s| Vector3::new(0.0, s.v.value, s.w.value + y * s.theta.0))
            .collect(),
        chi: chi
            .map(|(r, (k, l))| r.chi(y, &samples[k], &samples[l]))
            .collect(),
    }
}

/// Running integrals within one piece.
struct Inside {
    /// One list of pairs for each station.
    at_points: Vec<Vec<Running>>,
    /// At the end of the piece.
    at_end: Vec<Running>,
}

fn within(before: &[Running], samples: &[Vec<Sample>], gauss: &Gauss, h: f64) -> Inside {
    let mut inside = Inside {
        at_points: vec![before.to_vec(); POINTS],
        at_end: before.to_vec(),
    };
    let n = samples[0].len();
    for (place, (k, l)) in pairs(n).enumerate() {
        if before.is_empty() {
            break;
        }
        let rates: Vec<[f64; 3]> = samples
            .iter()
            .map(|s| Running::rates(&s[k], &s[l]))
            .collect();
        let integral = |weights: &[f64; POINTS], component: usize| {
            h * weights
                .iter()
                .zip(&rates)
                .map(|(w, r)| w * r[component])
                .sum::<f64>()
        };
        let mut lateral = [0.0; POINTS];
        for ((point, weights), lateral) in inside
            .at_points
            .iter_mut()
            .zip(&gauss.to_point)
            .zip(&mut lateral)
        {
            let running = &mut point[place];
            running.slopes += integral(weights, 0);
            running.chord += integral(weights, 1);
            running.lateral[0] += integral(weights, 2);
            *lateral = running.lateral[0];
        }
        let sum = |weights: &[f64; POINTS]| {
            h * weights.iter().zip(lateral).map(|(w, v)| w * v).sum::<f64>()
        };
        for (point, weights) in inside.at_points.iter_mut().zip(&gauss.to_point) {
            point[place].lateral[1] += sum(weights);
        }
        let end = &mut inside.at_end[place];
        end.slopes += integral(&gauss.weights, 0);
        end.chord += integral(&gauss.weights, 1);
        end.lateral[0] += integral(&gauss.weights, 2);
        end.lateral[1] += sum(&gauss.weights);
    }
    inside
}
