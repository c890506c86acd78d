"""stonecut: simplifies triangle meshes of any size, in memory or out of core, and measures the error.

In memory::

    points, faces = stonecut.simplify_arrays(points, faces, triangles=100_000)
    small = stonecut.simplify(mesh, ratio=0.01)          # trimesh, pyvista, Open3D: the same kind comes back

From file to file, in any memory, continued by the same call after an interruption::

    report = stonecut.simplify_file("scan.ply", "small.ply", ratio=0.01, memory="4GiB")

Names and meanings are those of the ``stonecut`` command; ``peak_memory_bytes`` of a report is of the whole process, the
interpreter and its arrays included. Everything after the meshes is keyword-only, and ``ratio`` is
the share of the triangles that is **kept**. Lengths are in the units of the mesh, sizes of memory in bytes or as text
(``"4GiB"``, ``"50%"``). All functions may be called from several threads at once and let other threads run; Ctrl-C ends
them, and so does an exception from ``progress``, which is called with a :class:`Progress` about 20 times a second.
Failures are :class:`Error` and its classes.
"""

from __future__ import annotations

import json
import math
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal

from . import _stonecut, errors
from ._adapt import adapt
from ._arrays import Array, Attributes, Mesh
from ._arrays import faces as _faces
from ._arrays import points as _points
from ._stonecut import Progress, __version__
from ._words import PathLike, options, path, paths, target
from .errors import (
    BadInput,
    DeviceError,
    EmptyResult,
    Error,
    InternalError,
    Interrupted,
    JobLocked,
    JobMismatch,
    LossWarning,
    MissingInput,
    NoSpace,
    NotEnoughMemory,
    ShortOfTarget,
    SystemFault,
    UsageError,
)

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
    "Measured",
    "MissingInput",
    "NoSpace",
    "NotEnoughMemory",
    "Progress",
    "ShortOfTarget",
    "SimplifiedArrays",
    "SystemFault",
    "UsageError",
    "__version__",
    "convert",
    "errors",
    "extract",
    "info",
    "measure",
    "plan",
    "render",
    "simplify",
    "simplify_arrays",
    "simplify_file",
    "synth",
    "tiles",
    "transfer",
]

Report = dict[str, Any]
OnProgress = Callable[[Progress], object]
Size = int | str
Topology = Literal["keep", "error"]
Fit = Literal["on", "off", "auto"]
Placement = Literal["optimal", "subset", "midpoint"]
Normals = Literal["keep", "recompute", "drop"]
Method = Literal["collapse", "cluster", "decimate", "retile"]
Until = Literal["partition", "simplify", "stitch"]
Textures = Literal["copy", "link", "embed", "none", "ktx2", "etc1s"]
Kind = Literal["terrain", "statue", "gyroid", "scans", "volume", "rooms"]


class SimplifiedArrays:
    """A mesh that :func:`simplify_arrays` has simplified; ``points, faces = result`` unpacks it,
    and ``result[0]`` is ``points``, ``result[1]`` ``faces``.

    ``points`` (n, 3) of the type of the input's, ``faces`` (m, 3) int32, ``attributes`` by name and of the types that were
    given, ``source`` (n,) uint32: the input vertex that survived as each vertex, in ascending order, by which anything
    else can be looked up. ``map``, if it was asked for, has for each vertex of the input the vertex that it became (int32), or -1.
    ``report`` says what was done; its keys are those of ``--report`` (docs/report.md).
    """

    def __init__(
        self,
        points: Array,
        faces: Array,
        attributes: dict[str, Array],
        source: Array,
        report: Report,
        map: Array | None = None,
    ) -> None:
        self.points = points
        self.faces = faces
        self.attributes = attributes
        self.source = source
        self.report = report
        self.map = map

    def __iter__(self) -> Iterator[Array]:
        return iter((self.points, self.faces))

    def __len__(self) -> int:
        return 2

    def __getitem__(self, index: int) -> Array:
        return (self.points, self.faces)[index]

    def __repr__(self) -> str:
        return f"SimplifiedArrays({len(self.points)} points, {len(self.faces)} faces)"

    @property
    def target_met(self) -> bool:
        """True if there are at most as many triangles as were wanted."""
        return bool(self.report["target_met"])

    @property
    def rejects(self) -> dict[str, int]:
        """Refused collapses by reason."""
        return dict(self.report["rejects"])


