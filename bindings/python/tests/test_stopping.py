"""Other threads run, Ctrl-C and exceptions of callbacks end a call, and the next one continues."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import sphere

import stonecut as sc


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("large") / "in.ply"
    sc.synth("statue", path, triangles=1_500_000)
    return path


class Enough(Exception):
    pass


def stop(_: sc.Progress) -> None:
    raise Enough


@pytest.fixture(autouse=True)
def interrupts() -> Iterator[None]:
    """Has Ctrl-C raise, also where the tests run in the background of a shell, which has it ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_an_exception_of_the_callback_ends_the_call(large: Path) -> None:
    points, faces = sphere(400)  # 1.9 M triangles: several calls of the kernel, each longer than a look
    with pytest.raises(Enough):
        sc.simplify_arrays(points, faces, ratio=0.1, progress=stop)
    # As one call of the kernel, which is stopped within.
    with pytest.raises(Enough):
        sc.simplify_arrays(points, faces, ratio=0.1, cell_triangles=10_000_000, progress=stop)
    output = large.parent / "stopped.ply"
    with pytest.raises(Enough):
        sc.simplify_file(large, output, ratio=0.1, progress=stop)
    assert not output.exists()


def test_a_stopped_run_is_continued_by_the_same_call(large: Path) -> None:
    expected, output = large.parent / "expected.ply", large.parent / "out.ply"
    sc.simplify_file(large, expected, ratio=0.01)
    seen: list[str] = []

    def stop_later(progress: sc.Progress) -> None:
        seen.append(progress.stage)
        if progress.stage == "simplify":
            raise Enough

    with pytest.raises(Enough):
        sc.simplify_file(large, output, ratio=0.01, progress=stop_later)
    assert not output.exists() and (large.parent / "out.ply.stonecut-job").is_dir()
    with pytest.raises(sc.JobMismatch):
        sc.simplify_file(large, output, ratio=0.02)
    report = sc.simplify_file(large, output, ratio=0.01, progress=lambda p: seen.append(p.stage))
    assert "simplify" in seen  # the partition can be over before the first look
    assert report["target_met"] and not (large.parent / "out.ply.stonecut-job").exists()
    assert output.read_bytes() == expected.read_bytes()


def test_ctrl_c_raises_keyboard_interrupt(large: Path) -> None:
    output = large.parent / "interrupted.ply"
    timer = threading.Timer(0.2, lambda: os.kill(os.getpid(), signal.SIGINT))
    begun: list[float] = []

    def begin(_: sc.Progress) -> None:
        if not begun:
            begun.append(time.monotonic())
            timer.start()

    with pytest.raises(KeyboardInterrupt):
        sc.simplify_file(large, output, ratio=0.5, progress=begin)
        time.sleep(5)  # had the run been faster than the signal
    assert not output.exists() or begun


def test_other_threads_run_meanwhile() -> None:
    points, faces = sphere(200)
    counts: list[int] = []
    is_over = threading.Event()

    def count() -> None:
        n = 0
        while not is_over.is_set():
            n += 1
        counts.append(n)

    counter = threading.Thread(target=count)
    counter.start()
    try:
        for _ in range(3):
            sc.simplify_arrays(points, faces, ratio=0.05, threads=1)
    finally:
        is_over.set()
        counter.join()
    # With the lock held all the while, the counter would have got no further than a few switches.
    assert counts[0] > 10_000


def test_progress_rises_to_one_and_ends_there() -> None:
    points, faces = sphere(300)
    seen: list[sc.Progress] = []
    sc.simplify_arrays(points, faces, ratio=0.1, progress=seen.append)
    assert seen and seen[-1].fraction == 1.0 and seen[-1].seconds_left == 0.0
    fractions = [p.fraction for p in seen]
    assert fractions == sorted(fractions)
    last: Any = seen[-1]
    assert last.stage == "finish" and last.done == last.total > 0 and last.memory_bytes > 1 << 20
    assert "finish" in repr(last)
    with pytest.raises(AttributeError):
        last.fraction = 0.0


def test_signals_belong_to_python_afterwards(large: Path) -> None:
    before = signal.getsignal(signal.SIGINT)
    sc.simplify_file(large, large.parent / "signals.ply", triangles=1000)
    assert signal.getsignal(signal.SIGINT) is before
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(1)


def test_a_callback_that_is_none_or_not_callable() -> None:
    points, faces = sphere(20)
    sc.simplify_arrays(points, faces, triangles=100, progress=None)
    with pytest.raises(TypeError):
        sc.simplify_arrays(points, faces, triangles=100, progress=np.zeros(1))  # type: ignore[arg-type]
