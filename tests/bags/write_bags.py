"""Writes bags of two topics with `rosbags`, one of them of an unknown type."""

import sys
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
store.register(get_types_from_msg("float64 force", "acme_msgs/msg/Finger"))
store.register(
    get_types_from_msg(
        "string name\nbool open\nFinger[] fingers\nuint8[] code\nint32 LIMIT=3",
        "acme_msgs/msg/Gripper",
    )
)
Point = store.types["geometry_msgs/msg/Point"]
Finger = store.types["acme_msgs/msg/Finger"]
Gripper = store.types["acme_msgs/msg/Gripper"]


for name, storage, mode in [
    ("plain", StoragePlugin.MCAP, None),
    ("by_file", StoragePlugin.MCAP, CompressionMode.FILE),
    ("by_message", StoragePlugin.MCAP, CompressionMode.MESSAGE),
    ("sqlite", StoragePlugin.SQLITE3, None),
]:
    writer = Writer(Path(sys.argv[1]) / name, version=9, storage_plugin=storage)
    if mode:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        point = writer.add_connection("/point", Point.__msgtype__, typestore=store)
        gripper = writer.add_connection("/gripper", Gripper.__msgtype__, typestore=store)
        for i in range(20):
            time = 1_000_000 * (i + 1)
            message = Point(x=float(i), y=0.0, z=0.0)
            writer.write(point, time, store.serialize_cdr(message, Point.__msgtype__))
            message = Gripper(
                name=f"hand {i}",
                open=i % 2 == 1,
                fingers=[Finger(force=1.5 * j) for j in range(3)],
                code=np.array([0, i, 255], dtype=np.uint8),
            )
            writer.write(gripper, time, store.serialize_cdr(message, Gripper.__msgtype__))
