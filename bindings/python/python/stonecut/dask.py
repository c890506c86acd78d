"""One job on a Dask cluster: the units of ``stonecut plan`` as Dask tasks, each a process on its worker.

In Python, with any cluster that Dask reaches::

    from dask.distributed import Client
    import stonecut.dask
    report = stonecut.dask.simplify("scan.ply", "small.ply", ratio=0.001, job="job", client=Client("tcp://head:8786"))

As a command: ``stonecut-dask IN OUT --ratio 0.1% --job job --cluster local|slurm|pbs|lsf|ssh|ADDRESS``. All workers see
the same files under the same paths and have the same stonecut. The same call continues after whatever ended it: all state is
in the job folder. Needs ``pip install 'stonecut[dask]'``; clusters other than ``local`` need ``dask-jobqueue`` or ``asyncssh``.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from typing import Any

from ._words import PathLike, options, path, target
from .errors import Error, _make

__all__ = ["simplify"]

#: Exit codes after which another attempt may succeed: failed, a fault of stonecut, a failing device.
_AGAIN = (1, 9, 10)


def _run(*words: str) -> subprocess.CompletedProcess[str]:
    """Runs the command of the package that this worker has."""
    command = [sys.executable, "-m", "stonecut", *words]
    return subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)


def _work(job: str, unit: str, words: Sequence[str]) -> tuple[str, int, str]:
    """Does one unit on the worker; the process ends with its worker. An exit code is a result, not an exception: whether it
    is worth another attempt is decided by the caller."""
    done = _run("work", job, unit, "--quiet", "--with-parent", *words)
    return unit, done.returncode, done.stderr.strip()


def _output(*words: str) -> Any:
    """The JSON that a command prints."""
    done = _run(*words)
    if done.returncode:
        raise _make(done.returncode, done.stderr.strip(), None, None)
    return json.loads(done.stdout)


def simplify(
    input: PathLike,
    output: PathLike,
    *,
    job: PathLike,
    client: Any,
    triangles: int | str | None = None,
    ratio: float | str | None = None,
    units: int | None = None,
    memory: int | str | None = None,
    threads: int | None = None,
    retries: int = 3,
    progress: Callable[[float, str], object] | None = None,
    **more: Any,
) -> dict[str, Any]:
    """Simplifies a file on all workers of ``client``; returns the report of the run.

    Args:
        job: folder of the job, seen by all workers; the same call continues what lies there.
        units: pieces to cut the work into [as many as there are workers].
        memory, threads: of each unit [what its worker's machine offers; give both where several workers share one].
        retries: further attempts at a unit whose process was killed or whose disk failed.
        progress: called with the share that is done, 0 to 1, and the unit that ended.
        more: further options of ``stonecut plan``: ``cell_triangles``, ``force``, ``min_component``, ...

    Raises the classes of :mod:`stonecut.errors`; what Dask cannot run at all is an exception of Dask.
    """
    words = [*target(triangles, ratio), *options(**more)]
    here = options(memory=memory, threads=threads)
    return _simplify([path("input", input), path("output", output), *words], path("job", job), client, units, here, retries, progress)


def _simplify(
    words: list[str],
    job: str,
    client: Any,
    units: int | None,
    here: list[str],
    retries: int,
    progress: Callable[[float, str], object] | None,
) -> dict[str, Any]:
    job = os.path.abspath(job)
    n_units = units or max(1, len(client.scheduler_info()["workers"]))
    graph = _output("plan", job, *words, *options(memory=_value(here, "--memory")), f"--units={n_units}", "--quiet")
    phases = graph["phases"]
    whole = sum(phase["units"] * phase["seconds"] for phase in phases)
    done = 0.0
    for phase in phases:
        names = [f"{phase['name']}/{index}" for index in range(phase["units"])]
        for unit in _phase(job, names, client, here, retries):
            done += phase["seconds"]
            if progress is not None:
                progress(done / whole, unit)
    report: dict[str, Any] = _output("status", job, "--json")["report"]
    return report


def _value(words: Sequence[str], name: str) -> str | None:
    return next((word.split("=", 1)[1] for word in words if word.startswith(name + "=")), None)


def _phase(job: str, units: list[str], client: Any, here: list[str], retries: int) -> Any:
    """Runs the units of one phase; gives each as it ends. Dask itself repeats what a dead worker had."""
    distributed = importlib.import_module("distributed")
    attempts = dict.fromkeys(units, 0)

    def submit(unit: str) -> Any:
        # A unit that is done already ends at once, so nothing is pure, and no result is worth keeping.
        key = f"{unit.replace('/', '-')}-{os.urandom(4).hex()}"
        pending[unit] = client.submit(_work, job, unit, here, key=key, pure=False, retries=retries)
        return pending[unit]

    pending: dict[str, Any] = {}
    running = distributed.as_completed([submit(unit) for unit in units])
    try:
        for future in running:
            unit, code, said = future.result()
            if code == 0:
                del pending[unit]
                yield unit
            elif (code < 0 or code in _AGAIN) and attempts[unit] < retries:
                attempts[unit] += 1
                running.add(submit(unit))
            elif code < 0:
                raise Error(f"{unit}: killed by signal {-code}, {retries + 1} times; is its memory enough?")
            else:
                raise _make(code, said, None, None)
    except BaseException:
        client.cancel(list(pending.values()))
        raise


def _cluster(name: str, jobs: int, given: dict[str, Any]) -> Any:
    """A client of the cluster of this name, which ends with it."""
    distributed = importlib.import_module("distributed")
    if "://" in name:
        return distributed.Client(name)
    if name == "local":
        cluster = distributed.LocalCluster(n_workers=jobs, threads_per_worker=1, dashboard_address=None)
    elif name == "ssh":
        cluster = distributed.SSHCluster(given["hosts"].split(","))
    else:
        kinds = importlib.import_module("dask_jobqueue")
        kind = {"slurm": "SLURMCluster", "pbs": "PBSCluster", "lsf": "LSFCluster", "sge": "SGECluster"}[name]
        asked = {key: given[key] for key in ("cores", "memory", "walltime", "queue") if given[key]}
        cluster = getattr(kinds, kind)(processes=1, **asked)
        # Not `scale`: a worker that is lost would not come back.
        cluster.adapt(minimum=jobs, maximum=jobs)
    return distributed.Client(cluster)


def main(words: Sequence[str] | None = None) -> None:
    """The command ``stonecut-dask``."""
    parser = argparse.ArgumentParser(prog="stonecut-dask", description="One job on a Dask cluster; other options are those of 'stonecut plan'.")
    parser.add_argument("input")
    parser.add_argument("output")
    parser.add_argument("--job", required=True, help="folder of the job, seen by all workers")
    parser.add_argument("--cluster", default="local", help="local, slurm, pbs, lsf, sge, ssh, or the address of a scheduler")
    parser.add_argument("--jobs", type=int, default=2, help="workers to ask for")
    parser.add_argument("--units", type=int, help="pieces to cut the work into")
    parser.add_argument("--memory", help="memory of each worker: 60GB")
    parser.add_argument("--cores", type=int, help="cores, and threads, of each worker")
    parser.add_argument("--walltime", help="of each job: 01:00:00")
    parser.add_argument("--queue", help="the queue, or partition, for the jobs")
    parser.add_argument("--hosts", help="for ssh: HEAD,WORKER,WORKER")
    args, more = parser.parse_known_args(words)

    def show(share: float, unit: str) -> None:
        print(f"\r\x1b[K{100 * share:3.0f} %  {unit}", end="" if share < 1 else "\n", file=sys.stderr, flush=True)

    here = options(memory=None if args.cluster not in ("local", "ssh") else args.memory, threads=args.cores)
    try:
        with _cluster(args.cluster, args.jobs, vars(args)) as client:
            if "://" not in args.cluster:
                client.wait_for_workers(1)
            report = _simplify([args.input, args.output, *more], args.job, client, args.units or args.jobs, here, 3, show)
    except Error as error:
        print(f"\nstonecut-dask: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    print(f"{report['output']['path']}: {report['output']['triangles']} triangles, {report['stop_reason']}", file=sys.stderr)


if __name__ == "__main__":
    main()
