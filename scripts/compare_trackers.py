#!/usr/bin/env python3
"""Compares fuyu-track with OpenCV in images with known truth.

FOLDER is written by `cargo run --release -p fuyu-track --example sequence`. Needs numpy and opencv-python-headless.
OpenCV gets the true pixels of the body, 3 px from its edge, as the mask; fuyu-track gets no mask.
"""

import sys
import time
from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT, FOCAL, BODY, RATE = 640, 480, 640.0, 2, 10.0
CENTRE = np.array([WIDTH / 2 - 0.5, HEIGHT / 2 - 0.5])


class Truth:
    def __init__(self, folder):
        self.folder = folder
        self.poses = np.loadtxt(folder / "poses.csv", delimiter=",").reshape(-1, 3, 4)

    def image(self, k):
        return cv2.imread(str(self.folder / f"{k:06}.pgm"), cv2.IMREAD_GRAYSCALE)

    def depth(self, k):
        return np.fromfile(self.folder / f"{k:06}.depth", np.float32).reshape(HEIGHT, WIDTH)

    def mask(self, k):
        ids = np.fromfile(self.folder / f"{k:06}.ids", np.uint16).reshape(HEIGHT, WIDTH)
        body = (ids == BODY).astype(np.uint8)
        return cv2.erode(body, np.ones((7, 7), np.uint8))

    def point(self, k, u, v, inverse):
        """The body's point at (u, v), in its frame; None at edges."""
        c, r = int(u), int(v)
        if not (0 <= c < WIDTH - 1 and 0 <= r < HEIGHT - 1):
            return None
        corners = inverse[r : r + 2, c : c + 2]
        if corners.min() <= 0 or abs(corners[0, 0] + corners[1, 1] - corners[0, 1] - corners[1, 0]) > 1e-4:
            return None
        a, b = u - c, v - r
        z = 1 / ((1 - b) * ((1 - a) * corners[0, 0] + a * corners[0, 1]) + b * ((1 - a) * corners[1, 0] + a * corners[1, 1]))
        p = np.array([(u - CENTRE[0]) / FOCAL * z, (v - CENTRE[1]) / FOCAL * z, z])
        X = self.poses[k]
        return X[:, :3].T @ (p - X[:, 3])

    def project(self, k, p):
        X = self.poses[k]
        p = X[:, :3] @ p + X[:, 3]
        return CENTRE + FOCAL * p[:2] / p[2]


def opencv(truth):
    """Rows frame, id, u, v, and milliseconds of processor time a frame."""
    cv2.setNumThreads(1)
    lk = dict(winSize=(15, 15), maxLevel=3, criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01))
    points, ids, rows, times, fresh, last = np.zeros((0, 1, 2), np.float32), [], [], [], 0, None
    for k in range(len(truth.poses)):
        image, mask = truth.image(k), truth.mask(k)
        began = time.thread_time()
        if len(points):
            there, found, _ = cv2.calcOpticalFlowPyrLK(last, image, points, None, **lk)
            back, returned, _ = cv2.calcOpticalFlowPyrLK(image, last, there, None, **lk)
            near = np.linalg.norm((back - points)[:, 0], axis=1) < 0.5
            kept = (found[:, 0] == 1) & (returned[:, 0] == 1) & near
            at = np.clip(np.round(there[:, 0]).astype(int), 0, [WIDTH - 1, HEIGHT - 1])
            kept &= mask[at[:, 1], at[:, 0]] == 1
            points, ids = there[kept], [i for i, keep in zip(ids, kept) if keep]
        if (k % 5 == 0 or len(points) < 90) and len(points) < 100:
            free = mask.copy()
            for u, v in points[:, 0]:
                cv2.circle(free, (round(float(u)), round(float(v))), 7, 0, -1)
            new = cv2.goodFeaturesToTrack(image, 100 - len(points), 0.01, 7, mask=free)
            if new is not None:
                new = cv2.cornerSubPix(image, new, (4, 4), (-1, -1), (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 8, 0.01))
                points = np.concatenate([points, new.astype(np.float32)])
                ids += range(fresh, fresh + len(new))
                fresh += len(new)
        times.append(1e3 * (time.thread_time() - began))
        rows += [(k, i, float(u), float(v)) for i, (u, v) in zip(ids, points[:, 0])]
        last = image
    return rows, times


def evaluate(truth, name, rows, times):
    frames = {}
    for k, i, u, v in rows:
        frames.setdefault(int(k), []).append((i, u, v))
    first, life, errors = {}, {}, []
    for k in sorted(frames):
        depth = truth.depth(k)
        inverse = np.where(np.isfinite(depth), 1 / depth, 0)
        for i, u, v in frames[k]:
            if i not in first:
                first[i] = (k, truth.point(k, u, v, inverse))
            life[i] = k - first[i][0] + 1
            since, p = first[i]
            if p is not None and k > since:
                errors.append((k - since, np.linalg.norm(truth.project(k, p) - [u, v])))
    errors = np.array(errors).reshape(-1, 2)
    old = errors[(errors[:, 0] >= 28) & (errors[:, 0] <= 32), 1]
    count = np.mean([len(f) for f in frames.values()]) if frames else 0.0
    half = np.percentile(old, [50, 95]) if len(old) else [np.nan, np.nan]
    share = 100 * np.mean(errors[:, 1] > 1) if len(errors) else np.nan
    middle = np.median(list(life.values())) if life else 0
    print(
        f"| {name} | {count:.0f} | {half[0]:.3f} | {half[1]:.2f} | {share:.1f} | {middle:.0f} | "
        f"{np.median(times):.1f} | {np.percentile(times, 95):.1f} |"
    )


def main():
    print("| images, tracker | points | median drift after 3 s [px] | 95 % [px] | off by more than 1 px [%] | median life [frames] | ms a frame | 95 % [ms] |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for folder in map(Path, sys.argv[1:]):
        truth = Truth(folder)
        ours = np.loadtxt(folder / "tracks.csv", delimiter=",", skiprows=1).reshape(-1, 4)
        ours[:, 0] = np.round(ours[:, 0] * RATE)
        evaluate(truth, f"{folder.name}, fuyu-track", ours, np.loadtxt(folder / "times.csv"))
        evaluate(truth, f"{folder.name}, OpenCV", *opencv(truth))


if __name__ == "__main__":
    main()