class Measured(dict[str, Any]):
    """The report of :func:`measure`, with the numbers most asked for as attributes. Lengths are in input units, and
    infinite (``None`` in the dictionary) where one of the meshes has no surface."""

    @property
    def rms(self) -> float:
        """Root mean square distance, both ways."""
        return _length(self["rms"])

    @property
    def relative_rms(self) -> float:
        """The same as a share of the diagonal of the original's bounding box."""
        return _length(self["relative_rms"])

    @property
    def mean(self) -> float:
        """Mean distance, both ways."""
        return 0.5 * (_length(self["forward"]["mean"]) + _length(self["backward"]["mean"]))

    @property
    def max(self) -> float:
        """Largest distance, either way, over samples and vertices."""
        return max(_length(self["forward"]["max"]), _length(self["backward"]["max"]))


def _length(value: float | None) -> float:
    """A length of a report; JSON has null for infinity."""
    return math.inf if value is None else float(value)


def _report(words: list[str], progress: OnProgress | None) -> tuple[Report, bool]:
    text, is_short = _stonecut.run(words, progress)
    return json.loads(text) or {}, is_short


def _warn_if_short(report: Report, is_short: bool) -> None:
    if not is_short:
        return
    made, quality = report["output"]["triangles"], report["quality"]
    if not report["target_met"]:
        what = f"short of the target of {report['target']}: {report['stop_reason']}"
    elif not quality["bearable"]:
        what = f"too few for this mesh, whose surface comes apart; ask for at least {quality['sensible_triangles']}"
    else:
        faults = report["input"]["faults"]
        what = "broken parts of the input were left out: " + ", ".join(f"{n} {name}" for name, n in faults.items() if n)
    warnings.warn(f"{made} triangles are left; {what}", ShortOfTarget, stacklevel=3)


def simplify_arrays(
    points: Any,
    faces: Any,
    *,
    triangles: int | str | None = None,
    ratio: float | str | None = None,
    attributes: Mapping[str, Any] | None = None,
    weight: Mapping[str, float] | None = None,
    label: str | Iterable[str] = (),
    topology: Topology = "error",
    fit: Fit = "auto",
    placement: Placement = "optimal",
    merge_distance: float | None = None,
    weld: str | float | None = None,
    no_self_intersections: bool = False,
    map: bool = False,
    cell_triangles: int | str | None = None,
    memory: Size | None = None,
    threads: int | None = None,
    progress: OnProgress | None = None,
) -> SimplifiedArrays:
    """Simplifies a mesh in memory; ``points, faces = simplify_arrays(points, faces, ratio=0.1)``.

    Args:
        points: (n, 3) float32 or float64, in any units; other numbers become float64. All finite.
        faces: (m, 3) int32, uint32, int64 or uint64, counted from 0; counter-clockwise seen from outside.
        triangles: as many are left, or up to two fewer; ``"100k"`` works too.
        ratio: the share of the triangles that is kept, 0 to 1; give this or ``triangles``.
        attributes: arrays with a row for each vertex. ``"color"`` (n, 3) or (n, 4) of uint8, uint16 or floats from 0 to 1,
            ``"normal"`` (n, 3) and ``"uv"`` (n, 2) of floats are known by name; any other is (n,) or (n, k): floats are
            averaged, integers and booleans are labels and taken from the vertex that survives. Vertices that are
            in one place with different ``"uv"`` are the seams of a texture and stay so.
        weight: how much attributes count against the shape: 0 rides along, 1 is sensible.
            By default colours and texture coordinates count 1, all others 0.
        label: names of attributes that are never averaged although they are floats.
        topology: ``"error"``: specks, holes of three edges and thin tubes smaller than the error may go;
            ``"keep"``: nothing of that kind, even if the target is missed.
        fit: whether vertices are moved to fit the original; ``"auto"`` where at most 1.1 % is left.
        placement: ``"subset"`` keeps to vertices of the input, bit for bit.
        merge_distance: the same as ``weld`` with a distance.
        weld: copies of vertices become one before everything else: ``"auto"`` (within rounding, where triangles hardly have
            a vertex in common), ``"off"`` or a distance; they keep the attributes of the first [auto].
        no_self_intersections: refuse what would make the surface pass through itself where it did not; takes four to eight times as long.
        map: gives ``result.map``, too: what each point of the input became; not with texture coordinates and ``merge_distance``.
        cell_triangles: beyond four cells of this size the mesh is simplified in parallel, through cells in memory [256k].
        memory: what the call may take beside the arrays [75 % of what the process may use].
        threads: [the cores the process may use]; the result does not depend on them.
        progress: called with a :class:`Progress`; an exception from it ends the call.

    Nothing is changed in place; the inputs are copied once. Memory beside that: about 120 bytes a triangle up to a million
    triangles, then about 40, the copy included. Warns with :class:`ShortOfTarget`.

    Raises:
        BadInput: wrong shapes or types, an index out of range, NaN or infinity, no faces.
        UsageError: no target or two, unknown options, attributes that do not fit.
        EmptyResult: nothing would be left. NotEnoughMemory: use :func:`simplify_file`.
    """
    points, faces = _points(points), _faces(faces)
    carried = Attributes(attributes, len(points), weight, label)
    words = ["simplify", "arrays", "arrays.ply", *target(triangles, ratio), *carried.words]
    words += options(
        topology=topology,
        fit=fit,
        placement=placement,
        merge_distance=merge_distance,
        weld=weld,
        no_self_intersections=no_self_intersections,
        map="arrays.npy" if map else None,
        cell_triangles=cell_triangles,
        memory=memory,
        threads=threads,
    )
    out = _stonecut.simplify_arrays(points, faces, carried.columns, words, progress)
    new_points, new_faces, source, rows, records, text = out
    report = json.loads(text)
    _warn_if_short(report, not (report["target_met"] and report["quality"]["bearable"]))
    # Fewer than 2^30 vertices are left, so int32 holds every index.
    mapped = rows.view("i4") if map else None
    return SimplifiedArrays(
        new_points, new_faces.view("i4"), carried.back(records, len(new_points)), source, report, mapped
    )


