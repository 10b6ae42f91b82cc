"""Scenes: what is to be computed."""

from __future__ import annotations

import difflib
import html
import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from . import _native
from ._errors import SceneError, not_accepted

__all__ = ["Scene", "as_scene", "plain", "scene", "scenes"]

_MOST_BYTES = 10_000_000


# A law from functions is a table over this much of q, finest at 0.
_FAR = 100.0
_POINTS = 601


def _sampled(key: str, value: Any, functions: list[Any] | tuple[Any, ...]) -> dict[str, Any]:
    """A contact law from its force G(q), or from force, potential U(q) and stiffness G'(q), as a table."""
    if not all(callable(it) for it in functions) or len(functions) not in (1, 3):
        accepted = "a function of q, the force; or three: force, potential and stiffness"
        raise not_accepted(key, value, accepted)
    q = np.sinh(np.linspace(-np.arcsinh(_FAR), np.arcsinh(_FAR), _POINTS))
    q[_POINTS // 2] = 0.0
    columns = []
    for function in functions:
        try:
            columns.append(np.array([float(function(it)) for it in q.tolist()]))
        except (TypeError, ValueError, ArithmeticError) as error:
            accepted = f"functions of one number that give one for every q from {-_FAR:g} to {_FAR:g}; {error}"
            raise not_accepted(key, value, accepted) from None
    for name, column in zip(("force", "potential", "stiffness"), columns):
        if not np.isfinite(column).all():
            bad = q[~np.isfinite(column)][0]
            raise not_accepted(key, value, f"a finite {name} for every q from {-_FAR:g} to {_FAR:g}; at {bad:g} it is not")
    force = columns[0]
    if len(columns) == 3:
        # Each is the derivative of the one before, on the average over an interval.
        _, potential, stiffness = columns
        for name, of, rate in (("potential", potential, force), ("force", force, stiffness)):
            rise, mean = np.diff(of), 0.5 * np.diff(q) * (rate[1:] + rate[:-1])
            size = np.abs(rate[1:]) + np.abs(rate[:-1]) + np.abs(rate).mean() + 1.0
            wrong = np.abs(rise - mean) > 0.05 * np.diff(q) * size
            if wrong.any():
                at = q[:-1][wrong][0]
                accepted = f"a {name} with the {'force' if name == 'potential' else 'stiffness'} as its derivative; at q = {at:g} it has not"
                raise not_accepted(key, value, accepted)
    return {"law": "table", "q": q.tolist(), "force": force.tolist()}


def _functions(contact: Any) -> list[Any] | tuple[Any, ...]:
    """A contact law that is given by functions, as several of them; empty for another."""
    several = contact if isinstance(contact, (list, tuple)) else [contact]
    return several if any(callable(it) for it in several) else []


def plain(key: str, value: Any) -> Any:
    """Plain values of mappings, sequences and NumPy's numbers and arrays; what is None is left out."""
    if isinstance(value, Mapping):
        inner = {name: plain(f"{key}.{name}" if key else str(name), it) for name, it in value.items()}
        for name in inner:
            if not isinstance(name, str):
                raise not_accepted(f"{key or 'a key'}", name, "keys that are text")
        return {name: it for name, it in inner.items() if it is not None}
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(key, value.tolist())
    if key == "oscillator.contact" and (functions := _functions(value)):
        return _sampled(key, value, functions)
    if isinstance(value, (list, tuple, range)):
        items = [plain(f"{key}[{k}]", it) for k, it in enumerate(value)]
        if None in items:
            raise not_accepted(f"{key}[{items.index(None)}]", None, "a value")
        return items
    if isinstance(value, int) and not isinstance(value, bool) and not -(2**63) <= value < 2**64:
        return float(value)
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise not_accepted(key, value, "text, a number, true or false, a list or a table")


class Scene:
    """What is to be computed, as a plain value that does not change.

    Args:
        sections: the keys of a scene file, as ``{"oscillator": {"zeta": 0.005, "h": 2e-3}, "outputs": {...}}``.
            NumPy's numbers and arrays are accepted for numbers and lists; what is None counts as left out.
            ``contact`` may be a function of q, the force, or three: force, potential and stiffness. It is taken as a
            cubic spline through 601 points between q = -100 and 100, finest at 0, and as a straight line beyond.

    Raises:
        SceneError: an unknown key, or a value that is not accepted: with ``key``, ``value``, ``accepted``.
    """

    def __init__(self, sections: Mapping[str, Any]) -> None:
        if not isinstance(sections, Mapping):
            accepted = "a dict of sections; Scene.from_toml takes text or a file, vi.scene the name of a built-in one"
            raise not_accepted("sections", sections, accepted)
        try:
            self._native = _native.Scene.of("untitled", plain("", sections))
        except SceneError as error:
            key, oscillator = "oscillator.contact", sections.get("oscillator")
            contact = oscillator.get("contact") if isinstance(oscillator, Mapping) else None
            if not _functions(contact) or not str(error.key).startswith(key + "."):
                raise
            raise not_accepted(key, contact, f"{error.accepted}, of {_POINTS} points of the function") from None

    @classmethod
    def _of(cls, native: _native.Scene) -> Scene:
        it = cls.__new__(cls)
        it._native = native
        return it

    @classmethod
    def from_toml(cls, source: str | os.PathLike[str]) -> Scene:
        """A scene from TOML: a file by its path, or the text itself: any text with ``=``, ``[`` or a line break in it. A
        path with one of these is to be a ``pathlib.Path``.

        Raises:
            SceneError: the text is no scene; the message shows the line.
            OSError: the file cannot be read.
        """
        if isinstance(source, str) and any(mark in source for mark in "=\n["):
            return cls._of(_native.Scene.parse("untitled", source))
        path = os.fspath(source)
        with open(path, "rb") as file:
            data = file.read(_MOST_BYTES + 1)
        if len(data) > _MOST_BYTES:
            raise not_accepted("source", path, "a scene of at most 10 MB of TOML")
        try:
            text = data.decode()
        except UnicodeDecodeError as error:
            raise not_accepted("source", path, f"TOML, which is UTF-8 text; {error}") from None
        return cls._of(_native.Scene.parse(path, text))

    def replace(self, key: str, value: Any) -> Scene:
        """The same scene with one key changed: ``scene.replace("oscillator.h", 1e-3)``.

        Raises:
            SceneError: as for a new scene.
        """
        value = plain(key, value)
        if value is None:
            raise not_accepted(key, value, "a value; to leave a key out, take it out of to_dict()")
        return self._of(self._native.replace(key, value))

    def to_dict(self) -> dict[str, Any]:
        """The scene with every default filled in, as plain values: ``scene`` in results.json."""
        return self._native.to_dict()

    def to_toml(self) -> str:
        """The scene with every default filled in, as a scene file."""
        return self._native.to_toml()

    def __eq__(self, other: object) -> bool:
        return self._native == other._native if isinstance(other, Scene) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.to_toml())

    def __reduce__(self) -> Any:
        return _restored, (self.to_toml(),)

    def __repr__(self) -> str:
        it = self.to_dict()
        oscillator = it["oscillator"]
        contact = oscillator["contact"]
        contact = contact if isinstance(contact, str) else contact["law"]
        asked = [name for name, value in it["outputs"].items() if value]
        asked += ["monte_carlo"] if "monte_carlo" in it else []
        level = "h" if "h" in oscillator else "force_psd"
        return (
            f"<Scene {it['title']!r}: {contact}, zeta = {oscillator['zeta']:g}, "
            f"{level} = {oscillator[level]:g}; {', '.join(asked)}>"
        )

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(self.to_toml())}</pre>"


def _restored(toml: str) -> Scene:
    return Scene.from_toml(toml)


def scenes() -> list[str]:
    """Names of the built-in scenes, the default one first."""
    return [name for name, _ in _native.built_in()]


def scene(name: str = "default") -> Scene:
    """A built-in scene.

    Raises:
        SceneError: there is none of that name; ``accepted`` lists them.
    """
    texts = dict(_native.built_in())
    if name not in texts:
        near = difflib.get_close_matches(str(name), texts, 1)
        guess = f"; did you mean {near[0]}?" if near else ""
        raise not_accepted("scene", name, ", ".join(texts) + guess)
    return Scene._of(_native.Scene.parse(name, texts[name]))


def as_scene(it: Scene | Mapping[str, Any]) -> Scene:
    """A scene, or a dict as one."""
    if isinstance(it, Scene):
        return it
    if isinstance(it, Mapping):
        return Scene(it)
    raise SceneError(
        f"scene = {it!r} is not accepted\naccepted: a Scene or a dict; vi.scene(name) gives a built-in one, "
        "vi.Scene.from_toml(path) reads a file",
        "scene",
        repr(it),
        "a Scene or a dict",
    )
