#!/usr/bin/env python3
"""Rows of the table of docs/results/bound.md: bounded runs beside the plain run to the same error.

    bound_rows.py STONECUT MESH RATIO[:E]... [-- OPTIONS OF SIMPLIFY]      prints rows of a Markdown table

For each RATIO (such as 1%) a plain run, then one with `--max-error E`. Without E the bound is the p99.9 of the plain run, as
`measure` finds it, the larger side, in four digits. OPTIONS go to both runs. Processor seconds are user and system, of the
whole process: of the bounded run with all its trials and certificates. Exit 3 (too few triangles to stand for the scan)
counts as a result and is marked (b).
"""

import json
import os
import resource
import subprocess
import sys
import tempfile


def run(command):
    """Exit code and processor seconds of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    code = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if code not in (0, 3):
        sys.exit(f"exit {code}: {' '.join(command)}")
    return code, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def report(path):
    with open(path) as file:
        return json.load(file)


def quantile(stonecut, mesh, plain, to):
    run([stonecut, "measure", mesh, plain, "--report", to])
    found = report(to)
    return float(f"{max(found[side]['p999'] for side in ('forward', 'backward')):.4g}")


def row(stonecut, mesh, ratio, bound, options, folder):
    plain, out, to = (os.path.join(folder, name) for name in ("plain.ply", "out.ply", "report.json"))
    simplify = [stonecut, "simplify", mesh]
    plain_code, plain_seconds = run(simplify + [plain, "--ratio", ratio, "--report", to, "--force"] + options)
    plain_count = report(to)["output"]["triangles"]
    if bound is None:
        bound = quantile(stonecut, mesh, plain, to)
    code, seconds = run(simplify + [out, "--max-error", repr(bound), "--report", to, "--force"] + options)
    found = report(to)
    count, enclosed = found["output"]["triangles"], found["hausdorff"]
    cells = [
        os.path.basename(mesh),
        ratio + (" (b)" if plain_code == 3 else ""),
        f"{bound:g}",
        f"{count:,}" + (" (b)" if code == 3 else ""),
        f"{plain_count:,}",
        f"{count / plain_count:.2f}",
        f"{enclosed['upper'] / bound:.3f}",
        f"{enclosed['lower'] / bound:.3f}",
        f"{len(found['max_error']['trials'])}",
        f"{seconds:.1f}",
        f"{plain_seconds:.2f}",
        f"{seconds / plain_seconds:.0f}",
        f"{found['peak_memory_bytes'] / 2**20:,.0f}",
        f"{found['cells']}",
    ]
    print("| " + " | ".join(cells) + " |", flush=True)


def main():
    args, options = sys.argv[1:], []
    if "--" in args:
        at = args.index("--")
        args, options = args[:at], args[at + 1 :]
    stonecut, mesh, ratios = args[0], args[1], args[2:]
    print(
        "| scan | plain run | E | triangles | plain | / plain | upper end / E | lower end / E | runs | CPU s | plain, CPU s | times | peak memory MiB | cells |"
    )
    print("|" + "---|" * 14)
    with tempfile.TemporaryDirectory(dir=os.path.dirname(os.path.abspath(mesh))) as folder:
        for ratio in ratios:
            ratio, _, bound = ratio.partition(":")
            row(stonecut, mesh, ratio, float(bound) if bound else None, options, folder)


if __name__ == "__main__":
    main()
