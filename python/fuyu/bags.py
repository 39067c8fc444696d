"""Recordings (rosbag2 in MCAP) as Arrow tables."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from ._fuyu import InputError, bag_topics, convert_bag

if TYPE_CHECKING:
    import pyarrow


class Bag:
    """A recording: a folder or an .mcap file, of fuyu or of any ROS 2 graph.

    A topic is a table with a row per message and a column per value, of any message type whose schema is in the bag. `log_time` and
    `publish_time` are the times of recording and of sending [ns]. Sequences are columns NAME[0], NAME[1], ..., as many as
    the longest one has elements. Needs pyarrow (`pip install fuyu[arrow]`).
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._topics = bag_topics(self.path)

    @property
    def topics(self) -> dict[str, str]:
        """ROS types by topic."""
        return {topic: kind for topic, (kind, _) in self._topics.items()}

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of messages by topic."""
        return {topic: count for topic, (_, count) in self._topics.items()}

    def table(self, topic: str) -> pyarrow.Table:
        """The messages of one topic."""
        return self.tables([topic])[topic]

    def tables(self, topics: list[str] | None = None) -> dict[str, pyarrow.Table]:
        """The messages of these topics, by topic; of all topics that can be tables by default."""
        import pyarrow.parquet

        for topic in topics or []:
            if topic not in self._topics:
                raise InputError(f"bag {self.path}: has no topic {topic}; it has {', '.join(self._topics)}")
        with tempfile.TemporaryDirectory(prefix="fuyu-") as folder:
            files = convert_bag(self.path, Path(folder), topics)
            # Read into memory, since the files vanish.
            return {topic: pyarrow.parquet.read_table(file, memory_map=False) for topic, file in files.items()}

    def __repr__(self) -> str:
        return f"fuyu.Bag({str(self.path)!r})"
