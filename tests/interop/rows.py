"""The rows of the interop matrix, values for messages, and how a peer reports: one JSON line for each row."""

import json
import random
import sys
import time

# What comes at once on an idle machine may take this long [s].
PATIENCE = 60.0
STREAM = 2000

# What a row says, and the function of a peer that finds out; a peer that cannot be asked has no such function.
BEFORE = [
    ("node, topics and types in the graph", "graph"),
    ("late joiner, what fuyu retained", "retained_from_fuyu"),
    ("late joiner, what fuyu gets", "retained_to_fuyu"),
]
AFTER = [
    ("service of fuyu", "service"),
    ("parameters of fuyu", "parameters"),
    # In this order: when the goal that goes on for ever has given feedback, both sides know all there is.
    ("action of fuyu: a goal is taken", "goal_taken"),
    ("action of fuyu: cancelled", "goal_cancelled"),
    ("action of fuyu: feedback", "goal_feedback"),
    ("action of fuyu: outcome", "goal_outcome"),
    ("action of fuyu: a goal is refused", "goal_refused"),
    ("images of 900 kB", "image"),
    ("1 kHz joint states from fuyu, reliable", "stream_from_fuyu"),
    ("1 kHz joint states to fuyu, reliable", "stream_to_fuyu"),
    ("best effort where it is asked for", "compatible"),
    ("reliable requested, best effort offered: the peer is notified", "subscription_refused"),
    ("best effort publisher, reliable subscriber: the peer is notified", "publisher_refused"),
    ("type hash in the graph", "type_hash"),
]


def run(peer, types):
    """All rows that a peer, a dictionary of its functions, has a part in; then waits until they have been read."""
    for name, test in BEFORE:
        attempt(name, peer.get(test))
    for name in types:
        attempt(f"`{name}`", peer["there_and_back"](name))
    for name, test in AFTER:
        attempt(name, peer.get(test))
    print("{}", flush=True)
    request()


def row(name, verdict, detail=""):
    print(json.dumps({"row": name, "verdict": bool(verdict), "detail": str(detail)}), flush=True)


def eventually(done, patience=PATIENCE):
    """What `done` gives as soon as it is not false; false after `patience`."""
    end = time.monotonic() + patience
    while True:
        found = done()
        if found or time.monotonic() > end:
            return found
        time.sleep(0.01)


def attempt(name, test):
    """A row, whatever happens."""
    if test is None:
        return
    try:
        verdict, detail = test()
    except Exception as e:  # a row that fails must not take the others along
        verdict, detail = False, f"{type(e).__name__}: {e}"
    row(name, verdict, detail)


class Values:
    """Values of elementary types that are the same in every run, none of them a default."""

    LIMITS = {
        "bool": None,
        "byte": (1, 255),
        "char": (1, 255),
        "int8": (-128, 127),
        "uint8": (1, 255),
        "int16": (-(2**15), 2**15 - 1),
        "uint16": (1, 2**16 - 1),
        "int32": (-(2**31), 2**31 - 1),
        "uint32": (1, 2**32 - 1),
        "int64": (-(2**63), 2**63 - 1),
        "uint64": (1, 2**64 - 1),
    }

    def __init__(self, seed):
        self.random = random.Random(seed)

    def of(self, kind):
        if kind == "bool":
            return True
        if kind in self.LIMITS:
            return self.random.randint(*self.LIMITS[kind])
        if kind == "float32":
            return self.random.randint(-(2**20), 2**20) / 64.0
        if kind == "float64":
            return self.random.uniform(-1e3, 1e3)
        if kind == "string":
            # Lengths of all remainders, letters of more than one byte.
            return "übung"[: self.random.randint(1, 5)] * self.random.randint(1, 3)
        raise ValueError(f"no value for {kind}")

    def length(self):
        return self.random.randint(1, 5)


def request():
    """What the test asks: one JSON object on stdin."""
    return json.loads(sys.stdin.readline())
