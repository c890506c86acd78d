"""The recipes of docs/python.md and docs/recipes.md, run as they stand."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from conftest import is_closed

import stonecut as sc

_HERE = Path(__file__).resolve()
# Beside the tests, where these were copied, or in the checkout.
_FOLDERS = [_HERE.parents[1], *(above / "docs" for above in _HERE.parents[3:4])]


def _recipes(name: str) -> dict[str, list[str]]:
    page = next((at / name for at in _FOLDERS if (at / name).exists()), None)
    sections = re.split(r"^## ", page.read_text() if page else "", flags=re.MULTILINE)[1:]
    found = {s.splitlines()[0]: re.findall(r"^```python\n(.*?)^```", s, flags=re.MULTILINE | re.DOTALL) for s in sections}
    return {title: blocks for title, blocks in found.items() if blocks}


_RECIPES = _recipes("python.md") | _recipes("recipes.md")
# Beyond thirty lines it is a program.
_MOST_LINES = 30


def test_there_are_eight() -> None:
    assert len(_RECIPES) == 8, list(_RECIPES)
    assert all("\n".join(blocks).count("\n") <= _MOST_LINES for blocks in _RECIPES.values())


def _closed(path: Path) -> bool:
    """True for a mesh of neuroglancer in which every edge has two triangles."""
    data = path.read_bytes()
    n = int.from_bytes(data[:4], "little")
    return is_closed(np.frombuffer(data, "<u4", offset=4 + 12 * n).reshape(-1, 3))


def _see(title: str) -> None:
    """What the recipe does not check itself."""
    made = {
        "From trimesh": ["small.ply"],
        "Measure and plot the error": ["error.png"],
        "A folder of scans": ["small/a.ply", "small/b.ply"],
        "pyvista": ["small.vtp"],
        "Labels, for neuroglancer and napari": ["mesh/info", "mesh/7", "mesh/7:0", "mesh/9"],
    }
    assert all(Path(name).exists() for name in made.get(title, []))
    if title == "Blender":
        bpy = pytest.importorskip("bpy")
        bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=6)
        before = len(bpy.context.object.data.polygons)
        assert bpy.ops.object.stonecut(ratio=0.05) == {"FINISHED"}
        assert 0 < len(bpy.context.object.data.polygons) <= 0.05 * before
    if title.startswith("Labels"):
        assert _closed(Path("mesh/7")) and _closed(Path("mesh/9"))


@pytest.mark.parametrize("title", _RECIPES)
def test_recipe(title: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = "\n".join(_RECIPES[title])
    for module in re.findall(r"^(?:import|from) (\w+)", code, flags=re.MULTILINE):
        pytest.importorskip(module)
    # No window is opened.
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.chdir(tmp_path)
    sc.synth("statue", "scan.ply", triangles=60_000, color=True)
    Path("scans").mkdir()
    sc.synth("statue", "scans/a.ply", triangles=8_000)
    sc.synth("gyroid", "scans/b.ply", triangles=8_000)
    Path("scans/broken.ply").write_text("ply\n")
    labels = np.zeros((20, 40, 40), np.uint16)
    labels[4:16, 5:35, 5:20], labels[6:12, 10:30, 20:33] = 7, 9
    np.save("labels.npy", labels)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sc.ShortOfTarget)
        exec(compile(code, title, "exec", dont_inherit=True), {"__name__": title})
    _see(title)
