"""A star tracker of one's own: attitudes of the base from its true odometry, with noise, some time after their exposure."""

import collections
import random

import rclpy
from geometry_msgs.msg import QuaternionStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node


class StarTracker(Node):
    def __init__(self):
        super().__init__("own_star_tracker")
        self.period = 1.0 / self.declare_parameter("rate", 4.0).value
        self.latency = self.declare_parameter("latency", 0.2).value
        self.noise = self.declare_parameter("noise", 5e-5).value
        self.random = random.Random(1)
        self.next = 0.0
        self.exposed = collections.deque()
        self.attitudes = self.create_publisher(QuaternionStamped, "star_tracker", 10)
        self.create_subscription(Odometry, "ground_truth/odom", self.look, 10)

    def look(self, odometry):
        time = odometry.header.stamp.sec + 1e-9 * odometry.header.stamp.nanosec
        if time >= self.next:
            self.next = time + self.period
            self.exposed.append((time, self.measure(odometry)))
        while self.exposed and self.exposed[0][0] + self.latency <= time:
            self.attitudes.publish(self.exposed.popleft()[1])

    def measure(self, odometry):
        """The true attitude times a small random rotation."""
        q = odometry.pose.pose.orientation
        x, y, z = (0.5 * self.random.gauss(0.0, self.noise) for _ in range(3))
        measured = QuaternionStamped()
        measured.header.stamp = odometry.header.stamp
        measured.header.frame_id = "world"
        measured.quaternion.w = q.w - q.x * x - q.y * y - q.z * z
        measured.quaternion.x = q.x + q.w * x + q.y * z - q.z * y
        measured.quaternion.y = q.y + q.w * y + q.z * x - q.x * z
        measured.quaternion.z = q.z + q.w * z + q.x * y - q.y * x
        return measured


rclpy.init()
try:
    rclpy.spin(StarTracker())
except KeyboardInterrupt:
    pass
except Exception:
    # Ctrl-C may come between any two lines, and what follows finds no context.
    if rclpy.ok():
        raise
