#!/usr/bin/env python3
"""Compares the charts of textured meshes: their number, the texels that they fill, their stretch and their seams.

usage: charts.py MESH.obj...
needs numpy, scipy, pillow. Sizes of pages are those of the images in the material library, or those of the line
`# page WIDTH HEIGHT` that `texture_peers.py` writes.

A chart is a component of faces joined by edges with the same coordinates on both sides. Stretch is the surface below a
step of one texel, over the mean of the mesh: L2 of Sander et al. 2001 (1 is the least possible), and the share of the
area where the longest such step is more than twice the mean. Seams are edges between charts, in lengths over the root
of the surface; borders of the surface do not count. The gap is the least one of 99 % of those along rows and columns.
"""
import os
import sys
import numpy as np


def read(path):
    """Corners' positions and coordinates in texels, (faces, 3, 3) and (faces, 3, 2), pages of faces, sizes of pages."""
    folder, sizes, names, page, v, vt, faces, pages = os.path.dirname(path), {}, {}, 0, [], [], [], []
    for line in open(path):
        word, _, rest = line.partition(" ")
        if word == "v":
            v.append(rest.split()[:3])
        elif word == "vt":
            vt.append(rest.split()[:2])
        elif word == "f":
            faces.append([[int(i) - 1 for i in corner.split("/")[:2]] for corner in rest.split()])
            pages.append(page)
        elif word == "usemtl":
            page = names.setdefault(rest.strip(), len(names))
        elif word == "#" and rest.startswith("page "):
            sizes[0] = [int(x) for x in rest.split()[1:]]
        elif word == "mtllib":
            from PIL import Image
            for word, *rest in (l.split(None, 1) for l in open(os.path.join(folder, rest.strip())) if " " in l):
                if word == "newmtl":
                    material = names.setdefault(rest[0].strip(), len(names))
                elif word in ("map_Kd", "norm"):
                    sizes[material] = Image.open(os.path.join(folder, rest[0].strip())).size
    faces, pages, side = np.array(faces), np.array(pages), np.array([sizes[i] for i in range(max(len(names), 1))])
    return np.array(v, float)[faces[:, :, 0]], np.array(vt, float)[faces[:, :, 1]] * side[pages][:, None], pages, side


def numbered(rows):
    """Number of each row (last axis) among the different ones, the first of each, the count of each."""
    _, first, number, n = np.unique(rows.reshape(-1, rows.shape[-1]), axis=0, return_index=True, return_inverse=True,
                                    return_counts=True)
    return number.reshape(rows.shape[:-1]), first, n


def charts(p, t, pages):
    """Chart of each face, and the length of edges between charts."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    page = np.repeat(pages, 3).reshape(-1, 3, 1)
    corner = numbered(np.concatenate([np.round(t * 64), page, p], 2))[0]
    edges = [np.sort(np.stack([k, np.roll(k, -1, 1)], 2).reshape(-1, 2), 1) for k in (numbered(p)[0], corner)]
    (shared, _, n_shared), (joined, first, n_joined) = numbered(edges[0]), numbered(edges[1])
    face = np.arange(len(p)).repeat(3)
    graph = coo_matrix((np.ones(len(face)), (face, face[first][joined])), (len(p), len(p)))
    length = np.linalg.norm(p - np.roll(p, -1, 1), axis=2).reshape(-1)
    seam = n_joined[joined] < n_shared[shared]
    return connected_components(graph, False)[1], (length[seam] / n_shared[shared][seam]).sum()


def filled(t, pages, side, chart):
    """Chart of each texel of each page, -1 where there is none, and the number of texels in two faces."""
    sheets, twice = [np.full((h, w), -1) for w, h in side], 0
    for corners, page, c in zip(t, pages, chart):
        low, high = (np.clip(k.astype(int), 0, side[page])
                     for k in (np.ceil(corners.min(0) - 0.5), np.floor(corners.max(0) + 0.5)))
        x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
        turns = [(q[0] - o[0]) * (y - o[1]) - (q[1] - o[1]) * (x - o[0])
                 for o, q in zip(corners, np.roll(corners, -1, 0))]
        inside = np.all([s > 0 for s in turns], 0) | np.all([s < 0 for s in turns], 0)
        part = sheets[page][low[1]:high[1], low[0]:high[0]]
        twice += (part[inside] >= 0).sum()
        part[inside] = c
    return sheets, twice


def gap(sheets):
    found = []
    for sheet in [s for both in sheets for s in (both, both.T)]:
        row, column = np.nonzero(sheet >= 0)
        chart = sheet[row, column]
        found.append(np.diff(column)[(np.diff(row) == 0) & (np.diff(chart) != 0)] - 1)
    return np.percentile(np.concatenate(found), 1)


def look(path):
    p, t, pages, side = read(path)
    chart, seams = charts(p, t, pages)
    sheets, twice = filled(t, pages, side, chart)
    (p1, p2), (a, b) = (np.moveaxis(x[:, 1:] - x[:, :1], 1, 0) for x in (p, t))
    area, flat = np.linalg.norm(np.cross(p1, p2), axis=1), a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    good = (np.abs(flat) > 1e-9) & (area > 0)
    with np.errstate(all="ignore"):
        s = (p1 * b[:, 1:] - p2 * a[:, 1:]) / flat[:, None]
        u = (p2 * a[:, :1] - p1 * b[:, :1]) / flat[:, None]
    e, f, g = (s * s).sum(1), (s * u).sum(1), (u * u).sum(1)
    mean = np.sqrt(area[good].sum() / np.abs(flat[good]).sum())
    wide = good & (np.sqrt((e + g + np.sqrt((e - g) ** 2 + 4 * f * f)) / 2) > 2 * mean)
    l2 = np.sqrt(np.average((e + g)[good] / 2, weights=area[good])) / mean
    shown, all_texels = sum((sheet >= 0).sum() for sheet in sheets), side.prod(1).sum()
    print(f"{path}: {len(p)} triangles, {chart.max() + 1} charts, surface {shown / all_texels:.1%} of {all_texels} "
          f"texels, {1 / mean:.2f} a unit, L2 {l2:.3f}, more than 2x {area[wide].sum() / area.sum():.2%}, seams "
          f"{seams / np.sqrt(area.sum() / 2):.1f}, gap {gap(sheets):.0f}, in two faces {twice / shown:.2%}, "
          f"without coordinates {area[~good].sum() / area.sum():.2%}", flush=True)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    for mesh in sys.argv[1:]:
        look(mesh)
