#!/usr/bin/env python3
"""The motion of a target from the pixels of a scenario's images, against what then happens.

    estimate_from_images.py SCENARIO FOLDER [TEXT=>TEXT...] [--eclipse] [-v]

Simulates 60 s of SCENARIO with images into FOLDER, and 120 s without; tracks points (`fuyu estimate --track --mask-id 2`) and predicts
the next 60 s, from the tracked points and from the true features of the camera. TEXT=>TEXT replaces text of the scenario; --eclipse removes
the points from 20 to 40 s, after which a tracker gives other ids; -v prints the estimator's notes. Needs numpy and `fuyu` in the PATH (or FUYU).
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np

from estimate_from_tracks import matrix, rotation_vector

FUYU = os.environ.get("FUYU", "fuyu")
# From the camera's axes to the base's.
R_BC = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
END, PREDICTED = 60.0, 60.0
# Of tracked points and of the camera's [px]; the estimator leaves out what is off by six times as much.
TRACKED_NOISE, CAMERA_NOISE = 0.1, 0.3


def run(*command):
    return subprocess.run([FUYU, *map(str, command)], capture_output=True, text=True)


def must(*command):
    done = run(*command)
    if done.returncode not in (0, 1):
        sys.exit(done.stderr)
    return done


def table(folder, topic):
    """Columns of a topic by name."""
    path = folder / (topic.strip("/").replace("/", "__") + ".csv")
    with open(path) as file:
        names = file.readline().strip().split(",")
        rows = [line.strip().split(",") for line in file]
    columns = {}
    for i, name in enumerate(names):
        try:
            columns[name] = np.array([float(row[i]) if row[i] else np.nan for row in rows])
        except ValueError:
            pass
    columns["t"] = columns["header.stamp.sec"] + 1e-9 * columns["header.stamp.nanosec"]
    return columns


def attitude(odometry, t):
    k = np.argmin(np.abs(odometry["t"] - t))
    assert abs(odometry["t"][k] - t) < 1e-3, t
    return matrix([odometry[f"pose.pose.orientation.{c}"][k] for c in "xyzw"])


def predicted(points, gyro, truth, noise):
    # A gyro without errors.
    done = run("estimate", points, "--fx", 640, "--fy", 640, "--cx", 319.5, "--cy", 239.5, "--gyro", gyro, "--gyro-noise", 0,
               "--gyro-bias", 0, "--pixel-noise", noise, "--predict", PREDICTED, "--json")
    if done.returncode:
        return "refused: " + done.stderr.strip().splitlines()[-1]
    found = json.loads(done.stdout)
    first, last = found["prediction"][0], found["prediction"][-1]
    base, target = truth
    R_WC = attitude(base, first["t"]) @ R_BC
    turned = matrix(last["q"]) @ matrix(first["q"]).T
    true = R_WC.T @ attitude(target, last["t"]) @ attitude(target, first["t"]).T @ R_WC
    error = rotation_vector(turned @ true.T)
    C = np.array(last["turn_covariance"])
    mahalanobis = np.sqrt(error @ np.linalg.solve(C, error))
    angle, sigma = np.degrees([np.linalg.norm(error), np.sqrt(np.trace(C))])
    if "-v" in sys.argv:
        print("\n".join(found["notes"]), file=sys.stderr)
    return f"{angle:.2f} | {sigma:.2f} | {mahalanobis:.1f} | {found['rms']:.3f}"


def without_eclipse(tracks):
    """Writes the tracks of a target that was dark from 20 to 40 s, and gives the new file."""
    rows = np.loadtxt(tracks, delimiter=",", skiprows=1).reshape(-1, 4)
    before, after = rows[rows[:, 0] < 20.0], rows[rows[:, 0] > 40.0]
    after[:, 1] += rows[:, 1].max() + 1
    path = tracks.with_name("eclipse.csv")
    np.savetxt(path, np.vstack([before, after]), delimiter=",", header="t,id,u,v", comments="", fmt=["%.9f", "%d", "%.6f", "%.6f"])
    return path


def main():
    scenario, folder = Path(sys.argv[1]), Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    text = scenario.read_text()
    for change in sys.argv[3:]:
        if "=>" in change:
            old, new = change.split("=>")
            assert old in text, old
            text = text.replace(old, new)
    (folder / "images.yaml").write_text(text)
    # The parameters of images are the last ones of the camera node.
    without, found = re.subn(r"\n    images:\n(?:      .*\n)+", "\n", text)
    assert found == 1, "the scenario renders no images"
    (folder / "long.yaml").write_text(without)
    if not (folder / "images").exists():
        must("simulate", folder / "images.yaml", "--duration", END, "--output", folder / "images", "--json")
        must("simulate", folder / "long.yaml", "--duration", END + PREDICTED, "--output", folder / "long", "--json")
        for bag in ["images", "long"]:
            topics = "/ground_truth/odom,/ground_truth/target/odom,/imu,/ground_truth/features,/camera/features"
            must("bag", "convert", folder / bag, "--to", "csv", "--topics", topics)
    long = folder / "long_csv"
    truth = table(long, "/ground_truth/odom"), table(long, "/ground_truth/target/odom")
    imu = table(folder / "images_csv", "/imu")
    w = R_BC.T @ np.array([imu[f"angular_velocity.{c}"] for c in "xyz"])
    gyro = folder / "gyro.csv"
    np.savetxt(gyro, np.column_stack([imu["t"], w.T]), delimiter=",", header="t,wx,wy,wz", comments="", fmt="%.17g")
    tracks = folder / "tracks.csv"
    done = run("estimate", folder / "images", "--track", "--mask-id", 2, "--tracks", tracks, "--json")
    print("| points | a frame | error after 60 s [deg] | sigma [deg] | Mahalanobis | residual [px] |")
    print("| --- | --- | --- | --- | --- | --- |")
    if tracks.exists():
        if "--eclipse" in sys.argv:
            tracks = without_eclipse(tracks)
        rows = np.loadtxt(tracks, delimiter=",", skiprows=1).reshape(-1, 4)
        print(f"| tracked | {len(rows) / len(np.unique(rows[:, 0])):.0f} | {predicted(tracks, gyro, truth, TRACKED_NOISE)} |")
    else:
        print(f"| tracked | 0 | {done.stderr.strip()} |")
    name = next(name for name in ["/ground_truth/features", "/camera/features"] if (folder / "images_csv" / (name.strip("/").replace("/", "__") + ".csv")).exists())
    features = table(folder / "images_csv", name)
    ideal = folder / "ideal.csv"
    with open(ideal, "w") as file:
        file.write("t,id,u,v\n")
        for k, t in enumerate(features["t"]):
            i = 0
            while f"ids[{i}]" in features and np.isfinite(features[f"ids[{i}]"][k]):
                file.write(f"{t},{features[f'ids[{i}]'][k]:.0f},{features[f'u[{i}]'][k]},{features[f'v[{i}]'][k]}\n")
                i += 1
    print(f"| of the camera | 20 | {predicted(ideal, gyro, truth, CAMERA_NOISE)} |")


if __name__ == "__main__":
    main()