def simplify(
    mesh: Any,
    *,
    triangles: int | str | None = None,
    ratio: float | str | None = None,
    weight: Mapping[str, float] | None = None,
    topology: Topology = "error",
    fit: Fit = "auto",
    placement: Placement = "optimal",
    merge_distance: float | None = None,
    weld: str | float | None = None,
    no_self_intersections: bool = False,
    cell_triangles: int | str | None = None,
    memory: Size | None = None,
    threads: int | None = None,
    progress: OnProgress | None = None,
) -> Any:
    """Simplifies a mesh of another package; the same kind comes back, with what its vertices carry.

    ``mesh`` is a ``trimesh.Trimesh``, a ``pyvista.PolyData``, an Open3D ``TriangleMesh`` (legacy or tensor) or a pair
    (points, faces). Colours, texture coordinates with their material, normals and numeric arrays of vertices are kept;
    what cannot be kept is named in a :class:`LossWarning`. The mesh itself is not changed. All else is as in
    :func:`simplify_arrays`.
    """
    adapted = adapt(mesh)
    known = {name: value for name, value in (weight or {}).items() if name in adapted.attributes}
    unknown = set(weight or {}) - {"color", "normal", "uv"} - set(known)
    if unknown:
        raise UsageError(f"weight: the mesh carries no {', '.join(sorted(unknown))}; for other arrays use simplify_arrays")
    result = simplify_arrays(
        adapted.points,
        adapted.faces,
        triangles=triangles,
        ratio=ratio,
        attributes=adapted.attributes,
        weight=known,
        topology=topology,
        fit=fit,
        placement=placement,
        merge_distance=merge_distance,
        weld=weld,
        no_self_intersections=no_self_intersections,
        cell_triangles=cell_triangles,
        memory=memory,
        threads=threads,
        progress=progress,
    )
    return adapted.back(result)


