//! Dispersions: how the parameters of a run are drawn.

use fuyu_campaign::{
    Covariance, Design, Distribution, compose, on_sphere, rotation_from_vector, rotation_within,
    uniform_rotation,
};

use super::{
    file::{Apply, CorrelatedFile, DispersionFile},
    parameters::{Changes, Parameters, Place, length},
    target::{Target, check_mean},
    values::{current, numbers_of, put_numbers, put_whole},
};
use crate::ros::ParameterValue;

/// Dispersion of one parameter, or of several correlated numbers.
#[derive(Clone)]
pub(super) struct Dispersion {
    /// The parameter or element; for a correlated dispersion, one place per number.
    pub places: Vec<Place>,
    apply: Apply,
    /// Index of its first coordinate in the sampling design.
    first: usize,
    draw: Draw,
}

/// The drawn quantity.
#[derive(Clone)]
pub(super) enum Draw {
    /// The values in turn, each for `stride` successive runs.
    Listed {
        values: Vec<ParameterValue>,
        stride: u64,
    },
    /// One of the values at random.
    Choice(Vec<ParameterValue>),
    /// A number for each element.
    Each(Vec<Distribution>),
    Correlated {
        mean: Vec<f64>,
        covariance: Covariance,
    },
    /// A vector of this length with a random direction, uniform on the sphere.
    Sphere(f64),
    Rotation(Turn),
}

/// A random rotation.
#[derive(Clone, Copy)]
pub(super) enum Turn {
    Uniform,
    /// Random, by at most this angle \[rad\].
    Within(f64),
    /// A rotation vector whose components have this normal distribution \[rad\].
    Normal(Distribution),
}

/// State shared by dispersions while they are built.
#[derive(Default)]
pub(super) struct Building {
    /// Names of the coordinates of the sampling design.
    pub coordinates: Vec<String>,
    /// Name and length of the lists, which advance together.
    pub(super) list: Option<(String, u64)>,
    /// Indices of dispersions that form a grid, with their numbers of values.
    pub(super) grids: Vec<(usize, u64)>,
}

impl Building {
    /// Sets the strides of grids: the last grid varies fastest, after the lists. Returns the number of runs after which
    /// lists and grids repeat.
    pub fn finish(&self, dispersions: &mut [Dispersion]) -> Result<Option<u64>, String> {
        let mut total = self.list.as_ref().map_or(1, |(_, length)| *length);
        for (index, count) in self.grids.iter().rev() {
            if let Draw::Listed { stride, .. } = &mut dispersions[*index].draw {
                *stride = total;
            }
            total = total.checked_mul(*count).filter(|n| *n < 1 << 40).ok_or(
                "the grids have more than 10^12 combinations; use fewer values, or latin_hypercube",
            )?;
        }
        Ok((self.list.is_some() || !self.grids.is_empty()).then_some(total))
    }
}

impl Dispersion {
    /// The dispersion of the parameter `name`.
    ///
    /// # Errors
    /// A line that names the parameter and the allowed form.
    pub fn new(
        name: &str,
        file: &DispersionFile,
        parameters: &Parameters,
        building: &mut Building,
        index: usize,
    ) -> Result<Self, String> {
        let place = parameters.find(name)?;
        let at = |e: String| format!("dispersion of {name}: {e}");
        let target = Target::new(&place, parameters);
        let kind = target.kind(file).map_err(at)?;
        let first = building.coordinates.len();
        let draw = target.draw(kind, file, name, building, index).map_err(at)?;
        target.check(&draw, file.apply).map_err(at)?;
        let drawn = draw.dimensions();
        let own = (0..drawn).map(|i| match drawn {
            1 => name.to_owned(),
            _ => format!("{name}[{i}]"),
        });
        building.coordinates.extend(own);
        Ok(Self {
            places: vec![place],
            apply: file.apply,
            first,
            draw,
        })
    }

