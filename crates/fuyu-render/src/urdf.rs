//! Visual elements of a URDF.

use std::collections::HashMap;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use roxmltree::{Document, Node};

use crate::{Material, Mesh, from_srgb, primitives};

/// A `<visual>` of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct Visual {
    /// The link.
    pub link: String,
    /// Where it is in the link's frame.
    pub origin: Isometry3<f64>,
    /// Its shape.
    pub geometry: Geometry,
    /// Its colour, red, green, blue, linear; none if the URDF has none, or if it is a mesh's own.
    pub colour: Option<[f32; 3]>,
    /// File of its texture.
    pub texture: Option<String>,
}

/// The shape of a [`Visual`]; lengths in metres.
#[derive(Debug, Clone, PartialEq)]
pub enum Geometry {
    /// A box with these edge lengths.
    Box(Vector3<f64>),
    /// A cylinder about z.
    Cylinder {
        /// Its radius.
        radius: f64,
        /// Its length.
        length: f64,
    },
    /// A sphere of this radius.
    Sphere(f64),
    /// The mesh in a file.
    Mesh {
        /// Name of the file.
        file: String,
        /// Factors along its axes.
        scale: Vector3<f64>,
    },
}

impl Visual {
    /// The surface, without its texture; grey without a colour.
    pub fn material(&self) -> Material {
        Material::diffuse(self.colour.unwrap_or([0.6; 3]))
    }

    /// The mesh of a box, cylinder or sphere; `None` for a file.
    pub fn primitive(&self, material: Material) -> Option<Mesh> {
        match &self.geometry {
            Geometry::Box(size) => Some(primitives::cuboid(*size, material)),
            Geometry::Cylinder { radius, length } => {
                Some(primitives::cylinder(*radius, *length, material))
            }
            Geometry::Sphere(radius) => Some(primitives::sphere(*radius, material)),
            Geometry::Mesh { .. } => None,
        }
    }
}

/// The visual elements of all links.
///
/// # Errors
/// A line that names the link and what is wrong with its visual element.
pub fn visuals(xml: &str) -> Result<Vec<Visual>, String> {
    let document = Document::parse(xml).map_err(|e| e.to_string())?;
    let robot = document.root_element();
    let named: HashMap<&str, Node> = (elements(robot, "material"))
        .filter_map(|material| Some((material.attribute("name")?, material)))
        .collect();
    let mut visuals = Vec::new();
    for link in elements(robot, "link") {
        let name = link.attribute("name").unwrap_or_default();
        for visual in elements(link, "visual") {
            let read = read(name, visual, &named);
            visuals.push(read.map_err(|e| format!("visual of link '{name}': {e}"))?);
        }
    }
    Ok(visuals)
}

fn elements<'a, 'd: 'a>(node: Node<'a, 'd>, name: &'a str) -> impl Iterator<Item = Node<'a, 'd>> {
    node.children().filter(move |n| n.has_tag_name(name))
}

fn element<'a, 'd: 'a>(node: Node<'a, 'd>, name: &'a str) -> Option<Node<'a, 'd>> {
    elements(node, name).next()
}

fn read(link: &str, visual: Node, named: &HashMap<&str, Node>) -> Result<Visual, String> {
    let geometry = element(visual, "geometry").ok_or("has no <geometry>")?;
    let shape = geometry.children().find(Node::is_element);
    let shape = shape.ok_or("<geometry> is empty")?;
    let origin = match element(visual, "origin") {
        None => Isometry3::identity(),
        Some(origin) => {
            let of = |name| vector(&origin, name, Vector3::zeros());
            let (xyz, rpy) = (of("xyz")?, of("rpy")?);
            let rotation = UnitQuaternion::from_euler_angles(rpy.x, rpy.y, rpy.z);
            Isometry3::from_parts(Translation3::from(xyz), rotation)
        }
    };
    let material = element(visual, "material");
    // A material with a name only is one of the robot's.
    let material = material.map(
        |material| match material.children().any(|n| n.is_element()) {
            true => material,
            false => {
                let known = material.attribute("name").and_then(|name| named.get(name));
                known.copied().unwrap_or(material)
            }
        },
    );
    let colour = match material.and_then(|m| element(m, "color")) {
        None => None,
        Some(colour) => Some(rgb(&colour)?),
    };
    let texture = material.and_then(|m| element(m, "texture"));
    let texture = texture.and_then(|t| t.attribute("filename"));
    Ok(Visual {
        link: link.to_owned(),
        origin,
        geometry: shape_of(&shape)?,
        colour,
        texture: texture.map(str::to_owned),
    })
}

