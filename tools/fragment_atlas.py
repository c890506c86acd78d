#!/usr/bin/env python3
"""Cuts a mesh into 10,000 charts of a texture atlas, and looks at what a simplified one has made of them.

usage: fragment_atlas.py make IN.ply OUT.ply          IN as `stonecut synth statue` writes it
       fragment_atlas.py check BEFORE.ply AFTER.ply   both as `make` and `stonecut simplify` write them
needs numpy. A chart is a field of a 100 x 100 grid of directions as seen from the middle of the mesh, laid into the
middle 0.8 of its field of the atlas; vertices between charts are doubled.
"""
import sys
import numpy as np

GRID = 100
FACE = np.dtype([("n", "u1"), ("v", "<i4", 3)])


def read(path):
    raw = open(path, "rb").read()
    end = raw.index(b"end_header\n") + 11
    lines = raw[:end].decode().splitlines()
    count = {l.split()[1]: int(l.split()[2]) for l in lines if l.startswith("element ")}
    names = [l.split()[2] for l in lines if l.startswith("property float ")]
    n = count["vertex"]
    vertices = np.frombuffer(raw, "<f4", n * len(names), end).reshape(n, len(names))
    faces = np.frombuffer(raw, FACE, count["face"], end + vertices.nbytes)
    return names, vertices, faces["v"]


def make(source, target):
    _, vertices, faces = read(source)
    p = vertices[:, :3].astype(float)
    direction = p - (p.min(0) + p.max(0)) / 2
    z = direction[:, 2] / np.linalg.norm(direction, axis=1)
    # Both in fields of the grid.
    angle = (np.arctan2(direction[:, 1], direction[:, 0]) / (2 * np.pi) % 1.0) * GRID
    height = (z + 1) / 2 * GRID
    a = angle[faces]
    # Across the meridian: on the side of the first corner.
    a += GRID * np.round((a[:, :1] - a) / GRID)
    h = height[faces]
    column = np.floor(a.mean(1)).astype(int) % GRID
    row = np.clip(np.floor(h.mean(1)).astype(int), 0, GRID - 1)
    s = a - column[:, None]
    s -= GRID * np.round((s - 0.5) / GRID)
    inside = np.stack([s, h - row[:, None]], 2)
    # What sticks out of a field stays within the margin of 0.1 around it.
    inside = 0.1 + 0.8 * np.clip(inside, -0.1, 1.1)
    field = np.stack([column, row], 1)[:, None, :]
    uv = ((field + inside) / GRID).astype("<f4").reshape(-1, 2)
    key = np.concatenate([faces.reshape(-1, 1), (row * GRID + column).repeat(3)[:, None]], 1)
    _, first, corner = np.unique(key, axis=0, return_index=True, return_inverse=True)
    out = np.concatenate([vertices[faces.reshape(-1)[first], :3], uv[first]], 1).astype("<f4")
    rows = np.empty(len(faces), FACE)
    rows["n"], rows["v"] = 3, corner.reshape(-1, 3)
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        + f"element vertex {len(out)}\n"
        + "".join(f"property float {name}\n" for name in ["x", "y", "z", "texture_u", "texture_v"])
        + f"element face {len(rows)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    with open(target, "wb") as file:
        file.write(header.encode() + out.tobytes() + rows.tobytes())


def charts_of(path):
    names, vertices, faces = read(path)
    uv = vertices[:, [names.index("texture_u"), names.index("texture_v")]].astype(float)
    chart = np.floor(uv * GRID).astype(int) @ [1, GRID]
    return uv, chart, faces


def check(before, after):
    uv, chart, faces = charts_of(before)
    low = np.full((GRID * GRID, 2), np.inf)
    high = np.full((GRID * GRID, 2), -np.inf)
    np.minimum.at(low, chart, uv)
    np.maximum.at(high, chart, uv)
    n_before = len(np.unique(chart[faces[:, 0]]))
    uv, chart, faces = charts_of(after)
    of_faces = chart[faces]
    mixed = (of_faces != of_faces[:, :1]).any(1).sum()
    off = np.maximum(np.maximum(low[chart] - uv, uv - high[chart]).max(1), 0)
    off = off[np.unique(faces)]
    print(f"{len(faces)} triangles, charts {n_before} -> {len(np.unique(of_faces[:, 0]))}, triangles over two charts "
          f"{mixed}, vertices outside of their chart by more than half a texel of 4096: {(off > 0.5 / 4096).sum()} "
          f"(at most {off.max():.2g})")


if __name__ == "__main__":
    if len(sys.argv) != 4 or sys.argv[1] not in ("make", "check"):
        sys.exit(__doc__)
    (make if sys.argv[1] == "make" else check)(sys.argv[2], sys.argv[3])