def simplify_file(
    input: PathLike | Iterable[PathLike],
    output: PathLike,
    *,
    triangles: int | str | None = None,
    ratio: float | str | None = None,
    max_error: float | None = None,
    method: Method = "collapse",
    grid: float | None = None,
    feature_angle: float | None = None,
    gradation: float | None = None,
    manifold: bool = False,
    optimize: int | None = None,
    pairs: bool = False,
    memory: Size | None = None,
    threads: int | None = None,
    cell_triangles: int | str | None = None,
    temp_dir: PathLike | None = None,
    keep_temp: bool = False,
    until: Until | None = None,
    force: bool = False,
    restart: bool = False,
    min_free: Size | None = None,
    format: str | None = None,
    skip_bad: bool = False,
    min_component: int | str | None = None,
    texture: Literal["auto", "keep", "bake", "none"] = "auto",
    bake_size: int | None = None,
    bake_pages: int | None = None,
    bake_normals: bool = False,
    drop_texture: bool = False,
    textures: Textures | None = None,
    drop_faces: bool = False,
    drop_names: bool = False,
    error_field: bool = False,
    weight: Mapping[str, float] | None = None,
    label: str | Iterable[str] = (),
    normals: Normals = "keep",
    topology: Topology = "error",
    fit: Fit = "auto",
    placement: Placement = "optimal",
    merge_distance: float | None = None,
    weld: str | float | None = None,
    lock: str | None = None,
    up: Literal["y", "z"] | None = None,
    scale: float | None = None,
    translate: str | Iterable[float] | None = None,
    transform: str | Iterable[float] | None = None,
    recentre: bool = False,
    progressive: PathLike | None = None,
    map: PathLike | None = None,
    progressive_bits: int | None = None,
    seams: PathLike | None = None,
    no_self_intersections: bool = False,
    close: bool | str | float | None = None,
    orient: bool = False,
    for_: Literal["print", "simulation"] | None = None,
    verify: bool = False,
    report: PathLike | None = None,
    receipt: PathLike | None = None,
    sign: PathLike | None = None,
    progress: OnProgress | None = None,
) -> Report:
    """Simplifies a mesh file of any size into another, in bounded memory; returns the report (docs/report.md).

    Reads PLY, STL, OBJ, GLB and glTF, also compressed; writes all but the last. Several files, folders and lists
    (``"@list.txt"``) become one mesh. The output appears whole or not at all.
    After an interruption, Ctrl-C included, the same call continues where it stopped: what is done lies in
    ``OUTPUT.stonecut-job``. Options mean what they mean on the command line (``stonecut simplify --help``); in short:

    Args:
        triangles, ratio: the count, one of them.
        max_error: no point of either surface may be farther from the other, in input units: alone, as few triangles as
            that allows; beside a count, whichever ends it first. Proven for the file that is written, so a run may be
            repeated with a tighter bound. ``error_field`` writes the distance with every vertex (PLY).
        method: ``"collapse"`` for results; ``"cluster"`` in one pass for previews, ``"decimate"`` and ``"retile"`` in memory,
            with ``grid`` (instead of a count), ``feature_angle``, ``gradation`` and ``manifold`` of theirs.
        no_self_intersections: refuse what would make the surface pass through itself where it did not; takes four to eight times as long.
        close: fill holes up to a size: ``True`` (5 % of the diagonal), ``"2%"``, a length or ``"all"``. orient: turn triangles over
            so that neighbours agree. for_: ``"print"`` or ``"simulation"``, which stand for these (docs/usage.md).
        optimize: sweeps over the result that make it fit better at the same count; slow, in memory.
        pairs: vertices that face each other across a gap may become one, so that parts join; in memory.
        memory: budget, everything included: bytes, ``"4GiB"`` or ``"50%"`` [75 % of what the process may use].
        temp_dir: where the job folder lies [beside the output]. until: stop after this stage and return ``{}``; the same
            call without it continues.
        force: replace the output if it exists. restart: throw away what an earlier call left.
        min_free: refuse a run that would leave less than this free on a disk that it writes to.
        min_component: drop components below a count of triangles, or below ``"size=2.5"`` or ``"size=0.1%"``.
        texture: keep the input's charts and images, or bake new ones for the result on pages of ``bake_size`` texels a
            side, ``bake_pages`` at most, normal maps with ``bake_normals`` [bake below 30 % of the triangles].
        textures: copy images beside the output, link, embed (GLB) or drop them [copy; embed for GLB].
        weld: copies of vertices become one before everything else: ``"auto"`` (within rounding), ``"off"`` or a distance ["auto"].
        lock: vertices that stay bit for bit: ``"boundary"``, or the name of a property that is not 0 there.
        up, scale, translate, transform, recentre: place the input before everything else.
        progressive: write a progressive mesh too, for ``stonecut refine``.
        map: write a map of vertices too (``.npy``), for :func:`transfer`: ``numpy.load`` gives the vertex of the result
            that each vertex of the input became, or -1.
        verify: measure the result; ``report["measured"]``.
        report: write the report to this file, too.
        receipt: write a receipt for ``stonecut verify``, signed with the key of minisign in the file ``sign``.
        progress: called with a :class:`Progress`; an exception from it ends the call, and the next one continues.

    Warns with :class:`ShortOfTarget`. Raises the classes of :mod:`stonecut.errors`.
    """
    words = _file_words(locals())
    found, is_short = _report(words, progress)
    _warn_if_short(found, is_short)
    return found


def transfer(
    map: PathLike,
    values: PathLike,
    output: PathLike,
    *,
    to: Literal["result", "input"] = "result",
    by: Literal["mean", "majority"] | None = None,
    memory: Size | None = None,
    temp_dir: PathLike | None = None,
    force: bool = False,
    progress: OnProgress | None = None,
) -> Report:
    """Carries values of vertices over to a simplified mesh by the map of :func:`simplify_file`, or back.

    Files of numpy (``.npy``) in and out, with a row for each vertex, of any size: see docs/usage.md. Returns counts: ``rows``,
    ``columns``, ``unknown`` (rows without a value: NaN or 0).
    """
    words = ["transfer", path("map", map), path("values", values), "--output=" + path("output", output)]
    words += options(to=to, by=by, memory=memory, temp_dir=temp_dir and path("temp_dir", temp_dir), force=force)
    return _report(words, progress)[0]


