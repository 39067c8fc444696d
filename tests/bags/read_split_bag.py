"""Reads a bag of several files with `rosbags`, counts the messages of each topic."""

import collections
import json
import sys
from pathlib import Path

from rosbags.rosbag2 import Reader

counts = collections.Counter()
with Reader(Path(sys.argv[1])) as reader:
    for connection, _, _ in reader.messages():
        counts[connection.topic] += 1
json.dump(counts, sys.stdout)
