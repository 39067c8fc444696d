//! Serialized messages.

use fuyu::msg::schema::{Layout, Schema};
use fuyu::msg::{self, Definition, Interface, cdr, scan::scan};
use fuyu::msg::{diagnostic_msgs, fuyu_msgs, nav_msgs, rcl_interfaces, sensor_msgs, tf2_msgs};

use crate::run::Target;

/// Reads bytes as a message in every way.
struct Reader {
    definition: &'static Definition,
    schema: Schema,
    decode: fn(&[u8]),
}

fn reader<M: Interface>() -> Reader {
    let definition = M::DEFINITION;
    let text = definition.schema_text();
    Reader {
        definition,
        schema: Schema::parse(&definition.type_name(), &text).unwrap(),
        decode: |bytes| {
            if let Ok(message) = cdr::decode::<M>(bytes) {
                // What was read can be written.
                cdr::encode(&message);
            }
        },
    }
}

#[test]
fn messages() {
    let joints = sensor_msgs::JointState {
        name: vec!["a".into(), "bc".into()],
        position: vec![1.0, 2.0],
        ..Default::default()
    };
    let transforms = tf2_msgs::TFMessage {
        transforms: vec![Default::default(); 3],
    };
    let path = nav_msgs::Path {
        poses: vec![Default::default(); 3],
        ..Default::default()
    };
    let mut corpus = vec![
        cdr::encode(&joints),
        cdr::encode(&transforms),
        cdr::encode(&path),
    ];
    corpus.push(cdr::encode(&diagnostic_msgs::DiagnosticArray {
        status: vec![Default::default(); 2],
        ..Default::default()
    }));
    corpus.push(cdr::encode(&rcl_interfaces::ParameterEvent::default()));
    corpus.push(cdr::encode(&fuyu_msgs::ControllerState::default()));
    assert!(msg::definitions().count() > 40);
    let readers = [
        reader::<sensor_msgs::JointState>(),
        reader::<tf2_msgs::TFMessage>(),
        reader::<nav_msgs::Path>(),
        reader::<diagnostic_msgs::DiagnosticArray>(),
        reader::<rcl_interfaces::ParameterEvent>(),
        reader::<fuyu_msgs::ControllerState>(),
        reader::<fuyu_msgs::FeatureTracks>(),
        reader::<sensor_msgs::Image>(),
    ];
    let target = Target {
        name: "cdr",
        corpus,
        words: &[],
        memory: 64 << 20,
    };
    target.run(|input| {
        for reader in &readers {
            (reader.decode)(input);
            let _ = scan(reader.definition, input);
            if let Ok(reading) = reader.schema.read(input) {
                let mut layout = Layout::new(reader.schema.clone(), 1000);
                layout.meet(&reading.lengths);
                layout.columns();
                let values = layout.numbers(&reading.lengths).count();
                assert_eq!(values, reading.values.len());
            }
        }
    });
}
