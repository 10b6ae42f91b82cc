"""Results: what a run answers."""

from __future__ import annotations

import importlib
import io
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._errors import SceneError, not_accepted
from ._number import Curve, Number
from ._scene import Scene

__all__ = ["Density", "Results"]

# Sections and parts of sections that are settings, not numbers with errors.
_SETTINGS = {"scene", "oscillator", "agreement", "method", "run", "decay_rates"}


def _array(values: list[float | None]) -> NDArray[np.float64]:
    return np.array([math.nan if it is None else it for it in values], dtype=np.float64)


def _wrapped(tree: Any) -> Any:
    """Value and error as one, lists of numbers as arrays."""
    if isinstance(tree, dict):
        if tree.keys() == {"value", "error"}:
            value, error = tree["value"], tree["error"]
            if isinstance(value, list):
                return Curve(_array(value), _array(error))
            return Number(value, error)
        return {key: it if key in _SETTINGS else _wrapped(it) for key, it in tree.items()}
    if isinstance(tree, list):
        if all(it is None or isinstance(it, (int, float)) for it in tree):
            return _array(tree)
        return [_wrapped(it) for it in tree]
    return tree


@dataclass(frozen=True, eq=False)
class Density:
    """The density p(q, v) at one time, as read-only arrays."""

    p: NDArray[np.float64]
    """p[i, j] is the density at q[i], v[j]: shape (len(q), len(v)); in 1/(q v), not masses of cells."""
    q: NDArray[np.float64]
    """Centres of the cells in displacement."""
    v: NDArray[np.float64]
    """Centres of the cells in velocity."""
    t: float
    """The time; infinite for the stationary one."""

    def __repr__(self) -> str:
        q, v = self.q, self.v
        return f"<Density at t = {self.t:g}: p[{len(q)}, {len(v)}], q {q[0]:.3g} to {q[-1]:.3g}, v {v[0]:.3g} to {v[-1]:.3g}>"

    def plot(self, ax: Any = None, **options: Any) -> Any:
        """A picture in the phase plane on ``ax``, or on a new one; needs matplotlib. Options are those of
        ``pcolormesh``. Returns the axes."""
        if ax is None:
            ax = importlib.import_module("matplotlib.pyplot").subplots()[1]
        image = ax.pcolormesh(self.q, self.v, self.p.T, **{"shading": "nearest", "rasterized": True, **options})
        ax.figure.colorbar(image, ax=ax, label="p(q, v)")
        title = "stationary" if math.isinf(self.t) else f"t = {self.t:g}"
        ax.set(xlabel="displacement q", ylabel="velocity v", title=title)
        return ax


class _State(TypedDict):
    """What a pickle keeps of results: the answers of `_native.Results`."""

    tree: dict[str, Any]
    table: str
    html: str
    files: list[tuple[str, bytes]]
    shortfalls: list[str]
    times: list[float]


