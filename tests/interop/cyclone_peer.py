"""The CycloneDDS side of the interop matrix: the topics of ROS spoken by plain DDS, without any code of ROS."""

import os
import re
import time

os.environ["CYCLONEDDS_URI"] = """<CycloneDDS><Domain>
<General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces><AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>20</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import make_idl_struct, types
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from rows import STREAM, Values, eventually, request, run

ELEMENTARY = {
    "bool": bool,
    "byte": types.uint8,
    "char": types.uint8,
    "float32": types.float32,
    "float64": types.float64,
    "int8": types.int8,
    "uint8": types.uint8,
    "int16": types.int16,
    "uint16": types.uint16,
    "int32": types.int32,
    "uint32": types.uint32,
    "int64": types.int64,
    "uint64": types.uint64,
    "string": str,
}
KIND = re.compile(r"([\w/]+?)(?:<=\d+)?(?:\[(<=)?(\d*)\])?$")

asked = request()
participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
classes = {}


def fields(name):
    """Name and kind of each field of a message, from its text."""
    for line in asked["texts"][name].splitlines():
        words = line.split("#")[0].split()
        if len(words) >= 2 and "=" not in " ".join(words).replace("<=", ""):
            kind = words[0]
            package = name.split("/")[0]
            base = KIND.match(kind)[1]
            if base not in ELEMENTARY and "/" not in base:
                kind = kind.replace(base, f"{package}/{base}", 1)
            yield words[1], kind


def parts(kind):
    """Base, how many, and whether these are a limit only."""
    base, limit, count = KIND.match(kind).groups()
    whole = "[" in kind
    return base, (int(count) if count else None) if whole else 1, whole, bool(limit)


def full(base):
    if base in ELEMENTARY:
        return base
    name = base.replace("/", "/msg/")
    return name if name in asked["texts"] else base.replace("/", "/action/")


def struct(name):
    if name not in classes:
        package, space, short = name.split("/")
        made = {field: idl_type(kind) for field, kind in fields(name)}
        # DDS has no struct without members; ROS puts this one in.
        made = made or {"structure_needs_at_least_one_member": types.uint8}
        classes[name] = make_idl_struct(f"{short}_", f"{package}::{space}::dds_::{short}_", made)
    return classes[name]


def idl_type(kind):
    base, count, whole, limit = parts(kind)
    inner = ELEMENTARY[base] if base in ELEMENTARY else struct(full(base))
    if not whole:
        return inner
    if count is None:
        return types.sequence[inner]
    return types.sequence[inner, count] if limit else types.array[inner, count]


def filled(name, values):
    made = {field: value(kind, values) for field, kind in fields(name)}
    return struct(name)(**(made or {"structure_needs_at_least_one_member": 0}))


def value(kind, values):
    base, count, whole, limit = parts(kind)
    one = lambda: values.of(base) if base in ELEMENTARY else filled(full(base), values)
    if not whole:
        return one()
    if count is None or limit:
        count = min(values.length(), count or 9)
    return [one() for _ in range(count)]


def qos(depth=10, reliable=True, latched=False):
    return Qos(
        Policy.Reliability.Reliable(duration(seconds=1)) if reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )


def reader(topic, name, *how, prefix="rt", **more):
    policies = qos(*how, **more)
    return DataReader(participant, Topic(participant, f"{prefix}/{topic}", struct(name), qos=policies), qos=policies)


def writer(topic, name, *how, prefix="rt", states=(), **more):
    policies = qos(*how, **more)
    topic = Topic(participant, f"{prefix}/{topic}", struct(name), qos=policies)
    return DataWriter(participant, topic, qos=Qos(*states, base=policies))


def matched(endpoint, status):
    found = lambda: getattr(endpoint, status)().current_count > 0
    if not eventually(found):
        raise TimeoutError("no match")


def publisher(topic, name, *how, **more):
    made = writer(topic, name, *how, **more)
    matched(made, "get_publication_matched_status")
    return made


def plain(message):
    """Values without classes, for a comparison."""
    if hasattr(message, "__dataclass_fields__"):
        return [plain(getattr(message, name)) for name in message.__dataclass_fields__]
    if isinstance(message, (list, tuple, bytes)):
        return [plain(part) for part in message]
    return message


def there_and_back(name):
    def test():
        package, _, short = name.split("/")
        back = reader(f"out/{package}/{short}", name)
        there = publisher(f"in/{package}/{short}", name)
        matched(back, "get_subscription_matched_status")
        sent = filled(name, Values(name))
        heard = []

        def echoed():
            there.write(sent)
            return eventually(lambda: heard.extend(back.take(10)) or heard, 2.0)

        came = eventually(echoed)
        same = came and plain(heard[0]) == plain(sent)
        return same, "" if same else f"{sent} came back as {heard[:1]}"

    return test


INT32, INT64 = "std_msgs/msg/Int32", "std_msgs/msg/Int64"
STRING, STATE, IMAGE = "std_msgs/msg/String", "sensor_msgs/msg/JointState", "sensor_msgs/msg/Image"


def image():
    back = reader("out/sensor_msgs/Image", IMAGE)
    there = publisher("in/sensor_msgs/Image", IMAGE)
    matched(back, "get_subscription_matched_status")
    sent = filled(IMAGE, Values("image"))
    sent.data = [i % 251 for i in range(900_000)]
    heard = []
    for number in range(1, 6):
        sent.header.frame_id = str(number)
        there.write(sent)
        if not eventually(lambda: heard.extend(back.take(10)) or len(heard) >= number):
            return False, f"image {number} is not back"
    return all(list(m.data) == sent.data for m in heard), "5 of 900 kB"


def number(message):
    return message.header.stamp.sec * 1000 + message.header.stamp.nanosec


def stream_from_fuyu():
    back = reader("stream", STATE, 4000)
    start = publisher("start_stream", INT32)
    matched(back, "get_subscription_matched_status")
    for _ in range(3):
        heard = []
        start.write(struct(INT32)(data=STREAM))
        if eventually(lambda: heard.extend(back.take(5000)) or len(heard) >= STREAM, 20.0):
            break
    numbers = [number(m) for m in heard]
    return numbers == list(range(STREAM)), f"{len(numbers)} of {STREAM}"


def stream_to_fuyu():
    counted = reader("counted", INT64, 100)
    there = publisher("upstream", STATE, 4000)
    matched(counted, "get_subscription_matched_status")
    state = filled(STATE, Values("state"))
    due = time.monotonic()
    for count in range(STREAM):
        state.header.stamp.sec, state.header.stamp.nanosec = divmod(count, 1000)
        there.write(state)
        due += 0.001
        time.sleep(max(0.0, due - time.monotonic()))
    heard = []
    eventually(lambda: heard.extend(counted.take(100)) or heard and heard[-1].data >= STREAM)
    count = heard[-1].data if heard else 0
    return count == STREAM, f"{count} of {STREAM}"


class Client:
    """Calls a service as plain DDS may: the bare request goes out, and there is nobody else whom an answer is for."""

    def __init__(self, service, kind):
        self.request = struct(f"{kind}_Request")
        self.answers = reader(f"{service}Reply", f"{kind}_Response", prefix="rr")
        self.requests = writer(f"{service}Request", f"{kind}_Request", prefix="rq")
        matched(self.answers, "get_subscription_matched_status")
        matched(self.requests, "get_publication_matched_status")

    def send(self, **fields):
        self.requests.write(self.request(**fields))

    def answer(self):
        heard = []
        if not eventually(lambda: heard.extend(self.answers.take(1)) or heard):
            raise TimeoutError("no answer")
        return heard[0]

    def call(self, **fields):
        self.send(**fields)
        return self.answer()


# ROS puts an octet into a request without fields.
NOTHING = {"structure_needs_at_least_one_member": 0}


def service():
    answer = Client("ping", "std_srvs/srv/Trigger").call(**NOTHING)
    return answer.success and answer.message == "pong", answer


def parameters():
    client = lambda name: Client(f"echo/{name[0]}", f"rcl_interfaces/srv/{name[1]}")
    listed = client(("list_parameters", "ListParameters")).call(prefixes=[], depth=0)
    described = client(("describe_parameters", "DescribeParameters")).call(names=["gain"])
    limit = described.descriptors[0].floating_point_range[0].to_value
    setting = client(("set_parameters", "SetParameters"))

    def set_to(number):
        parameter = filled("rcl_interfaces/msg/Parameter", Values("parameter"))
        parameter.name, parameter.value.type, parameter.value.double_value = "gain", 3, number
        return setting.call(parameters=[parameter]).results[0].successful

    good, bad = set_to(2.5), set_to(11.0)
    got = client(("get_parameters", "GetParameters")).call(names=["gain"]).values[0].double_value
    names = listed.result.names
    return "gain" in names and limit == 10.0 and good and not bad and got == 2.5, f"{names} {limit} {good} {bad} {got}"


STEPS = "simulation_interfaces/action/SimulateSteps"
# Constants of action_msgs/GoalStatus.
SUCCEEDED, CANCELED = 4, 5
# The parts of an action; made once, when first asked for.
parts_of_action = {}


def steps():
    if not parts_of_action:
        parts_of_action.update(
            send=Client("steps/_action/send_goal", f"{STEPS}_SendGoal"),
            result=Client("steps/_action/get_result", f"{STEPS}_GetResult"),
            cancel=Client("steps/_action/cancel_goal", "action_msgs/srv/CancelGoal"),
            feedback=reader("steps/_action/feedback", f"{STEPS}_FeedbackMessage", 1000),
        )
        matched(parts_of_action["feedback"], "get_subscription_matched_status")
    return parts_of_action


def identity(number):
    return struct("unique_identifier_msgs/msg/UUID")(uuid=[number] * 16)


def send_goal(number, count):
    return steps()["send"].call(goal_id=identity(number), goal=struct(f"{STEPS}_Goal")(steps=count))


def feedback_of(number, until):
    """Completed steps in the feedback of a goal, until `until` holds."""
    heard = []

    def enough():
        new = steps()["feedback"].take(1000)
        heard.extend(m.feedback.completed_steps for m in new if list(m.goal_id.uuid) == [number] * 16)
        return until(heard)

    eventually(enough)
    return heard


def goal_taken():
    answer = send_goal(1, 1_000_000)
    return answer.accepted and answer.stamp.sec > 0, answer


def goal_cancelled():
    heard = feedback_of(1, lambda heard: len(heard) >= 3)
    steps()["result"].send(goal_id=identity(1))
    when = struct("builtin_interfaces/msg/Time")(sec=0, nanosec=0)
    which = struct("action_msgs/msg/GoalInfo")(goal_id=identity(1), stamp=when)
    named = [list(info.goal_id.uuid) for info in steps()["cancel"].call(goal_info=which).goals_canceling]
    status = steps()["result"].answer().status
    return named == [[1] * 16] and status == CANCELED and len(heard) >= 3, f"{status} {len(heard)}"


def goal_feedback():
    taken = send_goal(2, 40).accepted
    heard = feedback_of(2, lambda heard: heard[-1:] == [40])
    return taken and heard == list(range(1, 41)), heard


def goal_outcome():
    answer = steps()["result"].call(goal_id=identity(2))
    return answer.status == SUCCEEDED and answer.result.result.error_message == "40 steps", answer


def goal_refused():
    """Two goals cannot have one identity."""
    first, second = send_goal(3, 1).accepted, send_goal(3, 1).accepted
    return first and not second, f"{first} {second}"


def retained_from_fuyu():
    back, heard = reader("retained", STRING, 1, latched=True), []
    eventually(lambda: heard.extend(back.take(10)) or heard)
    return [m.data for m in heard] == ["from before"], heard


def retained_to_fuyu():
    back, heard = reader("heard", STRING), []
    there = writer("peer_retained", STRING, 1, latched=True)
    there.write(struct(STRING)(data="from before"))
    late = publisher("come_late", INT32)
    matched(back, "get_subscription_matched_status")
    late.write(struct(INT32)(data=0))
    eventually(lambda: heard.extend(back.take(10)) or heard)
    return bool(heard) and heard[0].data == "from before", heard


def compatible():
    back, heard = reader("best_effort", STRING, reliable=False), []
    eventually(lambda: heard.extend(back.take(10)) or len(heard) > 3)
    return len(heard) > 3, len(heard)


def subscription_refused():
    back, heard = reader("best_effort", STRING), []
    refused = lambda: back.get_requested_incompatible_qos_status().total_count > 0
    eventually(refused)
    heard.extend(back.take(10))
    return refused() and not heard, heard


def publisher_refused():
    there = writer("reliable_please", STRING, reliable=False)
    refused = lambda: there.get_offered_incompatible_qos_status().total_count > 0
    eventually(refused)
    return refused(), ""


# What a node of ROS states that has another definition of a type; fuyu is to notice.
OTHER = Policy.Userdata(b"typehash=RIHS01_" + 64 * b"0" + b";")
other_definition = writer("start_stream", INT32, states=[OTHER])

run(globals(), asked["types"])
