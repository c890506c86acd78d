#!/usr/bin/env python3
"""Measures how much of foreign colours smaller sizes of a page show within charts, beside their borders and inside.

usage: seam_colours.py MESH.obj...
needs numpy, scipy, pillow, and charts.py beside it. Every texel of a chart is looked up as a graphics card does, as a
mean of four texels of a page that was halved as light, and again where only texels of its own chart count. What differs
(CIELAB, Delta E 1976) came from beyond the border. Beside a border: within two texels. The second row of numbers is the
same page, with its mean colour on all that is not in a chart: what it would be without colours beyond borders.
"""
import os
import sys
import numpy as np
from PIL import Image
from charts import charts, filled, read
MARGIN = 32


def pages_of(path):
    """Images of the material library, in the order of the materials, as light."""
    folder = os.path.dirname(path)
    names = [l.split(None, 1)[1].strip() for l in open(path[:-4] + ".mtl") if l.startswith("map_Kd ")]
    pages = [np.asarray(Image.open(os.path.join(folder, n)).convert("RGB"))[::-1] / 255.0 for n in names]
    return [np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) for c in pages]


def lab(c):
    xyz = c @ np.array([[0.4339, 0.2126, 0.0177], [0.3762, 0.7152, 0.1095], [0.1899, 0.0722, 0.8728]])
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], 1)


def halved(page):
    return (page[::2, ::2] + page[1::2, ::2] + page[::2, 1::2] + page[1::2, 1::2]) / 4


def looked_up(page, at):
    low = np.floor(at - 0.5).astype(int)
    part, colour = at - 0.5 - low, 0
    for dx in (0, 1):
        for dy in (0, 1):
            weight = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            colour = colour + page[low[:, 1] + dy, low[:, 0] + dx] * weight[:, None]
    return colour


def look(path):
    from scipy.ndimage import binary_erosion, find_objects
    p, t, pages, side = read(path)
    sheets, _ = filled(t, pages, side, charts(p, t, pages)[0])
    found = {(how, level): [] for how in (0, 1) for level in range(4)}
    beside = []
    for image, sheet in zip(pages_of(path), sheets):
        size = [-n % 16 for n in sheet.shape]
        sheet = np.pad(sheet, [(MARGIN, MARGIN + n) for n in size], constant_values=-1)
        image = np.pad(image, [(MARGIN, MARGIN + n) for n in size] + [(0, 0)], mode="edge")
        bare = np.where((sheet >= 0)[:, :, None], image, image[sheet >= 0].mean(0))
        for chart, box in enumerate(find_objects(sheet + 1)):
            if box is None:
                continue
            low = [s.start // 16 * 16 - 16 for s in box]
            box = tuple(slice(l, -(-s.stop // 16) * 16 + 16) for l, s in zip(low, box))
            mask = sheet[box] == chart
            y, x = np.nonzero(mask)
            beside.append(~binary_erosion(mask, np.ones((3, 3)), 2)[y, x])
            at, own = np.stack([x, y], 1) + 0.5, np.dstack([image[box] * mask[:, :, None], mask])
            for how, level_of in enumerate((image[box], bare[box])):
                mine = own
                for level in range(4):
                    alone = looked_up(mine, at / 2**level)
                    alone = alone[:, :3] / np.maximum(alone[:, 3:], 1e-9)
                    step = lab(looked_up(level_of, at / 2**level)) - lab(alone)
                    found[how, level].append(np.linalg.norm(step, axis=1))
                    level_of, mine = halved(level_of), halved(mine)
    beside = np.concatenate(beside)
    print(f"{path}: {beside.mean():.1%} of {len(beside)} texels are beside borders")
    for (how, level), step in found.items():
        step = np.concatenate(step)
        print(f"  {('as it is', 'bare')[how]}, 1/{2**level}: beside borders mean {step[beside].mean():.2f}, 99 % below "
              f"{np.percentile(step[beside], 99):.1f}; inside {step[~beside].mean():.2f}, "
              f"{np.percentile(step[~beside], 99):.1f}", flush=True)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    for mesh in sys.argv[1:]:
        look(mesh)