class _Stored:
    """Results after a pickle: the same answers as `_native.Results` gives, from what was written."""

    def __init__(self, state: _State) -> None:
        self._state = state

    def tree(self) -> dict[str, Any]:
        return self._state["tree"]

    def table(self) -> str:
        return self._state["table"]

    def html(self) -> str:
        return self._state["html"]

    def files(self) -> list[tuple[str, bytes]]:
        return self._state["files"]

    def shortfalls(self) -> list[str]:
        return self._state["shortfalls"]

    def times(self) -> list[float]:
        return self._state["times"]

    def density(self, place: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        arrays = [data for name, data in self.files() if name.endswith(".npz")]
        for data in arrays:
            with np.load(io.BytesIO(data)) as found:
                if "p" in found and float(found["t"]) == self.times()[place]:
                    p, q, v = found["p"], found["q"], found["v"]
                    for it in (p, q, v):
                        it.flags.writeable = False
                    return p, q, v
        raise IndexError(place)


class Results(Mapping[str, Any]):
    """What a run answers, under the names of results.json: ``r["transient"]["mean_q"].value``.

    A number is a ``Number``, a curve a ``Curve``, times and frequencies are arrays; what does not exist is None, or NaN
    in an array. Sections that were not asked for are absent. ``str()`` is the table that the program prints.
    """

    scene: Scene
    """The scene that was run."""

    def __init__(self, native: _native.Results | _Stored, scene: Scene) -> None:
        self._native = native
        self.scene = scene
        self._tree: dict[str, Any] | None = None
        self._sections: dict[str, Any] = {}

    def _plain(self) -> dict[str, Any]:
        if self._tree is None:
            self._tree = self._native.tree()
        return self._tree

    def __getitem__(self, section: str) -> Any:
        if section not in self._sections:
            tree = self._plain()
            if section not in tree:
                raise KeyError(f"{section!r} was not asked for; there are {', '.join(tree)}")
            found = tree[section]
            self._sections[section] = found if section in _SETTINGS else _wrapped(found)
        return self._sections[section]

    def __iter__(self) -> Iterator[str]:
        return iter(self._plain())

    def __len__(self) -> int:
        return len(self._plain())

    def __eq__(self, other: object) -> bool:
        """Whether all numbers are the same; how long the runs took does not count."""
        if not isinstance(other, Results):
            return NotImplemented
        a, b = ({key: it for key, it in r._plain().items() if key != "run"} for r in (self, other))
        return a == b

    __hash__ = None  # type: ignore[assignment]

    @property
    def times(self) -> tuple[float, ...]:
        """The times of the densities, infinite for the stationary one."""
        return tuple(self._native.times())

    @property
    def warnings(self) -> list[str]:
        """What the reader of the numbers should know."""
        return list(self._plain()["run"]["warnings"])

    @property
    def reached_tolerance(self) -> bool:
        """Whether every number that the program was free to refine reached ``accuracy.tolerance``."""
        return not self._native.shortfalls()

    def density(self, t: float | None = None) -> Density:
        """The density p(q, v) at a time of ``outputs.density_at``; ``math.inf`` is the stationary one on the mesh
        (``outputs.steady``). Without a time: the only one there is. The arrays look into the results: no copies.

        Raises:
            SceneError: there is none at that time.
        """
        times = self.times
        accepted = f"one of {', '.join(f'{it:g}' for it in times)}" if times else "none: the scene has no density_at"
        if t is None and len(times) == 1:
            t = times[0]
        close = [k for k, it in enumerate(times) if t is not None and (it == t or math.isclose(it, t, rel_tol=1e-12))]
        if not close:
            raise not_accepted("t", t, accepted)
        p, q, v = self._native.density(close[0])
        return Density(p, q, v, times[close[0]])

    def to_dict(self) -> dict[str, Any]:
        """results.json as plain values, a copy of your own."""
        return self._native.tree() if isinstance(self._native, _native.Results) else _copy(self._plain())

    def files(self) -> dict[str, bytes]:
        """Every file that ``vibroimpact run --out`` writes, by name: tables, arrays, pictures (SVG), the page."""
        return dict(self._native.files())

    def save(self, folder: str | os.PathLike[str], force: bool = False) -> None:
        """Write what ``vibroimpact run --out`` writes. Each file appears whole or not at all.

        Args:
            folder: a folder that does not exist yet, or any with ``force``; earlier results in it are replaced.

        Raises:
            SceneError: the folder exists, or another run is writing into it.
            VibroimpactError: it cannot be written.
        """
        _native.save(folder, list(self.files().items()), force)

    def plot(self) -> Any:
        """Densities, moments, spectrum and survival, what there is of them; needs matplotlib. Returns the figure."""
        pyplot = importlib.import_module("matplotlib.pyplot")
        panels: list[Any] = [self.density(t).plot for t in self.times]
        for section, name, axis in [
            ("transient", "mean_q", "t"),
            ("transient", "std_force", "t"),
            ("transient", "contact_loss_probability", "t"),
            ("spectrum", "fokker_planck", "omega"),
            ("first_loss", "survival", "t"),
        ]:
            if section in self and len(self[section][axis]) > 1:
                panels.append(_Panel(self[section][axis], self[section][name], (section, name, axis)))
        files = self.files()
        if not panels and "stationary_q.csv" in files:
            q, p = np.loadtxt(io.BytesIO(files["stationary_q.csv"]), delimiter=",", skiprows=1, usecols=(0, 1), unpack=True)
            panels.append(_Panel(q, Curve(p, np.zeros_like(p)), ("stationary", "density of q", "q")))
        if not panels:
            raise SceneError("there is nothing to plot: the scene asked for no density, moments, spectrum or survival")
        columns = min(len(panels), 3)
        rows = -(-len(panels) // columns)
        size = (4.5 * columns, 3.6 * rows)
        figure, axes = pyplot.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
        for ax in axes.flat[len(panels) :]:
            ax.remove()
        for ax, panel in zip(axes.flat, panels):
            panel(ax)
        return figure

    def __reduce__(self) -> Any:
        it = self._native
        state: _State = {
            "tree": self._plain(),
            "table": it.table(),
            "html": it.html(),
            "files": it.files(),
            "shortfalls": it.shortfalls(),
            "times": it.times(),
        }
        return _restored, (state, self.scene)

    def __str__(self) -> str:
        return self._native.table()

    def __repr__(self) -> str:
        it = self._plain()
        left = {"scene", "oscillator", "run", "agreement", "continuous_from"}
        sections = ", ".join(key for key in it if key not in left)
        return f"<Results of {it['scene']['title']!r}: {sections}; {it['run']['wall_seconds']:.3g} s>"

    def _repr_html_(self) -> str:
        return self._native.html()


@dataclass
class _Panel:
    """A curve with its error on axes of matplotlib."""

    x: NDArray[np.float64]
    y: Curve
    names: tuple[str, str, str]

    def __call__(self, ax: Any) -> None:
        section, name, axis = self.names
        ax.plot(self.x, self.y.value)
        ax.fill_between(self.x, self.y.value - self.y.error, self.y.value + self.y.error, alpha=0.3)
        ax.set(xlabel=axis, ylabel=name, title=section)
        if section == "spectrum":
            ax.set_yscale("log")


def _restored(state: _State, scene: Scene) -> Results:
    return Results(_Stored(state), scene)


def _copy(tree: Any) -> Any:
    if isinstance(tree, dict):
        return {key: _copy(it) for key, it in tree.items()}
    return [_copy(it) for it in tree] if isinstance(tree, list) else tree
