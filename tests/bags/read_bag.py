"""Reads a bag with `rosbags` and with `mcap-ros2-support`, decodes every message, prints what it found."""

import json
import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

bag = Path(sys.argv[1])
report = {"rosbags": {}, "mcap": {}, "undecoded": []}

with AnyReader([bag]) as reader:
    for connection in reader.connections:
        report["rosbags"].setdefault(connection.topic, 0)
        if connection.topic == "/robot_description":
            report["durability"] = connection.ext.offered_qos_profiles[0].durability.name
        if connection.topic == "/joint_states":
            report["hash"] = connection.digest
    for connection, _, raw in reader.messages():
        report["rosbags"][connection.topic] += 1
        if connection.msgtype in reader.typestore.types:
            message = reader.deserialize(raw, connection.msgtype)
            if connection.topic == "/joint_states":
                report["last_position"] = list(message.position)
        elif connection.topic not in report["undecoded"]:
            report["undecoded"].append(connection.topic)

(file,) = bag.glob("*.mcap")
with file.open("rb") as stream:
    reader = make_reader(stream, validate_crcs=True)
    assert reader.get_header().profile == "ros2"
    factory = DecoderFactory()
    decoders = {}
    for schema, channel, message in reader.iter_messages():
        report["mcap"].setdefault(channel.topic, 0)
        report["mcap"][channel.topic] += 1
        if channel.id not in decoders:
            decoders[channel.id] = factory.decoder_for(channel.message_encoding, schema)
        if decoder := decoders[channel.id]:
            decoder(message.data)
        else:
            assert channel.topic in report["undecoded"], channel.topic

json.dump(report, sys.stdout)
