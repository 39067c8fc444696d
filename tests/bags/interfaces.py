"""Compares definitions (JSON on stdin: type name -> text and RIHS01 hash) with those of the installed ROS 2."""

import json
import sys
from pathlib import Path

from rosbags.typesys import get_types_from_msg

share = Path(sys.prefix) / "share"
hashes = {}
for file in share.glob("*/*/*.json"):
    for entry in json.loads(file.read_text()).get("type_hashes", []):
        hashes[entry["type_name"]] = entry["hash_string"]


def reference(name):
    """The text of a message, or of the part of a service."""
    package, kind, type_name = name.split("/")
    if kind == "action":  # its parts follow from one file; their hashes are compared
        return None
    if kind == "msg":
        return (share / package / "msg" / f"{type_name}.msg").read_text()
    service, part = type_name.rsplit("_", 1)
    lines = (share / package / "srv" / f"{service}.srv").read_text().splitlines()
    cut = lines.index("---")
    lines = lines[:cut] if part == "Request" else lines[cut + 1 :]
    # Constants of services are not declared in Rust: none is used.
    return "\n".join(line for line in lines if "=" not in line.split("#")[0] or "<=" in line)


def parsed(text, name):
    package = name.split("/")[0]
    return json.dumps(get_types_from_msg(text, f"{package}/msg/Compared"), default=str)


report = {"compared": [], "differing": [], "missing": []}
for name, ours in json.load(sys.stdin).items():
    if name not in hashes:
        report["missing"].append(name)
        continue
    report["compared"].append(name)
    if hashes[name] != ours["hash"]:
        report["differing"].append(f"{name}: hash {ours['hash']} instead of {hashes[name]}")
    if reference(name) and parsed(ours["text"], name) != parsed(reference(name), name):
        report["differing"].append(f"{name}: {parsed(ours['text'], name)} instead of {parsed(reference(name), name)}")
json.dump(report, sys.stdout)
