"""Files: the report, the plan, measure, render, info, convert, synth; errors by class; the command."""

from __future__ import annotations

import inspect
import json
import keyword
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import stonecut as sc


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scan") / "scan.ply"
    made = sc.synth("scans", path, triangles=40_000)
    assert made["output"]["triangles"] >= 40_000
    return path


def test_simplify_file_gives_the_report_of_the_command(scan: Path) -> None:
    small = scan.parent / "small.ply"
    report = sc.simplify_file(scan, small, ratio=0.1, verify=True, report=scan.parent / "report.json", memory="1GiB")
    assert report["output"]["triangles"] <= report["target"] and report["target_met"]
    assert report["measured"]["rms"] > 0
    assert json.loads((scan.parent / "report.json").read_text()).keys() == report.keys()
    with pytest.raises(sc.UsageError, match="force"):
        sc.simplify_file(scan, small, ratio=0.1)
    again = sc.simplify_file(str(scan), str(small), triangles="2k", force=True, weight={"color": 0.5}, threads=1)
    assert again["settings"]["weight"].startswith("color=0.5")
    limited = sc.simplify_file(scan, scan.parent / "bound.ply", max_error=report["measured"]["forward"]["max"])
    assert limited["target_met"]


def test_values_are_carried_over_by_a_map(scan: Path) -> None:
    at = scan.parent
    sc.simplify_file(scan, at / "mapped.ply", ratio=0.2, map=at / "map.npy")
    with open(at / "map.npy", "rb") as file:
        to_result, to_input = np.load(file), np.load(file)
    np.save(at / "values.npy", np.arange(len(to_result), dtype=np.float32))
    done = sc.transfer(at / "map.npy", at / "values.npy", at / "carried.npy")
    carried = np.load(at / "carried.npy")
    assert done["rows"] == len(to_input) == len(carried) and carried.dtype == np.float32
    became = to_result == 7
    assert became.any() and carried[7] == pytest.approx(np.flatnonzero(became).mean(), rel=1e-5)


# Of the command line, and not of a module: how it talks, and what is a function here (`plan`) or always so (JSON).
_OF_THE_COMMAND_LINE = {"help", "quiet", "verbose", "log_file", "json", "dry_run", "output"}


@pytest.mark.parametrize("name", ["simplify", "measure", "render", "info", "convert", "synth", "tiles", "extract", "transfer"])
def test_every_option_of_the_command_is_a_keyword_of_the_same_name(name: str) -> None:
    asked = subprocess.run([sys.executable, "-m", "stonecut", name, "--help"], capture_output=True, text=True, check=True)
    options = re.findall(r"^ {2,6}(?:-\w, )?--([a-z][a-z-]*)", asked.stdout, re.MULTILINE)
    assert len(options) > 5
    function = sc.simplify_file if name == "simplify" else getattr(sc, name)
    known = set(inspect.signature(function).parameters)
    names = {option.replace("-", "_") for option in options} - _OF_THE_COMMAND_LINE
    # A word of the language has an underscore behind it.
    assert {f"{name}_" if keyword.iskeyword(name) else name for name in names} <= known


def test_tiles_are_made_and_a_mesh_is_extracted(scan: Path) -> None:
    at = scan.parent
    made = sc.tiles(scan, at / "tree", tile_triangles="4k", compress="none")
    assert made["tiles"] > 1 and (at / "tree" / "tileset.json").exists()
    whole = sc.extract(at / "tree", at / "whole.ply", max_error=0)
    some = sc.extract(at / "tree", at / "some.ply", triangles=3000)
    assert whole["triangles"] > 3000 >= some["triangles"] and some["reached"]
    with pytest.raises(sc.UsageError, match="force=True"):
        sc.extract(at / "tree", at / "some.ply", triangles=3000)


def test_errors_speak_python(scan: Path) -> None:
    with pytest.raises(FileNotFoundError) as missing:
        sc.simplify_file(scan.parent / "none.ply", scan.parent / "out.ply", ratio=0.1)
    assert isinstance(missing.value, sc.BadInput) and missing.value.path is not None
    with pytest.raises(sc.NotEnoughMemory, match=r"memory=\d") as small:
        sc.simplify_file(scan, scan.parent / "out.ply", ratio=0.1, memory="1MiB")
    assert "--" not in str(small.value)
    with pytest.raises(sc.UsageError, match="simplify_file"):
        sc.simplify(scan, ratio=0.1)


