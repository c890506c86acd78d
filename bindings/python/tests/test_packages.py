"""Meshes of trimesh, pyvista and Open3D: the same kind comes back with what its vertices carry. Left out where they are
not installed."""

from __future__ import annotations

import threading
import warnings
from typing import Any

import numpy as np
import pytest
from conftest import is_closed, sphere

import stonecut as sc


def shade(points: Any) -> Any:
    at = np.asarray(points, dtype=float)
    return np.clip(255 * (at + 1.1) / 2.2, 0, 255).astype(np.uint8)


def cylinder(n: int = 120, m: int = 60) -> tuple[Any, Any, Any]:
    """Points, faces and texture coordinates of a cylinder, split along its seam."""
    u, v = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1), indexing="ij")
    points = np.stack([np.cos(2 * np.pi * u), np.sin(2 * np.pi * u), 3 * v], axis=-1).reshape(-1, 3)
    points[-(m + 1) :] = points[: m + 1]
    corner = np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    quads = np.stack([a, b, c, d], axis=-1).reshape(-1, 4)
    return points, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]), np.stack([u, v], axis=-1).reshape(-1, 2)


def is_where_it_was(points: Any, uv: Any) -> bool:
    angle = 2 * np.pi * uv[:, 0]
    there = np.stack([np.cos(angle), np.sin(angle), 3 * uv[:, 1]], axis=1)
    return bool(np.linalg.norm(points - there, axis=1).max() < 0.07)


def test_trimesh_keeps_colours_attributes_and_texture() -> None:
    trimesh = pytest.importorskip("trimesh")
    points, faces = sphere(40)
    mesh = trimesh.Trimesh(points, faces, vertex_colors=shade(points), process=False)
    mesh.vertex_attributes["height"] = points[:, 2]
    mesh.face_attributes["part"] = np.zeros(len(faces))
    with pytest.warns(sc.LossWarning, match="face_attributes\\['part'\\]"):
        small = sc.simplify(mesh, triangles=1000)
    assert type(small) is type(mesh) and small.is_watertight and len(small.faces) <= 1000
    assert np.abs(small.visual.vertex_colors[:, :3].astype(int) - shade(small.vertices)).mean() < 6
    assert np.abs(small.vertex_attributes["height"] - small.vertices[:, 2]).mean() < 0.01
    assert len(mesh.faces) == len(faces)
    points, faces, uv = cylinder()
    visual = trimesh.visual.TextureVisuals(uv=uv, material=trimesh.visual.material.SimpleMaterial())
    textured = sc.simplify(trimesh.Trimesh(points, faces, visual=visual, process=False), triangles=800)
    assert textured.visual.kind == "texture" and textured.visual.material is visual.material
    assert is_where_it_was(textured.vertices, textured.visual.uv)


def test_pyvista_keeps_arrays_and_the_type_of_its_points() -> None:
    pyvista = pytest.importorskip("pyvista")
    points, faces = sphere(40)
    mesh = pyvista.PolyData.from_regular_faces(points.astype(np.float32), faces)
    mesh.point_data["rgb"] = shade(points)
    mesh.point_data["temperature"] = points[:, 0]
    mesh.point_data["flow"] = points
    mesh.point_data["zone"] = (points[:, 1] > 0).astype(np.int32)
    mesh.set_active_scalars("temperature")
    mesh.cell_data["id"] = np.arange(len(faces))
    with pytest.warns(sc.LossWarning, match="cell_data\\['id'\\]"):
        small = sc.simplify(mesh, ratio=0.05, weight={})
    assert isinstance(small, pyvista.PolyData) and small.points.dtype == np.float32
    assert small.is_manifold and small.n_open_edges == 0 and small.n_cells <= 0.05 * len(faces) + 2
    assert small.active_scalars_name == "temperature"
    assert np.abs(small.point_data["temperature"] - small.points[:, 0]).mean() < 0.01
    assert small.point_data["flow"].shape == small.points.shape
    assert set(np.unique(small.point_data["zone"])) <= {0, 1}
    assert np.abs(small.point_data["rgb"].astype(int) - shade(small.points)).mean() < 6
    # Quads are cut into triangles.
    plane = pyvista.Plane(i_resolution=40, j_resolution=40)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        flat = sc.simplify(plane, triangles=100)
    assert flat.is_all_triangles and flat.n_cells <= 100
    points, faces, uv = cylinder()
    mesh = pyvista.PolyData.from_regular_faces(points, faces)
    mesh.active_texture_coordinates = uv.astype(np.float32)
    textured = sc.simplify(mesh, triangles=800)
    assert is_where_it_was(textured.points, np.asarray(textured.active_texture_coordinates))


