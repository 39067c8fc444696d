//! Collision shapes: the `<collision>` elements of a robot description.

use nalgebra::Vector3;
use roxmltree::Node;

use super::document::{Checked, Source, version, without_surroundings};
use super::error::{UrdfError, UrdfProblem};
use crate::spatial::Pose;

/// A `<collision>` of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct CollisionElement {
    /// The link.
    pub link: String,
    /// Its name, if given.
    pub name: Option<String>,
    /// Pose of the shape's frame in the link.
    pub X_LC: Pose,
    /// The shape.
    pub geometry: CollisionGeometry,
}

/// The shape of a [`CollisionElement`].
#[derive(Debug, Clone, PartialEq)]
pub enum CollisionGeometry {
    /// A box with these edges \[m\].
    Box {
        /// Edges.
        size: Vector3<f64>,
    },
    /// A sphere.
    Sphere {
        /// Radius \[m\].
        radius: f64,
    },
    /// A cylinder about z.
    Cylinder {
        /// Radius \[m\].
        radius: f64,
        /// Length \[m\].
        length: f64,
    },
    /// A cylinder about z with half spheres at its ends.
    Capsule {
        /// Radius \[m\].
        radius: f64,
        /// Length without the half spheres \[m\].
        length: f64,
    },
    /// A mesh in a file, of which physics uses the convex hull.
    Mesh {
        /// Path or URL, as in the description.
        filename: String,
        /// Scale factors of the coordinates.
        scale: Vector3<f64>,
    },
}

impl CollisionElement {
    /// All `<collision>` elements of the robot description `xml`; `source` names it in messages. Links and joints are
    /// not checked here, but by [`Model::from_urdf`](crate::model::Model::from_urdf) or
    /// [`Model::repaired_from_urdf`](crate::model::Model::repaired_from_urdf). An element with several shapes gives
    /// several entries.
    ///
    /// # Errors
    /// [`UrdfError`] for a length that is not positive, and for text that is not a number.
    ///
    /// ```
    /// use fuyu_physics::model::{CollisionElement, CollisionGeometry};
    /// let xml = r#"<robot name="ball"><link name="base"><collision><origin xyz="0 0 1"/>
    /// <geometry><sphere radius="0.2"/></geometry></collision></link></robot>"#;
    /// let found = CollisionElement::all_from_urdf(xml, "ball.urdf")?;
    /// assert_eq!(found[0].geometry, CollisionGeometry::Sphere { radius: 0.2 });
    /// assert_eq!((found[0].link.as_str(), found[0].X_LC.translation.z), ("base", 1.0));
    /// # Ok::<(), fuyu_physics::model::UrdfError>(())
    /// ```
    pub fn all_from_urdf(xml: &str, source: &str) -> Result<Vec<Self>, UrdfError> {
        let text = without_surroundings(xml);
        let source = Source::parse(&text, source, true)?;
        let robot = source.robot()?;
        let version = version(robot);
        let mut found = Vec::new();
        let named = |n: &Node, tag: &str| n.is_element() && n.tag_name().name() == tag;
        for link in robot.children().filter(|n| named(n, "link")) {
            let name = link.attribute("name").unwrap_or_default();
            for collision in link.children().filter(|n| named(n, "collision")) {
                let X_LC = source.origin(collision, version)?;
                let geometries = collision.children().filter(|n| named(n, "geometry"));
                for shape in geometries
                    .flat_map(|g| g.children())
                    .filter(Node::is_element)
                {
                    let Some(geometry) = source.shape(shape)? else {
                        continue;
                    };
                    found.push(Self {
                        link: name.to_owned(),
                        name: collision.attribute("name").map(str::to_owned),
                        X_LC,
                        geometry,
                    });
                }
            }
        }
        Ok(found)
    }
}

