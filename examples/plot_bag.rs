//! A bag: read its messages and plot them.
//!
//! `cargo run --release --example plot_bag BAG [FOLDER]` draws joint rates and the power of the joints to
//! `FOLDER/joints.svg` and `.png`. Bags come from `fuyu launch`, from `fuyu simulate --output`, or from `ros2 bag record
//! --storage mcap`.

use std::{error::Error, path::PathBuf};

use fuyu::bag::Bag;
use fuyu::experiments::{Figure, Panel, Series};
use fuyu::msg::sensor_msgs::JointState;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let bag = Bag::open(arguments.next().ok_or("usage: plot_bag BAG [FOLDER]")?)?;
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| ".".to_owned()));

    for topic in bag.info()?.topics {
        println!("{:6} {} ({})", topic.count, topic.name, topic.type_name);
    }

    // Decoded as the type that is asked for; another type on the topic is an error.
    let states = bag.read::<JointState>("/joint_states")?;
    let first = states.first().ok_or("no joint states in the bag")?;
    let time = |log_time: u64| 1e-9 * (log_time - first.log_time) as f64;
    let curve = |name: &str, value: &dyn Fn(&JointState) -> f64| Series {
        name: name.to_owned(),
        points: (states.iter())
            .map(|s| (time(s.log_time), value(&s.message)))
            .collect(),
    };
    let joints = first.message.name.iter().enumerate();
    let rates = joints.map(|(j, name)| curve(name, &|state| state.velocity[j]));
    let power = curve("all joints", &|state| {
        let each = state.effort.iter().zip(&state.velocity);
        each.map(|(effort, rate)| effort * rate).sum()
    });

    let panel = |y_label: &str, series| Panel {
        y_label: y_label.to_owned(),
        series,
        ..Panel::default()
    };
    let figure = Figure {
        title: "Joints".to_owned(),
        x_label: "time [s]".to_owned(),
        panels: vec![
            panel("rate [rad/s]", rates.collect()),
            panel("power [W]", vec![power]),
        ],
        ..Figure::default()
    };
    for path in figure.save(&folder.join("joints"))? {
        println!("wrote {}", path.display());
    }
    Ok(())
}