def plan(
    input: PathLike | Iterable[PathLike],
    output: PathLike,
    *,
    triangles: int | str | None = None,
    ratio: float | str | None = None,
    max_error: float | None = None,
    memory: Size | None = None,
    threads: int | None = None,
    cell_triangles: int | str | None = None,
    temp_dir: PathLike | None = None,
    force: bool = False,
    min_component: int | str | None = None,
) -> Report:
    """Forecast of :func:`simplify_file`: cells, rounds, memory, disk in bytes, seconds. Nothing is written.

    Raises what the run would raise before it begins: NotEnoughMemory, NoSpace, BadInput, UsageError.
    """
    words = [*_file_words(locals()), "--dry-run"]
    return _report(words, None)[0]


def _joined(numbers: str | Iterable[float] | None) -> str | None:
    """Numbers as the command takes them."""
    return numbers if numbers is None or isinstance(numbers, str) else ",".join(str(float(number)) for number in numbers)


def _file_words(given: Mapping[str, Any]) -> list[str]:
    rest = dict(given)
    rest.pop("progress", None)
    words = ["simplify", *paths("input", rest.pop("input")), path("output", rest.pop("output"))]
    words += target(rest.pop("triangles"), rest.pop("ratio"), rest.pop("max_error"), rest.pop("grid", None))
    for name in ("temp_dir", "report", "receipt", "sign", "progressive", "map", "seams"):
        if rest.get(name) is not None:
            rest[name] = path(name, rest[name])
    for name in ("translate", "transform"):
        rest[name] = _joined(rest.get(name))
    if isinstance(rest.get("label"), str):
        rest["label"] = [rest["label"]]
    return words + options(**rest)


def measure(
    original: Any,
    simplified: Any,
    *,
    samples: int | str | None = None,
    seed: int = 0,
    memory: Size | None = None,
    threads: int | None = None,
    temp_dir: PathLike | None = None,
    heatmap: PathLike | None = None,
    heatmap_of: Literal["simplified", "original"] = "simplified",
    near: PathLike | None = None,
    within: float | None = None,
    certify: bool = False,
    tolerance: float | str | None = None,
    appearance: bool = False,
    views: int | None = None,
    lit: bool = False,
    pictures: PathLike | None = None,
    cell_triangles: int | str | None = None,
    report: PathLike | None = None,
    force: bool = False,
    progress: OnProgress | None = None,
) -> Measured:
    """Measures how far two meshes deviate from each other, both ways, and their connectivity.

    Two files of any size, or two meshes in memory (as for :func:`simplify`; positions only). Every sample and every vertex
    looks for the exactly nearest point of the other surface.

    Args:
        samples: on each surface [1M]; ``"200k"`` works too. seed: chooses among equally good sets of samples.
        heatmap: write a PLY coloured by distance; ``heatmap_of`` says which of the two it shows.
        near: samples within ``within`` of the vertices of this file are counted apart.
        certify: also enclose the largest distance in a proven interval, ``tolerance`` wide as a share of its upper end.
        appearance: also compare pictures of both, ``views`` of each, ``lit`` though there are colours; ``pictures`` is a
            folder to keep them in.
        report: write the report to this file, too.

    All from ``heatmap`` on, ``memory`` and ``temp_dir`` are for files only.

    Returns the report of ``stonecut measure`` as a dictionary: ``forward`` (original to simplified) and ``backward``, each
    with ``mean``, ``rms``, ``p999``, ``max`` in input units; ``rms``, ``diagonal``, ``relative_rms``; and as attributes
    ``rms``, ``max``, ``mean``, ``relative_rms``.
    """
    paths = {"temp_dir": temp_dir, "heatmap": heatmap, "near": near, "pictures": pictures, "report": report}
    of_files: dict[str, Any] = {
        "within": within,
        "certify": certify,
        "tolerance": tolerance,
        "appearance": appearance,
        "views": views,
        "lit": lit,
        "cell_triangles": cell_triangles,
    }
    files = [isinstance(mesh, (str, os.PathLike)) for mesh in (original, simplified)]
    if all(files):
        words = ["measure", path("original", original), path("simplified", simplified)]
        if heatmap is not None:
            words += options(heatmap_of=heatmap_of)
        words += options(samples=samples, seed=seed, memory=memory, threads=threads, force=force, **of_files)
        for name, file in paths.items():
            words += [] if file is None else options(**{name: path(name, file)})
        return Measured(_report(words, progress)[0])
    if any(files):
        raise UsageError("give two files or two meshes in memory, not one of each")
    asked = [name for name, value in {**paths, **of_files, "memory": memory}.items() if value not in (None, False)]
    if asked:
        raise UsageError(f"for files only: {', '.join(asked)}")
    meshes = []
    for mesh in (original, simplified):
        adapted = adapt(mesh)
        meshes.append(Mesh(_points(adapted.points), _faces(adapted.faces)))
    n = _count(1_000_000 if samples is None else samples)
    text = _stonecut.measure_arrays(meshes[0], meshes[1], n, seed, threads, progress)
    return Measured(json.loads(text))


