"""Starts the nodes that a scenario names, whichever they are; ends with its dynamics node."""

import yaml
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def nodes(context):
    config = LaunchConfiguration("config").perform(context)
    namespace = LaunchConfiguration("namespace").perform(context)
    with open(config) as file:
        keys = [key.rpartition("/") for key in yaml.safe_load(file) if "*" not in key]
    # Robots with namespaces of their own share one world, and so one clock.
    several = any(own for own, _, _ in keys)
    return [
        Node(
            package="fuyu",
            executable=name,
            name=name,
            namespace=own or namespace,
            parameters=[config],
            remappings=[("/tf", "tf"), ("/tf_static", "tf_static")] + ([] if several else [("/clock", "clock")]),
            output="screen",
            on_exit=Shutdown() if name == "dynamics" else None,
        )
        for own, _, name in keys
    ]


def generate_launch_description():
    servicing = PathJoinSubstitution([FindPackageShare("fuyu"), "config", "servicing.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("config", default_value=servicing, description="Scenario: a parameter file"),
            DeclareLaunchArgument("namespace", default_value="/", description="Namespace of the robot"),
            OpaqueFunction(function=nodes),
        ]
    )
