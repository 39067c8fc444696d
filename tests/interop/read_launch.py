"""What a launch file in Python starts, as JSON. ROS's own `launch` is on no package index, so the few of its names
that the file uses stand here, with the same meaning. Usage: read_launch.py FILE NAME:=VALUE..."""

import json
import os
import runpy
import sys
import types

values = dict(argument.split(":=", 1) for argument in sys.argv[2:])


class Thing:
    def __init__(self, *parts, **named):
        self.parts, self.named = parts, named


class DeclareLaunchArgument(Thing):
    pass


class OpaqueFunction(Thing):
    pass


class Shutdown(Thing):
    pass


class Node(Thing):
    KNOWN = {"package", "executable", "name", "namespace", "parameters", "remappings", "output", "on_exit"}

    def __init__(self, **named):
        assert set(named) <= self.KNOWN, named
        assert named["package"] == "fuyu"
        super().__init__(**named)


class LaunchConfiguration(Thing):
    def perform(self, context):
        return context[self.parts[0]]


class FindPackageShare(Thing):
    def perform(self, context):
        return os.path.dirname(os.path.dirname(os.path.abspath(sys.argv[1])))


class PathJoinSubstitution(Thing):
    def perform(self, context):
        return os.path.join(*(p if isinstance(p, str) else p.perform(context) for p in self.parts[0]))


class LaunchDescription(Thing):
    pass


def module(name, **members):
    sys.modules[name] = types.ModuleType(name)
    vars(sys.modules[name]).update(members)


module("launch", LaunchDescription=LaunchDescription)
module(
    "launch.actions",
    DeclareLaunchArgument=DeclareLaunchArgument,
    OpaqueFunction=OpaqueFunction,
    Shutdown=Shutdown,
)
module(
    "launch.substitutions",
    LaunchConfiguration=LaunchConfiguration,
    PathJoinSubstitution=PathJoinSubstitution,
)
module("launch_ros")
module("launch_ros.actions", Node=Node)
module("launch_ros.substitutions", FindPackageShare=FindPackageShare)

description = runpy.run_path(sys.argv[1])["generate_launch_description"]()
context, nodes = {}, []
for entity in description.parts[0]:
    if isinstance(entity, DeclareLaunchArgument):
        default = entity.named["default_value"]
        default = default if isinstance(default, str) else default.perform(context)
        context[entity.parts[0]] = values.get(entity.parts[0], default)
    elif isinstance(entity, OpaqueFunction):
        nodes += entity.named["function"](context)
    else:
        nodes.append(entity)
commands = [
    {
        **{key: node.named[key] for key in ("executable", "name", "namespace", "parameters")},
        "ends_all": isinstance(node.named["on_exit"], Shutdown),
    }
    for node in nodes
]
print(json.dumps(commands))
