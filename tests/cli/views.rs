//! The layouts in `views/` name topics and fields that exist.

use fuyu::{
    msg::{self, Base, Definition},
    nodes::topics::{self, Declaration},
    ros::qos::{Durability, Reliability},
};
use serde_json::Value;

fn text(name: &str) -> String {
    let path = format!("{}/views/{name}", env!("CARGO_MANIFEST_DIR"));
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// The topic called `name`, with or without the slash that RViz's layout leaves to the namespace. The robot's topic stands
/// for those of targets' descriptions, which are of its kind.
fn topic(name: &str) -> Declaration {
    let name = name.trim_start_matches('/');
    let name = match name == topics::TARGET_DESCRIPTION.of("target") {
        true => topics::ROBOT_DESCRIPTION.name,
        false => name,
    };
    let mut all = topics::all().into_iter();
    all.find(|t| t.name.trim_start_matches('/') == name)
        .unwrap_or_else(|| panic!("no node publishes {name}"))
}

/// Walks along a path of fields, `twist.twist.angular.x` or `velocity[0]`; it must end at a number.
fn follow(mut definition: &'static Definition, path: &str) {
    let mut fields = path.split('.').peekable();
    while let Some(name) = fields.next() {
        let name = name.split('[').next().unwrap();
        let field = definition.fields.iter().find(|f| f.name == name);
        let field = field.unwrap_or_else(|| panic!("{} has no {name}", definition.type_name()));
        match field.ty.base {
            Base::Message(inner) => definition = inner,
            Base::String => panic!("{path} is text"),
            _ => return assert!(fields.peek().is_none(), "{path} goes on after a number"),
        }
    }
    panic!("{path} is a whole message");
}

// A layout with an outdated topic or field shows an empty plot and no error.
#[test]
fn foxglove_layout_names_what_is_published() {
    let layout: Value = serde_json::from_str(&text("foxglove.json")).unwrap();
    let panels = layout["configById"].as_object().unwrap();
    let mut plotted = 0;
    for (id, panel) in panels {
        assert!(layout["layout"].to_string().contains(id), "{id} is nowhere");
        for path in panel["paths"].as_array().into_iter().flatten() {
            let (name, fields) = path["value"].as_str().unwrap().split_once('.').unwrap();
            let message = msg::find(&topic(name).type_name).unwrap();
            if id.starts_with("StateTransitions") {
                // Shows text, too.
                assert!(message.fields.iter().any(|f| f.name == fields), "{fields}");
                continue;
            }
            follow(message, fields);
            plotted += 1;
        }
    }
    assert!(plotted > 10, "{plotted} paths");

    // What the 3D panel of Foxglove draws of each.
    for name in panels["3D!fuyu"]["topics"].as_object().unwrap().keys() {
        let drawn = match topic(name).type_name.as_str() {
            "std_msgs/msg/String" => name == "/robot_description",
            kind => [
                "visualization_msgs/msg/MarkerArray",
                "geometry_msgs/msg/PoseStamped",
                "sensor_msgs/msg/CameraInfo",
            ]
            .contains(&kind),
        };
        assert!(drawn, "{name}");
    }
    let target = &panels["3D!fuyu"]["layers"]["target"];
    assert_eq!(
        topic(target["topic"].as_str().unwrap()).type_name,
        "std_msgs/msg/String"
    );
    let image = &panels["Image!fuyu"]["imageMode"];
    let calibration = topic(image["calibrationTopic"].as_str().unwrap());
    assert_eq!(calibration.type_name, "sensor_msgs/msg/CameraInfo");
}

// RViz shows nothing, not even an error, of a topic of another type or of an offer below its request.
#[test]
fn rviz_layout_asks_for_what_is_offered() {
    let layout: Value = serde_saphyr::from_str(&text("fuyu.rviz")).unwrap();
    let manager = &layout["Visualization Manager"];
    let listed = |name: &str| manager[name].as_array().unwrap().clone();
    let mut topics = 0;
    for item in [listed("Displays"), listed("Tools")].concat() {
        let class = item["Class"].as_str().unwrap();
        let (key, kind) = match class.trim_start_matches("rviz_default_plugins/") {
            "RobotModel" => ("Description Topic", "std_msgs/msg/String"),
            "MarkerArray" => ("Topic", "visualization_msgs/msg/MarkerArray"),
            "Odometry" => ("Topic", "nav_msgs/msg/Odometry"),
            "SetGoal" => ("Topic", "geometry_msgs/msg/PoseStamped"),
            "Grid" | "TF" | "MoveCamera" | "FocusCamera" | "Measure" => continue,
            _ => panic!("no display or tool of RViz is called {class}, or this test knows it not"),
        };
        let asked = &item[key];
        let offered = topic(asked["Value"].as_str().unwrap());
        assert_eq!(offered.type_name, kind, "{class}");
        let latched = match asked["Durability Policy"].as_str().unwrap() {
            "Transient Local" => true,
            "Volatile" => false,
            other => panic!("{class}: {other}"),
        };
        assert_eq!(
            latched,
            offered.qos.durability == Durability::TransientLocal,
            "{class}: what is latched is missed otherwise, what is not is never sent"
        );
        assert_eq!(asked["Reliability Policy"], "Reliable", "{class}");
        assert_eq!(offered.qos.reliability, Reliability::Reliable, "{class}");
        topics += 1;
    }
    assert_eq!(topics, 5);
}
