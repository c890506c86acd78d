#!/usr/bin/env python3
"""The C interface beside meshoptimizer on one mesh: rows of a table of docs/results/receipt.md.

    tools/c_peers.py LIBSTONECUT_C.so STONECUT MESH RATIO...

Needs numpy, trimesh and meshoptimizer from PyPI. Both simplify the same arrays on one thread, five times in turn; seconds are the processor's
within the call. RMS and largest distance of both results are found by `STONECUT measure`, the larger side.
"""

import ctypes
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time

import meshoptimizer
import numpy
import trimesh

size, text = ctypes.c_size_t, ctypes.c_char_p


class Mesh(ctypes.Structure):
    _fields_ = [("size", size), ("n_vertices", size), ("positions", ctypes.c_void_p), ("position_stride", size),
                ("position_type", ctypes.c_uint32), ("reserved", ctypes.c_uint32), ("n_triangles", size), ("triangles", ctypes.c_void_p),
                ("labels", ctypes.c_void_p), ("n_attributes", size), ("attributes", ctypes.c_void_p), ("source", ctypes.c_void_p)]


class Options(ctypes.Structure):
    _fields_ = [("size", size), ("count", ctypes.c_uint64), ("ratio", ctypes.c_double), ("memory_bytes", ctypes.c_uint64),
                ("threads", size), ("samples", ctypes.c_uint64), ("words", ctypes.c_void_p), ("n_words", size),
                ("progress", ctypes.c_void_p), ("user", ctypes.c_void_p)]


def ours(library, positions, triangles, ratio):
    mesh, options, result = Mesh(), Options(), ctypes.c_void_p()
    library.stonecut_init(ctypes.byref(mesh), ctypes.sizeof(mesh))
    library.stonecut_init(ctypes.byref(options), ctypes.sizeof(options))
    mesh.n_vertices, mesh.positions, mesh.position_type = len(positions), positions.ctypes.data, 9
    mesh.n_triangles, mesh.triangles = len(triangles), triangles.ctypes.data
    options.ratio, options.threads = ratio, 1
    begun = time.process_time()
    code = library.stonecut_simplify(ctypes.byref(mesh), ctypes.byref(options), ctypes.byref(result))
    seconds = time.process_time() - begun
    if code not in (0, 3):
        sys.exit(f"stonecut_simplify: {code}")
    found = ctypes.cast(library.stonecut_result_mesh(result), ctypes.POINTER(Mesh)).contents
    floats = ctypes.cast(found.positions, ctypes.POINTER(ctypes.c_float))
    numbers = ctypes.cast(found.triangles, ctypes.POINTER(ctypes.c_uint32))
    out = (numpy.ctypeslib.as_array(floats, (found.n_vertices, 3)).copy(), numpy.ctypeslib.as_array(numbers, (found.n_triangles, 3)).copy())
    library.stonecut_result_free(result)
    return seconds, out


def theirs(positions, triangles, ratio):
    indices, error = triangles.reshape(-1), numpy.zeros(1, numpy.float32)
    kept = numpy.zeros_like(indices)
    begun = time.process_time()
    count = meshoptimizer.simplify(kept, indices, positions, target_index_count=int(len(triangles) * ratio) * 3, target_error=1e30,
                                   result_error=error)
    return time.process_time() - begun, (positions, kept[:count].reshape(-1, 3))


def measured(stonecut, mesh, result):
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "out.ply")
        trimesh.Trimesh(*result, process=False).export(path)
        command = [stonecut, "measure", mesh, path, "--samples", "500k", "--json"]
        found = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    return [max(found[side][key] for side in ("forward", "backward")) for key in ("rms", "max")]


def main():
    library, stonecut, mesh, ratios = ctypes.CDLL(sys.argv[1]), sys.argv[2], sys.argv[3], map(float, sys.argv[4:])
    library.stonecut_result_mesh.restype, library.stonecut_result_mesh.argtypes = ctypes.c_void_p, [ctypes.c_void_p]
    library.stonecut_result_free.argtypes = [ctypes.c_void_p]
    read = trimesh.load(mesh, process=False)
    positions, triangles = numpy.ascontiguousarray(read.vertices, numpy.float32), numpy.ascontiguousarray(read.faces, numpy.uint32)
    print("| mesh | to | by | triangles | processor s | RMS | largest distance |\n|---|---|---|---|---|---|---|")
    for ratio in ratios:
        runs = [(ours(library, positions, triangles, ratio), theirs(positions, triangles, ratio)) for _ in range(5)]
        for name, side in (("stonecut", 0), ("meshoptimizer", 1)):
            result = runs[0][side][1]
            seconds = statistics.median(run[side][0] for run in runs)
            rms, largest = measured(stonecut, mesh, result)
            print(f"| {os.path.basename(mesh)} | {ratio:g} | {name} | {len(result[1]):,} | {seconds:.2f} | {rms:.3g} | {largest:.3g} |", flush=True)


main()
