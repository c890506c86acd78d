#!/usr/bin/env python3
"""Runs a peer on a binary PLY: VTK's quadric clustering or DecimatePro, meshoptimizer's simplifySloppy, pyacvd, MeshLab's
isotropic remeshing, or libigl's quadric edge collapse.

    python -m venv v && v/bin/pip install numpy vtk meshoptimizer pyacvd pymeshlab libigl
    v/bin/python tools/cluster_peers.py IN.ply {vtkqc,pro,sloppy,acvd,meshlab,qslim} TRIANGLES OUT.ply [CELL]

CELL is the length to begin with for vtkqc, in input units; divisions are changed until 95 to 100 % of the count is met.
Prints one line of JSON. Seconds are those of the peer's call, reading, writing and conversion of arrays left out.
"""

import json
import sys
import time

import numpy as np


def read(path):
    types = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4", "uint": "<u4"}
    with open(path, "rb") as file:
        element, counts, fields = None, {}, []
        while (words := file.readline().decode().split())[0] != "end_header":
            if words[0] == "element":
                element = words[1]
                counts[element] = int(words[2])
            elif words[0] == "property" and element == "vertex":
                fields.append((words[2], types[words[1]]))
        rows = np.frombuffer(file.read(counts["vertex"] * np.dtype(fields).itemsize), dtype=fields)
        faces = np.frombuffer(file.read(), dtype=[("n", "u1"), ("v", "<i4", 3)], count=counts["face"])
    return np.stack([rows[k] for k in "xyz"], 1).astype("f4"), faces["v"].copy()


def write(path, vertices, faces):
    rows = np.zeros(len(faces), dtype=[("n", "u1"), ("v", "<i4", 3)])
    rows["n"], rows["v"] = 3, faces
    axes = "".join(f"property float {k}\n" for k in "xyz")
    with open(path, "wb") as file:
        file.write(
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{axes}element face {len(faces)}\n"
            "property list uchar int vertex_indices\nend_header\n".encode()
        )
        file.write(vertices.astype("<f4").tobytes() + rows.tobytes())


def through_vtk(vertices, faces, make):
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

    data, points, cells = vtk.vtkPolyData(), vtk.vtkPoints(), vtk.vtkCellArray()
    points.SetData(numpy_to_vtk(vertices, deep=1))
    cells.SetData(3, numpy_to_vtk(faces.astype("i8").ravel(), deep=1, array_type=vtk.VTK_ID_TYPE))
    data.SetPoints(points)
    data.SetPolys(cells)
    run = make(vtk)
    run.SetInputData(data)
    start = time.time()
    run.Update()
    seconds, out = time.time() - start, run.GetOutput()
    ids = vtk_to_numpy(out.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return vtk_to_numpy(out.GetPoints().GetData()), ids, seconds


def vtkqc(vertices, faces, target, cell):
    extent = vertices.max(0) - vertices.min(0)
    for _ in range(12):

        def make(vtk):
            run = vtk.vtkQuadricClustering()
            run.AutoAdjustNumberOfDivisionsOff()
            run.SetNumberOfDivisions(*(int(n) for n in np.maximum(1, np.ceil(extent / cell))))
            run.UseInputPointsOff()
            run.UseFeatureEdgesOff()
            return run

        out = through_vtk(vertices, faces, make)
        if 0.95 * target <= len(out[1]) <= target:
            break
        cell *= (len(out[1]) / (0.975 * target)) ** 0.5
    return out


def pro(vertices, faces, target, _):
    def make(vtk):
        run = vtk.vtkDecimatePro()
        run.SetTargetReduction(1 - target / len(faces))
        run.PreserveTopologyOn()
        return run

    return through_vtk(vertices, faces, make)


def sloppy(vertices, faces, target, _):
    import meshoptimizer

    ids = np.ascontiguousarray(faces.ravel().astype("u4"))
    out = np.zeros_like(ids)
    start = time.time()
    n = meshoptimizer.simplify_sloppy(
        out, ids, np.ascontiguousarray(vertices), target_index_count=3 * target, target_error=1.0,
        result_error=np.zeros(1, "f4"),
    )
    seconds = time.time() - start
    used, places = np.unique(out[:n], return_inverse=True)
    return vertices[used], places.reshape(-1, 3), seconds


def acvd(vertices, faces, target, _):
    import pyacvd
    import pyvista

    rows = np.column_stack([np.full(len(faces), 3), faces]).ravel()
    start = time.time()
    clusters = pyacvd.Clustering(pyvista.PolyData(vertices, rows))
    clusters.cluster(target // 2 + 2)
    out = clusters.create_mesh()
    return np.asarray(out.points), np.asarray(out.faces).reshape(-1, 4)[:, 1:], time.time() - start


def meshlab(vertices, faces, target, _):
    import pymeshlab

    sides = vertices[faces].astype("f8")
    area = np.linalg.norm(np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), axis=1).sum() / 2
    length = (4 * area / (3**0.5 * target)) ** 0.5
    # Lengths are changed until the count is met; the last call is the one that is timed.
    for _ in range(4):
        start = time.time()
        meshes = pymeshlab.MeshSet()
        meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
        meshes.meshing_isotropic_explicit_remeshing(iterations=10, targetlen=pymeshlab.PureValue(length))
        seconds, out = time.time() - start, meshes.current_mesh()
        n = out.face_number()
        if 0.95 * target <= n <= 1.02 * target:
            break
        length *= (n / (0.985 * target)) ** 0.5
    return out.vertex_matrix(), out.face_matrix(), seconds


def qslim(vertices, faces, target, _):
    import igl

    start = time.time()
    points, ids, *_ = igl.qslim(vertices.astype("f8"), faces.astype("i4"), target)
    return points, ids, time.time() - start


if __name__ == "__main__":
    source, peer, target, result = sys.argv[1:5]
    cell = float(sys.argv[5]) if len(sys.argv) > 5 else None
    vertices, faces, seconds = globals()[peer](*read(source), int(target), cell)
    write(result, vertices, faces)
    print(json.dumps({"peer": peer, "input": source, "triangles": len(faces), "seconds": round(seconds, 3)}))
