"""The rclpy side of the interop matrix: every row that fuyu's node `echo` has a part in."""

import importlib
import os
import re
import threading
import time

import rclpy
from action_msgs.msg import GoalStatus
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy._rclpy_pybind11 import InvalidHandle
from rclpy.action import ActionClient
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image, JointState
from simulation_interfaces.action import SimulateSteps
from std_msgs.msg import Int32, Int64, String
from std_srvs.srv import Trigger
from unique_identifier_msgs.msg import UUID

from rows import PATIENCE, STREAM, Values, eventually, request, run

ELEMENTARY = {"boolean": "bool", "octet": "byte", "float": "float32", "double": "float64"}
SEQUENCE = re.compile(r"sequence<(.+?)(?:, (\d+))?>$")
ARRAY = re.compile(r"(.+)\[(\d+)\]$")


def load(name):
    package, kind, type_name = name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), type_name)


def filled(cls, values):
    message = cls()
    for name, kind in cls.get_fields_and_field_types().items():
        setattr(message, name, value(kind, values))
    return message


def value(kind, values):
    if match := SEQUENCE.match(kind):
        count = min(values.length(), int(match[2] or 9))
        return several(match[1], count, values)
    if match := ARRAY.match(kind):
        return several(match[1], int(match[2]), values)
    if "/" in kind:
        return filled(load(kind.replace("/", "/msg/")), values)
    kind = ELEMENTARY.get(kind, kind)
    found = values.of(kind)
    return bytes([found]) if kind == "byte" else found


def several(kind, count, values):
    return [value(kind, values) for _ in range(count)]


def profile(depth=10, reliable=True, latched=False):
    reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=depth, reliability=reliability, durability=durability)


rclpy.init()
node = rclpy.create_node("peer")
executor = SingleThreadedExecutor()
executor.add_node(node)


def spin():
    while rclpy.ok():
        try:
            executor.spin()
        except InvalidHandle:
            pass  # It was about to wait for what a row has just destroyed.


threading.Thread(target=spin, daemon=True).start()
asked = request()


def spinning(function, *arguments, **named):
    """The result of a function that is called in the thread that spins. If another thread sends a goal, rclpy may take its
    answer for one to nobody, since it notes a request after it has sent it."""
    task = executor.create_task(function, *arguments, **named)
    if not eventually(task.done):
        raise TimeoutError("the executor does not spin")
    return task.result()


def listen(topic, cls, qos):
    heard = []
    return heard, node.create_subscription(cls, topic, heard.append, qos)


def publisher(topic, cls, qos, **more):
    made = node.create_publisher(cls, topic, qos, **more)
    if not eventually(lambda: made.get_subscription_count() > 0):
        raise TimeoutError(f"no subscriber of {topic}")
    return made


def there_and_back(name):
    def test():
        package, _, type_name = name.split("/")
        cls = load(name)
        heard, back = listen(f"out/{package}/{type_name}", cls, profile())
        there = publisher(f"in/{package}/{type_name}", cls, profile())
        matched = lambda: node.count_publishers(f"out/{package}/{type_name}") > 0
        if not eventually(matched):
            return False, "its echo is not there"
        sent = filled(cls, Values(name))
        # The way back may be known to one side only when the first one comes.
        def echoed():
            there.publish(sent)
            return eventually(lambda: heard, 2.0)

        came = eventually(echoed)
        node.destroy_publisher(there)
        node.destroy_subscription(back)
        return came and heard[0] == sent, "" if came and heard[0] == sent else f"{sent} came back as {heard[:1]}"

    return test


def image():
    heard, _ = listen("out/sensor_msgs/Image", Image, profile())
    there = publisher("in/sensor_msgs/Image", Image, profile())
    pixels = bytes(i % 251 for i in range(900_000))
    for number in range(1, 6):
        sent = Image(height=600, width=500, step=1500, encoding="rgb8", data=pixels)
        sent.header.frame_id = str(number)
        there.publish(sent)
        if not eventually(lambda: [m for m in heard if m.header.frame_id == str(number)]):
            return False, f"image {number} is not back"
    return all(bytes(m.data) == pixels for m in heard), "5 of 900 kB"


def stream_from_fuyu():
    heard, _ = listen("stream", JointState, profile(4000))
    start = publisher("start_stream", Int32, profile())
    eventually(lambda: node.count_publishers("stream") > 0)
    # It is matched on this side; the other side may need a moment more: so a stream may begin late, once.
    for _ in range(3):
        heard.clear()
        start.publish(Int32(data=STREAM))
        if eventually(lambda: len(heard) >= STREAM, 20.0):
            break
    numbers = [m.header.stamp.sec * 1000 + m.header.stamp.nanosec for m in heard]
    return numbers == list(range(STREAM)), f"{len(numbers)} of {STREAM}"


def stream_to_fuyu():
    heard, _ = listen("counted", Int64, profile(100))
    there = publisher("upstream", JointState, profile(4000))
    names = [f"joint{i}" for i in range(1, 7)]
    state = JointState(name=names, position=[0.1] * 6, velocity=[0.2] * 6, effort=[0.3] * 6)
    due = time.monotonic()
    for number in range(STREAM):
        state.header.stamp.sec, state.header.stamp.nanosec = divmod(number, 1000)
        there.publish(state)
        due += 0.001
        time.sleep(max(0.0, due - time.monotonic()))
    eventually(lambda: heard and heard[-1].data >= STREAM)
    counted = heard[-1].data if heard else 0
    return counted == STREAM, f"{counted} of {STREAM}"


