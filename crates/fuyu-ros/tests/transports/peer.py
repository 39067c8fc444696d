"""A ROS node without ROS: keys, tokens, attachments and CDR written by hand from the design document of rmw_zenoh.

Usage: peer.py ENDPOINT. Prints JSON, one object per line; ends when its input is closed.
"""

import json
import struct
import sys
import threading
import time

import xxhash
import zenoh
import zenoh.ext

STRING = (
    "std_msgs::msg::dds_::String_/"
    "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
)
SUM = (
    "example_interfaces::srv::dds_::AddTwoInts_/"
    "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
)
DOMAIN = 2
LITTLE_ENDIAN = b"\x00\x01\x00\x00"


def key(name, kind):
    return f"{DOMAIN}/{name}/{kind}"


def string(text):
    data = text.encode() + b"\x00"
    return LITTLE_ENDIAN + struct.pack("<I", len(data)) + data


def text_of(cdr):
    assert cdr[:4] == LITTLE_ENDIAN, cdr[:4]
    (length,) = struct.unpack_from("<I", cdr, 4)
    return cdr[8 : 8 + length - 1].decode()


def attachment(number, gid):
    return struct.pack("<qqB", number, time.time_ns(), 16) + gid


def gid_of(token):
    digest = xxhash.xxh3_128_intdigest(token.encode())
    return digest.to_bytes(16, "little")


def tell(**what):
    print(json.dumps(what), flush=True)


def stated(data):
    """Number and GID of an attachment."""
    number, stamp, length = struct.unpack_from("<qqB", data)
    assert length == 16 and len(data) == 33, data
    age = time.time_ns() - stamp
    assert 0 <= age < 60e9, age
    return number, data[17:]


config = zenoh.Config.from_json5(
    f"""{{
        mode: "peer",
        connect: {{ endpoints: ["{sys.argv[1]}"] }},
        listen: {{ endpoints: ["tcp/127.0.0.1:0"] }},
        scouting: {{ multicast: {{ enabled: false }} }},
        timestamping: {{ enabled: true }},
    }}"""
)
session = zenoh.open(config)
zid = str(session.zid())


def token(number, kind, topic=""):
    return f"@ros2_lv/{DOMAIN}/{zid}/0/{number}/{kind}/%/%/python{topic}"


names = {
    "node": token(0, "NN"),
    "publisher": token(10, "MP", f"/%from_python/{STRING}/::,7:,:,:,,"),
    "subscription": token(11, "MS", f"/%chatter/{STRING}/::,10:,:,:,,"),
    "server": token(12, "SS", f"/%python_sum/{SUM}/::,10:,:,:,,"),
    "client": token(13, "SC", f"/%add_two_ints/{SUM}/::,10:,:,:,,"),
    "latched": token(14, "MP", f"/%python_description/{STRING}/:1:,1:,:,:,,"),
}
tokens = [session.liveliness().declare_token(name) for name in names.values()]

# A latched message, before anybody subscribes.
latched = zenoh.ext.declare_advanced_publisher(
    session,
    key("python_description", STRING),
    cache=zenoh.ext.CacheConfig(max_samples=1),
    publisher_detection=True,
)
for i in range(1, 4):
    latched.put(string(f"description {i}"), attachment=attachment(i, gid_of(names["latched"])))


def serve(query):
    number, gid = stated(query.attachment.to_bytes())
    a, b = struct.unpack_from("<qq", query.payload.to_bytes(), 4)
    query.reply(
        key("python_sum", SUM),
        LITTLE_ENDIAN + struct.pack("<q", a + b),
        attachment=attachment(number, gid),
    )


server = session.declare_queryable(key("python_sum", SUM), serve, complete=True)

heard = []
chatter = session.declare_subscriber(
    key("chatter", STRING),
    lambda sample: heard.append((text_of(sample.payload.to_bytes()), *stated(sample.attachment.to_bytes()))),
)
description = []
late = zenoh.ext.declare_advanced_subscriber(
    session,
    key("description", STRING),
    lambda sample: description.append(text_of(sample.payload.to_bytes())),
    history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
    subscriber_detection=True,
)


def eventually(what, condition):
    deadline = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.005)


def tokens_in_graph():
    replies = session.liveliness().get(f"@ros2_lv/{DOMAIN}/**")
    found = [str(reply.ok.key_expr) for reply in replies if reply.ok]
    return sorted(name for name in found if f"/{zid}/" not in name)


tell(ready=True)
eventually("chatter", lambda: len(heard) >= 3)
graph = tokens_in_graph()
publishers = [name for name in graph if "/MP/" in name and "%chatter" in name]
tell(
    heard=[text for text, _, _ in heard[:3]],
    numbers=[number for _, number, _ in heard[:3]],
    gids_are_those_of_the_token=all(gid == gid_of(publishers[0]) for _, _, gid in heard),
    tokens=graph,
)
eventually("description", lambda: description)
tell(description=description)


def call(number, a, b):
    replies = session.get(
        key("add_two_ints", SUM),
        payload=LITTLE_ENDIAN + struct.pack("<qq", a, b),
        attachment=attachment(number, gid_of(names["client"])),
        target=zenoh.QueryTarget.ALL_COMPLETE,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=20.0,
    )
    for reply in replies:
        number, gid = stated(reply.ok.attachment.to_bytes())
        assert gid == gid_of(names["client"])
        (total,) = struct.unpack_from("<q", reply.ok.payload.to_bytes(), 4)
        return number, total
    return None


tell(sums=[call(number, number, 40) for number in (1, 2, 3)])

stop = threading.Event()


def publish():
    publisher = session.declare_publisher(key("from_python", STRING))
    number = 0
    while not stop.wait(0.01):
        number += 1
        gid = gid_of(names["publisher"])
        publisher.put(string(f"message {number}"), attachment=attachment(number, gid))


thread = threading.Thread(target=publish)
thread.start()
sys.stdin.read()
stop.set()
thread.join()
session.close()