def test_open3d_keeps_colours_normals_and_corner_texture() -> None:
    open3d = pytest.importorskip("open3d")
    vector, triangle = open3d.utility.Vector3dVector, open3d.utility.Vector3iVector
    points, faces = sphere(40)
    mesh = open3d.geometry.TriangleMesh(vector(points), triangle(faces))
    mesh.vertex_colors = vector(shade(points) / 255)
    mesh.compute_vertex_normals()
    small = sc.simplify(mesh, triangles=1000)
    assert type(small) is type(mesh) and small.is_watertight() and small.has_vertex_normals()
    assert np.abs(255 * np.asarray(small.vertex_colors) - shade(small.vertices)).mean() < 6
    points, faces, uv = cylinder()
    # Joined along the seam: the texture differs at corners only.
    places, inverse = np.unique(points, axis=0, return_inverse=True)
    mesh = open3d.geometry.TriangleMesh(vector(places), triangle(inverse.reshape(-1)[faces]))
    mesh.triangle_uvs = open3d.utility.Vector2dVector(uv[faces.reshape(-1)])
    mesh.triangle_material_ids = open3d.utility.IntVector(np.zeros(len(faces), np.int32))
    textured = sc.simplify(mesh, triangles=800)
    corners = np.asarray(textured.vertices)[np.asarray(textured.triangles).reshape(-1)]
    assert len(textured.triangles) <= 800 and is_where_it_was(corners, np.asarray(textured.triangle_uvs))
    assert len(np.unique(np.asarray(textured.vertices), axis=0)) == len(textured.vertices)
    tensor = open3d.t.geometry.TriangleMesh.from_legacy(mesh)
    tensor.vertex["heat"] = open3d.core.Tensor(places[:, 2].astype(np.float32))
    again = sc.simplify(tensor, triangles=800)
    assert type(again) is type(tensor)
    at = again.vertex.positions.numpy()
    assert np.abs(again.vertex["heat"].numpy().reshape(-1) - at[:, 2]).mean() < 0.02
    faces_again = again.triangle.indices.numpy()
    assert is_where_it_was(at[faces_again.reshape(-1)], again.triangle["texture_uvs"].numpy().reshape(-1, 2))


def test_pairs_come_back_as_pairs_and_strangers_are_refused() -> None:
    points, faces = sphere(20)
    small, corners = sc.simplify((points, faces), triangles=200)
    assert len(corners) <= 200 and is_closed(corners) and len(small) < len(points)
    for stranger in (3, [points, faces], object()):
        with pytest.raises(sc.UsageError, match="is wanted, not"):
            sc.simplify(stranger, triangles=10)
    with pytest.raises(sc.UsageError, match="carries no heat"):
        sc.simplify((points, faces), triangles=10, weight={"heat": 1})


def test_the_error_agrees_with_another_measure() -> None:
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("rtree")
    points, faces = sphere(30)
    small, corners = sc.simplify_arrays(points, faces, triangles=500)
    ours = sc.measure((points, faces), (small, corners), samples=20_000)
    mesh = trimesh.Trimesh(points, faces, process=False)
    other = trimesh.Trimesh(small, corners, process=False)
    samples, _ = trimesh.sample.sample_surface(mesh, 5_000, seed=1)
    distance = trimesh.proximity.closest_point(other, samples)[1]
    assert np.sqrt((distance**2).mean()) == pytest.approx(ours["forward"]["rms"], rel=0.1)


def test_fewer_errors_than_fast_simplification() -> None:
    other = pytest.importorskip("fast_simplification")
    points, faces = sphere(60)
    theirs = other.simplify(points, faces, target_count=1000)
    ours = sc.simplify_arrays(points, faces, triangles=1000)
    error = [sc.measure((points, faces), tuple(mesh), samples=50_000).rms for mesh in (theirs, ours)]
    assert error[1] < error[0]


def test_simplify_lets_threads_share_a_mesh() -> None:
    trimesh = pytest.importorskip("trimesh")
    points, faces = sphere(30)
    mesh = trimesh.Trimesh(points, faces, process=False)
    found: list[int] = []
    jobs = [threading.Thread(target=lambda: found.append(len(sc.simplify(mesh, triangles=300).faces))) for _ in range(4)]
    for job in jobs:
        job.start()
    for job in jobs:
        job.join()
    assert len(found) == 4 and all(298 <= n <= 300 for n in found)
