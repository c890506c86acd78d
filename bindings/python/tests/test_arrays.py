"""simplify_arrays: types, orders, attributes, targets, and one clear exception for each fault."""

from __future__ import annotations

import gc
import resource
import sys
import sysconfig
import threading
import warnings
from typing import Any

import numpy as np
import pytest
from conftest import is_closed, sphere, volume

import stonecut as sc

Ball = tuple[Any, Any]


def test_the_target_is_met_and_the_mesh_stays_closed(ball: Ball) -> None:
    points, faces = ball
    for wanted in (4_000, 400):
        small, corners = sc.simplify_arrays(points, faces, triangles=wanted)
        assert wanted - 2 <= len(corners) <= wanted
        assert corners.dtype == np.int32 and small.dtype == np.float64
        assert is_closed(corners)
        assert abs(volume(small, corners) / volume(points, faces) - 1) < 0.01
    by_ratio = sc.simplify_arrays(points, faces, ratio=0.1)
    assert abs(len(by_ratio.faces) - 0.1 * len(faces)) <= 2
    assert by_ratio.target_met and by_ratio.report["output"]["triangles"] == len(by_ratio.faces)
    assert sum(by_ratio.rejects.values()) >= 0
    # source: the vertex that survived is near.
    assert (np.diff(by_ratio.source.astype(np.int64)) > 0).all()
    far = np.linalg.norm(points[by_ratio.source] - by_ratio.points, axis=1)
    assert np.median(far) < 0.05


def test_every_type_and_order_gives_the_same(ball: Ball) -> None:
    points, faces = ball
    expected = sc.simplify_arrays(points, faces, triangles=1000)
    for dtype in (np.int32, np.uint32, np.int64, np.uint64):
        result = sc.simplify_arrays(points, faces.astype(dtype), triangles=1000)
        assert np.array_equal(result.points, expected.points)
        assert np.array_equal(result.faces, expected.faces)
    padded = np.zeros((len(points), 5))
    padded[:, ::2] = points
    for given in (
        np.asfortranarray(points),
        padded[:, ::2],
        points[::-1][::-1],
        points.astype(">f8"),
        points.astype(np.longdouble),
        points.tolist(),
    ):
        assert np.array_equal(sc.simplify_arrays(given, faces, triangles=1000).points, expected.points)
    for corners in (np.asfortranarray(faces), faces.astype(">i8"), faces.tolist()):
        assert np.array_equal(sc.simplify_arrays(points, corners, triangles=1000).faces, expected.faces)
    single = points.astype(np.float32)
    by_single = sc.simplify_arrays(single, faces, triangles=1000)
    assert by_single.points.dtype == np.float32
    by_double = sc.simplify_arrays(single.astype(np.float64), faces, triangles=1000)
    assert np.array_equal(by_single.points, by_double.points.astype(np.float32))
    # Whole numbers and half floats are numbers too.
    assert sc.simplify_arrays((points * 1000).astype(np.int16), faces, triangles=1000).points.dtype == np.float64


def test_inputs_may_be_read_only_and_are_never_changed(ball: Ball) -> None:
    points, faces = (array.copy() for array in ball)
    color = np.zeros((len(points), 3), np.uint8)
    before = [points.copy(), faces.copy(), color.copy()]
    for array in (points, faces, color):
        array.setflags(write=False)
    sc.simplify_arrays(points, faces, triangles=500, attributes={"color": color})
    for array, copy in zip((points, faces, color), before, strict=True):
        assert np.array_equal(array, copy)


def test_results_own_their_memory_and_nothing_is_kept(ball: Ball) -> None:
    points, faces = ball
    points, faces = points.copy(), faces.copy()
    counts = [sys.getrefcount(array) for array in (points, faces)]
    result = sc.simplify_arrays(points, faces, triangles=500, progress=lambda _: None)
    kept = result.points.copy()
    assert [sys.getrefcount(array) for array in (points, faces)] == counts
    del points, faces
    gc.collect()
    assert np.array_equal(result.points, kept)
    result.points[0] = 1.0


