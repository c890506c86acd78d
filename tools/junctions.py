#!/usr/bin/env python3
"""Surfaces between labelled regions, simplified by stonecut, VTK and pymeshlab: tools/junctions.py STONECUT FOLDER

Makes a labelled volume (cells of a Voronoi diagram in a ball, 96^3 voxels), its surfaces by vtkSurfaceNets3D with both labels of each
face, and simplifies them to 20, 5 and 1 %. Counted here, by numpy alone: edges of one triangle, edges of three and more, and of each
region the edges that its faces have once, and its volume against the one before. Others know no labels of faces: theirs are those of
the nearest face before. Needs numpy, scipy, vtk, pymeshlab.
"""
import os
import subprocess
import sys

import numpy as np
import pymeshlab
import vtk
from scipy.spatial import cKDTree
from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy

stonecut, folder = os.path.abspath(sys.argv[1]), sys.argv[2]
os.makedirs(folder, exist_ok=True)
os.chdir(folder)
FACE = np.dtype([("n", "u1"), ("at", "<i4", 3), ("left", "<i4"), ("right", "<i4")])


def labelled(n=96, n_regions=24):
    """A ball of a grid, cut into regions around random places; 0 outside."""
    places = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 3)
    seeds = np.random.default_rng(3).uniform(0.2 * n, 0.8 * n, (n_regions, 3))
    labels = cKDTree(seeds).query(places)[1] + 1
    return np.where(np.linalg.norm(places - n / 2, axis=1) < 0.42 * n, labels, 0).reshape(n, n, n)


def surface_nets(volume):
    image = vtk.vtkImageData()
    image.SetDimensions(*volume.shape)
    image.GetPointData().SetScalars(numpy_to_vtk(volume.ravel(order="F").astype(np.int32), deep=True))
    nets = vtk.vtkSurfaceNets3D()
    nets.SetInputData(image)
    for i, label in enumerate(np.unique(volume)[1:]):
        nets.SetValue(i, label)
    nets.SetOutputMeshTypeToTriangles()
    nets.Update()
    out = nets.GetOutput()
    faces = vtk_to_numpy(out.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return vtk_to_numpy(out.GetPoints().GetData()).astype(float), faces, vtk_to_numpy(out.GetCellData().GetArray("BoundaryLabels")).astype(np.int32)


def write(path, points, faces, labels):
    rows = np.zeros(len(faces), FACE)
    rows["n"], rows["at"], rows["left"], rows["right"] = 3, faces, labels[:, 0], labels[:, 1]
    with open(path, "wb") as file:
        file.write((f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\n"
                    f"element face {len(faces)}\nproperty list uchar int vertex_indices\nproperty int left\nproperty int right\nend_header\n").encode())
        file.write(points.astype("<f4").tobytes() + rows.tobytes())


def read(path):
    data = open(path, "rb").read()
    header, _, body = data.partition(b"end_header\n")
    n, m = (int(line.split()[2]) for line in header.decode().splitlines() if line.startswith("element"))
    rows = np.frombuffer(body, FACE, m, 12 * n)
    return np.frombuffer(body, "<f4", 3 * n).reshape(-1, 3).astype(float), rows["at"], np.stack([rows["left"], rows["right"]], 1)


def counts(faces):
    """Times that each edge is used."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), 1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def volumes(points, faces, labels):
    corners = points[faces] - points.mean(0)
    cone = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    return {k: abs(cone[labels[:, 0] == k].sum() - cone[labels[:, 1] == k].sum()) for k in np.unique(labels) if k > 0}


def row(name, share, points, faces, labels, before):
    used, now = counts(faces), volumes(points, faces, labels)
    gaps = sum(int((counts(faces[(labels == k).any(1)]) % 2).sum()) for k in before)
    off = [abs(now.get(k, 0) - v) / v for k, v in before.items()]
    print(f"| {name} | {share:.0%} | {len(faces)} | {(used == 1).sum()} | {(used > 2).sum()} | {gaps} | {100 * max(off):.2f} % | {100 * np.mean(off):.2f} % |", flush=True)


points, faces, labels = surface_nets(labelled())
write("in.ply", points, faces, labels)
before = volumes(points, faces, labels)
nearest = cKDTree(points[faces].mean(1))
print("| program | share | triangles | edges of one | of three and more | open edges of regions | worst volume | mean |\n|---" + "|---" * 7 + "|")
row("the input", 1, points, faces, labels, before)
for share in (0.2, 0.05, 0.01):
    subprocess.run([stonecut, "simplify", "in.ply", "out.ply", "--ratio", str(share), "--force", "-q"], check=False)
    row("stonecut", share, *read("out.ply"), before)
    data = vtk.vtkPolyData()
    data.SetPoints(vtk.vtkPoints())
    data.GetPoints().SetData(numpy_to_vtk(points, deep=True))
    cells = vtk.vtkCellArray()
    cells.SetData(3, numpy_to_vtkIdTypeArray(faces.ravel().astype(np.int64), deep=True))
    data.SetPolys(cells)
    decimate = vtk.vtkQuadricDecimation()
    decimate.SetInputData(data)
    decimate.SetTargetReduction(1 - share)
    decimate.Update()
    out = decimate.GetOutput()
    p, f = vtk_to_numpy(out.GetPoints().GetData()).astype(float), vtk_to_numpy(out.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    row("VTK, quadric", share, p, f, labels[nearest.query(p[f].mean(1))[1]], before)
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(points, faces))
    meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=int(share * len(faces)), preserveboundary=True, preservetopology=True)
    mesh = meshes.current_mesh()
    p, f = mesh.vertex_matrix(), mesh.face_matrix()
    row("pymeshlab", share, p, f, labels[nearest.query(p[f].mean(1))[1]], before)
