"""A client of foxglove.sdk.v1: subscribes to topics, decodes a message of each, prints them."""

import base64
import json
import struct
import sys
import time

from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory
from mcap_ros2._dynamic import generate_dynamic
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

url, topics = sys.argv[1], set(sys.argv[2:])


def plain(value):
    """A decoded message as JSON."""
    if hasattr(value, "__slots__"):
        return {name: plain(getattr(value, name)) for name in value.__slots__}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, (bytes, bytearray)):
        return list(value)
    return value


def protobuf(channel, data):
    """A message of a type that its channel describes."""
    pool = descriptor_pool.DescriptorPool()
    files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"] + "=="))
    for file in files.file:
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))
    return json_format.MessageToDict(kind.FromString(data), preserving_proto_field_name=True)


report = {"messages": {}, "time": 0}
try:
    connect(url, subprotocols=["chat"])
except InvalidStatus as e:
    report["refused"] = e.response.status_code

deadline = time.monotonic() + 120
with connect(url, subprotocols=["foxglove.sdk.v1"], max_size=None) as socket:
    report["subprotocol"] = socket.subprotocol
    channels = {}
    while set(report["messages"]) != topics or not report["time"]:
        if time.monotonic() > deadline:
            sys.exit(f"no {topics - set(report['messages'])} among {[c['topic'] for c in channels.values()]}")
        message = socket.recv(timeout=120)
        if isinstance(message, str):
            message = json.loads(message)
            if message["op"] != "advertise":
                continue
            for channel in message["channels"]:
                channels[channel["id"]] = channel
                if channel["topic"] in topics:
                    # Any number of the client's own.
                    wish = {"id": 1000 + channel["id"], "channelId": channel["id"]}
                    socket.send(json.dumps({"op": "subscribe", "subscriptions": [wish]}))
        elif message[0] == 2:
            (report["time"],) = struct.unpack_from("<Q", message, 1)
        elif message[0] == 1:
            subscription, _ = struct.unpack_from("<IQ", message, 1)
            channel, data = channels[subscription - 1000], message[13:]
            if channel["topic"] in report["messages"]:
                continue
            if channel["encoding"] == "protobuf":
                decoded = protobuf(channel, data)
            else:
                assert channel["schemaEncoding"] == "ros2msg", channel
                decoders = generate_dynamic(channel["schemaName"], channel["schema"])
                decoded = plain(decoders[channel["schemaName"]](data))
            report["messages"][channel["topic"]] = decoded
json.dump(report, sys.stdout)
