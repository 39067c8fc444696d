"""A wheel commander of one's own: holds the base by torques of three wheels along its axes, with the attitude from gyro and
star tracker by a filter with constant gains."""

import collections

import numpy as np
import rclpy
from geometry_msgs.msg import QuaternionStamped
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState

WHEELS = ["wheel_x", "wheel_y", "wheel_z"]
PERIOD = 0.1


def product(a, b):
    """Of two quaternions with the real part first."""
    w = a[0] * b[0] - a[1:] @ b[1:]
    return np.append(w, a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))


def turned(q, rotation):
    """An attitude after a small rotation about body axes."""
    q = product(q, np.append(1.0, 0.5 * rotation))
    return q / np.linalg.norm(q)


def small(q):
    """The rotation vector of a small rotation."""
    return 2.0 * q[1:] * np.copysign(1.0, q[0])


def seconds(stamp):
    return stamp.sec + 1e-9 * stamp.nanosec


class WheelCommander(Node):
    def __init__(self):
        super().__init__("own_wheel_commander")
        self.p = self.declare_parameter("p", 300.0).value
        self.d = self.declare_parameter("d", 2400.0).value
        self.attitude = None
        self.bias = np.zeros(3)
        # Attitudes of the last seconds: a measurement corrects that of its own time.
        self.past = collections.deque(maxlen=300)
        self.last = None
        self.commanded = None
        self.commands = self.create_publisher(JointState, "wheel_commands", 10)
        self.create_subscription(QuaternionStamped, "star_tracker", self.correct, 10)
        self.create_subscription(Imu, "imu", self.measure, 10)

    def correct(self, message):
        q = message.quaternion
        measured = np.array([q.w, q.x, q.y, q.z])
        if self.attitude is None:
            self.attitude = measured
            return
        if not self.past:
            return
        time = seconds(message.header.stamp)
        _, then = min(self.past, key=lambda known: abs(known[0] - time))
        error = small(product(then * [1, -1, -1, -1], measured))
        self.attitude = turned(self.attitude, 0.3 * error)
        self.past = collections.deque(((t, turned(q, 0.3 * error)) for t, q in self.past), maxlen=300)
        self.bias -= 0.1 * error

    def measure(self, message):
        time = seconds(message.header.stamp)
        w = message.angular_velocity
        rate = np.array([w.x, w.y, w.z]) - self.bias
        angle = np.zeros(3)
        if self.attitude is not None:
            if self.last is not None and time > self.last:
                self.attitude = turned(self.attitude, rate * (time - self.last))
            self.past.append((time, self.attitude))
            # The reference is the attitude 1.
            angle = small(self.attitude)
        self.last = time
        if self.commanded is None or not 0.0 <= time - self.commanded < 0.999 * PERIOD:
            self.commanded = time
            # What the motor gives its wheel, the base gets with the other sign.
            effort = self.p * angle + self.d * rate
            self.commands.publish(JointState(header=message.header, name=WHEELS, effort=effort.tolist()))


rclpy.init()
try:
    rclpy.spin(WheelCommander())
except KeyboardInterrupt:
    pass
except Exception:
    # Ctrl-C may come between any two lines, and what follows finds no context.
    if rclpy.ok():
        raise
