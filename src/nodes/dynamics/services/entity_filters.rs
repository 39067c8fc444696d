//! Filters of entities: by name, category, tags and bounds.

use nalgebra::Vector3;
use regex::Regex;

use crate::{
    msg::simulation_interfaces::{
        Bounds, EntityFilters, EntityInfo, Result as Outcome, TagsFilter,
    },
    nodes::geometry::vector_from_msg,
};

/// Validated filters.
pub struct Filters<'a> {
    name: Option<Regex>,
    filters: &'a EntityFilters,
    bounds: Region,
}

enum Region {
    Everywhere,
    Box(Vector3<f64>, Vector3<f64>),
    Sphere(Vector3<f64>, f64),
}

impl<'a> Filters<'a> {
    /// Validates the filters of a request.
    ///
    /// # Errors
    /// The result code and a line that names the invalid filter.
    pub fn new(filters: &'a EntityFilters) -> Result<Self, Outcome> {
        let name = match filters.filter.as_str() {
            "" => None,
            text => Some(Regex::new(text).map_err(|e| {
                failed(format!(
                    "filter {text:?} is not a regular expression: {}",
                    e.to_string().replace('\n', " ")
                ))
            })?),
        };
        let mode = filters.tags.filter_mode;
        if ![TagsFilter::FILTER_MODE_ANY, TagsFilter::FILTER_MODE_ALL].contains(&mode) {
            return Err(failed(format!(
                "filter_mode of tags is {mode}; give 0 (any) or 1 (all)"
            )));
        }
        Ok(Self {
            name,
            filters,
            bounds: region(&filters.bounds)?,
        })
    }

    /// Whether an entity passes all filters.
    pub fn pass(&self, name: &str, info: &EntityInfo, origin: &Vector3<f64>) -> bool {
        let EntityFilters {
            categories, tags, ..
        } = self.filters;
        let has = |tag: &String| info.tags.contains(tag);
        let tagged = match tags.filter_mode {
            _ if tags.tags.is_empty() => true,
            TagsFilter::FILTER_MODE_ALL => tags.tags.iter().all(has),
            _ => tags.tags.iter().any(has),
        };
        let within = match &self.bounds {
            Region::Everywhere => true,
            Region::Box(low, high) => (0..3).all(|i| (low[i]..=high[i]).contains(&origin[i])),
            Region::Sphere(centre, radius) => (origin - centre).norm() <= *radius,
        };
        self.name.as_ref().is_none_or(|regex| regex.is_match(name))
            && (categories.is_empty() || categories.contains(&info.category))
            && tagged
            && within
    }
}

fn region(bounds: &Bounds) -> Result<Region, Outcome> {
    let points: Vec<_> = bounds.points.iter().map(vector_from_msg).collect();
    match (bounds.r#type, points.as_slice()) {
        (Bounds::TYPE_EMPTY, _) => Ok(Region::Everywhere),
        (Bounds::TYPE_BOX, [a, b]) => Ok(Region::Box(a.inf(b), a.sup(b))),
        (Bounds::TYPE_SPHERE, [centre, radius]) => Ok(Region::Sphere(*centre, radius.x)),
        (Bounds::TYPE_BOX | Bounds::TYPE_SPHERE, _) => Err(failed(format!(
            "bounds have {} points; a box has two corners, a sphere its centre and (radius, 0, 0)",
            points.len()
        ))),
        (kind, _) => Err(Outcome::new(
            Outcome::FEATURE_UNSUPPORTED,
            format!(
                "bounds of type {kind} are not supported; give 0 (none), 1 (box) or 3 (sphere)"
            ),
        )),
    }
}

fn failed(problem: String) -> Outcome {
    Outcome::new(Outcome::OPERATION_FAILED, problem)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::{geometry_msgs, simulation_interfaces::EntityCategory};

    fn passes(filters: &EntityFilters) -> bool {
        let info = EntityInfo {
            category: EntityCategory {
                category: EntityCategory::CATEGORY_DYNAMIC_OBJECT,
            },
            tags: vec!["target".to_owned(), "spawned".to_owned()],
            ..EntityInfo::default()
        };
        let filters = Filters::new(filters).unwrap_or_else(|e| panic!("{}", e.error_message));
        filters.pass("debris_2", &info, &Vector3::new(1.0, 2.0, 3.0))
    }

    fn bounds(kind: u8, points: &[[f64; 3]]) -> EntityFilters {
        let point = |&[x, y, z]: &[f64; 3]| geometry_msgs::Vector3 { x, y, z };
        EntityFilters {
            bounds: Bounds {
                r#type: kind,
                points: points.iter().map(point).collect(),
            },
            ..EntityFilters::default()
        }
    }

    #[test]
    fn an_entity_must_pass_all_filters() {
        let named = |filter: &str| EntityFilters {
            filter: filter.to_owned(),
            ..EntityFilters::default()
        };
        assert!(passes(&EntityFilters::default()));
        assert!(passes(&named("^debris_[0-9]+$")) && !passes(&named("^debris$")));
        let tagged = |tags: &[&str], filter_mode| EntityFilters {
            tags: TagsFilter {
                tags: tags.iter().map(|&t| t.to_owned()).collect(),
                filter_mode,
            },
            ..EntityFilters::default()
        };
        assert!(passes(&tagged(&["robot", "target"], 0)));
        assert!(!passes(&tagged(&["robot", "target"], 1)));
        let category = |category| EntityFilters {
            categories: vec![EntityCategory { category }],
            ..EntityFilters::default()
        };
        assert!(passes(&category(4)) && !passes(&category(1)));
        assert!(passes(&bounds(3, &[[0.0; 3], [4.0, 0.0, 0.0]])));
        assert!(!passes(&bounds(3, &[[0.0; 3], [3.0, 0.0, 0.0]])));
        assert!(passes(&bounds(1, &[[2.0, 3.0, 4.0], [0.0; 3]])));
        assert!(!passes(&bounds(1, &[[2.0, 1.0, 4.0], [0.0; 3]])));
    }

    #[test]
    fn an_invalid_filter_has_its_result_code() {
        let code = |f: &EntityFilters| Filters::new(f).err().map(|e| e.result);
        let hull = bounds(2, &[[0.0; 3]; 4]);
        assert_eq!(code(&hull), Some(Outcome::FEATURE_UNSUPPORTED));
        assert_eq!(
            code(&bounds(1, &[[0.0; 3]])),
            Some(Outcome::OPERATION_FAILED)
        );
        let open = EntityFilters {
            filter: "(".to_owned(),
            ..EntityFilters::default()
        };
        assert_eq!(code(&open), Some(Outcome::OPERATION_FAILED));
    }
}
