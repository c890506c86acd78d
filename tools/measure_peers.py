#!/usr/bin/env python3
"""Holds `stonecut measure` against two independent implementations.

    pip install pymeshlab open3d numpy
    tools/measure_peers.py STONECUT ORIGINAL.ply SIMPLIFIED.ply [...more pairs]

Each prints mean, RMS and maximum both ways, from its own million area-uniform samples a side:
MeshLab's Hausdorff filter (Monte Carlo samples, its own grid search) and Open3D's closest points
(Embree, single precision). The last column is the time of the call alone, without reading files.
The line below tells how far the RMS of two sets of samples may be apart by chance (one standard
deviation): much where a few pieces have vanished, whose distance is a hundred times the others'.
"""

import json
import os
import subprocess
import sys
import time

import numpy as np
import open3d
import pymeshlab

SAMPLES = int(os.environ.get("SAMPLES", 1_000_000))


def stonecut(program, original, simplified):
    start = time.time()
    out = subprocess.run(
        [program, "measure", original, simplified, "--json", "--threads", "1", "--samples", str(SAMPLES)],
        check=True, capture_output=True, text=True,
    ).stdout
    report = json.loads(out)
    return [[report[side][k] for k in ("mean", "rms", "max")] for side in ("forward", "backward")], time.time() - start


def meshlab(original, simplified):
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(original)
    meshes.load_new_mesh(simplified)
    start = time.time()
    sides = []
    for source, target in ((0, 1), (1, 0)):
        found = meshes.get_hausdorff_distance(
            sampledmesh=source, targetmesh=target, samplevert=False, sampleface=True,
            samplenum=SAMPLES, maxdist=pymeshlab.PercentageValue(100),
        )
        sides.append([found["mean"], found["RMS"], found["max"]])
    return sides, time.time() - start


def open3d_closest(original, simplified):
    meshes = [open3d.io.read_triangle_mesh(path) for path in (original, simplified)]
    start = time.time()
    # Single precision: about the origin it is at its best.
    centre = meshes[0].get_axis_aligned_bounding_box().get_center()
    for mesh in meshes:
        mesh.translate(-centre)
    open3d.utility.random.seed(1)
    sides, chances = [], []
    for source, target in ((0, 1), (1, 0)):
        points = np.asarray(meshes[source].sample_points_uniformly(SAMPLES).points)
        scene = open3d.t.geometry.RaycastingScene(nthreads=1)
        scene.add_triangles(open3d.t.geometry.TriangleMesh.from_legacy(meshes[target]))
        query = open3d.core.Tensor(points.astype(np.float32))
        closest = scene.compute_closest_points(query, nthreads=1)["points"].numpy().astype(np.float64)
        distance = np.linalg.norm(points - closest, axis=1)
        squares = distance**2
        sides.append([distance.mean(), np.sqrt(squares.mean()), distance.max()])
        # Of one set, that of the RMS is half of that of the mean square; of a difference, sqrt(2) times more.
        chances.append(squares.std() / squares.mean() / np.sqrt(len(squares)) / np.sqrt(2))
    return sides, time.time() - start, chances


def main():
    program, files = sys.argv[1], sys.argv[2:]
    for original, simplified in zip(files[::2], files[1::2]):
        print(f"{original} {simplified}")
        own, seconds = stonecut(program, original, simplified)
        *third, chances = open3d_closest(original, simplified)
        rows = [("stonecut", own, seconds), ("meshlab", *meshlab(original, simplified)), ("open3d", *third)]
        for name, sides, seconds in rows:
            cells = []
            for side, reference in zip(sides, own):
                cells += [f"{v:.6e} ({v / r - 1:+.3%})" for v, r in zip(side, reference)]
            print(f"  {name:9}" + "  ".join(cells) + f"  {seconds:.1f} s", flush=True)
        print("  RMS by chance " + " and ".join(f"{chance:.2%}" for chance in chances), flush=True)


if __name__ == "__main__":
    main()
