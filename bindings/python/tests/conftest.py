"""Meshes for the tests: small, closed, with a known shape."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

Array = npt.NDArray[np.float64]


def sphere(n: int = 60) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """A closed sphere with bumps: about 4 n^2 triangles, without poles (a subdivided cube)."""
    grid = np.linspace(-1, 1, n + 1)
    u, v = np.meshgrid(grid, grid, indexing="ij")
    one = np.ones_like(u)
    sides = [(one, u, v), (-one, v, u), (v, one, u), (u, -one, v), (u, v, one), (v, u, -one)]
    points = np.concatenate([np.stack(side, axis=-1).reshape(-1, 3) for side in sides])
    corner = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    quads = np.stack([a, b, c, d], axis=-1).reshape(-1, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    faces = np.concatenate([triangles + side * (n + 1) ** 2 for side in range(6)])
    points, inverse = np.unique(np.round(points, 9), axis=0, return_inverse=True)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points *= 1 + 0.03 * np.sin(9 * points[:, :1]) * np.cos(7 * points[:, 1:2])
    return points, inverse.reshape(-1)[faces].reshape(-1, 3).astype(np.int64)


def volume(points: npt.NDArray[np.float64], faces: npt.NDArray[np.int64]) -> float:
    """The enclosed volume."""
    a, b, c = (points[faces[:, i]].astype(np.float64) for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def is_closed(faces: npt.NDArray[np.int64]) -> bool:
    """True if every edge has one triangle on each side."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    forward = edges[:, 0] << 32 | edges[:, 1]
    backward = edges[:, 1] << 32 | edges[:, 0]
    return len(np.unique(forward)) == len(forward) and set(forward.tolist()) == set(backward.tolist())


@pytest.fixture(scope="session")
def ball() -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """A closed mesh of 43,200 triangles."""
    return sphere()
