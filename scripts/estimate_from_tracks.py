#!/usr/bin/env python3
"""Prediction error of `fuyu estimate` from tracked and from ideal points.

Every FOLDER is written by `cargo run --release -p fuyu-track --example sequence`. Needs numpy and `fuyu` in the PATH (or FUYU).
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

CAMERA = ["--fx", "640", "--fy", "640", "--cx", "319.5", "--cy", "239.5"]


def matrix(q):
    x, y, z, w = np.asarray(q) / np.linalg.norm(q)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])


def error(folder, table):
    """Angle between predicted and true rotation since the last frame, 60 s after it [deg]."""
    command = [os.environ.get("FUYU", "fuyu"), "estimate", str(folder / table), *CAMERA]
    command += ["--predict", "60", "--predict-rate", "10", "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        return done.stderr.strip().splitlines()[-1]
    found = json.loads(done.stdout)
    attitudes = {round(row[0], 3): matrix(row[1:]) for row in np.loadtxt(folder / "attitudes.csv", delimiter=",", skiprows=1)}
    first, last = found["prediction"][0], found["prediction"][-1]
    if round(last["t"], 3) not in attitudes:
        return f"the last points are at {first['t']:.1f} s"
    turned = matrix(last["q"]) @ matrix(first["q"]).T
    truth = attitudes[round(last["t"], 3)] @ attitudes[round(first["t"], 3)].T
    cosine = (np.trace(turned.T @ truth) - 1) / 2
    return f"{np.degrees(np.arccos(np.clip(cosine, -1, 1))):.2f} (residual {found['rms']:.3f} px)"


def main():
    print("| images | points a frame | error after 60 s from pixels [deg] | from ideal points [deg] |")
    print("| --- | --- | --- | --- |")
    for folder in map(Path, sys.argv[1:]):
        tracks = np.loadtxt(folder / "tracks.csv", delimiter=",", skiprows=1).reshape(-1, 4)
        images = len(np.loadtxt(folder / "times.csv"))
        print(f"| {folder.name} | {len(tracks) / images:.0f} | {error(folder, 'tracks.csv')} | {error(folder, 'ideal.csv')} |")


if __name__ == "__main__":
    main()
