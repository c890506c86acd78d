#!/usr/bin/env python3
"""Trees of tiles that other programs made of one scan, read back: triangles, and the largest distance from the scan.

  npm install 3d-tiles-tools; pip install py3dtiles numpy
  tools/trees_of_others.py STONECUT FOLDER_OF_NODE_MODULES

The scan is a statue of 20,000 triangles in twelve GLB tiles with overlap 0 (`synth --tiles`), and the same as `stonecut tiles` cuts it.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

STONECUT, NODE = sys.argv[1], Path(sys.argv[2]).absolute()


def run(*words, cwd=None):
    done = subprocess.run([str(w) for w in words], cwd=cwd, capture_output=True, text=True)
    return done.returncode, done.stdout + done.stderr


def cesium(*words):
    code, said = run("npx", "--prefix", NODE, "3d-tiles-tools", *words, cwd=NODE)
    if code:
        raise SystemExit(said)


def by_py3dtiles(folder):
    """A tree of one batched mesh with normals, moved by a transform, by py3dtiles."""
    import numpy as np
    from py3dtiles.tileset.content import B3dm
    from py3dtiles.tileset.tile import Tile
    from py3dtiles.tileset.tileset import TileSet
    from py3dtiles.tileset.bounding_volume_box import BoundingVolumeBox

    n = 20
    grid = np.array([[x, y, 0.1 * np.sin(x)] for y in range(n) for x in range(n)], dtype=np.float32)
    at = [(y * n + x, y * n + x + 1, (y + 1) * n + x) for y in range(n - 1) for x in range(n - 1)]
    at += [(a + 1, a + n + 1, a + n) for a, _, _ in at]
    mesh = B3dm.from_numpy_arrays(grid, np.array(at, dtype=np.uint32).reshape(-1, 3))
    folder.mkdir()
    mesh.save_as(folder / "m.b3dm")
    box = BoundingVolumeBox()
    box.set_from_list([10, 10, 0, 10, 0, 0, 0, 10, 0, 0, 0, 1])
    far = np.eye(4)
    far[:3, 3] = [4_278_000.0, 636_000.0, 4_672_000.0]
    tree = TileSet(geometric_error=10)
    tree.root_tile = Tile(geometric_error=0, bounding_volume=box, content_uri=Path("m.b3dm"), transform=far)
    tree.write_as_json(folder / "tileset.json")
    return len(at)


def row(name, tree, wanted, folder):
    out = folder / f"{name.replace(' ', '_')}.ply"
    code, said = run(STONECUT, "convert", tree, out, "--force", "--weld", "auto")
    if code not in (0, 3):
        print(f"| {name} | {said.strip().splitlines()[-1]} | | |")
        return
    _, text = run(STONECUT, "info", out, "--check", "--json")
    info = json.loads(text)
    print(f"| {name} | {info['triangles']} of {wanted} | {info.get('components')} | {info.get('boundary_edges')} |")


def main():
    folder = Path(tempfile.mkdtemp())
    run(STONECUT, "synth", "statue", folder / "scan.ply", "--triangles", "20000")
    run(STONECUT, "synth", "statue", folder / "glb", "--triangles", "20000", "--tiles", "12", "--format", "glb")
    _, text = run(STONECUT, "info", folder / "scan.ply", "--json")
    wanted = json.loads(text)["triangles"]
    print("| tree | triangles | components | open edges |\n|---|---|---|---|")
    cesium("createTilesetJson", "-f", "-i", folder / "glb", "-o", folder / "glb" / "tileset.json")
    row("3d-tiles-tools, GLB", folder / "glb" / "tileset.json", wanted, folder)
    (folder / "b3dm").mkdir()
    for glb in sorted((folder / "glb").glob("*.glb")):
        cesium("glbToB3dm", "-f", "-i", glb, "-o", folder / "b3dm" / (glb.stem + ".b3dm"))
    cesium("createTilesetJson", "-f", "-i", folder / "b3dm", "-o", folder / "b3dm" / "tileset.json")
    row("3d-tiles-tools, b3dm", folder / "b3dm" / "tileset.json", wanted, folder)
    cesium("merge", "-f", "-i", folder / "glb", "-o", folder / "merged")
    row("3d-tiles-tools, merged", folder / "merged" / "tileset.json", wanted, folder)
    cesium("upgrade", "-f", "-i", folder / "b3dm" / "tileset.json", "-o", folder / "upgraded", "--targetVersion", "1.1")
    row("3d-tiles-tools, upgraded to 1.1", folder / "upgraded" / "tileset.json", wanted, folder)
    n = by_py3dtiles(folder / "py3dtiles")
    row("py3dtiles, b3dm in ECEF", folder / "py3dtiles" / "tileset.json", n, folder)
    run(STONECUT, "tiles", folder / "scan.ply", folder / "own", "--tile-triangles", "2000")
    row("stonecut tiles", folder / "own" / "tileset.json", wanted, folder)


main()
