"""The ``stonecut`` command of the wheel: the same program, in the library of the module."""

from __future__ import annotations

import sys

from . import _stonecut


def main() -> None:
    """Runs the command line and exits with its code."""
    sys.exit(_stonecut.main(["stonecut", *sys.argv[1:]]))
