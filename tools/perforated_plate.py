#!/usr/bin/env python3
"""Writes plate.ply: a bent plate with 6 large holes and 98 small ones, thus of genus 104.

    python tools/perforated_plate.py

For docs/results/methods.md#genus-removed. Takes numpy.
"""

import numpy as np

LENGTH, WIDTH, HEIGHT = 150, 84, 4
N_SMALL = 98

# One layer of empty cubes around the plate.
solid = np.zeros((LENGTH + 2, WIDTH + 2, HEIGHT + 2), bool)
solid[1:-1, 1:-1, 1:-1] = True


def drill(x, y, radius):
    i, j = np.mgrid[0 : LENGTH + 2, 0 : WIDTH + 2]
    solid[(i - x) ** 2 + (j - y) ** 2 <= radius * radius] = False


large = [(25 + 50 * a, 21 + 42 * b) for a in range(3) for b in range(2)]
free = [
    (x, y)
    for y in range(6, WIDTH - 3, 8)
    for x in range(6, LENGTH - 3, 8)
    if all((x - p) ** 2 + (y - q) ** 2 > 14**2 for p, q in large)
]
for x, y in large:
    drill(x, y, 9)
for i in range(N_SMALL):
    drill(*free[i * len(free) // N_SMALL], 1.5)

# Faces of a cube by the direction they look into, counter-clockwise from outside.
FACES = {
    (1, 0, 0): [(1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1)],
    (-1, 0, 0): [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0)],
    (0, 1, 0): [(0, 1, 0), (0, 1, 1), (1, 1, 1), (1, 1, 0)],
    (0, -1, 0): [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)],
    (0, 0, 1): [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
    (0, 0, -1): [(0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0)],
}
numbers, triangles = {}, []
for cube in np.argwhere(solid):
    for direction, corners in FACES.items():
        if not solid[tuple(cube + direction)]:
            a, b, c, d = (
                numbers.setdefault(tuple(int(x) for x in cube + corner), len(numbers)) for corner in corners
            )
            triangles += [(a, b, c), (a, c, d)]

with open("plate.ply", "w") as file:
    file.write(f"ply\nformat ascii 1.0\nelement vertex {len(numbers)}\n")
    file.write("".join(f"property float {axis}\n" for axis in "xyz"))
    file.write(f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n")
    for x, y, z in numbers:
        file.write(f"{x} {y} {z + 14 * np.sin(np.pi * x / LENGTH):g}\n")
    for triangle in triangles:
        file.write("3 %d %d %d\n" % triangle)
