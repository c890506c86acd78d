#!/usr/bin/env python3
"""Bounded simplification by others and by stonecut, every result certified by `stonecut measure --certify`.

    bound_peers.py STONECUT MESH E...      prints a Markdown table

MESH is a PLY of triangles. Peers that are not installed are named and left out: MeshLib (`maxError`), VTK
(`vtkDecimatePro`, absolute error; `vtkQuadricDecimation`, maximum error), MeshLab (isotropic remeshing, largest distance), all
from PyPI; mmgs (`-hausd`) and cgal_envelope (peers/cgal_envelope.cpp, compiled) from PATH. Each gets six minutes.
Processor seconds include reading and writing.
"""

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile

LIMIT_SECONDS = 360


def meshlib(source, out, bound):
    from meshlib import mrmeshpy as mr

    mesh = mr.loadMesh(source)
    mesh.packOptimally()
    settings = mr.DecimateSettings()
    settings.strategy = mr.DecimateStrategy.MinimizeError
    settings.maxError = bound
    settings.packMesh = True
    mr.decimateMesh(mesh, settings)
    mr.saveMesh(mesh, out)


def vtk_with(decimate, source, out):
    import vtk

    reader = vtk.vtkPLYReader()
    reader.SetFileName(source)
    decimate.SetInputConnection(reader.GetOutputPort())
    writer = vtk.vtkPLYWriter()
    writer.SetFileName(out)
    writer.SetInputConnection(decimate.GetOutputPort())
    writer.Write()


def vtk_pro(source, out, bound):
    import vtk

    decimate = vtk.vtkDecimatePro()
    decimate.SetTargetReduction(1.0)
    decimate.PreserveTopologyOn()
    decimate.SplittingOff()
    decimate.SetErrorIsAbsolute(1)
    decimate.SetAbsoluteError(bound)
    vtk_with(decimate, source, out)


def vtk_quadric(source, out, bound):
    import vtk

    decimate = vtk.vtkQuadricDecimation()
    decimate.SetTargetReduction(1.0)
    # Its error is a quadric's, a squared distance.
    decimate.SetMaximumError(bound * bound)
    vtk_with(decimate, source, out)


def meshlab(source, out, bound):
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(source)
    meshes.meshing_isotropic_explicit_remeshing(
        targetlen=pymeshlab.PureValue(20 * bound),
        adaptive=True,
        checksurfdist=True,
        maxsurfdist=pymeshlab.PureValue(bound),
    )
    meshes.save_current_mesh(out, save_vertex_normal=False, save_vertex_color=False)


def mmgs(source, out, bound, stonecut):
    medit, result = out + ".mesh", out + ".o.mesh"
    vertices, triangles = read_ply(stonecut, source)
    with open(medit, "w") as file:
        file.write(f"MeshVersionFormatted 2\nDimension 3\nVertices\n{len(vertices)}\n")
        file.writelines(f"{x!r} {y!r} {z!r} 0\n" for x, y, z in vertices.tolist())
        file.write(f"Triangles\n{len(triangles)}\n")
        file.writelines(f"{a + 1} {b + 1} {c + 1} 0\n" for a, b, c in triangles.tolist())
        file.write("End\n")
    size = (vertices.max(axis=0) - vertices.min(axis=0)).max()
    run = ["mmgs", "-hausd", repr(bound), "-hmax", repr(float(size)), "-nr", "-v", "0", medit, result]
    subprocess.run(run, check=True, stdout=subprocess.DEVNULL)
    words = open(result).read().split()
    at = words.index("Vertices")
    n = int(words[at + 1])
    rows = words[at + 2 : at + 2 + 4 * n]
    at = words.index("Triangles")
    m = int(words[at + 1])
    faces = words[at + 2 : at + 2 + 4 * m]
    with open(out, "w") as file:
        file.write(f"ply\nformat ascii 1.0\nelement vertex {n}\nproperty double x\nproperty double y\nproperty double z\n")
        file.write(f"element face {m}\nproperty list uchar int vertex_indices\nend_header\n")
        file.writelines(" ".join(rows[4 * i : 4 * i + 3]) + "\n" for i in range(n))
        file.writelines("3 " + " ".join(str(int(v) - 1) for v in faces[4 * i : 4 * i + 3]) + "\n" for i in range(m))


