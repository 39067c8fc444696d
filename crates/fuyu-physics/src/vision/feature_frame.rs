//! One frame of a feature camera.

/// An image point that is tracked from frame to frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feature {
    /// Identity of the track. A point that was lost may return under another id.
    pub id: u64,
    /// Column \[px\]; pixel centres are at integers.
    pub u: f64,
    /// Row \[px\].
    pub v: f64,
}

/// The features of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FeatureFrame {
    /// Time of the exposure \[s\].
    pub time: f64,
    /// Features sorted by id, each id once. May be empty.
    pub features: Vec<Feature>,
}

impl FeatureFrame {
    /// A frame with `features` in any order.
    pub fn new(time: f64, mut features: Vec<Feature>) -> Self {
        features.sort_by_key(|f| f.id);
        Self { time, features }
    }

    /// The feature `id`, if it is in the frame.
    pub fn feature(&self, id: u64) -> Option<&Feature> {
        let at = self.features.binary_search_by_key(&id, |f| f.id).ok()?;
        Some(&self.features[at])
    }

    /// Pairs of the features that this frame and `other` have in common, sorted by id.
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

    fn frame(ids: &[u64]) -> FeatureFrame {
        let feature = |&id| Feature {
            id,
            u: id as f64,
            v: 0.0,
        };
        FeatureFrame::new(0.0, ids.iter().map(feature).collect())
    }

    #[test]
    fn common_features_are_in_both_frames() {
        let (a, b) = (frame(&[9, 1, 4, 7]), frame(&[2, 4, 5, 9, 11]));
        let ids: Vec<_> = a.common(&b).map(|(x, y)| (x.id, y.id)).collect();
        assert_eq!(ids, [(4, 4), (9, 9)]);
        assert_eq!(a.common(&frame(&[])).count(), 0);
        assert_eq!(b.feature(5).map(|f| f.u), Some(5.0));
        assert_eq!(b.feature(6), None);
    }
}
