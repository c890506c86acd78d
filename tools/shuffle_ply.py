#!/usr/bin/env python3
"""Puts the vertices, faces and corners of a binary little-endian PLY of bare geometry into random order.

usage: shuffle_ply.py IN.ply OUT.ply [SEED]      needs numpy; holds the whole mesh in memory
"""
import sys

import numpy as np

FACE = np.dtype([("n", "u1"), ("v", "<i4", (3,))])


def main(source, target, seed=1):
    with open(source, "rb") as f:
        header = b""
        while not header.endswith(b"end_header\n"):
            header += f.readline()
        counts = {
            line.split()[1]: int(line.split()[2])
            for line in header.decode().splitlines()
            if line.startswith("element ")
        }
        vertices = np.fromfile(f, "<f4", 3 * counts["vertex"]).reshape(-1, 3)
        faces = np.fromfile(f, FACE, counts["face"])["v"]
    rng = np.random.default_rng(seed)
    place = rng.permutation(len(vertices)).astype(np.int32)
    shuffled = np.empty_like(vertices)
    shuffled[place] = vertices
    faces = place[faces[rng.permutation(len(faces))]]
    turn = rng.integers(0, 3, len(faces))
    faces = np.take_along_axis(faces, (np.arange(3) + turn[:, None]) % 3, axis=1)
    rows = np.empty(len(faces), FACE)
    rows["n"], rows["v"] = 3, faces
    with open(target, "wb") as f:
        f.write(header)
        shuffled.tofile(f)
        rows.tofile(f)


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    main(*sys.argv[1:3], *map(int, sys.argv[3:]))
