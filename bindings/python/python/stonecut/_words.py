"""From keyword arguments to the words of the command line, which one parser reads for both."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

from .errors import UsageError

PathLike = str | os.PathLike[str]


def path(name: str, value: PathLike) -> str:
    """A path as a word. One that begins with a dash must not be taken for an option."""
    try:
        word = os.fspath(value)
    except TypeError:
        raise UsageError(f"{name}: a path is wanted, not {type(value).__name__}") from None
    if not isinstance(word, str):
        raise UsageError(f"{name}: a path as str is wanted, not {type(word).__name__}")
    if word == "-":
        raise UsageError(f"{name}: standard input and output are for the command line; name a file")
    return os.path.join(".", word) if word.startswith("-") else word


def paths(name: str, value: PathLike | Iterable[PathLike]) -> list[str]:
    """One path or several as words."""
    if isinstance(value, str | os.PathLike) or not isinstance(value, Iterable):
        return [path(name, value)]
    return [path(name, item) for item in value]


def options(**given: Any) -> list[str]:
    """Options that are not None: ``max_error=2`` becomes ``--max-error=2``, True a flag, False nothing."""
    words: list[str] = []
    for name, value in given.items():
        option = "--" + name.rstrip("_").replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            words.append(option)
        elif isinstance(value, Mapping):
            words.append(f"{option}=" + ",".join(f"{key}={item}" for key, item in value.items()))
        elif isinstance(value, str):
            words.append(f"{option}={value}")
        elif isinstance(value, Iterable) and not isinstance(value, os.PathLike):
            words.extend(f"{option}={item}" for item in value)
        else:
            words.append(f"{option}={value}")
    return words


def target(triangles: Any, ratio: Any, max_error: Any = None, grid: Any = None) -> list[str]:
    """The one count that is given, or the grid in its place, and the bound, alone or beside it."""
    given = {"triangles": triangles, "ratio": ratio, "grid": grid}
    counts = {name: value for name, value in given.items() if value is not None}
    bound = {} if max_error is None else {"max_error": max_error}
    if len(counts) > 1 or not (counts or bound):
        got = " and ".join(counts) or "none"
        raise UsageError(f"give one target, triangles=... or ratio=...; got {got} (ratio is the share that is kept)")
    return [word for name, value in {**counts, **bound}.items() for word in _target(name, value)]


def _target(name: str, value: Any) -> list[str]:
    """One of the targets, checked."""
    if isinstance(value, bool):
        raise UsageError(f"{name}={value}: a number is wanted")
    if name == "triangles" and not isinstance(value, str):
        try:
            whole = int(value)
            is_whole = whole == value
        except (TypeError, ValueError, OverflowError):  # not a number, NaN, infinity
            is_whole = False
        if not is_whole:
            raise UsageError(f"triangles={value}: a whole number is wanted; for a share use ratio")
        value = whole
    return options(**{name: value})
