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
        names = list(yaml.safe_load(file))
    return [
        Node(
            package="fuyu",
            executable=name,
            name=name,
            namespace=namespace,
            parameters=[config],
            remappings=[("/clock", "clock"), ("/tf", "tf"), ("/tf_static", "tf_static")],
            output="screen",
            on_exit=Shutdown() if name == "dynamics" else None,
        )
        for name in names
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