def _count(given: int | str) -> int:
    scale = {"k": 1_000, "m": 1_000_000, "g": 1_000_000_000}
    try:
        if isinstance(given, str):
            count = int(float(given.rstrip("kKmMgG")) * scale.get(given[-1:].lower(), 1))
        else:
            count = int(given)
    except (TypeError, ValueError, OverflowError):
        raise UsageError(f"samples={given!r}: a count is wanted, like 200k") from None
    if count < 1:
        raise UsageError(f"samples={given!r}: at least one sample is needed")
    return count


def render(
    mesh: Any,
    out: PathLike | None = None,
    *,
    size: tuple[int, int] = (1200, 900),
    view: str | Sequence[float] = "auto",
    zoom: Sequence[float] | None = None,
    edges: bool = False,
    flat: bool = False,
    color: Literal["plain", "vertex", "texture"] = "plain",
    color_by: str | None = None,
    scale_to: float | None = None,
    unlit: bool = False,
    caption: str | Sequence[str] = (),
    own_camera: bool = False,
    quadrics: int = 0,
    memory: Size | None = None,
    threads: int | None = None,
    force: bool = False,
    progress: OnProgress | None = None,
) -> Array:
    """Renders a mesh without a window or a GPU: pixels as uint8 (height, width, 3), and a PNG file if ``out`` is given.

    ``mesh`` is a file of any size, several files side by side seen by one camera, or a mesh in memory.

    Args:
        size: width and height in pixels. view: auto, front, back, left, right, top, bottom or a direction x, y, z.
        zoom: a close-up of a sphere x, y, z, r. edges: draw the edges. flat: facets instead of smooth shading.
        color: ``"vertex"`` paints with vertex colours, ``"texture"`` with the images of a file. color_by: paint by a number
            that the vertices of a file carry, with a legend up to ``scale_to``. unlit: without lamps and shade.
        caption: above each picture. quadrics: draw so many error quadrics. own_camera: each picture has its own view.
    """
    if isinstance(mesh, (str, os.PathLike)):
        files: list[Any] | None = [mesh]
    elif isinstance(mesh, (list, tuple)) and mesh and all(isinstance(m, (str, os.PathLike)) for m in mesh):
        files = list(mesh)
    else:
        files = None
    words = ["render", *([path("mesh", file) for file in files] if files else ["mesh"])]
    words += options(
        size=f"{size[0]}x{size[1]}",
        view=view if isinstance(view, str) else ",".join(map(str, view)),
        zoom=None if zoom is None else ",".join(map(str, zoom)),
        edges=edges,
        flat=flat,
        color=None if color_by is not None and color == "plain" else color,
        color_by=color_by,
        scale_to=scale_to,
        unlit=unlit,
        own_camera=own_camera,
        quadrics=quadrics or None,
        memory=memory,
        threads=threads,
        force=force,
    )
    words += options(caption=[caption] if isinstance(caption, str) else list(caption))
    given = None
    if files is None:
        adapted = adapt(mesh)
        colors = adapted.attributes.get("color") if color == "vertex" else None
        given = Mesh(_points(adapted.points), _faces(adapted.faces), None if colors is None else _bytes(colors))
    # The words need an output; where none is written, it is only a name.
    words.append("--output=" + ("picture.png" if out is None else path("out", out)))
    return _stonecut.picture(words, given, out is not None, progress)


def _bytes(colors: Any) -> Array:
    import numpy as np

    array = np.asarray(colors)[:, :3]
    if array.dtype == np.uint16:
        array = array / 257
    elif array.dtype.kind == "f":
        array = array * 255
    flat: Array = np.ascontiguousarray(np.clip(np.rint(array), 0, 255).astype(np.uint8)).reshape(-1)
    return flat