def test_memory_does_not_grow_from_call_to_call(ball: Ball) -> None:
    points, faces = ball

    def peak() -> int:
        for _ in range(20):
            sc.simplify_arrays(points, faces, triangles=500)
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    first = peak()
    assert peak() - first < 8 * 1024  # KiB; one mesh is 2 MiB, so 20 lost ones would be 40


def test_attributes_come_back_by_name_and_type(ball: Ball) -> None:
    points, faces = ball
    shade = np.clip(255 * (points[:, 2] + 1.1) / 2.2, 0, 255)
    attributes = {
        "color": np.stack([shade, 255 - shade, np.full(len(points), 9), np.full(len(points), 255)], axis=1).astype(np.uint8),
        "normal": points / np.linalg.norm(points, axis=1, keepdims=True),
        "temperature, °C": points[:, 0].astype(np.float32),
        "stress": np.stack([points[:, 0], 2 * points[:, 1]], axis=1),
        "class": (points[:, 1] > 0).astype(np.int64) + (1 << 40),
        "mask": points[:, 0] > 0,
        "half": points[:, 0].astype(np.float16),
        "big": points[:, 0].astype(">f4"),
    }
    for cells in (None, 4_000):
        result = sc.simplify_arrays(
            points, faces, ratio=0.05, attributes=attributes, weight={"stress": 1, "normal": 0.5}, cell_triangles=cells
        )
        assert list(result.attributes) == list(attributes)
        for name, array in result.attributes.items():
            assert array.dtype == attributes[name].dtype.newbyteorder("="), name
            assert array.shape == (len(result.points), *attributes[name].shape[1:]), name
        at = result.points
        assert np.abs(result.attributes["color"][:, 0] - np.clip(255 * (at[:, 2] + 1.1) / 2.2, 0, 255)).mean() < 4
        assert (result.attributes["color"][:, 3] == 255).all()
        assert np.allclose(np.linalg.norm(result.attributes["normal"], axis=1), 1, atol=1e-6)
        for name in ("temperature, °C", "half", "big"):
            assert np.abs(result.attributes[name] - at[:, 0]).mean() < 0.01, name
        assert np.abs(result.attributes["stress"][:, 1] - 2 * at[:, 1]).mean() < 0.02
        assert np.array_equal(result.attributes["class"], attributes["class"][result.source])
        assert np.array_equal(result.attributes["mask"], attributes["mask"][result.source])


def test_floats_can_be_labels_and_subset_keeps_vertices(ball: Ball) -> None:
    points, faces = ball
    number = np.arange(len(points), dtype=np.float64)
    result = sc.simplify_arrays(
        points, faces, triangles=500, attributes={"number": number}, label="number", placement="subset", fit="off"
    )
    assert np.array_equal(result.attributes["number"], result.source)
    assert np.array_equal(result.points, points[result.source])


