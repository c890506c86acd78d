#!/usr/bin/env python3
"""Images of every kind that people's scans have, baked and kept: colours of the result against those that Pillow reads.

  pip install numpy pillow trimesh
  tools/image_kinds.py STONECUT FOLDER

A sheet of 7,200 triangles with one image of 192 x 128 goes through `simplify --ratio 20%` to GLB, once with a new texture and once with its own.
Prints exit codes and the mean difference at the vertices within the result (0 to 255).
"""
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

STONECUT, FOLDER = str(Path(sys.argv[1]).absolute()), Path(sys.argv[2])
FOLDER.mkdir(parents=True, exist_ok=True)
SIDE, WIDTH, HEIGHT = 60, 192, 128
ROWS, COLUMNS = np.mgrid[0:HEIGHT, 0:WIDTH]
COLOURS = np.stack([COLUMNS * 255 // (WIDTH - 1), ROWS * 255 // (HEIGHT - 1), (255 - COLUMNS * 255 // (WIDTH - 1)) // 2], -1).astype("u1")


def png_of_16_bits(path):
    """Pillow writes no PNG of three channels with 16 bits."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = b"".join(b"\0" + (row.astype(">u2") * 257).tobytes() for row in COLOURS)
    head = struct.pack(">IIBBBBB", WIDTH, HEIGHT, 16, 2, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def kinds():
    """Name of each image and its colours."""
    image = Image.fromarray(COLOURS)
    grey, turned = image.convert("L"), image.getexif()
    turned[0x112] = 6  # Orientation: a quarter to the right. Coordinates of texture count in the image as it is stored.
    few = image.quantize(16)
    for name, made, how in [
        ("rgb.png", image, {}), ("palette.png", image.quantize(256), {}), ("palette-4-bits.png", few, {"bits": 4}),
        ("grey.png", grey, {}), ("grey.jpg", grey, {"quality": 95}), ("progressive.jpg", image, {"quality": 95, "progressive": True}),
        ("cmyk.jpg", image.convert("CMYK"), {"quality": 95}), ("exif-turned.jpg", image, {"quality": 95, "exif": turned}),
        ("lossless.webp", image, {"lossless": True}), ("plain.tif", image, {}), ("lzw.tif", image, {"compression": "tiff_lzw"}),
        ("cmyk.tif", image.convert("CMYK"), {}), ("lab.tif", image.convert("LAB"), {}), ("plain.bmp", image, {}),
        ("plain.tga", image, {}), ("plain.gif", image, {}), ("jpeg-2000.jp2", image, {}),
    ]:
        made.save(FOLDER / name, **how)
        yield name, np.array(Image.open(FOLDER / name).convert("RGB"))
    png_of_16_bits(FOLDER / "rgb-16-bits.png")
    yield "rgb-16-bits.png", COLOURS


def sheet(image):
    with (FOLDER / "sheet.obj").open("w") as out:
        out.write("mtllib sheet.mtl\n")
        at = [(i, j) for j in range(SIDE + 1) for i in range(SIDE + 1)]
        out.writelines(f"v {i} {j} {0.3 * np.sin(i / 9)}\n" for i, j in at)
        out.writelines(f"vt {i / SIDE} {j / SIDE}\n" for i, j in at)
        out.write("usemtl m\n")
        for a in (j * (SIDE + 1) + i + 1 for j in range(SIDE) for i in range(SIDE)):
            b, c, d = a + 1, a + SIDE + 2, a + SIDE + 1
            out.write(f"f {a}/{a} {b}/{b} {c}/{c}\nf {a}/{a} {c}/{c} {d}/{d}\n")
    (FOLDER / "sheet.mtl").write_text(f"newmtl m\nKd 0.2 0.4 0.8\nmap_Kd {image}\n")


def difference(result, colours):
    mesh = trimesh.load(result, process=False, force="mesh")
    page = mesh.visual.material.baseColorTexture
    if page is None:
        return "the material's colour"

    def at(values, u, v):
        height, width = values.shape[:2]
        return values[np.clip((v * height).astype(int), 0, height - 1), np.clip((u * width).astype(int), 0, width - 1)].astype(float)

    uv, place = mesh.visual.uv, mesh.vertices / SIDE
    found = at(np.array(page.convert("RGB")), uv[:, 0], 1 - uv[:, 1])
    # Images repeat, so at the border of the sheet viewers mix in its opposite border, as a new texture does.
    inside = (np.abs(place[:, :2] - 0.5) < 0.48).all(1)
    return f"{np.abs(found - at(colours, place[:, 0], 1 - place[:, 1]))[inside].mean():.1f}"


print("| image | new texture | its own |\n|---|---|---|")
for name, colours in kinds():
    sheet(name)
    cells = []
    for texture in ("bake", "keep"):
        result = FOLDER / f"{texture}.glb"
        done = subprocess.run([STONECUT, "simplify", FOLDER / "sheet.obj", result, "--ratio", "20%", "--texture", texture, "--force", "--restart", "-q"])
        cells.append(f"{done.returncode}, {difference(result, colours)}")
    print(f"| {name} | {' | '.join(cells)} |", flush=True)