fn shape_of(shape: &Node) -> Result<Geometry, String> {
    let length = |name: &str| {
        let text = shape.attribute(name).unwrap_or_default();
        let value: Option<f64> = text.trim().parse().ok();
        let value = value.filter(|x| x.is_finite() && *x > 0.0 && *x <= 1e6);
        let tag = shape.tag_name().name();
        value.ok_or_else(|| format!("<{tag}> has {name}=\"{text}\"; expected a length in m"))
    };
    match shape.tag_name().name() {
        "box" => {
            let size = vector(shape, "size", Vector3::zeros())?;
            match size.iter().all(|x| *x > 0.0 && *x <= 1e6) {
                true => Ok(Geometry::Box(size)),
                false => Err("<box> must have three positive lengths in m as its size".to_owned()),
            }
        }
        "cylinder" => Ok(Geometry::Cylinder {
            radius: length("radius")?,
            length: length("length")?,
        }),
        "sphere" => Ok(Geometry::Sphere(length("radius")?)),
        "mesh" => Ok(Geometry::Mesh {
            file: (shape.attribute("filename").filter(|f| !f.is_empty()))
                .ok_or("<mesh> has no filename")?
                .to_owned(),
            scale: vector(shape, "scale", Vector3::repeat(1.0))?,
        }),
        other => Err(format!(
            "<{other}> is no shape; expected box, cylinder, sphere or mesh"
        )),
    }
}

fn numbers(node: &Node, name: &str) -> Result<Option<Vec<f64>>, String> {
    let Some(text) = node.attribute(name) else {
        return Ok(None);
    };
    let values: Option<Vec<f64>> = (text.split_ascii_whitespace())
        .map(|word| word.parse().ok().filter(|x: &f64| x.is_finite()))
        .collect();
    let tag = node.tag_name().name();
    let values =
        values.ok_or_else(|| format!("<{tag}> has {name}=\"{text}\"; expected numbers"))?;
    Ok(Some(values))
}

fn vector(node: &Node, name: &str, default: Vector3<f64>) -> Result<Vector3<f64>, String> {
    let Some(values) = numbers(node, name)? else {
        return Ok(default);
    };
    match values[..] {
        [x, y, z] => Ok(Vector3::new(x, y, z)),
        _ => Err(format!(
            "<{}> has {} numbers in {name}; expected 3",
            node.tag_name().name(),
            values.len()
        )),
    }
}

fn rgb(colour: &Node) -> Result<[f32; 3], String> {
    let values = numbers(colour, "rgba")?.unwrap_or_default();
    match values[..] {
        [r, g, b, _] => Ok([r, g, b].map(|x| from_srgb(x as f32))),
        _ => Err(format!(
            "<color> has {} numbers in rgba; expected 4",
            values.len()
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROBOT: &str = r#"<robot name="r">
      <material name="red"><color rgba="1 0 0 1"/></material>
      <link name="a">
        <visual><origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>
          <geometry><box size="1 2 3"/></geometry><material name="red"/></visual>
        <visual><geometry><mesh filename="package://p/m.stl" scale="0.001 0.001 0.001"/></geometry>
          <material name="own"><texture filename="t.png"/></material></visual>
      </link>
      <link name="b"><visual><geometry><cylinder radius="0.1" length="2"/></geometry></visual>
        <visual><geometry><sphere radius="0.5"/></geometry></visual></link>
    </robot>"#;

    #[test]
    fn visuals_have_shapes_places_and_colours() {
        let visuals = visuals(ROBOT).unwrap();
        assert_eq!(visuals.len(), 4);
        assert_eq!(visuals[0].colour, Some([1.0, 0.0, 0.0]));
        assert_eq!(
            visuals[0].geometry,
            Geometry::Box(Vector3::new(1.0, 2.0, 3.0))
        );
        let moved = visuals[0].origin * nalgebra::Point3::new(1.0, 0.0, 0.0);
        assert!((moved.coords - Vector3::new(1.0, 3.0, 3.0)).norm() < 1e-12);
        assert_eq!(visuals[1].texture.as_deref(), Some("t.png"));
        let Geometry::Mesh { file, scale } = &visuals[1].geometry else {
            panic!("{:?}", visuals[1]);
        };
        assert_eq!((file.as_str(), scale.x), ("package://p/m.stl", 0.001));
        assert_eq!(visuals[2].link, "b");
        assert_eq!(visuals[3].geometry, Geometry::Sphere(0.5));
    }

    #[test]
    fn wrong_visuals_are_refused_with_their_link() {
        let refused = |from: &str, to: &str| visuals(&ROBOT.replace(from, to)).unwrap_err();
        let text = refused("radius=\"0.5\"", "radius=\"-1\"");
        assert!(
            text.contains("link 'b'") && text.contains("radius=\"-1\""),
            "{text}"
        );
        assert!(refused("size=\"1 2 3\"", "size=\"1 2\"").contains("2 numbers"));
        assert!(refused("rgba=\"1 0 0 1\"", "rgba=\"x\"").contains("expected numbers"));
        assert!(refused("<sphere radius=\"0.5\"/>", "<cone/>").contains("<cone> is no shape"));
    }
}
