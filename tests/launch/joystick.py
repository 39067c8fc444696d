"""An operator's joystick: publishes `joy` at 50 Hz, its button held down.

`joystick.py push` pushes the second axis halfway until it is ended. `joystick.py latency TRIALS` pushes it now and then and
prints, as JSON, how long it took each time until `joint_states` showed motion [s]."""

import json
import sys
import threading
import time

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState, Joy

# Rates above this are motion [rad/s]: servos fade away to less in the pauses.
MOTION = 2e-4


class Joystick(Node):
    def __init__(self):
        super().__init__("joystick")
        self.joy = self.create_publisher(Joy, "joy", 10)
        self.create_subscription(JointState, "joint_states", self.see, 10)
        self.create_timer(0.02, self.publish)
        self.push = 0.0
        self.moving = threading.Condition()
        self.fastest = 0.0
        self.seen = 0.0

    def publish(self):
        # Axes as a gamepad has them: 1 for x, 0 for y, 4 for z, 3 for yaw.
        self.joy.publish(Joy(axes=[self.push, 0.0, 0.0, 0.0, 0.0], buttons=[1]))

    def see(self, state):
        with self.moving:
            self.seen = time.monotonic()
            self.fastest = max(abs(v) for v in state.velocity)
            self.moving.notify_all()

    def latency(self, push):
        """Seconds from the push to the first joint state that shows motion."""
        with self.moving:
            self.moving.wait_for(lambda: self.fastest < MOTION, 30.0)
        self.push = push
        pushed = time.monotonic()
        self.publish()
        with self.moving:
            moved = self.moving.wait_for(lambda: self.fastest > MOTION, 30.0)
            return self.seen - pushed if moved else None


def main():
    rclpy.init()
    joystick = Joystick()
    if sys.argv[1] == "push":
        joystick.push = 0.5
        rclpy.spin(joystick)
        return
    threading.Thread(target=rclpy.spin, args=[joystick], daemon=True).start()
    # The first push starts time.
    latencies = []
    for trial in range(int(sys.argv[2]) + 1):
        latencies.append(joystick.latency(0.5 if trial % 2 else -0.5))
        time.sleep(0.2)
        joystick.push = 0.0
        # Pushes at odds with all periods.
        time.sleep(0.7 + 0.0037 * (trial % 7))
    print(json.dumps(latencies[1:]), flush=True)
    rclpy.shutdown()


try:
    main()
except KeyboardInterrupt:
    pass
except Exception:
    # Ctrl-C may come between any two lines, and what follows finds no context.
    if rclpy.ok():
        raise
