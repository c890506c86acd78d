"""Arrays as the compiled half takes them: types checked, order and byte order as it wants them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .errors import BadInput, UsageError

Array = npt.NDArray[Any]

# Columns by their names in PLY files, numbers of columns, types.
_NAMES = {
    "color": (["red", "green", "blue", "alpha"], (3, 4), ("u1", "u2", "f4", "f8")),
    "normal": (["nx", "ny", "nz"], (3,), ("f4", "f8")),
    "uv": (["s", "t"], (2,), ("f4", "f8")),
    "material": (["texnumber"], (1,), ("i4",)),
}
# Points of one mesh in memory, all of which int32 can name.
_MAX_POINTS = 2**31
_CODES = {"i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f4", "f8"}


class Mesh(NamedTuple):
    """A mesh for the compiled half."""

    points: Array
    faces: Array
    colors: Array | None = None


class Column(NamedTuple):
    """One number of each vertex, for the compiled half."""

    name: str
    scalar: str
    bytes: Array
    offset: int
    stride: int


def _native(array: Array) -> Array:
    return np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("="))


def points(given: Any) -> Array:
    """Points (n, 3) as float32 or float64 in C order; as they are if they are so already."""
    array = np.asarray(given)
    if array.ndim != 2 or array.shape[1] != 3:
        raise BadInput(f"points: an array of shape (n, 3) is wanted, not {array.shape}", "points")
    if len(array) > _MAX_POINTS:  # before anything is copied
        raise BadInput(f"points: {len(array)} are too many for one mesh in memory; write the mesh to a file", "points")
    if array.dtype.kind not in "fiu":
        raise BadInput(f"points: numbers are wanted, not {array.dtype}", "points")
    if array.dtype.newbyteorder("=") not in (np.dtype(np.float32), np.dtype(np.float64)):
        array = array.astype(np.float64)
    return _native(array)


def faces(given: Any) -> Array:
    """Faces (m, 3) as 32- or 64-bit integers in C order; as they are if they are so already."""
    array = np.asarray(given)
    if array.ndim != 2 or array.shape[1] != 3:
        hint = ""
        if array.ndim == 1 and array.dtype.kind in "iu" and array.size % 4 == 0 and (array[::4] == 3).all():
            hint = "; of VTK's flat list take faces.reshape(-1, 4)[:, 1:]"
        elif array.ndim == 2 and array.shape[1] == 4:
            hint = "; split quads into two triangles each"
        raise BadInput(f"faces: an array of shape (m, 3) is wanted, not {array.shape}{hint}", "faces")
    if array.size == 0:
        array = array.astype(np.int64)
    if array.dtype.kind not in "iu":
        raise BadInput(f"faces: integers are wanted, not {array.dtype}", "faces")
    if array.dtype.itemsize < 4:
        array = array.astype(np.int32)
    return _native(array)


class Attributes:
    """Named arrays of the vertices, as columns of one number each and back."""

    def __init__(
        self,
        given: Mapping[str, Any] | None,
        n_vertices: int,
        weight: Mapping[str, float] | None,
        label: Iterable[str],
    ) -> None:
        self.columns: list[Column] = []
        self._parts: list[tuple[str, np.dtype[Any], tuple[int, ...], list[str], bool]] = []
        for number, (name, values) in enumerate((given or {}).items()):
            self._add(number, name, values, n_vertices)
        self.words = self._weights(weight or {}) + self._labels([label] if isinstance(label, str) else label)

    def _add(self, number: int, name: str, values: Any, n_vertices: int) -> None:
        array = np.asarray(values)
        where = f"attributes[{name!r}]"
        if array.ndim not in (1, 2) or array.shape[0] != n_vertices:
            raise UsageError(f"{where}: one row for each of {n_vertices} points is wanted, not shape {array.shape}")
        dtype = array.dtype
        is_bool = dtype.kind == "b"
        if is_bool:
            array = array.astype(np.uint8)
        elif dtype == np.float16:
            array = array.astype(np.float32)
        array = _native(array)
        code = f"{array.dtype.kind}{array.dtype.itemsize}"
        if code not in _CODES:
            raise UsageError(f"{where}: {dtype} cannot be carried; numbers of up to 64 bits can")
        width = 1 if array.ndim == 1 else array.shape[1]
        if width == 0:
            raise UsageError(f"{where}: no column")
        names = [f"attribute{number}_{i}" for i in range(width)]
        if name in _NAMES:
            known, widths, codes = _NAMES[name]
            if width not in widths or code not in codes:
                wanted = " or ".join(f"(n, {w})" for w in widths)
                types = " or ".join(str(np.dtype(code)) for code in codes)
                raise UsageError(f"{where}: {wanted} of {types} is wanted, not {array.shape} of {dtype}")
            names = known[:width]
        flat = array.reshape(-1).view(np.uint8)
        size = array.dtype.itemsize
        for i, column in enumerate(names):
            self.columns.append(Column(column, code, flat, i * size, width * size))
        self._parts.append((name, dtype, array.shape[1:], names, is_bool))

    def _named(self, option: str, name: str) -> list[str]:
        for known, _, _, columns, _ in self._parts:
            if known == name:
                return columns
        have = ", ".join(known for known, *_ in self._parts) or "none"
        raise UsageError(f"{option}: there is no attribute {name!r}; there are {have}")

    def _weights(self, weight: Mapping[str, float]) -> list[str]:
        parts = []
        for name, value in weight.items():
            if name in _NAMES:
                parts.append(f"{name}={value}")
            else:
                parts += [f"{column}={value}" for column in self._named("weight", name)]
        return ["--weight=" + ",".join(parts)] if parts else []

    def _labels(self, label: Iterable[str]) -> list[str]:
        return [f"--label={column}" for name in label for column in self._named("label", name)]

    def back(self, records: Array, n_vertices: int) -> dict[str, Array]:
        """The arrays of a result, of the types that were given."""
        fields = [(column.name, "=" + column.scalar) for column in self.columns]
        out: dict[str, Array] = {}
        if not fields:
            return out
        table = records.view(np.dtype(fields)).reshape(n_vertices)
        for name, dtype, shape, columns, is_bool in self._parts:
            array = np.stack([table[column] for column in columns], axis=1)
            array = array.reshape(n_vertices, *shape)
            target = dtype.newbyteorder("=")
            out[name] = array.astype(bool) if is_bool else array.astype(target, copy=False)
        return out
