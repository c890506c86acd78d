#!/usr/bin/env python3
"""Compares Python packages that simplify meshes, on the same arrays in one run.

    python3 tools/compare_python.py OUT.json MESH.ply... [--ratios 0.1 0.01] [--only NAME...] [--samples 500000]
    python3 tools/compare_python.py - MESH.ply --uv --threads        # texture coordinates; eight threads at once

A mesh is read once. Every package then works in a forked child, which inherits the arrays, imports the package, does a tiny
mesh first and is measured on the call alone: wall time, processor time, growth of the peak of resident memory, and what
comes back. The error is two-sided, over samples spread evenly by area, by Open3D's ray casting scene (Embree), which shares no code
with stonecut. Needs numpy, open3d and the packages to compare; a package that is not installed is left out.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import tempfile
import time
import traceback
from pathlib import Path

import numpy as np


class Result:
    """Result of a package."""

    def __init__(self, points, faces, colors=None):
        self.points, self.faces, self.colors = np.asarray(points), np.asarray(faces), colors


def stonecut(points, faces, colors, count):
    import stonecut

    attributes = None if colors is None else {"color": colors}
    done = stonecut.simplify_arrays(points, faces, triangles=count, attributes=attributes)
    return Result(done.points, done.faces, done.attributes.get("color"))


def stonecut_one_thread(points, faces, colors, count):
    import stonecut

    attributes = None if colors is None else {"color": colors}
    done = stonecut.simplify_arrays(points, faces, triangles=count, attributes=attributes, threads=1)
    return Result(done.points, done.faces, done.attributes.get("color"))


def fast_simplification(points, faces, colors, count):
    import fast_simplification

    return Result(*fast_simplification.simplify(points, faces, target_count=count))


def pyfqmr(points, faces, colors, count):
    import pyfqmr

    work = pyfqmr.Simplify()
    work.setMesh(points, faces)
    work.simplify_mesh(target_count=count, verbose=False)
    vertices, triangles, _ = work.getMesh()
    return Result(vertices, triangles)


def trimesh(points, faces, colors, count):
    import trimesh

    mesh = trimesh.Trimesh(points, faces, vertex_colors=colors, process=False)
    small = mesh.simplify_quadric_decimation(face_count=count)
    kept = None if colors is None or small.visual.kind != "vertex" else np.asarray(small.visual.vertex_colors)[:, :3]
    return Result(small.vertices, small.faces, kept)


def _pyvista(points, faces, colors):
    import pyvista

    mesh = pyvista.PolyData.from_regular_faces(points, faces)
    if colors is not None:
        mesh.point_data["rgb"] = colors
    return mesh


def _from_pyvista(mesh):
    kept = mesh.point_data["rgb"] if "rgb" in mesh.point_data else None
    return Result(mesh.points, mesh.regular_faces, kept)


def pyvista(points, faces, colors, count):
    mesh = _pyvista(points, faces, colors)
    return _from_pyvista(mesh.decimate(1 - count / len(faces), scalars=colors is not None))


def pyvista_pro(points, faces, colors, count):
    return _from_pyvista(_pyvista(points, faces, colors).decimate_pro(1 - count / len(faces)))


def open3d(points, faces, colors, count):
    import open3d

    vector = open3d.utility.Vector3dVector
    mesh = open3d.geometry.TriangleMesh(vector(points.astype(np.float64)), open3d.utility.Vector3iVector(faces))
    if colors is not None:
        mesh.vertex_colors = vector(colors / 255)
    small = mesh.simplify_quadric_decimation(count)
    kept = np.rint(255 * np.asarray(small.vertex_colors)) if small.has_vertex_colors() else None
    return Result(np.array(small.vertices), np.array(small.triangles), kept)


def pymeshlab(points, faces, colors, count):
    import pymeshlab

    rgba = None if colors is None else np.column_stack([colors / 255, np.ones(len(colors))])
    given = {} if rgba is None else {"v_color_matrix": rgba}
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(points.astype(np.float64), faces, **given))
    meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=count)
    small = meshes.current_mesh()
    kept = None if rgba is None else np.rint(255 * small.vertex_color_matrix()[:, :3])
    return Result(small.vertex_matrix(), small.face_matrix(), kept)


def meshlib(points, faces, colors, count):
    from meshlib import mrmeshnumpy
    from meshlib import mrmeshpy

    mesh = mrmeshnumpy.meshFromFacesVerts(faces, points)
    settings = mrmeshpy.DecimateSettings()
    settings.maxDeletedFaces = mesh.topology.numValidFaces() - count
    settings.maxError = 3.4e38
    settings.packMesh = True
    mrmeshpy.decimateMesh(mesh, settings)
    return Result(mrmeshnumpy.getNumpyVerts(mesh), mrmeshnumpy.getNumpyFaces(mesh.topology))


def meshlib_parallel(points, faces, colors, count):
    from meshlib import mrmeshnumpy
    from meshlib import mrmeshpy

    mesh = mrmeshnumpy.meshFromFacesVerts(faces, points)
    settings = mrmeshpy.DecimateSettings()
    settings.maxDeletedFaces = mesh.topology.numValidFaces() - count
    settings.maxError = 3.4e38
    settings.packMesh = True
    settings.subdivideParts = 16
    mrmeshpy.decimateMesh(mesh, settings)
    return Result(mrmeshnumpy.getNumpyVerts(mesh), mrmeshnumpy.getNumpyFaces(mesh.topology))


PACKAGES = {
    f.__name__: f
    for f in (
        stonecut,
        stonecut_one_thread,
        fast_simplification,
        pyfqmr,
        trimesh,
        pyvista,
        pyvista_pro,
        open3d,
        pymeshlab,
        meshlib,
        meshlib_parallel,
    )
}


# What each package does with texture coordinates: takes one pair a vertex, gives points, faces and pairs at corners (m, 3, 2).


def uv_stonecut(points, faces, uv, count):
    import stonecut

    done = stonecut.simplify_arrays(points, faces, triangles=count, attributes={"uv": uv})
    return done.points, done.faces, done.attributes["uv"][done.faces]


def uv_trimesh(points, faces, uv, count):
    import trimesh

    visual = trimesh.visual.TextureVisuals(uv=uv)
    small = trimesh.Trimesh(points, faces, visual=visual, process=False).simplify_quadric_decimation(face_count=count)
    kept = getattr(small.visual, "uv", None)
    return small.vertices, small.faces, None if kept is None or not len(kept) else np.asarray(kept)[small.faces]


def _uv_pyvista(points, faces, uv, decimate):
    import pyvista

    mesh = pyvista.PolyData.from_regular_faces(points, faces)
    mesh.active_texture_coordinates = uv
    small = decimate(mesh)
    kept = small.active_texture_coordinates
    faces = small.regular_faces
    return small.points, faces, None if kept is None else np.asarray(kept)[faces]


def uv_pyvista(points, faces, uv, count):
    return _uv_pyvista(points, faces, uv, lambda mesh: mesh.decimate(1 - count / len(faces), tcoords=True))


def uv_pyvista_pro(points, faces, uv, count):
    return _uv_pyvista(points, faces, uv, lambda mesh: mesh.decimate_pro(1 - count / len(faces)))


def uv_open3d(points, faces, uv, count):
    import open3d

    vector = open3d.utility.Vector3dVector
    mesh = open3d.geometry.TriangleMesh(vector(points.astype(np.float64)), open3d.utility.Vector3iVector(faces))
    mesh.triangle_uvs = open3d.utility.Vector2dVector(uv[faces.reshape(-1)].astype(np.float64))
    small = mesh.simplify_quadric_decimation(count)
    kept = np.array(small.triangle_uvs).reshape(-1, 3, 2) if small.has_triangle_uvs() else None
    return np.array(small.vertices), np.array(small.triangles), kept


def uv_pymeshlab(points, faces, uv, count):
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(points.astype(np.float64), faces, v_tex_coords_matrix=uv.astype(np.float64)))
    meshes.compute_texcoord_transfer_vertex_to_wedge()
    meshes.meshing_decimation_quadric_edge_collapse_with_texture(targetfacenum=count)
    small = meshes.current_mesh()
    return small.vertex_matrix(), small.face_matrix(), small.wedge_tex_coord_matrix().reshape(-1, 3, 2)


UV = {f.__name__[3:]: f for f in (uv_stonecut, uv_trimesh, uv_pyvista, uv_pyvista_pro, uv_open3d, uv_pymeshlab)}


def compare_uv(path, ratio, n_samples):
    """For each package: whether texture coordinates come back, and how far they are off at samples of the result."""
    points, faces, uv = read_ply(path, ("s", "t"))
    count = round(ratio * len(faces))
    for name, work in UV.items():

        def run(work=work):
            new_points, new_faces, corners = work(points, faces, uv, count)
            found = {"triangles": len(new_faces), "kept": corners is not None}
            if corners is not None:
                low, high = points.min(axis=0), points.max(axis=0)
                whole = Surface(points, faces, (low + high) / 2, np.linalg.norm(high - low))
                small = Surface(new_points, new_faces, (low + high) / 2, np.linalg.norm(high - low))
                places, which, weights = sample(small.points, small.faces, n_samples, 1)
                near = whole.nearest(places)
                at = near["primitive_uvs"].astype(np.float64)
                beside = np.stack([1 - at[:, 0] - at[:, 1], at[:, 0], at[:, 1]], axis=1)
                mine = np.einsum("ij,ijk->ik", weights, corners[which])
                theirs = colour_at(uv, faces, near["primitive_ids"], beside)
                off = np.linalg.norm(mine - theirs, axis=1)
                found |= {"median": float(np.median(off)), "rms": float(np.sqrt((off**2).mean()))}
                found["off_by_0.02"] = float((off > 0.02).mean())
            return found

        print(json.dumps({"mesh": path.stem, "ratio": ratio, "package": name, **in_child(run)}), flush=True)


def compare_threads():
    """Eight threads at once ask for 800 or 8,000 triangles of the same sphere, four times each."""
    import threading

    import trimesh

    ball = trimesh.creation.icosphere(6)
    points, faces = np.asarray(ball.vertices), np.asarray(ball.faces, dtype=np.int32)
    for name in ("stonecut", "fast_simplification", "pyfqmr", "trimesh", "open3d", "pymeshlab"):

        def run(work=PACKAGES[name]):
            found = []

            def ask(wanted):
                for _ in range(4):
                    try:
                        found.append((wanted, len(work(points, faces, None, wanted).faces)))
                    except Exception as error:
                        found.append((wanted, repr(error)))

            threads = [threading.Thread(target=ask, args=((800, 8000)[i % 2],)) for i in range(8)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            wrong = [pair for pair in found if not isinstance(pair[1], int) or abs(pair[1] - pair[0]) > 0.02 * pair[0]]
            return {"calls": len(found), "wrong": len(wrong), "for_instance": wrong[:3]}

        print(json.dumps({"package": name, **in_child(run)}), flush=True)


def in_child(work):
    """Runs `work` in another process and gives back its result."""
    read, write = os.pipe()
    sys.stdout.flush()
    process = os.fork()
    if process == 0:
        try:
            os.close(read)
            os.write(write, json.dumps(work()).encode())
        except BaseException:
            traceback.print_exc()
        os._exit(0)
    os.close(write)
    with os.fdopen(read) as pipe:
        text = pipe.read()
    os.waitpid(process, 0)
    return json.loads(text) if text else {"failed": True}


def read_ply(path, names=("red", "green", "blue")):
    """Points float32, faces int32 and further properties of the vertices (None if there are none) of a mesh file."""
    import stonecut

    folder = tempfile.mkdtemp()
    plain = Path(folder) / "plain.ply"
    stonecut.convert(path, plain, format="binary_little_endian,float,int", drop_texture=True)
    data = plain.read_bytes()
    end = data.index(b"end_header\n") + 11
    header = data[:end].decode().splitlines()
    n, m = (int(line.split()[2]) for line in header if line.startswith("element"))
    types = {"float": "<f4", "uchar": "u1", "int": "<i4", "double": "<f8", "ushort": "<u2"}
    fields, inside = [], False
    for line in header:
        inside = line.startswith("element vertex") or (inside and not line.startswith("element"))
        if inside and line.startswith("property"):
            _, kind, name = line.split()
            fields.append((name, types[kind]))
    rows = np.frombuffer(data, fields, n, end)
    points = np.stack([rows[axis] for axis in "xyz"], axis=1)
    colors = None
    if names[0] in rows.dtype.names:
        colors = np.stack([rows[name] for name in names], axis=1)
    corners = np.frombuffer(data, [("n", "u1"), ("v", "<i4", 3)], m, end + rows.nbytes)
    assert (corners["n"] == 3).all()
    return points, np.ascontiguousarray(corners["v"]), colors


def status(name):
    with open("/proc/self/status") as lines:
        return next(int(line.split()[1]) for line in lines if line.startswith(name)) * 1024


def child(work, points, faces, colors, count, out):
    """Runs one package on one mesh; writes what it made and what it took."""
    tiny = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]], points.dtype)
    corners = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 4], [1, 4, 3], [2, 3, 4]], faces.dtype)
    try:
        work(tiny, corners, None if colors is None else colors[:5], 4)
    except Exception:  # the tiny mesh is only there so that everything is loaded
        pass
    with open("/proc/self/clear_refs", "w") as file:
        file.write("5")
    before = status("VmRSS")
    used = resource.getrusage(resource.RUSAGE_SELF)
    begin = time.perf_counter()
    result = work(points, faces, colors, count)
    seconds = time.perf_counter() - begin
    after = resource.getrusage(resource.RUSAGE_SELF)
    taken = {
        # Processes that ran or waited: wall times count only where it is about 1.
        "load": os.getloadavg()[0],
        "seconds": seconds,
        "cpu_seconds": after.ru_utime + after.ru_stime - used.ru_utime - used.ru_stime,
        "peak_bytes": status("VmHWM") - before,
    }
    colors = [] if result.colors is None else result.colors
    np.savez(out, points=result.points, faces=result.faces, colors=colors, taken=json.dumps(taken))


def sample(points, faces, n, seed):
    """Places on the surface, spread evenly by area, and their triangles and weights."""
    random = np.random.default_rng(seed)
    a, b, c = (points[faces[:, i]].astype(np.float64) for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    which = np.searchsorted(np.cumsum(area), random.random(n) * area.sum()).clip(0, len(faces) - 1)
    u, v = random.random((2, n))
    flip = u + v > 1
    u[flip], v[flip] = 1 - u[flip], 1 - v[flip]
    weights = np.stack([1 - u - v, u, v], axis=1)
    return np.einsum("ij,ijk->ik", weights, np.stack([a, b, c], axis=1)[which]), which, weights


class Surface:
    """A surface to which distances are taken, in units of the diagonal about a common middle."""

    def __init__(self, points, faces, middle, diagonal):
        import open3d

        self.points = ((points - middle) / diagonal).astype(np.float32)
        self.faces = np.ascontiguousarray(faces.astype(np.uint32))
        self.scene = open3d.t.geometry.RaycastingScene()
        self.scene.add_triangles(open3d.core.Tensor(self.points), open3d.core.Tensor(self.faces))

    def nearest(self, places):
        import open3d

        found = self.scene.compute_closest_points(open3d.core.Tensor(places.astype(np.float32)))
        return {name: found[name].numpy() for name in ("points", "primitive_ids", "primitive_uvs")}


def colour_at(colors, faces, which, weights):
    return np.einsum("ij,ijk->ik", weights, colors[faces[which]].astype(np.float64))


def judge(original, result, n_samples):
    """Two-sided error as a share of the original's diagonal; of colours too, in steps of 255."""
    points, faces, colors = original
    low, high = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
    middle, diagonal = (low + high) / 2, np.linalg.norm(high - low)
    small = Surface(result["points"], result["faces"], middle, diagonal)
    whole = Surface(points, faces, middle, diagonal)
    sums, most, colour = [], [], []
    for here, there, own, other in ((whole, small, colors, result["colors"]), (small, whole, result["colors"], colors)):
        places, which, weights = sample(here.points, here.faces, n_samples, 1)
        near = there.nearest(places)
        squared = ((near["points"].astype(np.float64) - places) ** 2).sum(axis=1)
        sums.append(squared.mean())
        most.append(np.sqrt(squared.max()))
        if own is not None and other is not None and len(own) and len(other):
            uv = near["primitive_uvs"].astype(np.float64)
            beside = np.stack([1 - uv[:, 0] - uv[:, 1], uv[:, 0], uv[:, 1]], axis=1)
            mine = colour_at(own[:, :3], here.faces, which, weights)
            theirs = colour_at(other[:, :3], there.faces, near["primitive_ids"], beside)
            colour.append(((mine - theirs) ** 2).mean())
    found = {"rms": float(np.sqrt(np.mean(sums))), "max": float(max(most))}
    if colour:
        found["colour_rms"] = float(np.sqrt(np.mean(colour)))
    return found


