"""Plans: what a run would compute, its size and its time."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from . import _native
from ._errors import not_accepted
from ._scene import Scene, as_scene

__all__ = ["Plan", "Stage", "plan"]


@dataclass(frozen=True)
class Stage:
    """One stage of a run."""

    name: str
    """As in results.json."""
    needed_by: tuple[str, ...]
    """The keys of the scene that ask for it."""
    method: str
    """How it will be computed, and why so."""
    cells: tuple[int, int] | None
    """Cells in q and in v; None without a mesh."""
    steps: int
    """Steps in time, of each path for Monte Carlo."""
    memory_bytes: int
    seconds: float
    """On this machine, within a factor of about three."""
    refusal: str | None
    """Why it will not be run, the others being run; None of one that will. It counts no bytes and no seconds."""


class Plan:
    """How a scene would be computed; nothing is computed yet. ``str()`` is what ``vibroimpact plan`` prints."""

    scene: Scene
    stages: tuple[Stage, ...]

    def __init__(self, native: _native.Plan, scene: Scene) -> None:
        self._native = native
        self.scene = scene

    def __getattr__(self, name: str) -> Any:
        # Made when asked for: a run needs none of it.
        if name != "stages":
            raise AttributeError(name)
        stages = tuple(
            Stage(**{**it, "needed_by": tuple(it["needed_by"]), "cells": it["cells"] and tuple(it["cells"])})
            for it in self._native.stages()
        )
        self.stages = stages
        return stages

    @property
    def seconds(self) -> float:
        """Of all stages, one after the other."""
        return sum(it.seconds for it in self.stages)

    @property
    def memory_bytes(self) -> int:
        """Of the stage that needs most."""
        return max((it.memory_bytes for it in self.stages), default=0)

    def __reduce__(self) -> Any:
        return plan, (self.scene,)

    def __str__(self) -> str:
        return str(self._native)

    def __repr__(self) -> str:
        names = ", ".join(it.name for it in self.stages)
        title = self.scene.to_dict()["title"]
        return f"<Plan of {title!r}: {names}; about {self.seconds:.1g} s, {self.memory_bytes / 1e6:.2g} MB>"

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"


def threads_of(threads: int | None) -> int | None:
    """A number of threads that is one."""
    if threads is None or (isinstance(threads, int) and not isinstance(threads, bool) and 1 <= threads <= 1024):
        return threads
    raise not_accepted("threads", threads, "a whole number from 1 to 1024, or None for one a core")


def plan(scene: Scene | Mapping[str, Any], threads: int | None = None) -> Plan:
    """What a run of a scene would compute; computes nothing.

    Args:
        scene: a scene, or a dict as for ``Scene``.
        threads: that the run would have; None is one a core.

    Raises:
        SceneError: the scene is wrong, cells that cannot fit ``accuracy.max_memory`` included.
        LimitError: every stage needs more memory than ``accuracy.max_memory``.
    """
    scene = as_scene(scene)
    return Plan(_native.plan(scene._native, threads_of(threads)), scene)
