#!/usr/bin/env python3
"""Simplifies meshes to ten counts each, and shows whether the verdicts are monotone: tools/verdicts.py STONECUT FOLDER MESH...

Of every run: the count, the error over the mean edge in percent, and `!` where the result may no longer stand for its input (exit
code 3). Exit code 1 where fewer triangles are judged better than more, or where the count that is named is not above the one given.
"""

import json
import os
import subprocess
import sys

SHARES = [0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002]


def main():
    stonecut, folder, n_wrong = os.path.abspath(sys.argv[1]), sys.argv[2], 0
    print("| mesh | " + " | ".join(f"{100 * share:g} %" for share in SHARES) + " | bearable, error | named |\n" + "|---" * 13 + "|")
    for mesh in sys.argv[3:]:
        cells, verdicts, errors, named = [], [], [], []
        for share in SHARES:
            report = os.path.join(folder, "verdict.json")
            run = subprocess.run([stonecut, "simplify", mesh, os.path.join(folder, "verdict.ply"), "--ratio", str(share), "--report", report,
                                  "--force", "--restart", "-q", "--texture", "none"], capture_output=True, text=True)
            if run.returncode not in (0, 3):
                sys.exit(run.stderr)
            quality = json.load(open(report))["quality"]
            verdicts.append(quality["bearable"] and run.returncode == 0)
            errors.append(quality["error_per_edge"])
            n = json.load(open(report))["output"]["triangles"]
            if not quality["bearable"]:
                named.append(quality["sensible_triangles"] / n)
            cells.append(f"{100 * errors[-1]:.1f}{'' if quality['bearable'] else '!'}{'' if (run.returncode == 3) != quality['bearable'] else ' exit ' + str(run.returncode)}")
        is_monotone = verdicts == sorted(verdicts, reverse=True)
        rises = all(a <= b * 1.001 for a, b in zip(errors, errors[1:]))
        n_wrong += not is_monotone or any(x < 1.25 for x in named)
        print(f"| {os.path.basename(mesh)} | " + " | ".join(cells) + f" | {'monotone' if is_monotone else 'NOT monotone'}, {'rises' if rises else 'falls somewhere'} "
              f"| {'at least x %.2f' % min(named) if named else '-'} |", flush=True)
    sys.exit(n_wrong > 0)


if __name__ == "__main__":
    main()
