#!/usr/bin/env python3
"""Holds the stated error of every tile of a tree against what `stonecut measure --certify` proves for it.

usage: tile_bounds.py STONECUT INPUT.ply TREE [--jobs N]
TREE is made of INPUT.ply by `stonecut tiles INPUT.ply TREE --compress none`; needs numpy.

Two distances belong to a tile above the finest level:
  there   from the surface of the tile to the whole input;
  back    from the triangles of the finest tiles below it to all tiles of its level.
All tiles of a group state one error, that of the group, so it is held against the largest distance of the group, too.
`measure --certify` proves the distance of two meshes both ways. A mesh against itself with a piece added is the distance of that
piece alone, so each of the two is one run, with the mesh cut to what lies within the stated error of the piece.
"""
import argparse
import json
import os
import struct
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor

import numpy as np

KINDS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
SIZES = {"char": "i1", "uchar": "u1", "short": "<i2", "ushort": "<u2", "int": "<i4", "uint": "<u4", "float": "<f4",
         "double": "<f8", "int8": "i1", "uint8": "u1", "int32": "<i4", "uint32": "<u4", "float32": "<f4", "float64": "<f8"}
FACE = np.dtype([("n", "u1"), ("v", "<i4", 3)])


def read_ply(path):
    """Corners of the triangles of a little-endian file without properties of faces."""
    raw = open(path, "rb").read()
    end = raw.index(b"end_header\n") + 11
    lines = [line.split() for line in raw[:end].decode().splitlines()]
    count = {line[1]: int(line[2]) for line in lines if line[0] == "element"}
    row = np.dtype([(line[2], SIZES[line[1]]) for line in lines if line[0] == "property" and line[1] != "list"])
    vertices = np.frombuffer(raw, row, count["vertex"], end)
    faces = np.frombuffer(raw, FACE, count["face"], end + vertices.nbytes)["v"]
    places = np.stack([vertices[k] for k in "xyz"], 1).astype(float)
    return places[faces]


def write_ply(path, triangles):
    """Writes triangles without common vertices, as doubles."""
    n = len(triangles)
    faces = np.zeros(n, FACE)
    faces["n"] = 3
    faces["v"] = np.arange(3 * n).reshape(n, 3)
    head = "ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty double x\nproperty double y\n" % (3 * n)
    head += "property double z\nelement face %d\nproperty list uchar int vertex_indices\nend_header\n" % n
    with open(path, "wb") as out:
        out.write(head.encode() + np.ascontiguousarray(triangles, "<f8").tobytes() + faces.tobytes())


def read_tile(path, origin):
    """Corners of the triangles of a tile in the frame of the input."""
    raw = open(path, "rb").read()
    length = struct.unpack("<I", raw[12:16])[0]
    data = json.loads(raw[20:20 + length])
    node = next(node for node in data["nodes"] if "mesh" in node)
    part = data["meshes"][0]["primitives"][0]

    def column(number):
        accessor = data["accessors"][number]
        view = data["bufferViews"][accessor["bufferView"]]
        width = {"SCALAR": 1, "VEC3": 3}[accessor["type"]]
        kind = np.dtype(KINDS[accessor["componentType"]])
        stride = view.get("byteStride", width * kind.itemsize)
        start = 28 + length + view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        rows = np.frombuffer(raw, "u1", accessor["count"] * stride, start).reshape(-1, stride)
        return np.ascontiguousarray(rows[:, :width * kind.itemsize]).view(kind)

    step = node["scale"][0]
    corner = np.round(np.array(node["translation"]) / step)
    places = np.array(origin) + (corner + column(part["attributes"]["POSITION"]).astype(float)) * step
    return places[column(part["indices"]).reshape(-1, 3).astype(int)]


def read_tree(folder):
    """Tiles with content, and the origin of their lattice. A tile: level, group, stated error, path, tiles below it."""
    tiles, origin = [], None

    def visit(name, tile):
        uri = tile.get("content", {}).get("uri")
        if uri and uri.endswith(".json"):
            other = os.path.normpath(os.path.join(os.path.dirname(name), uri))
            return visit(other, json.load(open(os.path.join(folder, other)))["root"])
        facts = tile["extras"]
        path = uri and os.path.normpath(os.path.join(os.path.dirname(name), uri))
        own = {"level": facts["level"], "group": facts.get("group"), "stated": facts.get("deviation", 0.0), "path": path}
        own["below"] = [visit(name, child) for child in tile.get("children", [])]
        if path:
            tiles.append(own)
        return own

    root = json.load(open(os.path.join(folder, "tileset.json")))
    visit("tileset.json", root["root"])
    return tiles, root["extras"]["stonecut"]["origin"]


