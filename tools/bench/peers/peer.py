#!/usr/bin/env python3
"""One simplification by one Python peer, for `bench compare`.

    peer.py NAME IN.raw OUT.raw TRIANGLES     prints one JSON object
    peer.py NAME --version

A raw mesh is two u64 (vertices, triangles), f64 x 3 a vertex, u32 x 3 a triangle, little-endian. Reading it
costs next to nothing, so that a peer is not charged for its file formats. Only the simplification is timed.
"""

import importlib.metadata
import json
import resource
import sys
import time

import numpy as np


def read(path):
    with open(path, "rb") as file:
        n_vertices, n_triangles = np.fromfile(file, "<u8", 2)
        positions = np.fromfile(file, "<f8", 3 * int(n_vertices)).reshape(-1, 3)
        triangles = np.fromfile(file, "<u4", 3 * int(n_triangles)).reshape(-1, 3)
    # About the middle, so that single precision is at its best; undone in `write`.
    origin = (positions.min(axis=0) + positions.max(axis=0)) / 2
    positions -= origin
    return positions, triangles.astype(np.int32), origin


def write(path, positions, triangles, origin):
    with open(path, "wb") as file:
        np.array([len(positions), len(triangles)], "<u8").tofile(file)
        (np.asarray(positions, "<f8") + origin).tofile(file)
        np.asarray(triangles, "<u4").tofile(file)


def status(field):
    with open("/proc/self/status") as file:
        for line in file:
            if line.startswith(field):
                return 1024 * int(line.split()[1])
    return 0


class Watch:
    """Seconds and CPU seconds of a `with` block; memory since the input lay in arrays, conversions included."""

    def __init__(self):
        try:
            with open("/proc/self/clear_refs", "w") as file:
                file.write("5")  # Resets the peak.
        except OSError:
            pass
        self.before = status("VmRSS:")

    def __enter__(self):
        self.begin, self.cpu = time.perf_counter(), time.process_time()

    def __exit__(self, *_):
        self.seconds = time.perf_counter() - self.begin
        self.cpu_seconds = time.process_time() - self.cpu
        self.extra = max(0, status("VmHWM:") - self.before)


def fast_simplification():
    import fast_simplification as peer

    def simplify(watch, positions, triangles, target):
        points, faces = positions.astype(np.float32), triangles
        with watch:
            points, faces = peer.simplify(points, faces, target_count=target)
        return points, faces

    return simplify


def pymeshlab():
    import pymeshlab as peer

    def simplify(watch, positions, triangles, target):
        meshes = peer.MeshSet()
        meshes.add_mesh(peer.Mesh(positions, triangles))
        with watch:
            meshes.meshing_decimation_quadric_edge_collapse(
                targetfacenum=target, preservenormal=True, preserveboundary=True, optimalplacement=True, autoclean=True
            )
        mesh = meshes.current_mesh()
        return mesh.vertex_matrix(), mesh.face_matrix()

    return simplify


def meshlib():
    from meshlib import mrmeshnumpy, mrmeshpy as peer

    def simplify(watch, positions, triangles, target):
        mesh = mrmeshnumpy.meshFromFacesVerts(triangles, positions)
        settings = peer.DecimateSettings()
        settings.strategy = peer.DecimateStrategy.MinimizeError
        settings.maxError = 3.4e38
        settings.maxDeletedFaces = max(0, mesh.topology.numValidFaces() - target)
        settings.packMesh = True
        with watch:
            peer.decimateMesh(mesh, settings)
        return mrmeshnumpy.getNumpyVerts(mesh), mrmeshnumpy.getNumpyFaces(mesh.topology)

    return simplify


def vtk():
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkFiltersCore import vtkQuadricDecimation

    def simplify(watch, positions, triangles, target):
        points = vtkPoints()
        points.SetData(numpy_to_vtk(positions.astype(np.float32), deep=True))
        cells = vtkCellArray()
        offsets = np.arange(0, 3 * len(triangles) + 1, 3, dtype=np.int64)
        cells.SetData(
            numpy_to_vtkIdTypeArray(offsets, deep=True),
            numpy_to_vtkIdTypeArray(triangles.astype(np.int64).ravel(), deep=True),
        )
        data = vtkPolyData()
        data.SetPoints(points)
        data.SetPolys(cells)
        peer = vtkQuadricDecimation()
        peer.SetInputData(data)
        peer.SetTargetReduction(1 - target / len(triangles))
        peer.VolumePreservationOn()
        with watch:
            peer.Update()
        out = peer.GetOutput()
        faces = vtk_to_numpy(out.GetPolys().GetConnectivityArray()).reshape(-1, 3)
        return vtk_to_numpy(out.GetPoints().GetData()), faces

    return simplify


PEERS = {
    "fast-simplification": fast_simplification,
    "pymeshlab": pymeshlab,
    "meshlib": meshlib,
    "vtk": vtk,
}


def main():
    name = sys.argv[1]
    if sys.argv[2] == "--version":
        print(importlib.metadata.version(name))
        return
    positions, triangles, origin = read(sys.argv[2])
    simplify = PEERS[name]()  # Imports the library.
    watch = Watch()
    points, faces = simplify(watch, positions, triangles, int(sys.argv[4]))
    write(sys.argv[3], points, faces, origin)
    print(json.dumps({
        "seconds": watch.seconds,
        "cpu_seconds": watch.cpu_seconds,
        "extra_bytes": watch.extra,
        "max_rss_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
    }))


if __name__ == "__main__":
    main()