def test_other_methods_stages_and_reports(scan: Path) -> None:
    at = scan.parent
    coarse = sc.simplify_file(scan, at / "cluster.ply", grid=0.2, method="cluster", manifold=True)
    assert coarse["output"]["triangles"] > 0
    kept = sc.simplify_file(scan, at / "decimate.ply", ratio=0.2, method="decimate", feature_angle=45)
    assert kept["output"]["triangles"] > 0
    assert sc.simplify_file(scan, at / "pairs.ply", ratio=0.2, pairs=True)["target_met"]
    assert sc.simplify_file(scan, at / "until.ply", ratio=0.2, until="partition") == {}
    assert not (at / "until.ply").exists()
    assert sc.simplify_file(scan, at / "until.ply", ratio=0.2)["target_met"]
    found = sc.measure(
        scan, at / "until.ply", samples="2k", certify=True, tolerance="20%", report=at / "measured.json", force=True
    )
    assert found.keys() == json.loads((at / "measured.json").read_text()).keys()
    bounded = sc.simplify_file(scan, at / "field.ply", max_error=2 * found.max, error_field=True)
    assert bounded["target_met"]
    painted = sc.render(at / "field.ply", color_by="error", size=(80, 60))
    assert painted.shape == (60, 80, 3)
    with pytest.raises(sc.UsageError, match="for files only: certify, views"):
        sc.measure(([[0, 0, 0]], [[0, 0, 0]]), ([[0, 0, 0]], [[0, 0, 0]]), certify=True, views=3)


def test_a_plan_writes_nothing(scan: Path) -> None:
    before = sorted(scan.parent.iterdir())
    plan = sc.plan(scan, scan.parent / "planned.ply", ratio=0.01, cell_triangles=5_000)
    assert plan["cells"] >= 8 and plan["needed_memory_bytes"] > 0 and plan["temp_bytes"] > 0
    assert sorted(scan.parent.iterdir()) == before
    with pytest.raises(sc.NotEnoughMemory):
        sc.plan(scan, scan.parent / "planned.ply", ratio=0.01, memory="1MiB")


def test_measure_files_and_arrays_alike(scan: Path) -> None:
    small = scan.parent / "measured.ply"
    sc.simplify_file(scan, small, ratio=0.05)
    found = sc.measure(scan, small, samples="50k", heatmap=scan.parent / "heat.ply")
    assert found.rms == found["rms"] and found.max >= found.rms >= 0 and found.mean <= found.rms
    assert 0 < found.relative_rms < 0.1
    assert (scan.parent / "heat.ply").exists()
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    same = sc.measure((points, faces), (points, faces), samples=1000)
    assert same.max == 0 and same["original"]["topology"]["euler_characteristic"] == 2
    moved = sc.measure((points, faces), (points + [0, 0, 0.25], faces), samples=20_000)
    assert moved.max == pytest.approx(0.25, rel=1e-6)
    with pytest.raises(sc.UsageError, match="two files or two meshes"):
        sc.measure(scan, (points, faces))
    with pytest.raises(sc.BadInput, match="index 6"):
        sc.measure((points, faces), (points, faces + 6))


def test_measure_in_memory_refuses_what_the_command_refuses() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    line = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.0]]), np.array([[0, 1, 2]])
    with pytest.raises(sc.BadInput, match="simplified: its 1 triangles have no area"):
        sc.measure((points, faces), line, samples=1000)
    with pytest.raises(sc.BadInput, match="original: its 1 triangles have no area"):
        sc.measure(line, (points, faces), samples=1000)
    too_few: list[int | str] = [0, -3, "0"]
    for samples in too_few:
        with pytest.raises(sc.UsageError, match="at least one sample"):
            sc.measure((points, faces), (points, faces), samples=samples)
    # Without faces there is no surface: every distance to it is infinite.
    none = np.zeros((0, 3), np.int64)
    for first, second in ((faces, none), (none, faces)):
        found = sc.measure((points, first), (points, second), samples=1000)
        assert found["rms"] is None
        assert found.rms == found.relative_rms == found.mean == found.max == float("inf")


