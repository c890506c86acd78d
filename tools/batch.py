#!/usr/bin/env python3
"""A batch of commands as a pipeline gives them: judged by exit codes and by `--progress json` alone.

usage: tools/batch.py STONECUT DIR

Makes its inputs in DIR with `synth`. No text for people is read: standard error must be one JSON object a line, the last one `end`
with the exit code; errors must have a code and say what to do. Kills, interruptions, a full disk (as root), reruns and changed
settings are among the commands. Prints a Markdown table; exits with 1 where something was not as documented. Standard library only.
"""
import argparse
import hashlib
import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("stonecut", type=Path)
parser.add_argument("folder", type=Path)
given = parser.parse_args()
program = str(given.stonecut.resolve())
at = given.folder
shutil.rmtree(at, ignore_errors=True)
at.mkdir(parents=True)
wrong = []
rows = []


def run(words, stop=None, after="", patience=0.05):
    """Runs a command, stops it with a signal at the first event of a stage; gives its exit code and its events."""
    child = subprocess.Popen([program, *words.split(), "--progress", "json"], cwd=at, stderr=subprocess.PIPE,
                             stdout=subprocess.DEVNULL, text=True)
    events, faults = [], []
    for line in child.stderr:
        try:
            events.append(json.loads(line))
        except ValueError:
            faults.append(f"not JSON: {line[:60]!r}")
            continue
        if stop and events[-1].get("stage") == after and events[-1]["event"] == "progress":
            time.sleep(patience)
            child.send_signal(stop)
            stop = None
    return child.wait(), events, faults


def expect(name, words, code, error=None, look=None, stop=None, after="", last=True):
    """One command of the batch: the exit code and, of an error, its code; `look` says what else must hold of the report."""
    got, events, faults = run(words, stop, after)
    end = events[-1] if events else {}
    if got != code:
        faults.append(f"exit code {got} instead of {code}")
    if last and end.get("event") != "end":
        faults.append(f"the last event is {end.get('event')}")
    if last and end.get("exit_code") != got:
        faults.append(f"the last event says {end.get('exit_code')}")
    if error:
        said = [event for event in events if event["event"] == "error"]
        if [event.get("code") for event in said] != [error]:
            faults.append(f"errors {[event.get('code') for event in said]} instead of {error}")
        elif not (said[0].get("advice") or ";" in said[0]["error"] or ":" in said[0]["error"]):
            faults.append("no word on what to do")
    if look and not faults:
        try:
            if not look(end.get("report") or {}, events):
                faults.append("the report is not as expected")
        except (KeyError, TypeError, IndexError) as missing:
            faults.append(f"the report has no {missing!r}")
    wrong.extend(f"{name}: {fault}" for fault in faults)
    rows.append((name, words, got, "; ".join(faults) or "as documented"))
    return events


def md5(name):
    return hashlib.md5((at / name).read_bytes()).hexdigest()


def planned(_, events):
    return events[0]["event"] == "plan"


expect("a scan", "synth statue in.ply --triangles 400k", 0)
expect("a scan in text", "convert in.ply in.obj", 0, look=planned)
expect("a scan for viewers", "convert in.ply in.glb", 0)
expect("rooms with images", "synth rooms rooms.obj --triangles 60k --uv", 0)
expect("the main job", "simplify in.ply o.ply --ratio 1%", 0,
       look=lambda report, events: planned(report, events) and report["output"]["triangles"] <= 4033 and report["target_met"])
expect("the same again, with its report", "simplify in.ply p.ply --ratio 1% --report p.json", 0)
expect("done already", "simplify in.ply p.ply --ratio 1% --report p.json", 0)
expect("another count, no --force", "simplify in.ply p.ply --ratio 2% --report p.json", 2, "usage")
expect("another count, --force", "simplify in.ply p.ply --ratio 2% --report p.json --force", 0,
       look=lambda report, _: report["output"]["triangles"] <= 8066)
expect("a wrong word", "simplify in.ply q.ply --ratio abc", 2, "usage")
expect("no target", "simplify in.ply q.ply", 2, "usage")
expect("an input that is not there", "simplify none.ply q.ply --ratio 1%", 4, "bad_input")
(at / "cut.ply").write_bytes((at / "in.ply").read_bytes()[:5_000_000])
expect("an input that is cut off", "simplify cut.ply q.ply --ratio 1%", 4, "bad_input")
expect("what of it is whole", "simplify cut.ply cut-small.ply --ratio 10% --skip-bad", 3)
(at / "empty.obj").write_bytes(b"")
expect("an empty file", "info empty.obj", 4, "bad_input")
expect("an output in no folder", "simplify in.ply no/such/q.ply --ratio 1%", 2, "usage")
expect("too little memory", "simplify in.ply q.ply --ratio 1% --memory 8MiB", 6, "no_memory")
expect("a plan alone", "simplify in.ply q.ply --ratio 1% --dry-run --report plan.json", 0, look=planned)
expect("one stage", "simplify in.ply s.ply --ratio 1% --until partition --cell-triangles 50k", 0)
expect("its state", "status s.ply.stonecut-job", 0)
expect("other settings into its folder", "simplify in.ply s.ply --ratio 3% --cell-triangles 50k", 8, "state_mismatch")
expect("the rest", "simplify in.ply s.ply --ratio 1% --cell-triangles 50k", 0)
expect("in small cells", "simplify in.ply t.ply --ratio 1% --cell-triangles 50k", 0)
if md5("s.ply") != md5("t.ply"):
    wrong.append("in stages: other bytes")
