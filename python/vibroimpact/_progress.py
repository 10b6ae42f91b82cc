"""Progress of long work on standard error, or to a function of the caller's."""

from __future__ import annotations

import contextlib
import importlib
import math
import sys
from collections.abc import Callable, Iterator
from typing import Any

from ._errors import not_accepted

__all__ = ["Progress", "reporting"]

Progress = Callable[[str, float], object]


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


@contextlib.contextmanager
def reporting(progress: bool | Progress) -> Iterator[Progress | None]:
    """What is to be told name and fraction of a stage; None for nobody."""
    if not isinstance(progress, bool):
        if not callable(progress):
            raise not_accepted("progress", progress, "True, False or a function of stage and fraction")
        yield progress
    elif progress:
        reporter = _reporter()
        try:
            yield reporter
        finally:
            reporter.close()
    else:
        yield None
