//! URDF, YAML, CSV and message definitions.

use fuyu::experiments::Observations;
use fuyu::model::Model;
use fuyu::msg::{self, schema::Schema};
use fuyu::ros::{NodeName, ParamsFile};

use crate::run::{Target, files};

const MEGABYTE: u64 = 1 << 20;

#[test]
fn urdf() {
    let words = [
        "<link name=\"a\">",
        "<joint name=\"j\" type=\"revolute\">",
        "<mass value=\"",
        "1e308",
        "-1",
        "nan",
        "inf",
        "0",
        "<parent link=\"a\"/>",
        "<child link=\"a\"/>",
        "type=\"floating\"",
        "<mimic joint=\"joint1\"/>",
        "<unknown/>",
        "type=\"planar\"",
        "\"",
        "&lt;",
        "<!DOCTYPE a [<!ENTITY b \"bbbb\">]>",
        "</robot>",
    ];
    let target = Target {
        name: "urdf",
        corpus: files("urdf", "urdf"),
        words: &words,
        memory: 64 * MEGABYTE,
    };
    target.run(|input| {
        let text = String::from_utf8_lossy(input);
        let _ = Model::from_urdf(&text, "input");
        let _ = Model::repaired_from_urdf(&text, "input").map(|robot| robot.warnings());
    });
}

#[test]
fn yaml() {
    let words = [
        "ros__parameters:",
        "/**:",
        "&a ",
        "*a",
        "<<: *a",
        "[",
        "{",
        "- ",
        "!!binary ",
        "!!float ",
        ".nan",
        "1e999",
        "99999999999999999999",
        "? ",
        "|\n",
        "---\n",
        "\t",
        "\u{feff}",
    ];
    let mut corpus = files("config", "yaml");
    corpus.push(b"a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\nd: [*c, *c]\n".to_vec());
    let target = Target {
        name: "yaml",
        corpus,
        words: &words,
        memory: 64 * MEGABYTE,
    };
    let names = ["dynamics", "camera", "controller"];
    let names = names.map(|name| NodeName::new("/", name).unwrap());
    target.run(|input| {
        if let Ok(file) = ParamsFile::parse("input", &String::from_utf8_lossy(input)) {
            file.nodes();
            names.iter().for_each(|name| drop(file.overrides(name)));
        }
    });
}

#[test]
fn csv() {
    let mut tracks = "t,id,u,v\n".to_owned();
    let mut rates = "t,wx,wy,wz\n".to_owned();
    for i in 0..30 {
        tracks += &format!("{}.5,{},{}.25,3e2\n", i / 5, i % 5, 100 + i);
        rates += &format!("{i},0.1,-0.02,{}e-3\n", i + 1);
    }
    let target = Target {
        name: "csv",
        corpus: vec![tracks.into_bytes(), rates.into_bytes()],
        words: &[
            "t",
            "id",
            "wx",
            ",",
            "\"",
            "\"\"",
            "\n",
            "\r\n",
            "#",
            "1e308",
            "-0",
            "nan",
            "18446744073709551616",
        ],
        memory: 64 * MEGABYTE,
    };
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("input.csv");
    target.run(|input| {
        std::fs::write(&file, input).unwrap();
        let _ = Observations::read(&file);
    });
}

#[test]
fn schemas() {
    let corpus = msg::definitions()
        .map(|d| d.schema_text().into_bytes())
        .collect();
    let target = Target {
        name: "schemas",
        corpus,
        words: &[
            "uint8[0] ",
            "float64[1000000] ",
            "string<=5[<=9] ",
            "Header header\n",
            "===\nMSG: std_msgs/Header\n",
            "wstring ",
            "[]",
            " x\n",
            "=1\n",
            "#",
        ],
        memory: 64 * MEGABYTE,
    };
    // Any message: a small one of zeros, which most types accept.
    let message = [&[0, 1, 0, 0][..], &[0; 400]].concat();
    target.run(|input| {
        if let Ok(schema) = Schema::parse("a/msg/B", &String::from_utf8_lossy(input)) {
            let _ = schema.read(&message);
        }
    });
}
