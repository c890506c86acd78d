"""Meshes of other packages: read by what they look like, given back as the same kind.

None of the packages is imported; a mesh is known by the module of its type. What a kind carries at vertices is kept, and
what cannot be kept is named in a :class:`stonecut.LossWarning`.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ._arrays import Array
from .errors import LossWarning, UsageError

if TYPE_CHECKING:
    from . import SimplifiedArrays


class Adapted(NamedTuple):
    """A mesh as arrays, and how to make the same kind of a result."""

    points: Array
    faces: Array
    attributes: dict[str, Any]
    back: Callable[[SimplifiedArrays], Any]


def adapt(mesh: Any) -> Adapted:
    """Reads a mesh of any known kind, or a pair (points, faces)."""
    if isinstance(mesh, tuple) and len(mesh) == 2:
        return Adapted(mesh[0], mesh[1], {}, lambda result: (result.points, result.faces))
    if isinstance(mesh, str | os.PathLike):
        raise UsageError(f"{os.fspath(mesh)!r} is a file, not a mesh in memory: simplify_file(input, output, ...) reads and writes files")
    module = type(mesh).__module__
    package = module.partition(".")[0]
    if package == "trimesh" and hasattr(mesh, "visual"):
        return _trimesh(mesh)
    if hasattr(mesh, "point_data") and hasattr(mesh, "regular_faces"):
        return _pyvista(mesh)
    if package == "open3d" and hasattr(mesh, "triangle") and hasattr(mesh, "vertex"):
        return _open3d_tensor(mesh)
    if package == "open3d" and hasattr(mesh, "triangles"):
        return _open3d(mesh)
    raise UsageError(
        f"a mesh of trimesh, pyvista or Open3D or a pair (points, faces) is wanted, not {module}.{type(mesh).__qualname__}; "
        "take its arrays to simplify_arrays"
    )


def _lost(what: str, why: str) -> None:
    warnings.warn(f"{what} cannot be kept: {why}", LossWarning, stacklevel=5)


def _is_number(array: Array) -> bool:
    return array.dtype.kind in "biuf" and array.ndim in (1, 2) and array.dtype.itemsize <= 8


def _trimesh(mesh: Any) -> Adapted:
    n = len(mesh.vertices)
    attributes: dict[str, Any] = {}
    kind = mesh.visual.kind
    uv = getattr(mesh.visual, "uv", None) if kind == "texture" else None
    if kind == "vertex":
        attributes["color"] = np.asarray(mesh.visual.vertex_colors)
    elif uv is not None:
        attributes["uv"] = np.asarray(uv, dtype=np.float64)
    elif kind == "face":
        _lost("face colours", "they are one a face; mesh.visual.to_color() or vertex colours can")
    for name in mesh.face_attributes:
        _lost(f"face_attributes[{name!r}]", "it belongs to faces, and those of the result are others")
    names = {}
    for number, (name, values) in enumerate(mesh.vertex_attributes.items()):
        array = np.asarray(values)
        if _is_number(array) and len(array) == n:
            names[f"vertex{number}"] = name
            attributes[f"vertex{number}"] = array
        else:
            _lost(f"vertex_attributes[{name!r}]", f"it is of type {array.dtype} and shape {array.shape}")

    def back(result: SimplifiedArrays) -> Any:
        out = type(mesh)(vertices=result.points, faces=result.faces, process=False, metadata=dict(mesh.metadata))
        if "color" in attributes:
            out.visual.vertex_colors = result.attributes["color"]
        elif uv is not None:
            out.visual = type(mesh.visual)(uv=result.attributes["uv"], material=mesh.visual.material)
        for known, name in names.items():
            out.vertex_attributes[name] = result.attributes[known]
        return out

    return Adapted(mesh.vertices, mesh.faces, attributes, back)


def _pyvista(mesh: Any) -> Adapted:
    given = mesh if mesh.is_all_triangles else mesh.triangulate()
    if given.n_lines or given.n_verts:
        _lost("lines and single points", "only triangles are simplified")
    for name in given.cell_data:
        _lost(f"cell_data[{name!r}]", "it belongs to faces, and those of the result are others")
    data = given.point_data
    textured = data.GetTCoords() if hasattr(data, "GetTCoords") else given.GetPointData().GetTCoords()
    uv_name = None if textured is None else textured.GetName()
    attributes: dict[str, Any] = {}
    names = {}
    for number, name in enumerate(data.keys()):
        array = np.asarray(data[name])
        known = f"point{number}"
        if array.dtype == np.uint8 and array.ndim == 2 and array.shape[1] in (3, 4) and "color" not in attributes:
            known = "color"
        elif name == uv_name and array.ndim == 2 and array.shape[1] == 2:
            known = "uv"
        elif name == data.active_normals_name and array.dtype.kind == "f":
            known = "normal"
        if _is_number(array):
            names[known] = name
            attributes[known] = array
        else:
            _lost(f"point_data[{name!r}]", f"it is of type {array.dtype} and shape {array.shape}")

    def back(result: SimplifiedArrays) -> Any:
        out = type(mesh).from_regular_faces(result.points, result.faces)
        for known, name in names.items():
            if known == "uv":
                out.active_texture_coordinates = result.attributes[known]
            else:
                out.point_data[name] = result.attributes[known]
        if mesh.active_scalars_name in out.point_data:
            out.set_active_scalars(mesh.active_scalars_name)
        for name in mesh.field_data:
            out.field_data[name] = mesh.field_data[name]
        return out

    return Adapted(np.asarray(given.points), np.asarray(given.regular_faces), attributes, back)


def _open3d(mesh: Any) -> Adapted:
    points, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    attributes: dict[str, Any] = {}
    if mesh.has_vertex_colors():
        attributes["color"] = np.asarray(mesh.vertex_colors)
    if mesh.has_vertex_normals():
        attributes["normal"] = np.asarray(mesh.vertex_normals)
    is_textured = mesh.has_triangle_uvs()
    corners = Corners(faces, np.asarray(mesh.triangle_uvs), np.asarray(mesh.triangle_material_ids)) if is_textured else None

    def back(result: SimplifiedArrays) -> Any:
        out = type(mesh)()
        points, faces = result.points, result.faces
        vertices = np.arange(len(points))
        if corners is not None:
            vertices, points, faces = corners.joined(result)
            out.triangle_uvs = type(mesh.triangle_uvs)(result.attributes["uv"][result.faces.reshape(-1)])
            out.triangle_material_ids = type(mesh.triangle_material_ids)(corners.materials(result))
            out.textures = mesh.textures
        out.vertices = type(mesh.vertices)(points.astype(np.float64))
        out.triangles = type(mesh.triangles)(faces)
        if "color" in attributes:
            out.vertex_colors = type(mesh.vertices)(result.attributes["color"][vertices])
        if "normal" in attributes:
            out.vertex_normals = type(mesh.vertices)(result.attributes["normal"][vertices])
        if mesh.has_triangle_normals():
            out.compute_triangle_normals()
        return out

    return Adapted(*_split(points, faces, attributes, corners), back)


def _open3d_tensor(mesh: Any) -> Adapted:
    tensor = type(mesh.vertex.positions)
    points, indices = mesh.vertex.positions.cpu().numpy(), mesh.triangle.indices.cpu().numpy()
    attributes: dict[str, Any] = {}
    names = {}
    for number, (name, value) in enumerate(mesh.vertex.items()):
        array = value.cpu().numpy()
        if name == "positions":
            continue
        known = {"colors": "color", "normals": "normal"}.get(name, f"vertex{number}")
        if known == "color" and array.dtype.kind == "f" and array.size and array.max() > 1.0:
            known = f"vertex{number}"
        if _is_number(array):
            names[known] = name
            attributes[known] = array
        else:
            _lost(f"vertex[{name!r}]", f"it is of type {array.dtype} and shape {array.shape}")
    uvs = None
    for name, value in mesh.triangle.items():
        if name == "texture_uvs":
            uvs = value.cpu().numpy().reshape(-1, 2)
        elif name not in ("indices", "normals"):
            _lost(f"triangle[{name!r}]", "it belongs to faces, and those of the result are others")
    corners = None if uvs is None else Corners(indices, uvs, None)

    def back(result: SimplifiedArrays) -> Any:
        out = type(mesh)()
        points, faces = result.points, result.faces
        vertices = np.arange(len(points))
        if corners is not None:
            vertices, points, faces = corners.joined(result)
        out.vertex.positions = tensor.from_numpy(np.ascontiguousarray(points))
        out.triangle.indices = tensor.from_numpy(np.ascontiguousarray(faces.astype(indices.dtype)))
        for known, name in names.items():
            out.vertex[name] = tensor.from_numpy(np.ascontiguousarray(result.attributes[known][vertices]))
        if corners is not None:
            at_corners = result.attributes["uv"][result.faces]
            out.triangle["texture_uvs"] = tensor.from_numpy(np.ascontiguousarray(at_corners))
        if hasattr(mesh, "has_valid_material") and mesh.has_valid_material():
            out.material = mesh.material
        return out

    return Adapted(*_split(points, indices, attributes, corners), back)


class Corners:
    """Texture coordinates at the corners of faces: vertices are split where their corners differ."""

    def __init__(self, faces: Array, uvs: Array, materials: Array | None) -> None:
        corners = faces.reshape(-1)
        self.uvs = np.ascontiguousarray(uvs)
        material = np.zeros(len(corners), np.int32)
        if materials is not None and len(materials) == len(faces):
            material = np.repeat(materials.astype(np.int32), 3)
        s, t = self.uvs[:, 0], self.uvs[:, 1]
        order = np.lexsort((material, t, s, corners))
        keys = (corners[order], s[order], t[order], material[order])
        is_new = np.ones(len(order), bool)
        is_new[1:] = np.logical_or.reduce([key[1:] != key[:-1] for key in keys])
        number = np.empty(len(order), np.int64)
        number[order] = np.cumsum(is_new) - 1
        first = order[is_new]
        self.faces = number.reshape(faces.shape)
        self.vertex = corners[first]
        self.uv = self.uvs[first]
        self.material = material[first]

    def joined(self, result: SimplifiedArrays) -> tuple[Array, Array, Array]:
        """Vertices of the result that stay, their places, and faces over them: copies at seams become one again."""
        points, inverse = np.unique(result.points, axis=0, return_inverse=True)
        inverse = inverse.reshape(-1)
        first = np.empty(len(points), np.int64)
        first[inverse[::-1]] = np.arange(len(inverse))[::-1]
        return first, points, inverse[result.faces].astype(np.int32)

    def materials(self, result: SimplifiedArrays) -> Array:
        """The material of each face of the result."""
        return np.asarray(result.attributes["material"][result.faces[:, 0]], dtype=np.int32)


def _split(points: Array, faces: Array, attributes: dict[str, Any], corners: Corners | None) -> tuple[Array, Array, dict[str, Any]]:
    if corners is None:
        return points, faces, attributes
    split = {name: array[corners.vertex] for name, array in attributes.items()}
    split["uv"] = corners.uv
    split["material"] = corners.material
    return points[corners.vertex], corners.faces, split
