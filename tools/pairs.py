#!/usr/bin/env python3
"""Two builds side by side on scans: rows of the tables of docs/results/real-scans.md.

    tools/pairs.py OLD NEW RATIO... -- MESH... [-- OPTIONS OF SIMPLIFY]

For every mesh and ratio both builds run `simplify` in turn, five pairs where a run takes less than a second, three else. Seconds are user and
system of the process, the median of the ratios is printed. RMS and largest error of both results are found by NEW (`measure`, 500 k samples,
the larger side); triangles are those of NEW, `us` its microseconds a triangle of the input.
"""

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile


def run(*words, answer=False):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 3):
        sys.exit(f"exit code {done.returncode}: {' '.join(words)}")
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return json.loads(done.stdout) if answer else (done.returncode, seconds)


def errors(new, mesh, result):
    found = run(new, "measure", mesh, result, "--samples", "500k", "--json", answer=True)
    return [max(found[side][key] for side in ("forward", "backward")) for key in ("rms", "max")]


def main():
    parts = [[]]
    for word in sys.argv[1:]:
        parts.append([]) if word == "--" else parts[-1].append(word)
    (old, new, *ratios), meshes, *rest = parts
    options = rest[0] if rest else []
    print("| scan | to | triangles | us a triangle | time, new / old | RMS, new / old | largest error, new / old | exit code |")
    print("|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        results = [os.path.join(folder, name) for name in ("old.ply", "new.ply")]
        report = os.path.join(folder, "report.json")
        for mesh in meshes:
            for ratio in ratios:
                def simplify(binary, out):
                    return run(binary, "simplify", mesh, out, "--ratio", ratio, "--force", "--restart", "--report", report, *options)

                pairs, wanted = [], 3
                while len(pairs) < wanted:
                    seconds = [simplify(binary, out)[1] for binary, out in zip((old, new), results)]
                    pairs.append(seconds)
                    wanted = 5 if pairs[0][1] < 1 else 3
                code, _ = simplify(new, results[1])
                with open(report) as file:
                    said = json.load(file)
                time = statistics.median(now / before for before, now in pairs)
                own = statistics.median(now for _, now in pairs) / said["input"]["triangles"] * 1e6
                same = open(results[0], "rb").read() == open(results[1], "rb").read()
                if same:
                    error = "same bytes | same bytes"
                else:
                    found = [errors(new, mesh, result) for result in results]
                    error = " | ".join(f"{now / before:.3f}" for before, now in zip(*found))
                count = said["output"]["triangles"]
                print(f"| {os.path.basename(mesh)} | {ratio} | {count:,} | {own:.2f} | {time:.2f} | {error} | {code} |", flush=True)


if __name__ == "__main__":
    main()
