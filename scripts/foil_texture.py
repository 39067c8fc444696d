#!/usr/bin/env python3
"""Draws urdf/foil.png: the facets of crumpled multi-layer insulation, each of its own brightness, as a texture of 256 x 256 texels.

    foil_texture.py PNG

Needs numpy and opencv-python-headless. Equal on every machine.
"""

import sys

import cv2
import numpy as np

SIZE, FACETS = 256, 500


def main():
    random = np.random.RandomState(7)
    centres = random.uniform(0, SIZE, (FACETS, 2)).astype(np.float32)
    grey = random.uniform(0.35, 1.0, FACETS)
    v, u = np.mgrid[0:SIZE, 0:SIZE]
    texels = np.stack([u, v], axis=-1).reshape(-1, 1, 2).astype(np.float32)
    # The facet of a texel is that of the nearest centre.
    nearest = np.concatenate([
        ((part - centres) ** 2).sum(axis=-1).argmin(axis=1) for part in np.array_split(texels, 64)
    ])
    shade = (255 * grey[nearest]).round().astype(np.uint8).reshape(SIZE, SIZE)
    cv2.imwrite(sys.argv[1], shade)


if __name__ == "__main__":
    main()
