//! COLLADA 1.4 and 1.5: geometry, its place in the visual scene, diffuse colours and textures.

use std::collections::HashMap;

use nalgebra::{Matrix4, Point3, Rotation3, Unit, Vector3};
use roxmltree::{Document, Node, ParsingOptions};

use super::{Resolve, texture_file};
use crate::{Material, MeshData};

/// Deepest tree of nodes.
const DEEPEST: usize = 32;
/// Most nodes, each counted as often as others repeat it.
const MOST_NODES: usize = 100_000;

/// Reads the visual scene of a COLLADA file, or all its geometry if it has none.
pub(super) fn read(bytes: &[u8], resolve: &mut Resolve) -> Result<MeshData, String> {
    let text = std::str::from_utf8(bytes).map_err(|_| "is not UTF-8 text")?;
    let options = ParsingOptions {
        nodes_limit: 10_000_000,
        ..ParsingOptions::default()
    };
    let document = Document::parse_with_options(text.trim_start_matches('\u{feff}'), options)
        .map_err(|e| format!("cannot be read as COLLADA: {e}"))?;
    let root = document.root_element();
    if root.tag_name().name() != "COLLADA" {
        return Err(format!(
            "is not COLLADA: its root is <{}>",
            root.tag_name().name()
        ));
    }
    let by_id: HashMap<&str, Node> = (root.descendants())
        .filter_map(|node| Some((node.attribute("id")?, node)))
        .collect();
    let unit = find(root, "asset").and_then(|asset| find(asset, "unit"));
    let metre = unit.and_then(|unit| unit.attribute("meter"));
    let metre: f64 = match metre {
        None => 1.0,
        Some(text) => (text.trim().parse().ok())
            .filter(|m: &f64| m.is_finite() && *m > 0.0)
            .ok_or_else(|| format!("unit meter=\"{text}\" is not a positive number"))?,
    };
    let mut reader = Reader {
        by_id,
        resolve,
        whole: MeshData::default(),
        visited: 0,
    };
    let scale = Matrix4::new_scaling(metre);
    let scene = find(root, "scene").and_then(|scene| find(scene, "instance_visual_scene"));
    match scene {
        Some(instance) => {
            let scene = reader.target(&instance)?;
            for node in children(scene, "node") {
                reader.node(node, &scale, 0)?;
            }
        }
        None => {
            for geometry in root
                .descendants()
                .filter(|n| n.has_tag_name_local("geometry"))
            {
                reader.geometry(geometry, &scale, &HashMap::new())?;
            }
        }
    }
    Ok(reader.whole)
}

/// Names without their namespace.
trait LocalName {
    fn has_tag_name_local(&self, name: &str) -> bool;
}

impl LocalName for Node<'_, '_> {
    fn has_tag_name_local(&self, name: &str) -> bool {
        self.is_element() && self.tag_name().name() == name
    }
}

fn children<'a, 'd: 'a>(node: Node<'a, 'd>, name: &'a str) -> impl Iterator<Item = Node<'a, 'd>> {
    node.children().filter(move |n| n.has_tag_name_local(name))
}

fn find<'a, 'd: 'a>(node: Node<'a, 'd>, name: &str) -> Option<Node<'a, 'd>> {
    node.children().find(|n| n.has_tag_name_local(name))
}

fn numbers<T: std::str::FromStr>(node: &Node) -> Result<Vec<T>, String> {
    // Text may be split by comments.
    let texts = node.children().filter_map(|child| child.text());
    let mut all = Vec::new();
    for text in texts {
        for word in text.split_ascii_whitespace() {
            let name = node.tag_name().name();
            all.push(
                word.parse()
                    .map_err(|_| format!("<{name}> contains '{word}'"))?,
            );
        }
    }
    Ok(all)
}

struct Reader<'a, 'd, 'r, 'f> {
    by_id: HashMap<&'a str, Node<'a, 'd>>,
    resolve: &'r mut Resolve<'f>,
    whole: MeshData,
    /// Number of nodes so far; one may be repeated by several others.
    visited: usize,
}

/// Numbers with how many belong together.
struct Values {
    numbers: Vec<f32>,
    stride: usize,
}

