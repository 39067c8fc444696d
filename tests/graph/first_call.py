"""Calls /probe/get_parameters once, as a new process does with `ros2 service call`, and prints how long the response took
[ms], from the end of wait_for_service."""

import os
import sys
import threading
import time

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.executors import SingleThreadedExecutor

PATIENCE = 10.0

rclpy.init()
node = rclpy.create_node(sys.argv[1])
executor = SingleThreadedExecutor()
executor.add_node(node)
threading.Thread(target=executor.spin, daemon=True).start()
client = node.create_client(GetParameters, "/probe/get_parameters")
if not client.wait_for_service(PATIENCE):
    sys.exit("no service")
answered = threading.Event()
start = time.monotonic()
future = client.call_async(GetParameters.Request(names=["rate"]))
future.add_done_callback(lambda _: answered.set())
if answered.wait(PATIENCE):
    print((time.monotonic() - start) * 1e3, flush=True)
# Without an orderly end, as a process that is killed: the server has to forget it by itself.
os._exit(0)