impl Source<'_> {
    /// The shape of an element; `None` if the shape is unknown.
    fn shape(&self, shape: Node) -> Checked<Option<CollisionGeometry>> {
        let length = |attribute, missing| self.positive(shape, attribute, missing);
        let radius = || length("radius", "attribute 'radius'");
        Ok(Some(match shape.tag_name().name() {
            "box" => {
                self.required(shape, "size", "attribute 'size'")?;
                let size = self
                    .numbers::<3>(shape, "size", "three positive numbers")?
                    .unwrap_or_default();
                if !size.iter().all(|edge| *edge > 0.0) {
                    return Err(self.not_positive(shape, "size", "three positive numbers"));
                }
                CollisionGeometry::Box { size: size.into() }
            }
            "sphere" => CollisionGeometry::Sphere { radius: radius()? },
            "cylinder" => CollisionGeometry::Cylinder {
                radius: radius()?,
                length: length("length", "attribute 'length'")?,
            },
            "capsule" => CollisionGeometry::Capsule {
                radius: radius()?,
                length: length("length", "attribute 'length'")?,
            },
            "mesh" => {
                let filename = self
                    .required(shape, "filename", "attribute 'filename'")?
                    .to_owned();
                let scale = self.numbers::<3>(shape, "scale", "three finite numbers")?;
                CollisionGeometry::Mesh {
                    filename,
                    scale: scale.unwrap_or([1.0; 3]).into(),
                }
            }
            _ => return Ok(None),
        }))
    }

    fn positive(&self, node: Node, attribute: &str, missing: &'static str) -> Checked<f64> {
        let value = self.required_number(node, attribute, missing)?;
        if value > 0.0 {
            return Ok(value);
        }
        Err(self.not_positive(node, attribute, "a positive number"))
    }

    fn not_positive(&self, node: Node, attribute: &str, wanted: &'static str) -> UrdfError {
        let problem = UrdfProblem::Number {
            element: node.tag_name().name().to_owned(),
            attribute: attribute.to_owned(),
            value: node.attribute(attribute).unwrap_or_default().to_owned(),
            wanted,
        };
        self.error(node, problem)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(geometry: &str) -> Result<Vec<CollisionElement>, UrdfError> {
        let xml = format!(
            r#"<robot name="r"><link name="a"><collision name="c"><geometry>{geometry}</geometry></collision></link></robot>"#
        );
        CollisionElement::all_from_urdf(&xml, "r.urdf")
    }

    #[test]
    fn all_shapes_are_read() {
        for (text, geometry) in [
            (
                r#"<box size="1 2 3"/>"#,
                CollisionGeometry::Box {
                    size: Vector3::new(1.0, 2.0, 3.0),
                },
            ),
            (
                r#"<cylinder radius="0.1" length="2"/>"#,
                CollisionGeometry::Cylinder {
                    radius: 0.1,
                    length: 2.0,
                },
            ),
            (
                r#"<capsule radius="0.1" length="2"/>"#,
                CollisionGeometry::Capsule {
                    radius: 0.1,
                    length: 2.0,
                },
            ),
            (
                r#"<mesh filename="package://r/a.stl" scale="0.001 0.001 0.001"/>"#,
                CollisionGeometry::Mesh {
                    filename: "package://r/a.stl".to_owned(),
                    scale: Vector3::repeat(1e-3),
                },
            ),
        ] {
            let found = read(text).unwrap();
            assert_eq!(
                (found.len(), &found[0].geometry, found[0].name.as_deref()),
                (1, &geometry, Some("c"))
            );
        }
        assert_eq!(read("<cone/>"), Ok(vec![]));
    }

    #[test]
    fn lengths_that_are_not_positive_are_named() {
        let message = read(r#"<box size="1 0 3"/>"#).unwrap_err().to_string();
        assert!(message.starts_with("r.urdf:1: link 'a': "), "{message}");
        assert!(
            message.contains("size")
                && message.contains("1 0 3")
                && message.contains("three positive numbers"),
            "{message}"
        );
        let message = read(r#"<sphere radius="-1"/>"#).unwrap_err().to_string();
        assert!(
            message.contains("radius") && message.contains("-1"),
            "{message}"
        );
    }
}
