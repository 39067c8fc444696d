//! Mesh files: the same body from every format, and files that are wrong.

use std::fmt::Write;

use base64::{Engine, prelude::BASE64_STANDARD};
use fuyu_render::{Distortion, Mesh, Scene, load, render};
use nalgebra::{Isometry3, Vector3};

use crate::{camera, put};

/// Corners and triangles of a wedge: not symmetric, so that no two axes can be confused.
const CORNERS: [[f32; 3]; 6] = [
    [0.0, 0.0, 0.0],
    [2.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 0.5],
    [2.0, 0.0, 0.5],
    [0.0, 1.0, 0.5],
];
const TRIANGLES: [[u32; 3]; 8] = [
    [0, 2, 1],
    [3, 4, 5],
    [0, 1, 4],
    [0, 4, 3],
    [1, 2, 5],
    [1, 5, 4],
    [2, 0, 3],
    [2, 3, 5],
];

fn none(name: &str) -> Result<Vec<u8>, String> {
    Err(format!("{name}: no such file"))
}

fn stl() -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((TRIANGLES.len() as u32).to_le_bytes());
    for t in TRIANGLES {
        bytes.extend([0; 12]);
        for i in t {
            bytes.extend(CORNERS[i as usize].iter().flat_map(|x| x.to_le_bytes()));
        }
        bytes.extend([0; 2]);
    }
    bytes
}

fn obj() -> String {
    let mut text = "mtllib wedge.mtl\n".to_owned();
    for [x, y, z] in CORNERS {
        writeln!(text, "v {x} {y} {z}").unwrap();
    }
    text += "usemtl paint\n";
    for t in TRIANGLES {
        writeln!(text, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1).unwrap();
    }
    text
}

/// In centimetres, half of it in a node that is displaced, its corners in the other order.
fn dae() -> String {
    let numbers = CORNERS
        .map(|[x, y, z]| format!("{} {} {}", y * 100.0, -x * 100.0, z * 100.0))
        .join(" ");
    let indices = TRIANGLES.map(|[a, b, c]| format!("{a} {b} {c}")).join(" ");
    format!(
        r##"<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
 <asset><unit name="centimeter" meter="0.01"/><up_axis>Z_UP</up_axis></asset>
 <library_effects><effect id="e"><profile_COMMON><technique sid="c"><lambert>
   <diffuse><color>0.5 0.25 1 1</color></diffuse></lambert></technique></profile_COMMON></effect></library_effects>
 <library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
 <library_geometries><geometry id="g"><mesh>
   <source id="p"><float_array id="pa" count="18">{numbers}</float_array><technique_common>
     <accessor source="#pa" count="6" stride="3"/></technique_common></source>
   <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
   <triangles count="8" material="s"><input semantic="VERTEX" source="#v" offset="0"/><p>{indices}</p></triangles>
 </mesh></geometry></library_geometries>
 <library_visual_scenes><visual_scene id="s"><node><translate>0 0 0</translate>
   <rotate>0 0 1 90</rotate><instance_geometry url="#g"><bind_material><technique_common>
   <instance_material symbol="s" target="#m"/></technique_common></bind_material></instance_geometry></node></visual_scene>
 </library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"##
    )
}

fn gltf(count: usize) -> String {
    let mut data: Vec<u8> = TRIANGLES
        .iter()
        .flatten()
        .flat_map(|i| i.to_le_bytes())
        .collect();
    data.extend(CORNERS.iter().flatten().flat_map(|x| x.to_le_bytes()));
    let text = BASE64_STANDARD.encode(&data);
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
"nodes":[{{"mesh":0,"scale":[2,2,2]}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":1}},"indices":0,"material":0}}]}}],
"materials":[{{"pbrMetallicRoughness":{{"baseColorFactor":[0.25,0.5,0.75,1]}}}}],
"buffers":[{{"byteLength":168,"uri":"data:application/octet-stream;base64,{text}"}}],
"bufferViews":[{{"buffer":0,"byteLength":96}},{{"buffer":0,"byteOffset":96,"byteLength":72}}],
"accessors":[{{"bufferView":0,"componentType":5125,"count":24,"type":"SCALAR"}},
{{"bufferView":1,"componentType":5126,"count":{count},"type":"VEC3","min":[0,0,0],"max":[2,1,0.5]}}]}}"#
    )
}

