#!/usr/bin/env python3
"""Prediction error of `fuyu estimate` from tracked and from ideal points, and what the estimator says about it.

The sigma is the root of the trace of the covariance of the predicted rotation. The Mahalanobis error is the error's size in that
covariance: of an exact one, its median is 1.54, and 2.9 % are above 3.

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


def rotation_vector(R):
    w = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine, cosine = np.linalg.norm(w) / 2, (np.trace(R) - 1) / 2
    return w * (0.5 if sine < 1e-12 else np.arctan2(sine, cosine) / (2 * sine))


def predicted(folder, table):
    """Error of the rotation since the last frame, 60 s after it: angle and sigma [deg], Mahalanobis error, residual [px]; or a line that
    says why there is none."""
    command = [os.environ.get("FUYU", "fuyu"), "estimate", str(folder / table), *CAMERA]
    command += ["--predict", "60", "--predict-rate", "10", "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        return "refused: " + done.stderr.strip().splitlines()[-1].split(": ", 2)[-1]
    found = json.loads(done.stdout)
    if "-v" in sys.argv:
        print("\n".join(found["notes"]), file=sys.stderr)
    attitudes = {round(row[0], 3): matrix(row[1:]) for row in np.loadtxt(folder / "attitudes.csv", delimiter=",", skiprows=1)}
    first, last = found["prediction"][0], found["prediction"][-1]
    if round(last["t"], 3) not in attitudes:
        return f"the last points are at {first['t']:.1f} s"
    turned = matrix(last["q"]) @ matrix(first["q"]).T
    truth = attitudes[round(last["t"], 3)] @ attitudes[round(first["t"], 3)].T
    error = rotation_vector(turned @ truth.T)
    C = np.array(last["turn_covariance"])
    mahalanobis = np.sqrt(error @ np.linalg.solve(C, error))
    angle, sigma = np.degrees([np.linalg.norm(error), np.sqrt(np.trace(C))])
    return f"{angle:.2f} | {sigma:.2f} | {mahalanobis:.1f} | {found['rms']:.3f}"


def main():
    print("| images | points a frame | error after 60 s from pixels [deg] | sigma [deg] | Mahalanobis | residual [px] |")
    print("| --- | --- | --- | --- | --- | --- |")
    for folder in (Path(name) for name in sys.argv[1:] if name != "-v"):
        tracks = np.loadtxt(folder / "tracks.csv", delimiter=",", skiprows=1).reshape(-1, 4)
        images = len(np.loadtxt(folder / "times.csv"))
        for table, name in [("tracks.csv", folder.name), ("ideal.csv", f"{folder.name}, ideal points")]:
            print(f"| {name} | {len(tracks) / images:.0f} | {predicted(folder, table)} |", flush=True)


if __name__ == "__main__":
    main()