def test_a_texture_keeps_its_seam() -> None:
    # A cylinder whose texture goes once around: the first and last column are in one place, with u = 0 and u = 1.
    n, m = 120, 60
    u, v = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1), indexing="ij")
    angle = 2 * np.pi * u
    points = np.stack([np.cos(angle), np.sin(angle), 3 * v], axis=-1).reshape(-1, 3)
    points[-(m + 1) :] = points[: m + 1]
    corner = np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    quads = np.stack([a, b, c, d], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    uv = np.stack([u, v], axis=-1).reshape(-1, 2)
    for cells in (None, 1_000):
        result = sc.simplify_arrays(points, faces, triangles=600, attributes={"uv": uv}, cell_triangles=cells)
        assert len(result.faces) <= 600
        at = result.attributes["uv"][result.faces]
        # No triangle runs back across the whole texture, and the texture is where it was.
        assert (at[..., 0].max(axis=1) - at[..., 0].min(axis=1)).max() < 0.5
        angle = 2 * np.pi * result.attributes["uv"][:, 0]
        there = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        assert np.linalg.norm(result.points[:, :2] - there, axis=1).max() < 0.05
        assert np.abs(result.points[:, 2] - 3 * result.attributes["uv"][:, 1]).max() < 0.05


def test_eight_threads_get_each_their_own(ball: Ball) -> None:
    points, faces = ball
    expected = {wanted: sc.simplify_arrays(points, faces, triangles=wanted) for wanted in (800, 8000)}
    found: list[tuple[int, sc.SimplifiedArrays]] = []

    def work(wanted: int) -> None:
        for _ in range(3):
            found.append((wanted, sc.simplify_arrays(points, faces, triangles=wanted)))

    threads = [threading.Thread(target=work, args=((800, 8000)[i % 2],)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 24
    for wanted, result in found:
        assert np.array_equal(result.points, expected[wanted].points)
        assert np.array_equal(result.faces, expected[wanted].faces)


def test_free_threads_stay_free() -> None:
    is_locked = getattr(sys, "_is_gil_enabled", None)
    if is_locked is None or not sysconfig.get_config_var("Py_GIL_DISABLED"):
        pytest.skip("not a free-threaded interpreter")
    # A module that has not declared that it needs no lock would have brought it back.
    assert not is_locked()


def number(array: Any) -> Any:
    """The number of each element, row by row."""
    return np.arange(array.size).reshape(array.shape)


@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        (lambda p, f: (p, f + len(p)), sc.BadInput, "row 0: index"),
        (lambda p, f: (p, np.where(f == 7, -1, f)), sc.BadInput, "index -1"),
        (lambda p, f: (p, np.where(f == 7, np.uint64(2**63 + 9), f.astype(np.uint64))), sc.BadInput, "9223372036854775817"),
        (lambda p, f: (np.where(number(p) == 16, np.nan, p), f), sc.BadInput, "row 5: y is NaN"),
        (lambda p, f: (np.where(number(p) == 16, np.inf, p), f), sc.BadInput, "row 5: y is inf"),
        (lambda p, f: (p[:, :2], f), sc.BadInput, r"\(n, 3\)"),
        (lambda p, f: (p.reshape(-1), f), sc.BadInput, r"\(n, 3\)"),
        (lambda p, f: (p, f[:, :2]), sc.BadInput, r"\(m, 3\)"),
        (lambda p, f: (p, np.insert(f, 0, 3, axis=1).reshape(-1)), sc.BadInput, r"reshape\(-1, 4\)"),
        (lambda p, f: (p, np.insert(f, 0, 3, axis=1)), sc.BadInput, "quads"),
        (lambda p, f: (p, f.astype(float)), sc.BadInput, "integers"),
        (lambda p, f: (p, f > 0), sc.BadInput, "integers"),
        (lambda p, f: (p.astype(complex), f), sc.BadInput, "numbers"),
        (lambda p, f: (p.astype(str), f), sc.BadInput, "numbers"),
        (lambda p, f: (p, f[:0]), sc.BadInput, "there are none"),
        (lambda p, f: (p[:0], f[:0]), sc.BadInput, "there are none"),
        (lambda p, f: (p[:0], f), sc.BadInput, "0 points"),
        (lambda p, f: (p, np.zeros_like(f)), sc.BadInput, "three different corners"),
        (lambda p, f: (None, f), sc.BadInput, r"\(n, 3\)"),
    ],
)
def test_bad_meshes_are_refused_with_the_place(ball: Ball, change: Any, kind: type[sc.Error], words: str) -> None:
    points, faces = ball
    given = change(points.copy(), faces.copy())
    with pytest.raises(kind, match=words) as caught:
        sc.simplify_arrays(*given, triangles=100)
    assert caught.value.exit_code == 4
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "one target"),
        ({"triangles": 9, "ratio": 0.1}, "one target"),
        ({"ratio": 1.5}, "ratio"),
        ({"ratio": 0}, "ratio"),
        ({"ratio": -0.5}, "ratio"),
        ({"ratio": float("nan")}, "ratio"),
        ({"triangles": 0}, "ask for at least 1"),
        ({"triangles": -5}, "-5"),
        ({"triangles": 0.5}, "use ratio"),
        ({"triangles": float("nan")}, "whole number"),
        ({"triangles": float("inf")}, "whole number"),
        ({"triangles": []}, "whole number"),
        ({"triangles": 9, "fit": "maybe"}, "maybe"),
        ({"triangles": 9, "topology": "any"}, "any"),
        ({"triangles": 9, "threads": 0}, "0"),
        ({"triangles": 9, "cell_triangles": 10}, "1000"),
        ({"triangles": 9, "weight": {"heat": 1}}, "no attribute 'heat'"),
        ({"triangles": 9, "label": "heat"}, "no attribute 'heat'"),
        ({"triangles": 9, "attributes": {"a": np.zeros(3)}}, "one row for each"),
        ({"triangles": 9, "attributes": {"a": None}}, "one row for each"),
        ({"triangles": 9, "attributes": {"color": "n2"}}, "is wanted"),
        ({"triangles": 9, "attributes": {"uv": "n3"}}, "is wanted"),
        ({"triangles": 9, "attributes": {"normal": "int"}}, "is wanted"),
        ({"triangles": 9, "attributes": {"a": "complex"}}, "cannot be carried"),
        ({"triangles": 9, "attributes": {"a": "object"}}, "cannot be carried"),
    ],
)
def test_bad_options_are_refused_by_name(ball: Ball, options: dict[str, Any], words: str) -> None:
    points, faces = ball
    n = len(points)
    arrays = {
        "n2": np.zeros((n, 2)),
        "n3": np.zeros((n, 3)),
        "int": np.zeros((n, 3), int),
        "complex": np.zeros(n, complex),
        "object": np.full(n, None),
    }
    options = dict(options)
    if "attributes" in options:
        options["attributes"] = {
            name: arrays[value] if isinstance(value, str) else value for name, value in options["attributes"].items()
        }
    with pytest.raises(sc.UsageError, match=words) as caught:
        sc.simplify_arrays(points, faces, **options)
    assert caught.value.exit_code == 2


