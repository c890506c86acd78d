"""One job on a Dask cluster of three processes, of which one is killed."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import pytest

import stonecut as sc

distributed: Any = pytest.importorskip("distributed")
sc_dask: Any = pytest.importorskip("stonecut.dask")


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scan") / "scan.ply"
    sc.synth("statue", path, triangles=400_000)
    sc.simplify_file(path, path.parent / "whole.ply", ratio=0.02, cell_triangles=10_000)
    return path


def test_a_killed_worker_changes_no_byte(scan: Path) -> None:
    killed: list[int] = []
    shares: list[float] = []
    with distributed.LocalCluster(n_workers=3, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client:
            processes = list(client.run(os.getpid).values())

            def progress(share: float, unit: str) -> None:
                shares.append(share)
                if unit.startswith("simplify/") and not killed:
                    os.kill(processes[0], signal.SIGKILL)
                    killed.append(processes[0])

            report = sc_dask.simplify(
                scan, scan.parent / "out.ply", ratio=0.02, cell_triangles=10_000, job=scan.parent / "job",
                client=client, units=8, memory="1GiB", threads=1, progress=progress,
            )
            assert killed and len(set(processes)) == 3
            assert shares == sorted(shares) and shares[-1] == pytest.approx(1)
            assert report["output"]["triangles"] <= report["target"]
            assert (scan.parent / "out.ply").read_bytes() == (scan.parent / "whole.ply").read_bytes()
            with pytest.raises(sc.JobMismatch):
                sc_dask.simplify(scan, scan.parent / "out.ply", ratio=0.03, job=scan.parent / "job", client=client, force=True)
            with pytest.raises(sc.BadInput):
                sc_dask.simplify(scan.parent / "none.ply", scan.parent / "o.ply", ratio=0.03, job=scan.parent / "other", client=client)


def test_the_command_takes_a_cluster_by_name(scan: Path) -> None:
    out = scan.parent / "by-name.ply"
    words = f"{scan} {out} --ratio 2% --cell-triangles 10000 --job {scan.parent / 'job-2'} --jobs 2 --memory 1GiB --cores 1"
    sc_dask.main(words.split())
    assert out.read_bytes() == (scan.parent / "whole.ply").read_bytes()