fn ids(mesh: Mesh) -> Vec<u16> {
    let mut scene = Scene::new();
    let pose = Isometry3::new(Vector3::new(-0.5, 0.1, 4.0), Vector3::new(0.4, -0.5, 0.7));
    put(&mut scene, mesh, 1, pose);
    render(&scene, &camera(160, 120, 150.0, Distortion::None)).ids
}

#[test]
fn every_format_gives_the_same_body() {
    let paint = |name: &str| match name {
        "wedge.mtl" => Ok(b"newmtl paint\nKd 1 0 0\n".to_vec()),
        other => none(other),
    };
    let read = |name: &str, bytes: &[u8]| load::load(name, bytes, &mut { paint }).unwrap();
    let reference = Mesh::new(read("wedge.stl", &stl())).unwrap();
    assert!(reference.is_closed());
    let expected = ids(reference);
    assert!(expected.iter().filter(|id| **id == 1).count() > 1000);

    let data = read("a/wedge.OBJ", obj().as_bytes());
    assert_eq!(data.materials[0].diffuse, [1.0, 0.0, 0.0]);
    assert_eq!(ids(Mesh::new(data).unwrap()), expected);

    let data = read("wedge.dae", dae().as_bytes());
    assert!((data.materials[0].diffuse[0] - 0.214).abs() < 1e-3);
    let mesh = Mesh::new(data).unwrap();
    assert!(mesh.is_closed());
    let differing = ids(mesh)
        .iter()
        .zip(&expected)
        .filter(|(a, b)| a != b)
        .count();
    assert!(differing <= 2, "{differing}");

    let mut data = read("wedge.gltf", gltf(6).as_bytes());
    assert_eq!(data.materials[0].diffuse, [0.25, 0.5, 0.75]);
    data.transform(&Vector3::repeat(0.5), &Isometry3::identity());
    assert_eq!(ids(Mesh::new(data).unwrap()), expected);
}

#[test]
fn textures_of_an_obj_file_are_read() {
    let png = fuyu_render::encode::png(&[255, 0, 0, 0, 0, 255], 2, 1, 3).unwrap();
    let text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n";
    let mut files = |name: &str| match name {
        "m.mtl" => Ok(b"newmtl a\nmap_Kd t.png\n".to_vec()),
        "t.png" => Ok(png.clone()),
        other => none(other),
    };
    let data = load::load("x.obj", text.as_bytes(), &mut files).unwrap();
    assert!(data.materials[0].texture.is_some());
    assert_eq!(data.uvs, [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    let mut broken = |name: &str| match name {
        "m.mtl" => Ok(b"newmtl a\nmap_Kd t.png\n".to_vec()),
        _ => Ok(b"no picture".to_vec()),
    };
    let refused = load::load("x.obj", text.as_bytes(), &mut broken).unwrap_err();
    assert!(refused.contains("texture t.png"), "{refused}");
}

#[test]
fn wrong_files_are_refused_in_one_line() {
    let refused = |name: &str, bytes: &[u8]| {
        let refused = load::load(name, bytes, &mut none).unwrap_err();
        assert!(!refused.contains('\n'), "{refused}");
        refused
    };
    assert!(refused("a.step", b"").contains("expected .stl, .obj, .dae, .gltf or .glb"));
    assert!(refused("a.stl", b"solid").contains("STL"));
    assert!(refused("a.obj", obj().as_bytes()).contains("wedge.mtl: no such file"));
    assert!(refused("a.dae", b"<a/>").contains("its root is <a>"));
    let wrong = dae()
        .replace("count=\"8\"", "count=\"8\" ")
        .replace("<p>0 2 1", "<p>0 2 77");
    assert!(refused("a.dae", wrong.as_bytes()).contains("index 77 is beyond"));
    let wrong = dae().replace("url=\"#g\"", "url=\"#other\"");
    assert!(refused("a.dae", wrong.as_bytes()).contains("#other, which is not in the file"));
    // A node that contains itself.
    let wrong = dae().replace("<node>", "<node id=\"n\"><instance_node url=\"#n\"/>");
    assert!(refused("a.dae", wrong.as_bytes()).contains("nested more than"));
    assert!(refused("a.glb", b"glTF").contains("glTF"));
    // More vertices than the buffer has.
    assert!(refused("a.gltf", gltf(7).as_bytes()).contains("accessor 1 lies outside"));
}