def run(name, mesh, ratio, n_samples, repeats):
    points, faces, colors = mesh
    count = round(ratio * len(faces))
    best = None
    for _ in range(repeats):
        out = tempfile.mktemp(suffix=".npz")
        sys.stdout.flush()
        process = os.fork()
        if process == 0:
            try:
                child(PACKAGES[name], points, faces, colors, count, out)
                os._exit(0)
            except ImportError as error:
                print(f"left out: {name} ({error})")
                os._exit(3)
            except BaseException:
                traceback.print_exc()
                os._exit(1)
        code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
        if code != 0:
            return {"package": name, "failed": code}
        result = dict(np.load(out))
        os.remove(out)
        taken = json.loads(str(result.pop("taken")))
        if best is None or taken["cpu_seconds"] < best[0]["cpu_seconds"]:
            best = (taken, result)
        if taken["cpu_seconds"] > 10:  # long enough for the differences between packages
            break
    taken, result = best
    edges = np.sort(np.concatenate([result["faces"][:, [0, 1]], result["faces"][:, [1, 2]], result["faces"][:, [2, 0]]]), axis=1)
    _, uses = np.unique(edges.astype(np.int64) @ np.array([1 << 32, 1]), return_counts=True)
    return {
        "package": name,
        "wanted": count,
        "triangles": len(result["faces"]),
        **taken,
        # A child: ray casting must not run in the process that forks the others.
        **in_child(lambda: judge(mesh, result, n_samples)),
        "open_edges": int((uses == 1).sum()),
        "non_manifold_edges": int((uses > 2).sum()),
        "has_colours": bool(len(result["colors"])),
        "colours_differ": bool(len(result["colors"]) and result["colors"].std(axis=0).max() > 1),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("meshes", nargs="+", type=Path)
    parser.add_argument("--ratios", nargs="+", type=float, default=[0.1, 0.01])
    parser.add_argument("--only", nargs="+", choices=PACKAGES, default=list(PACKAGES))
    parser.add_argument("--samples", type=int, default=500_000)
    parser.add_argument("--repeats", type=int, default=1, help="runs of a package, of which the fastest counts; slow ones run once")
    parser.add_argument("--uv", action="store_true", help="compare what becomes of texture coordinates s, t")
    parser.add_argument("--threads", action="store_true", help="see whether threads get each their own result")
    arguments = parser.parse_args()
    if arguments.threads:
        compare_threads()
    if arguments.uv:
        for path in arguments.meshes:
            for ratio in arguments.ratios:
                compare_uv(path, ratio, arguments.samples)
    if arguments.threads or arguments.uv:
        return
    rows = []
    for path in arguments.meshes:
        mesh = read_ply(path)
        for ratio in arguments.ratios:
            for name in arguments.only:
                row = {"mesh": path.stem, "input": len(mesh[1]), "ratio": ratio}
                row |= run(name, mesh, ratio, arguments.samples, arguments.repeats)
                rows.append(row)
                print(json.dumps(row), flush=True)
                arguments.out.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