def test_render_gives_pixels_and_writes_a_picture(scan: Path) -> None:
    out = scan.parent / "picture.png"
    pixels = sc.render(scan, out, size=(160, 120), color="vertex", view=(1, -1, 0.5), edges=True)
    assert pixels.shape == (120, 160, 3) and pixels.dtype == np.uint8 and pixels.std() > 5
    assert out.read_bytes()[1:4] == b"PNG"
    with pytest.raises(sc.UsageError, match="force"):
        sc.render(scan, out, size=(16, 12))
    both = sc.render([scan, scan], size=(80, 60), caption=["before", "after"])
    assert both.shape[1] == 162 and both.shape[0] > 60
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    drawn = sc.render((points, faces), scan.parent / "arrays.png", size=(64, 64))
    assert drawn.shape == (64, 64, 3) and drawn.std() > 5
    with pytest.raises(sc.UsageError, match="1 to 16384"):
        sc.render((points, faces), size=(0, 5))


def test_info_convert_and_names_that_look_like_options(scan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(scan.parent)
    done = sc.convert(scan, "-odd name.obj", format="obj")
    assert done["output"]["triangles"] > 39_000
    assert sc.info("-odd name.obj")["triangles"] == done["output"]["triangles"]
    checked = sc.info(scan, check=True)
    assert checked["components"] > 1 and checked["properties"][:3] == ["red", "green", "blue"]
    sc.convert("-odd name.obj", "again.stl", force=True)
    assert sc.info("again.stl")["coordinate_bits"] == 32


def test_errors_have_the_class_of_their_exit_code(scan: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.ply"
    bad.write_text("ply\nformat ascii 1.0\nelement vertex 3\n")
    missing = tmp_path / "missing.ply"
    cases: list[tuple[type[sc.Error], type[BaseException], int, object]] = [
        (sc.BadInput, ValueError, 4, lambda: sc.info(bad)),
        (sc.BadInput, ValueError, 4, lambda: sc.info(missing)),
        (sc.UsageError, ValueError, 2, lambda: sc.convert(scan, tmp_path / "x.docx")),
        (sc.UsageError, ValueError, 2, lambda: sc.synth("cube", tmp_path / "x.ply", triangles=10)),  # type: ignore[arg-type]
        (sc.UsageError, ValueError, 2, lambda: sc.info("-")),
        (sc.UsageError, ValueError, 2, lambda: sc.info(3)),  # type: ignore[arg-type]
        (sc.UsageError, ValueError, 2, lambda: sc.simplify_file(scan, tmp_path / "no" / "folder.ply", ratio=0.1)),
        (sc.NotEnoughMemory, MemoryError, 6, lambda: sc.simplify_file(scan, tmp_path / "a.ply", ratio=0.1, memory="1MiB")),
    ]
    for kind, builtin, code, call in cases:
        with pytest.raises(kind) as caught:
            call()  # type: ignore[operator]
        error = caught.value
        assert isinstance(error, builtin) and isinstance(error, sc.Error) and error.exit_code == code
        copy = pickle.loads(pickle.dumps(error))
        assert type(copy) is type(error) and str(copy) == str(error) and copy.path == error.path
    with pytest.raises(sc.BadInput) as caught:
        sc.info(bad)
    assert caught.value.path == str(bad) and str(bad) in str(caught.value)
    assert sc.BadInput.__module__ == "stonecut.errors"


def test_every_class_can_be_made_and_pickled() -> None:
    from stonecut import errors

    for code in (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 130):
        for errno in (None, 13):
            error = errors._make(code, "what", "/some/path", errno)
            assert error.exit_code == code and str(error) == "what" and error.path == "/some/path"
            copy = pickle.loads(pickle.dumps(error))
            assert (type(copy), str(copy), copy.path) == (type(error), "what", "/some/path")
            assert getattr(copy, "errno", None) == getattr(error, "errno", None)
    assert isinstance(errors._make(1, "what", None, 13), OSError)
    full = errors._make(5, "what", None, None)
    assert isinstance(full, OSError) and full.errno == 28


def test_the_command_comes_with_the_module(scan: Path) -> None:
    for command in ([sys.executable, "-m", "stonecut"], [str(Path(sys.executable).parent / "stonecut")]):
        done = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True)
        assert done.stdout == f"stonecut {sc.__version__}\n"
        wrong = subprocess.run([*command, "simplify"], capture_output=True, text=True, check=False)
        assert wrong.returncode == 2 and "Usage" in wrong.stderr
        done = subprocess.run([*command, "info", str(scan), "--json"], capture_output=True, text=True, check=True)
        assert json.loads(done.stdout) == sc.info(scan)
