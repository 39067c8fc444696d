"""Two operators and a watcher at the server of `fuyu launch --cockpit`; prints what they experience."""

import json
import socket
import struct
import sys
import threading
import time

from mcap_ros2._dynamic import generate_dynamic
from websockets.sync.client import connect

url, token = sys.argv[1], sys.argv[2]
PATIENCE = 60
HEADER = b"\0\1\0\0"


class Client:
    """A client of foxglove.sdk.v1 that remembers what it receives."""

    def __init__(self, query):
        self.socket = connect(f"{url}/{query}", subprotocols=["foxglove.sdk.v1"], max_size=None)
        self.info, self.channels, self.services, self.statuses = None, {}, {}, []
        self.replies, self.parameters, self.rates, self.decoders = {}, {}, [], {}
        self.calls = 0
        threading.Thread(target=self.listen, daemon=True).start()
        self.wait(lambda: self.info and "/joint_states" in self.channels)
        wish = {"id": 1, "channelId": self.channels["/joint_states"]["id"]}
        self.send({"op": "subscribe", "subscriptions": [wish]})

    def send(self, message):
        self.socket.send(json.dumps(message))

    def listen(self):
        try:
            for message in self.socket:
                self.take(message)
        except Exception:  # The connection ends.
            pass

    def take(self, message):
        if isinstance(message, str):
            message = json.loads(message)
            if message["op"] == "serverInfo":
                self.info = message
            elif message["op"] == "advertise":
                self.channels |= {c["topic"]: c for c in message["channels"]}
            elif message["op"] == "advertiseServices":
                self.services |= {s["name"]: s for s in message["services"]}
            elif message["op"] == "status":
                self.statuses.append(message["message"])
            elif message["op"] == "serviceCallFailure":
                self.replies[message["callId"]] = message["message"]
            elif message["op"] == "parameterValues":
                self.parameters |= {p["name"]: p.get("value") for p in message["parameters"]}
        elif message[0] == 1:
            channel = self.channels["/joint_states"]
            decode = self.decoders.setdefault("joints", generate_dynamic(channel["schemaName"], channel["schema"]))
            state = decode[channel["schemaName"]](message[13:])
            self.rates.append((time.monotonic(), max(map(abs, state.velocity))))
        elif message[0] == 3:
            _, call, length = struct.unpack_from("<III", message, 1)
            self.replies[call] = message[13 + length :]

    def wait(self, condition, patience=PATIENCE):
        start = time.monotonic()
        while not condition():
            if time.monotonic() > start + patience:
                sys.exit(f"not within {patience} s; told: {self.statuses}")
            time.sleep(0.002)
        return time.monotonic() - start

    def call(self, name, request):
        self.wait(lambda: name in self.services)
        self.calls += 1
        head = struct.pack("<BIII", 2, self.services[name]["id"], self.calls, 3)
        self.socket.send(head + b"cdr" + HEADER + request)
        self.wait(lambda: self.calls in self.replies)
        reply = self.replies[self.calls]
        return reply if isinstance(reply, str) else list(reply[4:])

    def advertise(self, topic, kind):
        channel = {"id": 7, "topic": topic, "encoding": "cdr", "schemaName": kind}
        self.send({"op": "advertise", "channels": [channel]})

    def push(self, deflection, pressed=1, age=0.0):
        """Axis 0 of the joystick is y, button 0 enables."""
        now = time.time() - age
        stamp = struct.pack("<iI", int(now), int(now % 1 * 1e9))
        axes = [deflection, 0, 0, 0, 0]
        body = stamp + struct.pack("<I", 1) + b"\0" * 4 + struct.pack("<I5f", 5, *axes) + struct.pack("<Ii", 1, pressed)
        self.socket.send(struct.pack("<BI", 1, 7) + HEADER + body)

    def moves(self):
        return bool(self.rates) and self.rates[-1][1] > 2e-4

    def slows(self, since):
        """Time from `since` until the joints have half of their fastest rate then."""
        rate = self.rates[-1][1]
        self.wait(lambda: self.rates[-1][1] < rate / 2)
        return time.monotonic() - since

    def push_until(self, condition):
        start = time.monotonic()
        while not condition():
            if time.monotonic() > start + PATIENCE:
                sys.exit(f"the push has no effect; told: {self.statuses}")
            self.push(0.5)
            time.sleep(0.02)


report = {}
watcher, wrong = Client(""), Client("?token=0")
report["watcher"], report["wrong"] = watcher.info["capabilities"], wrong.info["capabilities"]
first, second = Client(f"?token={token}"), Client(f"?token={token}")
report["operator"] = first.info["capabilities"]

# Nobody has control yet: changing services and parameters are refused.
report["refused_call"] = first.call("/dynamics/set_simulation_state", b"\2")
first.send({"op": "getParameters", "parameterNames": ["/teleop.method", "/teleop.rate"], "id": "a"})
first.wait(lambda: len(first.parameters) == 2)
report["method"] = first.parameters["/teleop.method"]
value = {"name": "/teleop.method", "value": "transpose_generalized"}
first.send({"op": "setParameters", "parameters": [value], "id": "b"})
first.wait(lambda: any("take control" in s for s in first.statuses))

first.advertise("/joy", "sensor_msgs/msg/Joy")
first.push_until(watcher.moves)
second.advertise("/joy", "sensor_msgs/msg/Joy")
second.push(0.5)
second.wait(lambda: any("another client has control" in s for s in second.statuses))
report["second_takes"] = second.call("/foxglove/control", b"\1")[0]
first.send({"op": "setParameters", "parameters": [value], "id": "c"})
first.wait(lambda: first.parameters["/teleop.method"] == "transpose_generalized")
# At full speed.
push = time.monotonic() + 1.0
first.push_until(lambda: watcher.moves() and time.monotonic() > push)
# Without a closing handshake, as when a page is killed.
closed = time.monotonic()
first.socket.socket.shutdown(socket.SHUT_RDWR)
report["slowed_after_close"] = watcher.slows(closed)
watcher.wait(lambda: not watcher.moves())

report["second_takes_then"] = second.call("/foxglove/control", b"\1")[0]
push = time.monotonic() + 1.0
second.push_until(lambda: watcher.moves() and time.monotonic() > push)
silent = time.monotonic()
report["slowed_after_silence"] = watcher.slows(silent)
watcher.wait(lambda: not watcher.moves())
time.sleep(1.0)
# Control has expired; what the client sends without asking has no effect.
second.statuses.clear()
for _ in range(20):
    second.push(0.5)
    time.sleep(0.02)
report["moves_without_asking"] = watcher.moves()
second.wait(lambda: any("must take it again" in s for s in second.statuses))
report["asks"] = second.call("/foxglove/control", b"\1")[0]
second.push(0.0, pressed=0)
# Commands that were held up for 2 s.
for _ in range(20):
    second.push(0.5, age=2.0)
    time.sleep(0.02)
report["moves_by_late_commands"] = watcher.moves()
second.push_until(watcher.moves)
report["call"] = second.call("/dynamics/get_simulation_state", b"\0")[0]
second.send({"op": "advertise", "channels": [{"id": 8, "topic": "/joint_commands", "encoding": "cdr", "schemaName": "sensor_msgs/msg/JointState"}]})
second.wait(lambda: any("/joint_commands: clients may publish on" in s for s in second.statuses))
json.dump(report, sys.stdout)
