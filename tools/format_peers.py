#!/usr/bin/env python3
"""Holds what `stonecut convert` reads and writes against five other programs.

    pip install pymeshlab trimesh open3d vtk meshio scipy numpy
    tools/format_peers.py STONECUT read FILE...    what each of them finds in FILE, against stonecut
    tools/format_peers.py STONECUT write FILE...   FILE converted to each format, read by each of them; without FILE, bumpy grids
                                                   of 3,600 vertices with normals, colours and quality, in floats and doubles

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


def grid(path, dtype):
    """A bumpy grid as a binary PLY whose positions have this type."""
    i, j = (k.ravel() for k in np.mgrid[:60, :60])
    rows = np.zeros(3600, [(name, dtype) for name in "xyz"] + [(n, "<f4") for n in ("nx", "ny", "nz", "quality")]
                    + [(name, "u1") for name in ("red", "green", "blue")])
    rows["x"], rows["y"], rows["z"] = i + 1 / 3, j / 7, np.sin(i / 3) * np.cos(j / 5)
    rows["nz"], rows["quality"], rows["red"], rows["green"] = 1, i, 4 * i, 4 * j
    at = (60 * np.arange(59)[:, None] + np.arange(59)).ravel()
    faces = np.zeros(2 * len(at), [("n", "u1"), ("corners", "<i4", 3)])
    faces["n"] = 3
    faces["corners"] = np.concatenate([np.stack([at, at + 60, at + 1], 1), np.stack([at + 1, at + 60, at + 61], 1)])
    kinds = {"<f4": "float", "<f8": "double", "|u1": "uchar"}
    lines = [f"property {kinds[rows.dtype[name].str]} {name}" for name in rows.dtype.names]
    head = ["ply", "format binary_little_endian 1.0", "element vertex 3600", *lines, f"element face {len(faces)}",
            "property list uchar int vertex_indices", "end_header", ""]
    with open(path, "wb") as file:
        file.write("\n".join(head).encode() + rows.tobytes() + faces.tobytes())
    return path


def main():
    if sys.argv[1] == "compare":
        print(compare(*sys.argv[2:]))
        return
    stonecut, mode, files = os.path.abspath(sys.argv[1]), sys.argv[2], sys.argv[3:]
    print("| file | stonecut | " + " | ".join(READERS) + " |\n|---|---|" + "---|" * len(READERS))
    with tempfile.TemporaryDirectory() as folder:
        wanted = os.path.join(folder, "wanted.npy")
        if mode == "write" and not files:
            files = [grid(os.path.join(folder, f"grid_{dtype[1:]}.ply"), dtype) for dtype in ("<f4", "<f8")]
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
                run = subprocess.run([stonecut, "convert", path, out, "--format", format, "--force", "-q"], stderr=subprocess.DEVNULL)
                assert run.returncode in (0, 3), out  # 3: the format has no place for colours
                row = [verdict(reader, out, wanted) for reader in READERS]
                print(f"| {os.path.basename(path)}: {kind} {format} | {size} | " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