expect("a longer scan", "synth statue large.ply --triangles 2M", 0)
long = "simplify large.ply k.ply --ratio 30% --cell-triangles 50k --threads 1"
for stop, name, code, error in ((signal.SIGINT, "from the keyboard", 130, "interrupted"),
                                (signal.SIGTERM, "by a scheduler", 143, "interrupted"), (signal.SIGKILL, "at once", -9, None)):
    job = long.replace("k.ply", f"{stop.name}.ply")
    expect(f"stopped {name}", job, code, error, stop=stop, after="simplify", last=error is not None)
    expect(f"stopped {name}: its state", f"status {stop.name}.ply.stonecut-job", 0)
    expect(f"stopped {name}: gone on with", job, 0, look=lambda report, _: report["target_met"])
expect("never stopped", long, 0)
if len({md5(name) for name in ("k.ply", "SIGINT.ply", "SIGTERM.ply", "SIGKILL.ply")}) != 1:
    wrong.append("stopped: other bytes")
expect("begun again", "simplify in.ply m.ply --ratio 30% --cell-triangles 20k --until simplify", 0)
expect("with other settings from the start", "simplify in.ply m.ply --ratio 5% --restart", 0)
expect("a bound", "simplify in.ply b.ply --max-error 0.01", 0,
       look=lambda report, _: report["hausdorff"]["upper"] <= 0.01 and report["hausdorff"]["certified"])
expect("several sizes", "simplify in.ply c.ply --ratio 10%,1%", 0)
expect("measured", "measure in.ply o.ply --samples 100k", 0, look=lambda report, _: report["relative_rms"] > 0)
expect("proven", "measure in.ply o.ply --samples 100k --certify", 0,
       look=lambda report, _: report["hausdorff"]["certified"])
expect("a picture", "render o.ply -o o.png --size 320x240", 0)
expect("looked at", "info o.ply --check", 0)
expect("tiles", "tiles in.ply web", 0, look=planned)
expect("tiles again", "tiles in.ply web", 2, "usage")
expect("tiles checked", "info web --check", 0)
expect("a mesh out of tiles", "extract web e.ply --triangles 20k", 0)
expect("a texture kept", "simplify rooms.obj keep.glb --ratio 10% --texture keep", 0)
expect("a new texture", "simplify rooms.obj bake.glb --ratio 5% --texture bake --bake-size 512", 0)
for image in at.glob("rooms*.png"):
    image.rename(image.with_suffix(".gone"))
expect("images gone", "convert rooms.obj white.glb", 3,
       look=lambda report, _: {loss["kind"] for loss in report["losses"]} & {"image", "images"})
expect("clustered", "simplify in.ply cl.ply --ratio 2% --method cluster", 0)
expect("a progressive mesh", "simplify in.ply pr.ply --ratio 1% --progressive pr.pm", 0)
expect("a step of it", "refine pr.pm r.ply --triangles 10k", 0)
expect("a scan of many sheets", "synth gyroid thin.ply --triangles 100k", 0)
expect("too few triangles for the scan", "simplify thin.ply ten.ply --triangles 10", 3)
folder = at / "many"
folder.mkdir()
expect("a scan in tiles", "synth statue many/part.obj --triangles 100k --tiles 9", 0)
expect("tiles as one scan", "simplify many one.glb --ratio 10%", 0,
       look=lambda report, _: len(report["inputs"]) == 9)
small = at / "full"
small.mkdir()
if os.geteuid() == 0 and subprocess.run(["mount", "-t", "tmpfs", "-o", "size=3m", "none", small]).returncode == 0:
    try:
        expect("a full disk", "convert in.ply full/o.ply", 5, "no_space")
        if list(small.iterdir()):
            wrong.append("a full disk: something is left")
    finally:
        subprocess.run(["umount", small], check=True)
else:
    print("skipped: a full disk (needs root)")

print("| command | words | exit code | |\n|---|---|---|---|")
for name, words, code, verdict in rows:
    print(f"| {name} | `{words}` | {code} | {verdict} |")
print(f"\n{len(rows)} commands, {len(wrong)} not as documented")
for fault in wrong:
    print("-", fault)
raise SystemExit(1 if wrong else 0)
