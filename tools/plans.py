#!/usr/bin/env python3
"""Plans and progress against what came out: a table of bytes and seconds, and the seconds left along each run.

usage: tools/plans.py STONECUT DIR [--triangles 4M] [--only WORD] [--threads N]

Makes its own inputs in DIR. Every run is followed with `--progress json`; of each the planned seconds, temporary and output
bytes stand beside the true ones, and for every tenth of the run the predicted end over the true one (1.00 is right). Standard
library only.
"""
import argparse
import json
import shutil
import subprocess
import time
from pathlib import Path

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("stonecut", type=Path)
parser.add_argument("folder", type=Path)
parser.add_argument("--triangles", default="4M")
parser.add_argument("--only", default="")
parser.add_argument("--threads")
given = parser.parse_args()
at = given.folder
at.mkdir(parents=True, exist_ok=True)


def run(words):
    """Runs a command; gives its exit code, its events with the time at which each came, and its seconds."""
    began = time.monotonic()
    words = [str(given.stonecut.resolve()), *words.split(), "--progress", "json"]
    if given.threads and words[1] != "info":
        words += ["--threads", given.threads]
    child = subprocess.Popen(words, cwd=at, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    events = [(time.monotonic() - began, json.loads(line)) for line in child.stderr]
    return child.wait(), events, time.monotonic() - began


def tree_bytes(path):
    if path.is_dir():
        return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    # A chain writes several files, a texture lies in a folder beside its mesh.
    return sum(tree_bytes(other) if other.is_dir() else other.stat().st_size
               for other in path.parent.glob(path.stem + "*"))


def share(planned, true):
    return f"{planned / true:9.2f}" if true and planned is not None else "        -"


RUNS = {
    "plain": "simplify in.ply {o}.ply --ratio 1%",
    "plain, small cells": "simplify in.ply {o}.ply --ratio 10% --cell-triangles 100k",
    "plain to glb": "simplify in.ply {o}.glb --ratio 10%",
    "plain to obj": "simplify in.ply {o}.obj --ratio 10%",
    "bounded": "simplify small.ply {o}.ply --max-error 0.002",
    "bounded to a count": "simplify small.ply {o}.ply --ratio 5% --max-error 0.01",
    "chain": "simplify in.ply {o}.ply --ratio 10%,1%,0.1%",
    "verified": "simplify in.ply {o}.ply --ratio 1% --verify",
    "components": "simplify in.ply {o}.ply --ratio 1% --min-component 100",
    "progressive": "simplify small.ply {o}.ply --ratio 1% --progressive {o}.pm",
    "cluster": "simplify in.ply {o}.ply --ratio 1% --method cluster",
    "decimate": "simplify in.ply {o}.ply --ratio 1% --method decimate",
    "retile": "simplify in.ply {o}.ply --ratio 1% --method retile",
    "optimize": "simplify small.ply {o}.ply --ratio 5% --optimize 1",
    "pairs": "simplify small.ply {o}.ply --ratio 5% --pairs",
    "textured, kept": "simplify rooms.obj {o}.glb --ratio 40% --texture keep",
    "textured, baked": "simplify rooms.obj {o}.glb --ratio 10%",
    "tiles": "tiles in.ply {o}",
    "convert": "convert in.ply {o}.obj",
    "convert to glb": "convert in.ply {o}.glb",
    "measure": "measure in.ply small.ply",
    "measure in cells": "measure in.ply small.ply --memory 300MiB",
    "certified": "measure small.ply coarse.ply --certify",
}


def main():
    for name, words in [("in.ply", f"synth statue in.ply --triangles {given.triangles}"),
                        ("small.ply", "simplify in.ply small.ply --ratio 10%"),
                        ("coarse.ply", "simplify small.ply coarse.ply --ratio 10%"),
                        ("rooms.obj", "synth rooms rooms.obj --triangles 300k")]:
        if not (at / name).exists():
            run(words)
    print(f"{'planned over true':22} {'seconds':>9} {'temporary':>9} {'output':>9} {'true s':>8}   "
          "predicted end over the true one, at 10 %, 20 %, ... of the run; longest rise of what is left")
    for name, words in RUNS.items():
        if given.only not in name:
            continue
        out = at / "plans-out"
        for old in at.glob("plans-out*"):
            shutil.rmtree(old) if old.is_dir() else old.unlink()
        code, events, seconds = run(words.format(o="plans-out"))
        plan = next((event["plan"] for _, event in events if event["event"] == "plan"), {})
        report = events[-1][1].get("report") or next(
            (event["report"] for _, event in events if event["event"] == "summary"), {})
        left = [(at_, event["seconds_left"]) for at_, event in events if event["event"] == "progress"]
        curve = []
        for tenth in range(1, 10):
            before = [at_ + l for at_, l in left if at_ <= seconds * tenth / 10]
            curve.append(f"{before[-1] / seconds:.2f}" if before else "-")
        rise = max([b + tb - a - ta for (ta, a), (tb, b) in zip(left, left[1:])], default=0)
        ready = next((at_ for at_, event in events if event["event"] == "plan"), 0)
        written = tree_bytes(out) if out.exists() else sum(
            f.stat().st_size for f in at.glob("plans-out*") if f.is_file())
        if "textures" in str(plan) or any(f.is_dir() for f in at.glob("plans-out*_textures")):
            written += sum(tree_bytes(f) for f in at.glob("plans-out*_textures"))
        print(f"{name:22} {share(plan.get('seconds'), seconds - ready)} "
              f"{share(plan.get('temp_bytes'), report.get('peak_temp_bytes'))} "
              f"{share(plan.get('output_bytes'), written)} {seconds:8.1f}   {' '.join(curve)}; {max(rise, 0):.1f} s"
              f"{'' if code == 0 else f'   exit code {code}'}", flush=True)


main()
