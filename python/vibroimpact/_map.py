"""Maps: a scene at every point of a grid, on threads of this process or wherever an executor takes it."""

from __future__ import annotations

import functools
import json
import math
import os
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._errors import ToleranceWarning, VibroimpactError, not_accepted
from ._number import Curve
from ._plan import threads_of
from ._progress import Progress, reporting
from ._scene import Scene, as_scene, plain

__all__ = ["Map", "map"]

# Tasks that an executor is given at most: each takes some milliseconds to send.
_TASKS = 1000


class Executor(Protocol):
    """What takes work elsewhere: of ``concurrent.futures``, or a ``dask.distributed.Client``."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Any: ...


class Map(Mapping[str, Curve]):
    """The numbers of a map by their names in results.json, sections before them: ``m["stationary.mean_q"].value``.

    Arrays have the shape of the axes, in the order of ``over``; of a list, as of moments at several times, its length
    comes last. ``m[name][i, k]`` is the ``Number`` of one point. NaN stands where a point has no number, and for the error of one that has none.
    """

    axes: dict[str, NDArray[Any]]
    """The values of each key, the first running slowest."""
    failed: dict[tuple[int, ...], str]
    """Place and message of the points that have no results."""
    missed: list[tuple[int, ...]]
    """Places of the points with a number that did not reach the tolerance though the program was free to refine it."""

    def __init__(self, axes: Sequence[tuple[str, list[Any]]], lines: Sequence[dict[str, Any]]) -> None:
        self.axes = {key: _axis(values) for key, values in axes}
        self._shape = tuple(len(values) for _, values in axes)
        self.failed, self.missed = {}, []
        found: dict[str, list[tuple[int, Any, Any]]] = {}
        for line in sorted(lines, key=lambda it: int(it["index"])):
            index = int(line["index"])
            place = tuple(int(k) for k in np.unravel_index(index, self._shape))
            if "error" in line:
                self.failed[place] = line["error"]["message"]
            if any(it["free"] for it in line.get("shortfalls", ())):
                self.missed.append(place)
            for name, value, error in _numbers(line.get("results", {}), ""):
                if name in self.axes:
                    continue  # It repeats the axis.
                found.setdefault(name, []).append((index, value, error))
        self._curves = {name: self._curve(it) for name, it in found.items()}

    def _curve(self, found: list[tuple[int, Any, Any]]) -> Curve:
        lengths = [len(value) for _, value, _ in found if isinstance(value, list)]
        shape = (math.prod(self._shape), *([max(lengths)] if lengths else []))
        arrays = np.full(shape, math.nan), np.full(shape, math.nan)
        for index, *pair in found:
            for array, it in zip(arrays, pair):
                if isinstance(it, list):
                    array[index, : len(it)] = [math.nan if x is None else x for x in it]
                elif it is not None:
                    array[index] = it
        value, error = (array.reshape(self._shape + shape[1:]) for array in arrays)
        return Curve(value, error)

    def __getitem__(self, name: str) -> Curve:
        if name not in self._curves:
            raise KeyError(f"{name!r} is none of {', '.join(self._curves)}")
        return self._curves[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._curves)

    def __len__(self) -> int:
        return len(self._curves)

    @property
    def shape(self) -> tuple[int, ...]:
        """Points along each axis."""
        return self._shape

    def __repr__(self) -> str:
        axes = " x ".join(f"{key}[{len(values)}]" for key, values in self.axes.items())
        return f"<Map over {axes}: {len(self)} numbers; {len(self.failed)} points failed>"


def _axis(values: list[Any]) -> NDArray[Any]:
    """The values of a key; of lists, which may have different lengths, an array of objects."""
    if not any(isinstance(it, (list, dict)) for it in values):
        return np.array(values)
    axis = np.empty(len(values), dtype=object)
    for k, it in enumerate(values):
        axis[k] = it
    return axis


def _numbers(tree: Any, name: str) -> Iterator[tuple[str, Any, Any]]:
    """Name, value and error of every number below; of a curve, and of a list of objects, both are lists."""
    if isinstance(tree, dict):
        if tree.keys() == {"value", "error"}:
            yield name, tree["value"], tree["error"]
        elif "re" in tree and "im" in tree:
            # An eigenvalue: its error is that of both parts.
            for part in ("re", "im"):
                yield f"{name}.{part}", tree[part], tree.get("error")
        else:
            for key, it in tree.items():
                yield from _numbers(it, f"{name}.{key}" if name else key)
    elif isinstance(tree, list) and any(isinstance(it, dict) for it in tree):
        rows = [{inner: pair for inner, *pair in _numbers(it, name)} for it in tree]
        for inner in dict.fromkeys(key for row in rows for key in row):
            pairs = [row.get(inner, [None, None]) for row in rows]
            yield inner, [value for value, _ in pairs], [error for _, error in pairs]
    elif isinstance(tree, (list, int, float)) and not isinstance(tree, bool):
        yield name, tree, None


@functools.lru_cache(maxsize=1)
def _made(toml: str, over: str, keep: tuple[str, ...]) -> _native.Map:
    """The map in a process that works for an executor: its points are checked once."""
    axes = [(key, values) for key, values in json.loads(over)]
    return _native.map(_native.Scene.parse("untitled", toml), axes, keep)


def _lines(toml: str, over: str, keep: tuple[str, ...], indices: Sequence[int], threads: int) -> list[str]:
    """The lines of some points: what an executor does."""
    made = _made(toml, over, keep)
    return [made.line(index, threads) for index in indices]


def _by_executor(
    work: tuple[str, str, tuple[str, ...]], points: int, executor: Executor, threads: int, told: Progress | None
) -> list[str]:
    # Neighbours cost alike: each task has points from all over the map.
    tasks = min(points, _TASKS)
    # dask takes equal calls for one, and remembers it: a map asked for again is to be computed.
    options = {"pure": False} if type(executor).__module__.split(".")[0] == "distributed" else {}
    futures = [executor.submit(_lines, *work, range(k, points, tasks), threads, **options) for k in range(tasks)]
    lines: list[str] = []
    try:
        for k, future in enumerate(futures):
            lines += future.result()
            if told is not None:
                told("map", (k + 1) / tasks)
    except BaseException:
        for future in futures:
            future.cancel()
        raise
    return lines


def _here(made: _native.Map, threads: int, told: Progress | None) -> list[str]:
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        made.run(folder, threads, told)
        with open(os.path.join(folder, "part-1-of-1.jsonl"), encoding="utf-8") as file:
            return file.readlines()


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def map(
    scene: Scene | Mapping[str, Any],
    over: Mapping[str, Any],
    executor: Executor | None = None,
    *,
    threads: int | None = None,
    progress: bool | Progress = False,
    keep: Sequence[str] = (),
) -> Map:
    """A scene at every point of a grid.

    The numbers are the same to the last bit for any executor and any number of threads. A point that fails does not
    stop the others: ``Map.failed`` has its message. To a folder, in parts and to be continued, maps are written by the
    program: ``vibroimpact map``.

    Args:
        scene: a scene, or a dict as for ``Scene``.
        over: keys of the scene, each with its values, or with a range as text: ``"log:1e-4:1e-2:40"``,
            ``"lin:0:1:11"``. The first key runs slowest.
        executor: None for threads of this process; else anything with the ``submit`` of ``concurrent.futures``, as a
            ``ProcessPoolExecutor`` or a ``dask.distributed.Client``, whose workers have this package.
        threads: None is one a core, or with an executor one a task.
        progress: as for ``run``.
        keep: curves of results.json to keep at every point, as ``"spectrum"`` or ``"first_loss.survival"``.

    Raises:
        SceneError: a point has no scene that is right, or an argument is wrong.

    Warns:
        ToleranceWarning: points have a number that did not reach ``accuracy.tolerance``.
        UserWarning: points failed.
    """
    scene, threads = as_scene(scene), threads_of(threads)
    if not isinstance(over, Mapping):
        raise not_accepted("over", over, "a dict of keys and their values")
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise not_accepted("executor", executor, "None, or something with submit, as of concurrent.futures")
    axes = [(key, plain(key, values)) for key, values in over.items()]
    for key, values in axes:
        if not isinstance(values, (list, str)):
            raise not_accepted(key, values, 'a list of values, or a range as "log:1e-4:1e-2:40"')
    kept = tuple([keep] if isinstance(keep, str) else keep)
    made = _native.map(scene._native, axes, kept)
    with reporting(progress) as told:
        if executor is None:
            lines = _here(made, threads or _cores(), told)
        else:
            work = scene.to_toml(), json.dumps(axes), kept
            lines = _by_executor(work, len(made), executor, threads or 1, told)
    result = Map(made.axes(), [json.loads(line) for line in lines])
    if len(lines) != len(made):
        raise VibroimpactError(f"{len(made)} points have {len(lines)} lines")
    if result.missed:
        text = f"{len(result.missed)} points have a number that did not reach accuracy.tolerance: see Map.missed"
        warnings.warn(text, ToleranceWarning, stacklevel=2)
    if result.failed:
        place, message = next(iter(result.failed.items()))
        text = f"{len(result.failed)} points failed: see Map.failed; at {place}: {message}"
        warnings.warn(text, UserWarning, stacklevel=2)
    return result