    /// The dispersion of several numbers with a covariance.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn correlated(
        file: &CorrelatedFile,
        parameters: &Parameters,
        building: &mut Building,
    ) -> Result<Self, String> {
        let at = |e: String| format!("correlated {}: {e}", file.parameters.join(", "));
        let n = file.parameters.len();
        let covariance = Covariance::new(&file.covariance).map_err(|e| at(e.to_string()))?;
        if covariance.dimensions() != n {
            let rows = covariance.dimensions();
            return Err(at(format!("covariance has {rows} rows for {n} parameters")));
        }
        let mean = file.mean.clone().unwrap_or_else(|| vec![0.0; n]);
        check_mean(&mean, n).map_err(at)?;
        let places = file.parameters.iter().map(|name| {
            let place = parameters.find(name)?;
            match (parameters.nominal(&place), place.element) {
                (ParameterValue::Double(_), _) | (ParameterValue::DoubleArray(_), Some(_)) => {
                    Ok(place)
                }
                (value, _) => Err(at(format!(
                    "{name} is {}; give doubles, or elements as in {name}[0]",
                    value.kind()
                ))),
            }
        });
        let places = places.collect::<Result<Vec<_>, String>>()?;
        let first = building.coordinates.len();
        building.coordinates.extend(file.parameters.iter().cloned());
        Ok(Self {
            places,
            apply: file.apply,
            first,
            draw: Draw::Correlated { mean, covariance },
        })
    }

    /// Number of elements of a whole list after the change; `None` for anything else.
    pub fn length(&self, parameters: &Parameters) -> Option<usize> {
        let place = &self.places[0];
        if place.element.is_some() || self.places.len() > 1 {
            return None;
        }
        let nominal = length(parameters.nominal(place))?;
        Some(match &self.draw {
            Draw::Listed { values, .. } | Draw::Choice(values) => {
                values.first().and_then(length).unwrap_or(nominal)
            }
            Draw::Each(all) => all.len(),
            Draw::Correlated { mean, .. } => mean.len(),
            Draw::Sphere(_) => 3,
            Draw::Rotation(_) => 4,
        })
    }

    /// Draws the values for a run, and records the changed parameters.
    pub fn change(
        &self,
        run: u64,
        design: &Design,
        parameters: &Parameters,
        changes: &mut Changes,
    ) {
        let u = |k: usize| design.coordinate(run, self.first + k);
        let numbers: Vec<f64> = match &self.draw {
            Draw::Listed { values, stride } => {
                let at = (run / stride) % values.len() as u64;
                return self.put_value(&values[at as usize], parameters, changes);
            }
            Draw::Choice(values) => {
                let at = (u(0) * values.len() as f64) as usize;
                let value = &values[at.min(values.len() - 1)];
                return self.put_value(value, parameters, changes);
            }
            Draw::Each(all) => (all.iter().enumerate())
                .map(|(k, d)| d.quantile(u(k)))
                .collect(),
            Draw::Correlated { mean, covariance } => {
                let numbers: Vec<_> = (0..mean.len()).map(u).collect();
                let deviations = covariance.deviations(&numbers);
                mean.iter().zip(deviations).map(|(m, d)| m + d).collect()
            }
            Draw::Sphere(radius) => on_sphere([u(0), u(1)]).map(|x| radius * x).to_vec(),
            Draw::Rotation(turn) => {
                let u = [u(0), u(1), u(2)];
                let drawn = match turn {
                    Turn::Uniform => uniform_rotation(u),
                    Turn::Within(largest) => rotation_within(u, *largest),
                    Turn::Normal(normal) => rotation_from_vector(u.map(|u| normal.quantile(u))),
                };
                let value = current(&self.places[0], parameters, changes);
                if let (Apply::Add, ParameterValue::DoubleArray(v)) = (self.apply, &*value)
                    && let Ok(nominal) = <[f64; 4]>::try_from(v.as_slice())
                {
                    *value = ParameterValue::DoubleArray(compose(nominal, drawn).to_vec());
                } else {
                    *value = ParameterValue::DoubleArray(drawn.to_vec());
                }
                return;
            }
        };
        if self.places.len() > 1 {
            for (place, number) in self.places.iter().zip(numbers) {
                put_numbers(place, &[number], self.apply, parameters, changes);
            }
        } else {
            put_numbers(&self.places[0], &numbers, self.apply, parameters, changes);
        }
    }

    /// Applies a listed value, which fits the parameter.
    fn put_value(&self, value: &ParameterValue, parameters: &Parameters, changes: &mut Changes) {
        let place = &self.places[0];
        match (self.apply, numbers_of(value)) {
            (Apply::Add | Apply::Scale, Some(numbers)) => {
                put_numbers(place, &numbers, self.apply, parameters, changes);
            }
            _ => put_whole(place, value, parameters, changes),
        }
    }
}

impl Draw {
    /// Number of coordinates of the sampling design that it needs.
    fn dimensions(&self) -> usize {
        match self {
            Self::Listed { .. } => 0,
            Self::Choice(_) => 1,
            Self::Each(all) => all.len(),
            Self::Correlated { mean, .. } => mean.len(),
            Self::Sphere(_) => 2,
            Self::Rotation(_) => 3,
        }
    }
}
