//! What one frame of a feature camera shows.

/// An image point with an identity that lasts while it is tracked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feature {
    /// Which point it is. A point that was lost may come back under another id.
    pub id: u64,
    /// Column \[px\]; pixel centres are at integers.
    pub u: f64,
    /// Row \[px\].
    pub v: f64,
}

/// The features of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Sighting {
    /// When the frame was exposed \[s\].
    pub time: f64,
    /// What was seen, sorted by id; none is there twice. May be empty.
    pub features: Vec<Feature>,
}

impl Sighting {
    /// A sighting of features in any order.
    pub fn new(time: f64, mut features: Vec<Feature>) -> Self {
        features.sort_by_key(|f| f.id);
        Self { time, features }
    }

    /// The feature `id`, if it was seen.
    pub fn feature(&self, id: u64) -> Option<&Feature> {
        let at = self.features.binary_search_by_key(&id, |f| f.id).ok()?;
        Some(&self.features[at])
    }

    /// The features that this frame and `other` share, in the order of their ids.
    pub fn common<'a>(
        &'a self,
        other: &'a Self,
    ) -> impl Iterator<Item = (&'a Feature, &'a Feature)> + 'a {
        let mut rest = other.features.as_slice();
        self.features.iter().filter_map(move |a| {
            let skip = rest.iter().take_while(|b| b.id < a.id).count();
            rest = &rest[skip..];
            rest.first().filter(|b| b.id == a.id).map(|b| (a, b))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sighting(ids: &[u64]) -> Sighting {
        let feature = |&id| Feature {
            id,
            u: id as f64,
            v: 0.0,
        };
        Sighting::new(0.0, ids.iter().map(feature).collect())
    }

    #[test]
    fn common_features_are_those_of_both() {
        let (a, b) = (sighting(&[9, 1, 4, 7]), sighting(&[2, 4, 5, 9, 11]));
        let ids: Vec<_> = a.common(&b).map(|(x, y)| (x.id, y.id)).collect();
        assert_eq!(ids, [(4, 4), (9, 9)]);
        assert_eq!(a.common(&sighting(&[])).count(), 0);
        assert_eq!(b.feature(5).map(|f| f.u), Some(5.0));
        assert_eq!(b.feature(6), None);
    }
}