def test_what_cannot_be_met_is_a_warning_or_an_error(ball: Ball) -> None:
    points, faces = ball
    with pytest.warns(sc.ShortOfTarget, match="short of the target"):
        result = sc.simplify_arrays(points, faces, triangles=2, topology="keep")
    assert not result.target_met and len(result.faces) >= 4
    with pytest.raises(sc.NotEnoughMemory, match="simplify_file") as caught:
        sc.simplify_arrays(points, faces, triangles=100, memory="1MiB")
    assert isinstance(caught.value, MemoryError)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sc.simplify_arrays(points, faces, triangles=len(faces))


def test_cells_in_memory_are_as_good_and_do_not_depend_on_threads() -> None:
    points, faces = sphere(120)
    whole = sc.simplify_arrays(points, faces, ratio=0.02)
    cells = [sc.simplify_arrays(points, faces, ratio=0.02, cell_triangles=8_000, threads=n) for n in (1, 3)]
    assert cells[0].report["cells"] > 15 and whole.report["cells"] == 1
    assert np.array_equal(cells[0].points, cells[1].points) and np.array_equal(cells[0].faces, cells[1].faces)
    assert is_closed(cells[0].faces)
    error = [sc.measure((points, faces), (r.points, r.faces), samples=50_000).rms for r in (whole, cells[0])]
    assert error[1] < 1.1 * error[0]


def test_a_map_leads_every_point_to_one_near_it() -> None:
    points, faces = sphere(60)
    several: list[dict[str, Any]] = [{}, {"cell_triangles": 4_000}]
    for options in several:
        small = sc.simplify_arrays(points, faces, ratio=0.2, map=True, **options)
        assert small.map is not None and small.map.shape == (len(points),) and small.map.min() >= 0
        assert np.linalg.norm(points - small.points[small.map], axis=1).max() < 0.5
        assert np.array_equal(small.map[small.source], np.arange(len(small.points)))
    assert sc.simplify_arrays(points, faces, ratio=0.2).map is None
    with pytest.raises(sc.UsageError, match="merge"):
        sc.simplify_arrays(points, faces, ratio=0.2, map=True, merge_distance=0.1)


@pytest.mark.parametrize("n", [2**31 + 1, 2**32])
def test_more_points_than_an_index_holds_are_refused_on_paper(n: int) -> None:
    # Rows of no length: points without their memory, which must be refused before they are copied.
    points = np.lib.stride_tricks.as_strided(np.zeros(3), shape=(n, 3), strides=(0, 8))
    with pytest.raises(sc.BadInput, match=f"points: {n} are too many"):
        sc.simplify_arrays(points, np.array([[0, 1, 2]]), triangles=1)
