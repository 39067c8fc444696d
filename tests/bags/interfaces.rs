//! The Rust declarations of messages against the `.msg` files: our own, and those of ROS 2 Jazzy.

use fuyu::msg::{self, Definition, fuyu_msgs};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crate::{python, scripts};

/// `FUYU_UPDATE_MSG=1` writes the files from the declarations.
#[test]
fn our_msg_files_are_the_text_of_the_declarations() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("msg");
    let mut expected: BTreeMap<String, String> = msg::definitions()
        .filter(|d| d.package == "fuyu_msgs")
        .map(|d| (format!("{}.msg", d.name), d.msg_text()))
        .collect();
    if std::env::var_os("FUYU_UPDATE_MSG").is_some() {
        for (name, text) in &expected {
            fs::write(folder.join(name), text).unwrap();
        }
    }
    let cmake = fs::read_to_string(folder.join("CMakeLists.txt")).unwrap();
    for entry in fs::read_dir(&folder).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if name.ends_with(".msg") {
            let text = fs::read_to_string(folder.join(&name)).unwrap();
            assert_eq!(Some(text), expected.remove(&name), "{name}");
            assert!(
                cmake.contains(&format!("\"{name}\"")),
                "CMakeLists.txt lacks {name}"
            );
        }
    }
    assert!(expected.is_empty(), "no file for {:?}", expected.keys());
    // Schemas in bags carry units and frames, too.
    let schema = <fuyu_msgs::Momentum as msg::Interface>::DEFINITION.schema_text();
    assert!(schema.contains("[N m s], inertial axes"), "{schema}");
}

#[test]
fn other_packages_are_as_ros_defines_them() {
    #[derive(serde::Deserialize)]
    struct Report {
        compared: Vec<String>,
        differing: Vec<String>,
        missing: Vec<String>,
    }
    let ours: BTreeMap<String, serde_json::Value> = msg::definitions()
        .chain(msg::service_definitions())
        .map(|d: &Definition| {
            let value = serde_json::json!({"text": d.msg_text(), "hash": d.type_hash()});
            (d.type_name(), value)
        })
        .collect();
    // Builds the packages of interfaces that have no wheel into the environment.
    python::environment("test-interfaces.sh", &[]);
    let text = scripts::run("interfaces.py", &[], &serde_json::to_string(&ours).unwrap());
    let report: Report = serde_json::from_str(&text).unwrap();
    assert_eq!(report.differing, [""; 0]);
    assert_eq!(report.missing, [""; 0]);
    assert_eq!(report.compared.len(), ours.len());
    assert!(
        report.compared.len() > 60,
        "only {} compared",
        report.compared.len()
    );
}
