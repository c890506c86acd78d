"""The recipes of docs/python.md, run as they stand."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import pytest

import stonecut as sc

_HERE = Path(__file__).resolve()
_PAGES = [_HERE.parents[1] / "python.md", _HERE.parents[3] / "docs" / "python.md" if len(_HERE.parents) > 3 else _HERE]
_PAGE = next((page.read_text() for page in _PAGES if page.name == "python.md" and page.exists()), "")
_SECTIONS = re.split(r"^## ", _PAGE, flags=re.MULTILINE)[1:]
_RECIPES = {
    section.splitlines()[0]: re.findall(r"^```python\n(.*?)^```", section, flags=re.MULTILINE | re.DOTALL)
    for section in _SECTIONS
}
_RECIPES = {title: blocks for title, blocks in _RECIPES.items() if blocks}


def test_there_are_five() -> None:
    assert len(_RECIPES) == 5, list(_RECIPES)


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
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sc.ShortOfTarget)
        exec(compile(code, title, "exec"), {"__name__": title})
    made = {
        "From trimesh": ["small.ply"],
        "Measure and plot the error": ["error.png"],
        "A folder of scans": ["small/a.ply", "small/b.ply"],
    }
    assert all(Path(name).exists() for name in made.get(title, []))