def info(
    file: PathLike,
    *,
    check: bool = False,
    self_intersections: bool = False,
    memory: Size | None = None,
    temp_dir: PathLike | None = None,
    threads: int | None = None,
    progress: OnProgress | None = None,
) -> Report:
    """Content of a mesh file; with ``check`` it is read whole, and connectivity and faults are counted.

    ``self_intersections`` also counts the pairs of triangles that pass through or lie on each other (with ``check``)."""
    words = ["info", path("file", file), *options(check=check, memory=memory, threads=threads)]
    words += options(self_intersections=self_intersections)
    words += [] if temp_dir is None else options(temp_dir=path("temp_dir", temp_dir))
    return _report(words, progress)[0]


def convert(
    input: PathLike,
    output: PathLike,
    *,
    format: str | None = None,
    force: bool = False,
    skip_bad: bool = False,
    drop_texture: bool = False,
    drop_names: bool = False,
    textures: Textures | None = None,
    keep_duplicates: bool = False,
    keep_unreferenced: bool = False,
    up: Literal["y", "z"] | None = None,
    scale: float | None = None,
    translate: str | Iterable[float] | None = None,
    transform: str | Iterable[float] | None = None,
    recentre: bool = False,
    weld: str | float | None = None,
    split: str | None = None,
    memory: Size | None = None,
    temp_dir: PathLike | None = None,
    report: PathLike | None = None,
    progress: OnProgress | None = None,
) -> Report:
    """Converts a mesh of any size; reads PLY, STL, OBJ, GLB and glTF, writes all but the last.

    Args:
        format: words joined by commas, as ``"ascii"`` or ``"double,ply"`` [by the output's name, binary].
        textures: copy images beside the output, link, embed (GLB) or drop them [copy; embed for GLB].
        skip_bad: drop and count broken faces and vertices instead of failing; warns with :class:`ShortOfTarget`.
        keep_duplicates, keep_unreferenced: keep faces that come twice, and vertices without a face.
        memory: budget, as ``"2GiB"`` or bytes; report: a file for the report.
        up, scale, translate, transform, recentre: place the mesh before everything else.
        weld: copies of vertices become one: ``"off"``, ``"auto"`` (within rounding) or a distance [off].
        split: a file for each label of faces, ``"label"`` or the name of a property; ``output`` has ``{label}`` in its name.

    Returns the counts of what was written (``output``) and of what was dropped (``faults``)."""
    words = ["convert", path("input", input), path("output", output)]
    words += options(
        format=format,
        force=force,
        skip_bad=skip_bad,
        drop_texture=drop_texture,
        drop_names=drop_names,
        textures=textures,
        keep_duplicates=keep_duplicates,
        keep_unreferenced=keep_unreferenced,
        up=up,
        scale=scale,
        translate=_joined(translate),
        transform=_joined(transform),
        recentre=recentre,
        weld=weld,
        split=split,
        memory=memory,
    )
    words += [] if report is None else options(report=path("report", report))
    words += [] if temp_dir is None else options(temp_dir=path("temp_dir", temp_dir))
    found, is_short = _report(words, progress)
    if is_short:
        bad = found["faults"]["bad_faces"]
        lost = [loss for loss in found["losses"] if loss["severity"] == "whole"]
        said = [f"{loss['what']}: {loss['reason']}" for loss in lost]
        said += [f"{bad} broken faces or rows were left out"] if bad else []
        warnings.warn("; ".join(said) or "the output is short of the input", ShortOfTarget, stacklevel=2)
    return found


def synth(
    kind: Kind,
    output: PathLike,
    *,
    triangles: int | str,
    seed: int = 1,
    shuffle: bool = False,
    color: bool = False,
    uv: bool = False,
    noise: float | None = None,
    integer: bool = False,
    sea: bool = False,
    pages: int | None = None,
    tiles: int | None = None,
    round: int | float | None = None,
    t_junctions: bool = False,
    overlap: float | str | None = None,
    format: str | None = None,
    force: bool = False,
    threads: int | None = None,
    progress: OnProgress | None = None,
) -> Report:
    """Makes a synthetic scan of any size, the same for the same seed: terrain, statue, gyroid, scans, volume, rooms or foam.

    Args:
        triangles: at least as many; ``"4M"`` works too. seed: another one makes another mesh.
        shuffle: vertices, faces and corners in random order. color, uv: with vertex colours, texture coordinates.
        sea: of the terrain, water at height 0. noise, integer: of the volume, a factor of the scanner's noise, and whole
            values, which meet the level exactly. pages: of the rooms, the largest number of images.
        tiles: cut into about as many files in the folder ``output``. round: digits after the point of their coordinates, or a
            step. t_junctions: edges of borders split in one of two tiles. overlap: share of a side by which tiles overlap.

    Returns the path and the counts of what was written (``output``)."""
    words = ["synth", kind, path("output", output)]
    words += options(
        triangles=triangles,
        seed=seed,
        shuffle=shuffle,
        color=color,
        uv=uv,
        noise=noise,
        integer=integer,
        sea=sea,
        pages=pages,
        tiles=tiles,
        round=round,
        t_junctions=t_junctions,
        overlap=overlap,
        format=format,
        force=force,
        threads=threads,
    )
    return _report(words, progress)[0]