def ask(kind, name, request):
    client = node.create_client(kind, name)
    if not client.wait_for_service(PATIENCE):
        raise TimeoutError(f"no service {name}")
    future = client.call_async(request)
    eventually(future.done)
    return future.result()


def service():
    answer = ask(Trigger, "ping", Trigger.Request())
    return answer is not None and answer.success and answer.message == "pong", answer


def parameters():
    names = ask(ListParameters, "echo/list_parameters", ListParameters.Request()).result.names
    described = ask(DescribeParameters, "echo/describe_parameters", DescribeParameters.Request(names=["gain"]))
    limit = described.descriptors[0].floating_point_range[0].to_value
    def set_to(number):
        wanted = SetParameters.Request(parameters=[Parameter("gain", value=number).to_parameter_msg()])
        return ask(SetParameters, "echo/set_parameters", wanted).results[0].successful
    good, bad = set_to(2.5), set_to(11.0)
    got = ask(GetParameters, "echo/get_parameters", GetParameters.Request(names=["gain"])).values[0].double_value
    return "gain" in names and limit == 10.0 and good and not bad and got == 2.5, f"{names} {limit} {good} {bad} {got}"


# The client, and goals that more than one row has a part in.
seen = {}
ENDLESS = 1_000_000


def send(steps, **more):
    """A goal for `steps`, and where its feedback goes."""
    if "client" not in seen:
        seen["client"] = ActionClient(node, SimulateSteps, "steps")
    client = seen["client"]
    if not client.wait_for_server(PATIENCE):
        raise TimeoutError("no action steps")
    heard = []
    on_feedback = lambda message: heard.append(message.feedback.completed_steps)
    future = spinning(client.send_goal_async, SimulateSteps.Goal(steps=steps), feedback_callback=on_feedback, **more)
    if not eventually(future.done):
        raise TimeoutError("no answer to a goal")
    return future.result(), heard


def outcome_of(goal):
    future = spinning(goal.get_result_async)
    if not eventually(future.done):
        raise TimeoutError("no outcome")
    return future.result()


def goal_taken():
    seen["endless"] = goal, _ = send(ENDLESS)
    return goal.accepted and goal.stamp.sec > 0, goal.stamp


def goal_cancelled():
    goal, heard = seen["endless"]
    eventually(lambda: len(heard) >= 3)
    cancel = spinning(goal.cancel_goal_async)
    if not eventually(cancel.done):
        raise TimeoutError("no answer to a cancellation")
    named = [bytes(info.goal_id.uuid) for info in cancel.result().goals_canceling]
    status = outcome_of(goal).status
    ours = named == [bytes(goal.goal_id.uuid)]
    return ours and status == GoalStatus.STATUS_CANCELED and len(heard) >= 3, f"{status} {len(heard)}"


def goal_feedback():
    seen["short"], heard = send(40)
    eventually(lambda: heard[-1:] == [40])
    # rclpy keeps the last ten while it is busy.
    return heard[-1:] == [40] and heard == sorted(set(heard)), heard


def goal_outcome():
    outcome = outcome_of(seen["short"])
    error_message = outcome.result.result.error_message
    return outcome.status == GoalStatus.STATUS_SUCCEEDED and error_message == "40 steps", outcome


def goal_refused():
    """Two goals cannot have one identity."""
    same = UUID(uuid=list(range(16)))
    first, _ = send(1, goal_uuid=same)
    second, _ = send(1, goal_uuid=same)
    return first.accepted and not second.accepted, f"{first.accepted} {second.accepted}"


def retained_from_fuyu():
    heard, _ = listen("retained", String, profile(1, latched=True))
    eventually(lambda: heard)
    return [m.data for m in heard] == ["from before"], heard


def retained_to_fuyu():
    heard, _ = listen("heard", String, profile())
    there = node.create_publisher(String, "peer_retained", profile(1, latched=True))
    there.publish(String(data="from before"))
    late = publisher("come_late", Int32, profile())
    late.publish(Int32())
    eventually(lambda: heard)
    return bool(heard) and heard[0].data == "from before", heard


def compatible():
    taken, _ = listen("best_effort", String, profile(5, reliable=False))
    eventually(lambda: len(taken) > 3)
    return len(taken) > 3, f"{len(taken)}"


def subscription_refused():
    reported = []
    events = SubscriptionEventCallbacks(incompatible_qos=reported.append)
    heard = []
    node.create_subscription(String, "best_effort", heard.append, profile(), event_callbacks=events)
    eventually(lambda: reported)
    return bool(reported) and not heard, reported


def publisher_refused():
    reported = []
    events = PublisherEventCallbacks(incompatible_qos=reported.append)
    node.create_publisher(String, "reliable_please", profile(reliable=False), event_callbacks=events)
    eventually(lambda: reported)
    return bool(reported), reported


def graph():
    seen = lambda: ("echo", "/") in node.get_node_names_and_namespaces()
    eventually(seen)
    def kinds():
        found = dict(node.get_publisher_names_and_types_by_node("echo", "/"))
        return found.get("/stream") == ["sensor_msgs/msg/JointState"]
    return seen() and bool(eventually(kinds)), node.get_node_names_and_namespaces()


def type_hash():
    eventually(lambda: node.get_publishers_info_by_topic("stream"))
    found = str(node.get_publishers_info_by_topic("stream")[0].topic_type_hash)
    return found.startswith("RIHS01_a13ee3a3"), found


run(globals(), asked["types"])
# Not in order: the thread that spins would be in the way.
os._exit(0)
