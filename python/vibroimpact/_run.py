"""Runs."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from typing import Any

from . import _native
from ._errors import ToleranceWarning
from ._plan import Plan, threads_of
from ._progress import Progress, reporting
from ._results import Results
from ._scene import Scene, as_scene

__all__ = ["run"]


def run(
    scene: Scene | Plan | Mapping[str, Any],
    *,
    threads: int | None = None,
    progress: bool | Progress = False,
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
        LimitError: ``accuracy.max_seconds`` or ``max_memory`` was reached before any answer.
        VibroimpactError: anything else that fails.

    Warns:
        ToleranceWarning: a number did not reach ``accuracy.tolerance``, or a stage beside
            others has no answer, as exit status 3 of the program says.
    """
    threads = threads_of(threads)
    planned = scene._native if isinstance(scene, Plan) else None
    scene = scene.scene if isinstance(scene, Plan) else as_scene(scene)
    with reporting(progress) as told:
        native = _native.run(scene._native, planned, threads, told, out, bool(force))
    for text in native.shortfalls():
        warnings.warn(text, ToleranceWarning, stacklevel=2)
    return Results(native, scene)
