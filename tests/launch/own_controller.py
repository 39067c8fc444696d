"""A controller of one's own: takes the place of fuyu's controller node and brings the joints to a posture.

Run it with `fuyu launch` of a scenario without controller; any node that answers `joint_states`
with `joint_commands` will do."""

import time

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState


class JointPd(Node):
    def __init__(self):
        super().__init__("own_controller")
        self.posture = self.declare_parameter("posture", [1.2, 1.5, -1.4, -0.2, 0.2, -0.5]).value
        self.stiffness = self.declare_parameter("stiffness", [160.0, 40.0, 80.0, 4.0, 0.8, 0.08]).value
        self.damping = self.declare_parameter("damping", [400.0, 100.0, 200.0, 10.0, 2.0, 0.2]).value
        self.delay = self.declare_parameter("delay", 0.0).value
        self.commands = self.create_publisher(JointState, "joint_commands", 10)
        self.create_subscription(JointState, "joint_states", self.answer, 10)

    def answer(self, state):
        gains = zip(self.stiffness, self.damping, self.posture, state.position, state.velocity)
        time.sleep(self.delay)
        efforts = [k * (goal - q) - d * qd for k, d, goal, q, qd in gains]
        self.commands.publish(JointState(header=state.header, name=state.name, effort=efforts))


rclpy.init()
try:
    rclpy.spin(JointPd())
except KeyboardInterrupt:
    pass
except Exception:
    # Ctrl-C may come between any two lines, and what follows finds no context.
    if rclpy.ok():
        raise
