from collections.abc import Callable, Sequence
from typing import Any, final

import numpy.typing as npt

from ._arrays import Column, Mesh

__all__ = ["Progress", "__version__", "main", "measure_arrays", "picture", "run", "simplify_arrays"]

__version__: str

_Array = npt.NDArray[Any]
_Callback = Callable[[Progress], object] | None

@final
class Progress:
    """Progress of a call."""

    @property
    def stage(self) -> str: ...
    @property
    def number(self) -> int: ...
    @property
    def stages(self) -> int: ...
    @property
    def done(self) -> int: ...
    @property
    def total(self) -> int: ...
    @property
    def fraction(self) -> float: ...
    @property
    def seconds(self) -> float: ...
    @property
    def seconds_left(self) -> float: ...
    @property
    def memory_bytes(self) -> int: ...

def run(words: Sequence[str], callback: _Callback) -> tuple[str, bool]: ...
def picture(words: Sequence[str], mesh: Mesh | None, writes: bool, callback: _Callback) -> _Array: ...
def main(words: Sequence[str]) -> int: ...
def simplify_arrays(
    points: _Array,
    faces: _Array,
    columns: Sequence[Column],
    words: Sequence[str],
    callback: _Callback,
) -> tuple[_Array, _Array, _Array, _Array, _Array, str]: ...
def measure_arrays(
    original: Mesh,
    simplified: Mesh,
    samples: int,
    seed: int,
    threads: int | None,
    callback: _Callback,
) -> str: ...