def tiles(
    input: PathLike | Iterable[PathLike],
    output: PathLike,
    *,
    tile_triangles: int | str | None = None,
    pixels: float | None = None,
    finest: int | str | float | None = None,
    compress: Literal["meshopt", "none"] | None = None,
    texture: Literal["bake", "colors"] | None = None,
    textures: Literal["ktx2", "etc1s"] | None = None,
    up: Literal["y", "z"] | None = None,
    scale: float | None = None,
    translate: str | Iterable[float] | None = None,
    recentre: bool = False,
    geo: str | Iterable[float] | None = None,
    transform: str | Iterable[float] | None = None,
    crs: str | None = None,
    viewer: bool = False,
    weld: str | float | None = None,
    skip_bad: bool = False,
    memory: Size | None = None,
    threads: int | None = None,
    temp_dir: PathLike | None = None,
    keep_temp: bool = False,
    restart: bool = False,
    force: bool = False,
    report: PathLike | None = None,
    receipt: PathLike | None = None,
    sign: PathLike | None = None,
    progress: OnProgress | None = None,
) -> Report:
    """Cuts a mesh of any size into a folder of tiles at all levels of detail (OGC 3D Tiles 1.1).

    Args:
        tile_triangles: about so many in a tile [16k]. pixels: the deviation in a viewer's picture, at most [1].
        finest: the finest level that is kept, a share or a count. compress: ``"meshopt"`` or ``"none"`` ["meshopt"].
        texture: ``"bake"`` an image for each tile, or ``"colors"`` of vertices out of the images.
        textures: images of tiles as KTX2, ``"ktx2"`` (UASTC) or ``"etc1s"`` (smaller) [JPEG or PNG].
        up, scale, translate, recentre: place the mesh. geo: latitude, longitude, height of its origin. transform: 16 numbers
            by columns. crs: the system of its coordinates, as ``"EPSG:25832"``. viewer: a page to look at the tree.

    All else is as in :func:`simplify_file`; the same call continues after an interruption. Returns the report of
    ``stonecut tiles``: ``levels``, ``tiles`` and what else it counts."""
    words = ["tiles", *paths("input", input), path("output", output)]
    words += options(
        tile_triangles=tile_triangles,
        pixels=pixels,
        finest=finest,
        compress=compress,
        texture=texture,
        textures=textures,
        up=up,
        scale=scale,
        translate=_joined(translate),
        recentre=recentre,
        geo=_joined(geo),
        transform=_joined(transform),
        crs=crs,
        viewer=viewer,
        weld=weld,
        skip_bad=skip_bad,
        memory=memory,
        threads=threads,
        keep_temp=keep_temp,
        restart=restart,
        force=force,
    )
    for name, file in {"temp_dir": temp_dir, "report": report, "receipt": receipt, "sign": sign}.items():
        words += [] if file is None else options(**{name: path(name, file)})
    return _report(words, progress)[0]


def extract(
    tree: PathLike,
    output: PathLike,
    *,
    max_error: float | None = None,
    triangles: int | str | None = None,
    inside: str | Iterable[float] | None = None,
    max_error_inside: float | None = None,
    format: str | None = None,
    memory: Size | None = None,
    threads: int | None = None,
    force: bool = False,
    progress: OnProgress | None = None,
) -> Report:
    """Extracts one mesh from a folder of tiles: the coarsest within ``max_error`` of the input, or of so many ``triangles``.

    ``inside`` is a box (x0, y0, z0, x1, y1, z1) in which ``max_error_inside`` holds. Returns counts of the mesh, and
    ``deviation``, its bound in input units. Warns with :class:`ShortOfTarget` where the count cannot be met."""
    words = ["extract", path("tree", tree), path("output", output)]
    words += options(
        max_error=max_error,
        triangles=triangles,
        inside=_joined(inside),
        max_error_inside=max_error_inside,
        format=format,
        memory=memory,
        threads=threads,
        force=force,
    )
    found, is_short = _report(words, progress)
    if is_short:
        warnings.warn(f"{found['triangles']} triangles: the number was not met", ShortOfTarget, stacklevel=2)
    return found
