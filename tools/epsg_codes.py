#!/usr/bin/env python3
"""Compares places of coordinate reference systems with PROJ (pip install pyproj).

  tools/epsg_codes.py               rows of the test in src/io/globe.rs
  tools/epsg_codes.py STONECUT      a table: distance of the root of `tiles --crs` from PROJ, for each code
"""

import json
import math
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

from pyproj import Transformer

PLACES = [
    (32633, 500400.0, 4600200.0, 100.0),
    (32756, 334000.0, 6252000.0, 30.0),
    (25832, 691000.0, 5335000.0, 520.0),
    (2056, 2683000.0, 1247000.0, 408.0),
    (2154, 652000.0, 6862000.0, 35.0),
    (27700, 530000.0, 180000.0, 10.0),
    (28992, 121000.0, 487000.0, 2.0),
    (3067, 385000.0, 6672000.0, 15.0),
    (3857, 950000.0, 6000000.0, 50.0),
    (4326, 8.5417, 47.3769, 408.0),
]
# Other methods of projection, and the geocentric system.
MORE = [
    (4978, 4278000.0, 636000.0, 4672000.0),
    (2263, 980000.0, 200000.0, 10.0),
    (31256, 0.0, 340000.0, 170.0),
    (31370, 149000.0, 170000.0, 20.0),
    (3035, 4321000.0, 3210000.0, 80.0),
    (3413, 300000.0, -1200000.0, 80.0),
    (5070, 1500000.0, 1800000.0, 20.0),
    (2193, 1750000.0, 5428000.0, 20.0),
    (31467, 3500000.0, 5400000.0, 300.0),
]


def lat_lon_height(code, x, y, z):
    lon, lat, height = Transformer.from_crs(code, 4979, always_xy=True).transform(x, y, z)
    return lat, lon, height


def geocentric(code, x, y, z):
    lat, lon, height = lat_lon_height(code, x, y, z)
    return Transformer.from_crs(4979, 4978, always_xy=True).transform(lon, lat, height)


def root_of(program, code, x, y, z, folder):
    """Puts a small square on the globe; returns where its middle comes to lie."""
    side = 1e-5 if code == 4326 else 1.0
    corners = [(x + a * side, y + b * side, z) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    mesh = folder / f"{code}.ply"
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty double x\nproperty double y\n"
    head += "property double z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"
    faces = struct.pack("<B3iB3i", 3, 0, 1, 2, 3, 0, 2, 3)
    mesh.write_bytes(head.encode() + b"".join(struct.pack("<3d", *c) for c in corners) + faces)
    tree = folder / f"{code}"
    done = subprocess.run([program, "tiles", mesh, tree, "--crs", f"EPSG:{code}"], capture_output=True, text=True)
    if done.returncode not in (0, 3):
        return done.stderr.strip().splitlines()[-1]
    tileset = json.loads((tree / "tileset.json").read_text())
    m, origin = tileset["root"]["transform"], tileset["extras"]["stonecut"]["origin"]
    p = [x - origin[0], y - origin[1], z - origin[2]]
    return [sum(m[4 * a + k] * p[a] for a in range(3)) + m[12 + k] for k in range(3)]


def main():
    if len(sys.argv) < 2:
        for code, x, y, z in PLACES:
            print(f'        ("EPSG:{code}", [{x!r}, {y!r}, {z!r}], {list(lat_lon_height(code, x, y, z))}),')
        return
    print("| code | distance from PROJ, mm |\n|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for code, x, y, z in PLACES + MORE:
            found = root_of(sys.argv[1], code, x, y, z, Path(folder))
            if isinstance(found, str):
                print(f"| {code} | {found} |")
                continue
            print(f"| {code} | {1000 * math.dist(found, geocentric(code, x, y, z)):.3f} |")


main()