def finest(tile):
    """Paths of the finest tiles below a tile."""
    if tile["level"] == 0:
        return [tile["path"]]
    return [path for child in tile["below"] for path in finest(child)]


class Mesh:
    """Triangles with their boxes."""

    def __init__(self, triangles):
        self.triangles = triangles
        self.low, self.high = triangles.min(1), triangles.max(1)

    def near(self, piece, distance):
        low, high = piece.min((0, 1)) - distance, piece.max((0, 1)) + distance
        return self.triangles[((self.low <= high) & (self.high >= low)).all(1)]


def distance(stonecut, piece, mesh, stated):
    """An interval that holds the largest distance of `piece` from `mesh`."""
    # A little more than is stated: a stated error that is too small must show.
    near = mesh.near(piece, 2.0 * stated)
    if not len(near):
        return [float("inf")] * 2
    with tempfile.TemporaryDirectory() as at:
        files = [os.path.join(at, name) for name in ("a.ply", "b.ply", "r.json")]
        write_ply(files[0], near)
        write_ply(files[1], np.concatenate([near, piece]))
        command = [stonecut, "measure", *files[:2], "--certify", "--samples", "2k", "--threads", "1", "--report", files[2]]
        subprocess.run(command, check=True, capture_output=True)
        found = json.load(open(files[2]))["hausdorff"]
        return [found["lower"], found["upper"]]


def line(name, ratios):
    ratios = np.sort(ratios)
    above = int((ratios > 3).sum())
    return "%-22s %4d  %5.3f  %5.2f  %5.2f   %d above 3" % (name, len(ratios), ratios[0], np.median(ratios), ratios[-1], above)


def main():
    arguments = argparse.ArgumentParser()
    for name in ("stonecut", "input", "tree"):
        arguments.add_argument(name)
    arguments.add_argument("--jobs", type=int, default=2)
    arguments.add_argument("--list", action="store_true", help="prints every tile")
    args = arguments.parse_args()
    tiles, origin = read_tree(args.tree)
    content = {tile["path"]: read_tile(os.path.join(args.tree, tile["path"]), origin) for tile in tiles}
    whole = Mesh(read_ply(args.input))
    levels = {}
    for level in sorted({tile["level"] for tile in tiles}):
        levels[level] = Mesh(np.concatenate([content[t["path"]] for t in tiles if t["level"] == level]))
    coarse = [tile for tile in tiles if tile["level"] > 0]

    def look(tile):
        there = distance(args.stonecut, content[tile["path"]], whole, tile["stated"])
        below = finest(tile)
        if not below:
            return there, None
        below = np.concatenate([content[path] for path in below])
        return there, distance(args.stonecut, below, levels[tile["level"]], tile["stated"])

    with ThreadPoolExecutor(args.jobs) as pool:
        found = list(pool.map(look, coarse))
    rows, groups = [], {}
    for tile, (there, back) in zip(coarse, found):
        ends = [max(pair) for pair in zip(there, back or [0.0, 0.0])]
        ratios = [tile["stated"] / max(x, 1e-300) for x in (there[1], back[1] if back else 0.0, ends[1], ends[0])]
        rows.append((tile["level"], ratios, back is not None))
        group = groups.setdefault((tile["level"], tile["group"]), [tile["stated"], 0.0])
        group[1] = max(group[1], ends[1])
        if args.list:
            print(tile["path"], tile["level"], tile["group"], "%.6g" % tile["stated"], there, back)
    print("stated / certified    tiles   min  median   max")
    for level in sorted({row[0] for row in rows}):
        own = [row for row in rows if row[0] == level]
        print(line("level %d, there" % level, [row[1][0] for row in own]))
        if any(row[2] for row in own):
            print(line("level %d, back" % level, [row[1][1] for row in own if row[2]]))
        print(line("level %d, both" % level, [row[1][2] for row in own]))
        print(line("level %d, groups" % level, [stated / most for key, (stated, most) in groups.items() if key[0] == level]))
    print(line("all, both", [row[1][2] for row in rows]))
    print(line("all, groups", [stated / most for stated, most in groups.values()]))
    print("stated below the lower end of what is certified:", sum(row[1][3] < 1.0 for row in rows))


if __name__ == "__main__":
    main()
