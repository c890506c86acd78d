"""Exceptions, one class for each exit code of the command line.

Every class is a :class:`Error` and, where Python has one for the purpose, also a built-in exception, so that
``except ValueError``, ``except OSError`` and ``except MemoryError`` work as expected.
"""

from __future__ import annotations

import errno
import os
import re
from typing import Any

__all__ = [
    "BadInput",
    "DeviceError",
    "EmptyResult",
    "Error",
    "InternalError",
    "Interrupted",
    "JobLocked",
    "JobMismatch",
    "LossWarning",
    "MissingInput",
    "NoSpace",
    "NotEnoughMemory",
    "ShortOfTarget",
    "SystemFault",
    "UsageError",
]


class Error(Exception):
    """Any failure of stonecut: reading, writing, a damaged temporary file (exit code 1).

    ``exit_code`` is what the command line would end with; ``path`` the file, folder or argument, if there is one.
    """

    exit_code: int = 1
    path: str | None = None

    def __init__(self, message: str, path: str | None = None) -> None:
        super().__init__(message)
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return (_again, (type(self), str(self), self.path, getattr(self, "errno", None)))


class SystemFault(Error, OSError):
    """The operating system refused to read, write, create or rename (1); ``errno`` says why."""


class UsageError(Error, ValueError):
    """The arguments make no sense (2)."""

    exit_code = 2


class EmptyResult(Error, ValueError):
    """The run came to its end, but nothing would be left of the mesh (3)."""

    exit_code = 3


class BadInput(Error, ValueError):
    """The mesh breaks its format, or holds what no mesh may hold (4)."""

    exit_code = 4


class MissingInput(BadInput, FileNotFoundError):
    """A file that was named is not there (4)."""


class NoSpace(Error, OSError):
    """The file system is full (5)."""

    exit_code = 5


class NotEnoughMemory(Error, MemoryError):
    """The memory budget cannot hold the work (6)."""

    exit_code = 6


class JobLocked(Error):
    """Another run holds the job (7)."""

    exit_code = 7


class JobMismatch(Error, ValueError):
    """The job folder belongs to another input or to other settings (8)."""

    exit_code = 8


class InternalError(Error, RuntimeError):
    """A fault of stonecut itself; please report it (9)."""

    exit_code = 9


class DeviceError(Error, OSError):
    """The disk takes no files, or fails (10)."""

    exit_code = 10


class Interrupted(Error):
    """The call was asked to stop (130). Ctrl-C raises ``KeyboardInterrupt`` instead."""

    exit_code = 130


class ShortOfTarget(UserWarning):
    """The result is there, but has more triangles than wanted, or too few to stand for its input (exit code 3)."""


class LossWarning(UserWarning):
    """Something that the mesh carries cannot be kept; the message names it."""


_CLASSES: dict[int, type[Error]] = {
    kind.exit_code: kind
    for kind in (
        UsageError,
        EmptyResult,
        BadInput,
        NoSpace,
        NotEnoughMemory,
        JobLocked,
        JobMismatch,
        InternalError,
        DeviceError,
        Interrupted,
    )
}


def _make(exit_code: int, message: str, path: Any, code: int | None) -> Error:
    """The exception for an error of the compiled half."""
    kind = _CLASSES.get(exit_code, Error if code is None else SystemFault)
    if kind is NoSpace:
        code = errno.ENOSPC
    if kind is BadInput and path is not None and not os.path.lexists(path):
        kind, code = MissingInput, errno.ENOENT
    return _again(kind, _as_keywords(message), None if path is None else str(path), code)


def _as_keywords(message: str) -> str:
    """Options of the command line as the keywords that they are here: ``give --force`` becomes ``give force=True``."""
    message = re.sub(r"--(force|restart|skip-bad|recentre)\b", lambda option: _keyword(option) + "=True", message)
    message = re.sub(r"--([a-z][a-z-]*[a-z]) (?=\d)", lambda option: _keyword(option) + "=", message)
    return re.sub(r"--([a-z][a-z-]*[a-z])\b", _keyword, message)


def _keyword(option: re.Match[str]) -> str:
    return option[1].replace("-", "_")


def _again(kind: type[Error], message: str, path: str | None, code: int | None) -> Error:
    error = kind(message, path)
    if code is not None and isinstance(error, OSError):
        error.errno = code
    return error
