//! `--help` and `--version` of a node's executable.

/// The text for `--help` or `--version` of the node `name`, if the arguments before `--ros-args` contain one of them.
pub(super) fn requested(name: &str, args: &[String]) -> Option<String> {
    let own = args.iter().take_while(|arg| *arg != "--ros-args");
    own.into_iter().find_map(|arg| match arg.as_str() {
        "-h" | "--help" => Some(help(name)),
        "-V" | "--version" => Some(version(name)),
        _ => None,
    })
}

fn version(name: &str) -> String {
    format!("{name} {}\n", env!("CARGO_PKG_VERSION"))
}

fn help(name: &str) -> String {
    format!(
        "The ROS 2 node '{name}'\n\n\
         Usage: {name} [--ros-args [ROS_ARGS]... [--]]\n\n\
         Options:\n  \
         -h, --help     Print this text\n  \
         -V, --version  Print the version\n\n\
         ROS arguments:\n  \
         -r, --remap FROM:=TO          Rename a topic or service; __node:=NAME, __ns:=/NAMESPACE\n  \
         -p, --param NAME:=VALUE       Set a parameter\n      \
         --params-file FILE        Set the parameters in a YAML file\n      \
         --log-level LEVEL         debug, info, warn or error\n      \
         --disable-rosout-logs     Do not publish the log on /rosout\n      \
         --disable-stdout-logs     Do not write the log to the console\n\n\
         Environment: ROS_DOMAIN_ID, ROS_AUTOMATIC_DISCOVERY_RANGE\n\n\
         `ros2 param list /{name}` and `ros2 param describe /{name} PARAMETER` describe the parameters while it runs.\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn help_is_for_arguments_before_those_of_ros() {
        let asked = |line: &str| {
            let args: Vec<_> = line.split_whitespace().map(str::to_owned).collect();
            requested("camera", &args)
        };
        assert!(asked("--help").unwrap().contains("Usage: camera"));
        assert!(asked("-V").unwrap().starts_with("camera 0."));
        assert_eq!(asked(""), None);
        assert_eq!(asked("--ros-args -p text:=--help"), None);
    }
}
