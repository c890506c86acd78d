#!/usr/bin/env python3
"""Holds the error of every level of a tree of tiles against that of a run of `simplify` to the same count.

usage: tile_levels.py STONECUT INPUT.ply TREE [-- OPTIONS OF SIMPLIFY]      prints rows of a Markdown table
TREE is made of INPUT.ply by `stonecut tiles INPUT.ply TREE --compress none`; needs numpy.

All tiles of a level together are one mesh. It and the result of `simplify --fit off` (rounds of a tree do not fit) are measured
with the same samples: RMS of both directions, in units of the input.
"""
import json
import os
import subprocess
import sys
import tempfile

import numpy as np

from tile_bounds import read_tile, read_tree, write_ply


def run(command):
    subprocess.run(command, check=True, capture_output=True)


def rms(stonecut, mesh, result, folder):
    """RMS of both directions."""
    to = os.path.join(folder, "r.json")
    run([stonecut, "measure", mesh, result, "--samples", "1M", "--report", to])
    found = json.load(open(to))
    return (0.5 * (found["forward"]["rms"] ** 2 + found["backward"]["rms"] ** 2)) ** 0.5


def main():
    own, options = sys.argv[1:], []
    if "--" in own:
        at = own.index("--")
        own, options = own[:at], own[at + 1:]
    if len(own) != 3:
        sys.exit(__doc__)
    stonecut, mesh, tree = own
    tiles, origin = read_tree(tree)
    print("| mesh | level | triangles | RMS of the level | RMS of the direct run | ratio |\n|---|---|---|---|---|---|")
    for level in sorted({tile["level"] for tile in tiles} - {0}):
        parts = [read_tile(os.path.join(tree, t["path"]), origin) for t in tiles if t["level"] == level]
        triangles = np.concatenate(parts)
        with tempfile.TemporaryDirectory() as folder:
            whole, direct = (os.path.join(folder, name) for name in ("level.ply", "direct.ply"))
            write_ply(whole, triangles)
            run([stonecut, "simplify", mesh, direct, "--triangles", str(len(triangles)), "--fit", "off", "--texture", "none", *options])
            of_level, of_direct = (rms(stonecut, mesh, result, folder) for result in (whole, direct))
        row = [os.path.basename(mesh), level, f"{len(triangles):,}", f"{of_level:.4g}", f"{of_direct:.4g}", f"{of_level / of_direct:.3f}"]
        print("| " + " | ".join(map(str, row)) + " |", flush=True)


if __name__ == "__main__":
    main()