impl Values {
    fn get<const N: usize>(&self, index: usize) -> Result<[f32; N], String> {
        let start = index.checked_mul(self.stride);
        let values = start.and_then(|start| self.numbers.get(start..start + N));
        let values = values.and_then(|v| v.try_into().ok());
        values.ok_or_else(|| format!("index {index} is beyond the end of its source"))
    }
}

/// Where the indices of one vertex in `<p>` lead.
#[derive(Default)]
struct Inputs {
    position: Option<(usize, Values)>,
    normal: Option<(usize, Values)>,
    uv: Option<(usize, Values)>,
    /// Indices per vertex.
    count: usize,
}

impl<'a, 'd> Reader<'a, 'd, '_, '_> {
    /// The element that `url` or `source` of an element names.
    fn target(&self, node: &Node) -> Result<Node<'a, 'd>, String> {
        let url = ["url", "source", "target"]
            .iter()
            .find_map(|a| node.attribute(*a));
        let name = node.tag_name().name();
        let url = url.ok_or_else(|| format!("<{name}> has no url"))?;
        let found = url.strip_prefix('#').and_then(|id| self.by_id.get(id));
        (found.copied()).ok_or_else(|| format!("<{name}> names {url}, which is not in the file"))
    }

    fn node(
        &mut self,
        node: Node<'a, 'd>,
        parent: &Matrix4<f64>,
        depth: usize,
    ) -> Result<(), String> {
        if depth > DEEPEST {
            return Err(format!("nodes are nested more than {DEEPEST} deep"));
        }
        self.visited += 1;
        if self.visited > MOST_NODES {
            return Err(format!(
                "has more than {MOST_NODES} nodes, repeated ones included"
            ));
        }
        let mut X = *parent;
        for child in node.children().filter(Node::is_element) {
            if let Some(transform) = transform(&child)? {
                X *= transform;
            }
        }
        for child in node.children().filter(Node::is_element) {
            match child.tag_name().name() {
                "node" => self.node(child, &X, depth + 1)?,
                "instance_node" => {
                    let target = self.target(&child)?;
                    self.node(target, &X, depth + 1)?;
                }
                "instance_geometry" => {
                    let geometry = self.target(&child)?;
                    let bound = child.descendants();
                    let bound = bound.filter(|n| n.has_tag_name_local("instance_material"));
                    let mut materials = HashMap::new();
                    for instance in bound {
                        let symbol = instance.attribute("symbol").unwrap_or_default();
                        materials.insert(symbol, self.target(&instance)?);
                    }
                    self.geometry(geometry, &X, &materials)?;
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn geometry(
        &mut self,
        geometry: Node<'a, 'd>,
        X: &Matrix4<f64>,
        materials: &HashMap<&'a str, Node<'a, 'd>>,
    ) -> Result<(), String> {
        // Splines and convex hulls have no triangles.
        let Some(mesh) = find(geometry, "mesh") else {
            return Ok(());
        };
        for primitive in mesh.children().filter(Node::is_element) {
            let kind = primitive.tag_name().name();
            let kinds = ["triangles", "polylist", "polygons", "trifans", "tristrips"];
            if !kinds.contains(&kind) {
                continue;
            }
            let symbol = primitive.attribute("material").unwrap_or_default();
            let material = match materials.get(symbol) {
                Some(material) => self.material(*material)?,
                None => Material::grey(0.6),
            };
            let part = self.primitive(primitive, kind, material)?;
            self.append(part, X);
        }
        Ok(())
    }

    fn append(&mut self, mut part: MeshData, X: &Matrix4<f64>) {
        for p in &mut part.positions {
            let moved = X.transform_point(&Point3::from(p.map(f64::from)));
            *p = [moved.x as f32, moved.y as f32, moved.z as f32];
        }
        let linear = X.fixed_view::<3, 3>(0, 0).into_owned();
        match linear.try_inverse() {
            Some(inverse) => {
                for n in &mut part.normals {
                    let moved = inverse.transpose() * Vector3::from(n.map(f64::from));
                    let unit = moved.try_normalize(0.0).unwrap_or_default();
                    *n = [unit.x as f32, unit.y as f32, unit.z as f32];
                }
            }
            None => part.normals.clear(),
        }
        if linear.determinant() < 0.0 {
            part.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        self.whole.append(part);
    }

    fn primitive(
        &self,
        primitive: Node<'a, 'd>,
        kind: &str,
        material: Material,
    ) -> Result<MeshData, String> {
        let inputs = self.inputs(primitive)?;
        let mut part = MeshData {
            materials: vec![material],
            ..MeshData::default()
        };
        let counts = match find(primitive, "vcount") {
            Some(counts) => Some(numbers::<usize>(&counts)?),
            None => None,
        };
        // A polygon with holes is drawn without them.
        let lists = primitive
            .children()
            .filter_map(|n| match n.tag_name().name() {
                "p" => Some(n),
                "ph" => find(n, "p"),
                _ => None,
            });
        for list in lists {
            let indices: Vec<usize> = numbers(&list)?;
            let mut corners = Vec::with_capacity(indices.len() / inputs.count);
            for vertex in indices.chunks_exact(inputs.count) {
                corners.push(part.positions.len() as u32);
                inputs.add(vertex, &mut part)?;
            }
            match (kind, &counts) {
                ("triangles", _) => part.triangles.extend(corners.as_chunks::<3>().0),
                ("polylist", Some(counts)) => {
                    let mut rest = corners.as_slice();
                    for count in counts {
                        let polygon = rest.split_at_checked(*count);
                        let (polygon, after) = polygon.ok_or("<vcount> is longer than <p>")?;
                        part.triangles.extend(super::fan(polygon));
                        rest = after;
                    }
                }
                ("polylist", None) => return Err("<polylist> has no <vcount>".to_owned()),
                ("tristrips", _) => {
                    let strip = corners.windows(3).enumerate();
                    part.triangles.extend(strip.map(|(k, t)| match k % 2 {
                        0 => [t[0], t[1], t[2]],
                        _ => [t[1], t[0], t[2]],
                    }));
                }
                _ => part.triangles.extend(super::fan(&corners)),
            }
        }
        Ok(part)
    }

    fn inputs(&self, primitive: Node<'a, 'd>) -> Result<Inputs, String> {
        let mut inputs = Inputs::default();
        for input in children(primitive, "input") {
            let offset = input.attribute("offset").unwrap_or("0");
            let offset: usize = (offset.parse().ok())
                .filter(|o| *o < 64)
                .ok_or_else(|| format!("<input> has the offset '{offset}'"))?;
            inputs.count = inputs.count.max(offset + 1);
            let target = self.target(&input)?;
            match input.attribute("semantic") {
                Some("VERTEX") => {
                    for vertex in children(target, "input") {
                        let source = self.target(&vertex)?;
                        inputs.set(vertex.attribute("semantic"), offset, &source, self)?;
                    }
                }
                semantic => inputs.set(semantic, offset, &target, self)?,
            }
        }
        if inputs.position.is_none() {
            return Err(format!(
                "<{}> has no positions",
                primitive.tag_name().name()
            ));
        }
        Ok(inputs)
    }

    fn values(&self, source: &Node<'a, 'd>, least: usize) -> Result<Values, String> {
        let accessor = source
            .descendants()
            .find(|n| n.has_tag_name_local("accessor"));
        let accessor = accessor.ok_or("a <source> has no <accessor>")?;
        let array = self.target(&accessor)?;
        let stride = accessor.attribute("stride").unwrap_or("1");
        let stride = stride.parse().unwrap_or(0);
        if stride < least {
            return Err(format!(
                "an <accessor> has the stride {stride}; expected {least}"
            ));
        }
        Ok(Values {
            numbers: numbers(&array)?,
            stride,
        })
    }

    /// The surface that a `<material>` describes.
    fn material(&mut self, material: Node<'a, 'd>) -> Result<Material, String> {
        let instance = find(material, "instance_effect");
        let instance = instance.ok_or("a <material> has no <instance_effect>")?;
        let effect = self.target(&instance)?;
        let part = |name: &str| effect.descendants().find(|n| n.has_tag_name_local(name));
        let mut surface = Material::grey(0.6);
        let Some(diffuse) = part("diffuse") else {
            return Ok(surface);
        };
        if let Some(colour) = find(diffuse, "color") {
            if let [r, g, b, ..] = numbers::<f32>(&colour)?[..] {
                surface = Material::from_srgb_colour([r, g, b]);
            }
        } else if let Some(used) = find(diffuse, "texture") {
            let sampler = used.attribute("texture").unwrap_or_default();
            let file = self.image_file(effect, sampler);
            let file = file.ok_or_else(|| format!("texture '{sampler}' names no image"))?;
            surface = Material::grey(1.0);
            surface.texture = Some(texture_file(&file, self.resolve)?);
        }
        let number = |name: &str| -> Option<f32> {
            let value = find(part(name)?, "float")?;
            numbers(&value).ok()?.first().copied()
        };
        if let Some(shininess) = number("shininess") {
            surface.shininess = shininess.clamp(1.0, 1000.0);
        }
        let specular = part("specular").and_then(|s| find(s, "color"));
        if let Some([r, g, b, ..]) = specular.and_then(|s| numbers::<f32>(&s).ok()).as_deref() {
            surface.specular = ((r + g + b) / 3.0).clamp(0.0, 1.0) * 0.2;
        }
        Ok(surface)
    }

    /// The file of the image that a sampler leads to; some files name the image itself.
    fn image_file(&self, effect: Node<'a, 'd>, sampler: &str) -> Option<String> {
        let parameter = |sid: &str| {
            let named = |n: &Node| n.attribute("sid") == Some(sid);
            effect.descendants().find(named)
        };
        let text = |node: Node<'a, 'd>, name: &str| {
            let found = node.descendants().find(|n| n.has_tag_name_local(name))?;
            Some(found.text()?.trim().to_owned())
        };
        let surface = parameter(sampler).and_then(|p| text(p, "source"));
        let image = match surface {
            Some(surface) => text(parameter(&surface)?, "init_from")?,
            None => sampler.to_owned(),
        };
        let image = self.by_id.get(image.as_str())?;
        // COLLADA 1.5 has a <ref> in <init_from>.
        text(*image, "ref").or_else(|| text(*image, "init_from"))
    }
}

impl Inputs {
    fn set<'a, 'd>(
        &mut self,
        semantic: Option<&str>,
        offset: usize,
        source: &Node<'a, 'd>,
        reader: &Reader<'a, 'd, '_, '_>,
    ) -> Result<(), String> {
        match semantic {
            Some("POSITION") => self.position = Some((offset, reader.values(source, 3)?)),
            Some("NORMAL") => self.normal = Some((offset, reader.values(source, 3)?)),
            // The first of several sets.
            Some("TEXCOORD") if self.uv.is_none() => {
                self.uv = Some((offset, reader.values(source, 2)?));
            }
            _ => {}
        }
        Ok(())
    }

    /// Adds the vertex with these indices.
    fn add(&self, indices: &[usize], part: &mut MeshData) -> Result<(), String> {
        if let Some((offset, values)) = &self.position {
            part.positions.push(values.get(indices[*offset])?);
        }
        if let Some((offset, values)) = &self.normal {
            part.normals.push(values.get(indices[*offset])?);
        }
        if let Some((offset, values)) = &self.uv {
            part.uvs.push(values.get(indices[*offset])?);
        }
        Ok(())
    }
}

/// The transform of an element of a node, if it is one.
fn transform(node: &Node) -> Result<Option<Matrix4<f64>>, String> {
    let name = node.tag_name().name();
    let length = match name {
        "matrix" => 16,
        "translate" | "scale" => 3,
        "rotate" => 4,
        "lookat" | "skew" => return Err(format!("<{name}> cannot be read")),
        _ => return Ok(None),
    };
    let values: Vec<f64> = numbers(node)?;
    if values.len() != length || values.iter().any(|x| !x.is_finite()) {
        return Err(format!(
            "<{name}> has {} numbers, not {length}",
            values.len()
        ));
    }
    Ok(Some(match name {
        "matrix" => Matrix4::from_row_slice(&values),
        "translate" => Matrix4::new_translation(&Vector3::from_row_slice(&values)),
        "scale" => Matrix4::new_nonuniform_scaling(&Vector3::from_row_slice(&values)),
        _ => {
            let axis = Unit::try_new(Vector3::from_row_slice(&values[..3]), 1e-12);
            let axis = axis.ok_or("<rotate> has no axis")?;
            Rotation3::from_axis_angle(&axis, values[3].to_radians()).to_homogeneous()
        }
    }))
}