def cgal(source, out, bound, stonecut):
    result = out + ".result.obj"
    subprocess.run([stonecut, "convert", source, out + ".obj", "--force"], check=True, stderr=subprocess.DEVNULL)
    subprocess.run(["cgal_envelope", out + ".obj", result, repr(bound)], check=True, stdout=subprocess.DEVNULL)
    subprocess.run([stonecut, "convert", result, out, "--force"], check=True, stderr=subprocess.DEVNULL)


def read_ply(stonecut, path):
    """Positions and triangles of a PLY, by way of an ASCII one."""
    import numpy as np

    plain = tempfile.mktemp(suffix=".stl")
    subprocess.run([stonecut, "convert", path, plain, "--force"], check=True, stderr=subprocess.DEVNULL)
    rows = np.fromfile(plain, offset=84, dtype=np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")]))
    os.remove(plain)
    vertices, triangles = np.unique(rows["v"].reshape(-1, 3), axis=0, return_inverse=True)
    return vertices.astype(float), triangles.reshape(-1, 3)


PEERS = {
    "MeshLib, maxError": (meshlib, "meshlib"),
    "VTK DecimatePro, absolute error": (vtk_pro, "vtk"),
    "VTK QuadricDecimation, maximum error": (vtk_quadric, "vtk"),
    "MeshLab isotropic remeshing, largest distance": (meshlab, "pymeshlab"),
    "mmgs -hausd": (mmgs, None),
    "CGAL Polyhedral_envelope_filter": (cgal, None),
}


def child(name, stonecut, source, out, bound):
    peer, module = PEERS[name]
    peer(source, out, float(bound)) if module else peer(source, out, float(bound), stonecut)


def seconds():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def row(stonecut, source, name, bound, command, out):
    before = seconds()
    try:
        ended = subprocess.run(command, timeout=LIMIT_SECONDS, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    except subprocess.TimeoutExpired:
        print(f"| {bound:g} | {name} | did not end in {LIMIT_SECONDS} s | | |", flush=True)
        return
    used = seconds() - before
    if ended.returncode != 0 or not os.path.exists(out):
        words = ended.stderr.decode(errors="replace").strip().splitlines()
        print(f"| {bound:g} | {name} | failed: {words[-1] if words else ended.returncode} | | |", flush=True)
        return
    report = out + ".json"
    subprocess.run(
        [stonecut, "measure", source, out, "--certify", "--report", report], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    found = json.load(open(report))
    enclosed = found["hausdorff"]
    ends = f"{enclosed['lower'] / bound:.3f} to {enclosed['upper'] / bound:.3f}"
    print(f"| {bound:g} | {name} | {ends} | {found['simplified']['triangles']:,} | {used:.1f} |", flush=True)


def main():
    if sys.argv[1] == "--child":
        return child(*sys.argv[2:])
    stonecut, source = sys.argv[1:3]
    print("| E | | largest distance, of E, certified | triangles | processor s |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for bound in map(float, sys.argv[3:]):
            out = os.path.join(folder, "stonecut.ply")
            run = [stonecut, "simplify", source, out, "--max-error", repr(bound), "--force"]
            row(stonecut, source, "stonecut --max-error", bound, run, out)
            for i, (name, (_, module)) in enumerate(PEERS.items()):
                program = {"mmgs -hausd": "mmgs", "CGAL Polyhedral_envelope_filter": "cgal_envelope"}.get(name)
                is_here = __import__("importlib.util").util.find_spec(module) if module else shutil.which(program)
                if not is_here:
                    print(f"| {bound:g} | {name} | not installed | | |", flush=True)
                    continue
                out = os.path.join(folder, f"{i}.ply")
                run = [sys.executable, __file__, "--child", name, stonecut, source, out, repr(bound)]
                row(stonecut, source, name, bound, run, out)


if __name__ == "__main__":
    main()
