"""Runs."""

from __future__ import annotations

import importlib
import math
import os
import sys
import warnings
from collections.abc import Callable, Mapping
from typing import Any

from . import _native
from ._errors import ToleranceWarning, not_accepted
from ._plan import Plan, threads_of
from ._results import Results
from ._scene import Scene, as_scene

__all__ = ["run"]


class _Line:
    """Progress as a line on standard error."""

    def __init__(self) -> None:
        self._stage = self._shown = ""

    def __call__(self, stage: str, fraction: float) -> None:
        if self._stage not in ("", stage):
            sys.stderr.write("\n")
        shown = f"\r{stage:<16} {math.floor(100 * fraction):3} %"
        if shown != self._shown:
            sys.stderr.write(shown)
            sys.stderr.flush()
        self._stage, self._shown = stage, shown

    def close(self) -> None:
        if self._stage:
            sys.stderr.write("\n")


class _Bar:
    """Progress as a bar of tqdm for each stage."""

    def __init__(self, tqdm: Any) -> None:
        self._tqdm, self._bar, self._stage = tqdm, None, ""

    def __call__(self, stage: str, fraction: float) -> None:
        if stage != self._stage:
            self.close()
            form = "{l_bar}{bar}| {elapsed}<{remaining}"
            self._bar, self._stage = self._tqdm(total=100, desc=stage, bar_format=form), stage
        bar: Any = self._bar
        bar.update(100 * fraction - bar.n)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()


def _reporter() -> _Bar | _Line:
    try:
        return _Bar(importlib.import_module("tqdm.auto").tqdm)
    except ImportError:
        return _Line()


def run(
    scene: Scene | Plan | Mapping[str, Any],
    *,
    threads: int | None = None,
    progress: bool | Callable[[str, float], object] = False,
    out: str | os.PathLike[str] | None = None,
    force: bool = False,
) -> Results:
    """Compute everything a scene asks for.

    Other Python threads go on meanwhile. The numbers are the same to the last bit for any number of threads. Ctrl-C
    ends a run within a second; of the files only whole ones are left.

    Args:
        scene: a scene, a dict as for ``Scene``, or a plan.
        threads: that compute; None is one a core. No environment variable has a say in it.
        progress: True for a bar (if tqdm is installed) or a line on standard error; or a function of the name of a
            stage and the fraction of it that is done, called on this thread. What it raises ends the run.
        out: a folder for the files of ``vibroimpact run --out``, each stage's as soon as it has ended; one that exists
            is refused unless ``force``.

    Raises:
        SceneError: the scene, or an argument, is wrong.
        LimitError: ``accuracy.max_seconds`` or ``max_memory`` was reached before the answer.
        VibroimpactError: anything else that fails.

    Warns:
        ToleranceWarning: a number did not reach ``accuracy.tolerance``, as exit status 3 of the program says.
    """
    threads = threads_of(threads)
    planned = scene._native if isinstance(scene, Plan) else None
    scene = scene.scene if isinstance(scene, Plan) else as_scene(scene)
    if not (isinstance(progress, bool) or callable(progress)):
        raise not_accepted("progress", progress, "True, False or a function of stage and fraction")
    reporter = _reporter() if progress is True else None
    told: Callable[[str, float], object] | None = reporter
    if not isinstance(progress, bool):
        told = progress
    try:
        native = _native.run(scene._native, planned, threads, told, out, bool(force))
    finally:
        if reporter is not None:
            reporter.close()
    for text in native.shortfalls():
        warnings.warn(text, ToleranceWarning, stacklevel=2)
    return Results(native, scene)
