#!/usr/bin/env python3
"""Holds what `stonecut convert` reads and writes against five other programs.

    pip install pymeshlab trimesh open3d vtk meshio scipy numpy
    tools/format_peers.py STONECUT read FILE...    what each of them finds in FILE, against stonecut
    tools/format_peers.py STONECUT write FILE...   FILE converted to each format, read by each of them

"same": the same triangles with the same corner positions (as floats) in the same orientation. Every reader
runs in a process of its own, since some of them crash.
"""

import os
import subprocess
import sys
import tempfile

import numpy as np

READERS = ["pymeshlab", "trimesh", "open3d", "vtk", "meshio"]
FORMATS = [("ply", ""), ("ply", "ascii"), ("ply", "binary_big_endian"), ("ply", "double,uint"), ("ply", "float"),
           ("stl", ""), ("stl", "ascii"), ("obj", "")]


def read(reader, path):
    """Positions and triangles, as this program finds them."""
    if reader == "pymeshlab":
        import pymeshlab
        meshes = pymeshlab.MeshSet()
        meshes.load_new_mesh(path)
        return meshes.current_mesh().vertex_matrix(), meshes.current_mesh().face_matrix()
    if reader == "trimesh":
        import trimesh
        mesh = trimesh.load(path, process=False)
        return mesh.vertices, getattr(mesh, "faces", [])
    if reader == "open3d":
        import open3d
        mesh = open3d.io.read_triangle_mesh(path)
        return np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    if reader == "vtk":
        import vtk
        from vtk.util.numpy_support import vtk_to_numpy
        kind = {"ply": vtk.vtkPLYReader, "stl": vtk.vtkSTLReader, "obj": vtk.vtkOBJReader}[path.rsplit(".", 1)[1]]
        source, flat = kind(), vtk.vtkTriangleFilter()
        source.SetFileName(path)
        flat.SetInputConnection(source.GetOutputPort())
        flat.Update()
        found = flat.GetOutput()
        return vtk_to_numpy(found.GetPoints().GetData()), vtk_to_numpy(found.GetPolys().GetConnectivityArray())
    import meshio
    mesh = meshio.read(path)
    return mesh.points, np.concatenate([c.data for c in mesh.cells if c.type == "triangle"] or [np.zeros((0, 3))])


def soup(vertices, triangles):
    """Every triangle from its smallest corner on, sorted."""
    corners = np.asarray(vertices, dtype=np.float32)[np.asarray(triangles, dtype=np.int64).reshape(-1, 3)]
    corners = corners + np.float32(0)  # -0 is 0
    turned = np.stack([np.roll(corners, -k, axis=1).reshape(-1, 9) for k in range(3)])
    least = [min(range(3), key=lambda k: tuple(turned[k, i])) for i in range(corners.shape[0])]
    flat = turned[least, np.arange(corners.shape[0])]
    return flat[np.lexsort(flat.T[::-1])]


def own(stonecut, path, folder):
    """The mesh as stonecut reads it, by way of the plainest PLY there is."""
    out = os.path.join(folder, "own.ply")
    subprocess.run([stonecut, "convert", path, out, "--drop-texture", "--keep-duplicates", "--force",
                    "--format", "double,int", "-q"], check=True, capture_output=True)
    with open(out, "rb") as file:
        counts, stride = {}, 0
        for line in iter(lambda: file.readline().split(), [b"end_header"]):
            if line[0] == b"element":
                counts[line[1]], last = int(line[2]), line[1]
            elif line[0] == b"property" and last == b"vertex":
                stride += {b"double": 8, b"int": 4, b"uint": 4, b"float": 4, b"short": 2, b"ushort": 2}.get(line[1], 1)
        body = file.read()
    vertices = np.frombuffer(body, np.uint8, counts[b"vertex"] * stride).reshape(-1, stride)
    faces = np.frombuffer(body, np.uint8, counts[b"face"] * 13, len(vertices) * stride).reshape(-1, 13)
    return vertices[:, :24].copy().view("<f8"), faces[:, 1:].copy().view("<i4")


def verdict(reader, path, wanted):
    """What comes out of `compare` below, in a process of its own."""
    run = subprocess.run([sys.executable, __file__, "compare", reader, path, wanted], capture_output=True,
                         text=True, errors="replace")
    if run.returncode < 0:
        return "crashes"
    return run.stdout.strip().splitlines()[-1] if run.returncode == 0 and run.stdout.strip() else "no"


def compare(reader, path, wanted):
    found = soup(*read(reader, path))
    wanted = np.load(wanted)
    if len(found) == 0 and len(wanted) > 0:
        return "no triangles"
    if found.shape != wanted.shape:
        return f"{len(found)} triangles"
    return "same" if np.array_equal(found, wanted) else "other"


def main():
    if sys.argv[1] == "compare":
        print(compare(*sys.argv[2:]))
        return
    stonecut, mode, files = os.path.abspath(sys.argv[1]), sys.argv[2], sys.argv[3:]
    print("| file | stonecut | " + " | ".join(READERS) + " |\n|---|---|" + "---|" * len(READERS))
    with tempfile.TemporaryDirectory() as folder:
        wanted = os.path.join(folder, "wanted.npy")
        for path in files:
            vertices, triangles = own(stonecut, path, folder)
            np.save(wanted, soup(vertices, triangles))
            size = f"{len(vertices)} v, {len(triangles)} t"
            if mode == "read":
                row = [verdict(reader, path, wanted) for reader in READERS]
                print(f"| {os.path.basename(path)} | {size} | " + " | ".join(row) + " |", flush=True)
                continue
            for kind, format in FORMATS:
                out = os.path.join(folder, "out." + kind)
                subprocess.run([stonecut, "convert", path, out, "--format", format, "--force", "-q"], check=True)
                row = [verdict(reader, out, wanted) for reader in READERS]
                print(f"| {os.path.basename(path)}: {kind} {format} | {size} | " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
