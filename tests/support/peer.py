"""A real ROS 2 node (rclpy) that a test drives: one JSON command a line on stdin, one JSON answer a line."""

import array
import bisect
import collections
import importlib
import json
import os
import subprocess
import sys
import threading
import time

import rclpy
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rcl_interfaces.msg import Parameter as ParameterMsg
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)


# A command ends as soon as what it waits for is there; this is its timeout [s].
PATIENCE = 60.0


def qos(name, depth=1000):
    profile = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth)
    profile.reliability = (
        ReliabilityPolicy.BEST_EFFORT if name == "sensor_data" else ReliabilityPolicy.RELIABLE
    )
    profile.durability = (
        DurabilityPolicy.TRANSIENT_LOCAL if name == "latched" else DurabilityPolicy.VOLATILE
    )
    return profile


def load(type_name):
    package, kind, name = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), name)


def plain(value):
    """A message as JSON."""
    if hasattr(value, "get_fields_and_field_types"):
        return {f: plain(getattr(value, f)) for f in value.get_fields_and_field_types()}
    if isinstance(value, (list, tuple, array.array)):
        return [plain(v) for v in value]
    if isinstance(value, bytes):
        return list(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    return value


def fill(message, values):
    """JSON into a message; JSON has no NaN, null stands for it."""
    nan = float("nan")
    for field, value in values.items():
        inner = getattr(message, field)
        if isinstance(value, dict):
            fill(inner, value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            element = message.get_fields_and_field_types()[field]
            element = element.removeprefix("sequence<").removesuffix(">").replace("/", "/msg/")
            setattr(message, field, [fill(load(element)(), v) for v in value])
        elif isinstance(value, list):
            setattr(message, field, [nan if v is None else v for v in value])
        else:
            setattr(message, field, nan if value is None else value)
    return message


class Peer:
    def __init__(self, name):
        rclpy.init()
        self.node = rclpy.create_node(name)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.received = collections.defaultdict(list)
        self.arrived = threading.Condition()
        self.publishers = {}
        threading.Thread(target=self.executor.spin, daemon=True).start()

    def spinning(self, function, *arguments, **named):
        """The result of a function that is called in the thread that spins. If another thread calls it, rclpy may take an
        answer for one to nobody, since it notes a request after it has sent it; and it fails if it is about to wait for
        what is being destroyed."""
        return self.done(self.executor.create_task(function, *arguments, **named), PATIENCE)

    def subscribe(self, topic, type, qos_name="reliable"):
        def take(message):
            with self.arrived:
                self.received[topic].append((time.time(), plain(message)))
                self.arrived.notify_all()

        self.node.create_subscription(load(type), topic, take, qos(qos_name))

    def wait(self, topic, count=1, since=0.0, timeout=PATIENCE):
        """The messages that came after `since`, as soon as there are `count` of them."""
        all = self.received[topic]

        def first():
            return bisect.bisect_left(all, since, key=lambda m: m[0])

        with self.arrived:
            self.arrived.wait_for(lambda: len(all) - first() >= count, timeout)
            return [{"time": t, "message": m} for t, m in all[first() :]]

    def publish(self, topic, type, message, qos_name="reliable", matched=1, timeout=PATIENCE):
        """Publishes once `matched` subscribers are there."""
        if topic not in self.publishers:
            self.publishers[topic] = self.node.create_publisher(load(type), topic, qos(qos_name))
        publisher = self.publishers[topic]
        deadline = time.time() + timeout
        while publisher.get_subscription_count() < matched:
            if time.time() > deadline:
                raise TimeoutError(f"{publisher.get_subscription_count()} subscribers of {topic}")
            time.sleep(0.02)
        publisher.publish(fill(load(type)(), message))
        return publisher.get_subscription_count()

    def graph(self, node, expected, namespace="/", timeout=PATIENCE):
        """What the graph shows of a node, as soon as that has all names of `expected` (kind to names): its
        endpoints appear one by one, and any pause between two of them may be long."""
        deadline = time.time() + timeout
        while True:
            seen = self.snapshot(node, namespace)
            missing = {
                kind: sorted(set(names) - set((seen or {}).get(kind, {})))
                for kind, names in expected.items()
            }
            if seen is not None and not any(missing.values()):
                return seen
            if time.time() > deadline:
                nodes = self.node.get_node_names_and_namespaces()
                raise TimeoutError(f"{node} lacks {missing}, it has {seen}; nodes are {nodes}")
            time.sleep(0.05)

    def snapshot(self, node, namespace):
        """Endpoints of a node as the graph shows them now; nothing if it does not show the node."""
        if (node, namespace) not in self.node.get_node_names_and_namespaces():
            return None
        try:
            return {
                "publishers": dict(
                    self.node.get_publisher_names_and_types_by_node(node, namespace)
                ),
                "subscribers": dict(
                    self.node.get_subscriber_names_and_types_by_node(node, namespace)
                ),
                "services": dict(self.node.get_service_names_and_types_by_node(node, namespace)),
            }
        except rclpy.node.NodeNameNonExistentError:
            return None

    def topic_info(self, topic, nodes, timeout=PATIENCE):
        """Publishers of a topic, as soon as they are those of `nodes` (names, sorted), or else at last."""
        deadline = time.time() + timeout
        while True:
            found = self.node.get_publishers_info_by_topic(topic)
            if sorted(i.node_name for i in found) == nodes or time.time() > deadline:
                break
            time.sleep(0.05)
        return [
            {
                "node": i.node_name,
                "namespace": i.node_namespace,
                "type": i.topic_type,
                "reliability": i.qos_profile.reliability.name,
                "durability": i.qos_profile.durability.name,
            }
            for i in found
        ]

    def call(self, service, type, request, timeout=PATIENCE):
        client = self.node.create_client(load(type), service)
        try:
            if not client.wait_for_service(timeout):
                return {"error": f"no service {service}"}
            future = self.spinning(client.call_async, fill(load(type).Request(), request))
            answered = threading.Event()
            future.add_done_callback(lambda _: answered.set())
            if not answered.wait(timeout):
                return {"error": f"no answer from {service}"}
            return {"response": plain(future.result())}
        finally:
            self.spinning(self.node.destroy_client, client)

    def first_calls(self, service, type, request, count, timeout=10.0):
        """How long the first calls of as many new clients take [ms], from the end of `wait_for_service`; nothing for one
        without an answer."""
        times = []
        for _ in range(count):
            client = self.node.create_client(load(type), service)
            try:
                if not client.wait_for_service(PATIENCE):
                    return {"error": f"no service {service}"}
                answered = threading.Event()
                start = time.monotonic()
                future = self.spinning(client.call_async, fill(load(type).Request(), request))
                future.add_done_callback(lambda _, answered=answered: answered.set())
                answer = answered.wait(timeout)
                times.append((time.monotonic() - start) * 1e3 if answer else None)
            finally:
                self.spinning(self.node.destroy_client, client)
        return times

    def first_goals(self, action, type, goal, count, timeout=10.0):
        """How long as many new clients wait for the acceptance of a goal, its cancellation and its result [ms]; nothing for
        what is not answered."""
        times = []
        for _ in range(count):
            client = ActionClient(self.node, load(type), action)
            try:
                if not client.wait_for_server(PATIENCE):
                    return {"error": f"no action {action}"}
                start = time.monotonic()
                handle = self.done(self.spinning(client.send_goal_async, fill(load(type).Goal(), goal)), timeout)
                times.append((time.monotonic() - start) * 1e3)
                start = time.monotonic()
                self.done(self.spinning(handle.cancel_goal_async), timeout)
                times.append((time.monotonic() - start) * 1e3)
                start = time.monotonic()
                self.done(self.spinning(handle.get_result_async), timeout)
                times.append((time.monotonic() - start) * 1e3)
            except TimeoutError:
                times.append(None)
            finally:
                self.spinning(client.destroy)
        return times

    def once(self, topic, type, message, matched=1):
        """As `ros2 topic pub --once -w MATCHED`: a new participant publishes and ends a tenth of a second later."""
        context = rclpy.Context()
        rclpy.init(context=context)
        node = rclpy.create_node(f"once{time.monotonic_ns()}", context=context)
        publisher = node.create_publisher(load(type), topic, 10)
        deadline = time.time() + PATIENCE
        while publisher.get_subscription_count() < matched:
            if time.time() > deadline:
                raise TimeoutError(f"{publisher.get_subscription_count()} subscribers of {topic}")
            time.sleep(0.1)
        publisher.publish(fill(load(type)(), message))
        time.sleep(0.1)
        node.destroy_node()
        rclpy.shutdown(context=context)

    def serve(self, service, type, response):
        """Answers every call of a service with the same response."""
        answer = fill(load(type).Response(), response)
        self.node.create_service(load(type), service, lambda _, __: answer)

    def done(self, future, timeout):
        """What a future gives."""
        ready = threading.Event()
        future.add_done_callback(lambda _: ready.set())
        if not ready.wait(timeout):
            raise TimeoutError("no answer")
        return future.result()

    def act(self, action, type, goal, cancel_after=None, timeout=PATIENCE):
        """Feedback and outcome of a goal, which is cancelled after so many feedbacks."""
        feedback, enough = [], threading.Event()

        def hear(message):
            feedback.append(plain(message.feedback))
            if len(feedback) == cancel_after:
                enough.set()

        client = ActionClient(self.node, load(type), action)
        try:
            if not client.wait_for_server(timeout):
                return {"error": f"no action {action}"}
            goal = fill(load(type).Goal(), goal)
            handle = self.done(self.spinning(client.send_goal_async, goal, feedback_callback=hear), timeout)
            if not handle.accepted:
                return {"accepted": False}
            cancelled = None
            if cancel_after is not None:
                if not enough.wait(timeout):
                    raise TimeoutError(f"{len(feedback)} feedbacks")
                cancelled = self.done(self.spinning(handle.cancel_goal_async), timeout).return_code
            outcome = self.done(self.spinning(handle.get_result_async), timeout)
            return {
                "accepted": True,
                "cancelled": cancelled,
                "status": outcome.status,
                "result": plain(outcome.result),
                "feedback": list(feedback),
            }
        finally:
            self.spinning(client.destroy)

    def process_id(self):
        return os.getpid()

    def pause(self, seconds):
        """Stops this process for a while; to its peers the network is interrupted."""
        command = f"kill -STOP {os.getpid()}; sleep {seconds}; kill -CONT {os.getpid()}"
        subprocess.run(["sh", "-c", command], check=True)

    def withdraw(self, topic):
        """Ends the publisher of a topic."""
        self.spinning(self.node.destroy_publisher, self.publishers.pop(topic))

    def set_parameters(self, node, values, atomically=False):
        messages = [Parameter(name, value=value).to_parameter_msg() for name, value in values]
        kind = "set_parameters_atomically" if atomically else "set_parameters"
        type = "rcl_interfaces/srv/" + ("SetParametersAtomically" if atomically else "SetParameters")
        return self.call(f"{node}/{kind}", type, {"parameters": messages})


def main():
    peer = Peer(sys.argv[1] if len(sys.argv) > 1 else "peer")
    print(json.dumps({"ready": True}), flush=True)
    for line in sys.stdin:
        command = json.loads(line)
        operation = getattr(peer, command.pop("do"))
        try:
            answer = operation(**command)
        except Exception as e:  # the test decides what it means
            answer = {"error": f"{type(e).__name__}: {e}"}
        print(json.dumps(answer), flush=True)


main()
