"""Numbers that never travel alone: a value and its error."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

__all__ = ["Curve", "Number"]


def _text(value: float, error: float) -> str:
    """The value to the digit after the first of its error, as far as a float has digits."""
    if not (math.isfinite(value) and math.isfinite(error)) or error <= 0:
        return f"{value!r} +- {error:.0e}" if error else f"{value!r} +- 0"
    first = math.floor(math.log10(error))
    size = math.floor(math.log10(abs(value))) if value else first
    if 1e-4 <= max(abs(value), error) < 1e7:
        return f"{value:.{min(max(1 - first, 0), 16 - min(size, 0))}f} +- {error:.0e}"
    return f"{value:.{min(max(size - first + 1, 0), 16)}e} +- {error:.0e}"


@dataclass(frozen=True)
class Number:
    """A number with its error, in the unit of the value.

    Without sampling the error is an estimate that the actual one is meant to stay below; with sampling it is one
    standard error. ``float()`` gives the value; a format, as in ``f"{x:.4f}"``, is that of both.
    """

    value: float
    error: float

    def __float__(self) -> float:
        return self.value

    def __str__(self) -> str:
        return _text(self.value, self.error)

    def __format__(self, spec: str) -> str:
        if not spec:
            return str(self)
        error = f"{self.error:{spec}}"
        # Digits that hide an error say nothing of it.
        hidden = self.error > 0.0 and not any(digit in error for digit in "123456789")
        return f"{self.value:{spec}} +- {f'{self.error:.0e}' if hidden else error}"

    def to_ufloat(self) -> Any:
        """As ``uncertainties.ufloat``, the error as its standard deviation; needs the package uncertainties."""
        return importlib.import_module("uncertainties").ufloat(self.value, self.error)


@dataclass(frozen=True, eq=False)
class Curve:
    """Numbers with their errors: two arrays of the same shape, NaN where there is no number. Along one axis, as times, or
    several, as those of a map."""

    value: NDArray[np.float64]
    error: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.value)

    @overload
    def __getitem__(self, place: int | tuple[int, ...]) -> Number: ...
    @overload
    def __getitem__(self, place: slice) -> Curve: ...
    def __getitem__(self, place: int | tuple[int, ...] | slice) -> Number | Curve:
        if isinstance(place, slice):
            return Curve(self.value[place], self.error[place])
        value, error = self.value[place], self.error[place]
        if np.ndim(value):
            raise IndexError(f"a place in {self.value.ndim} dimensions is needed, not {place}")
        return Number(float(value), float(error))

    def __iter__(self) -> Iterator[Number]:
        return (self[k] for k in range(len(self)))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.value, dtype=dtype) if copy else np.asarray(self.value, dtype=dtype)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Curve):
            return NotImplemented
        pairs = (self.value, other.value), (self.error, other.error)
        return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)

    def __str__(self) -> str:
        if self.value.ndim != 1:
            return f"{' x '.join(map(str, self.value.shape))} numbers"
        shown = [str(it) for it in (self if len(self) <= 6 else self[:3])]
        if len(self) > 6:
            shown += ["...", *(str(it) for it in self[-2:])]
        return f"[{', '.join(shown)}]"

    def __repr__(self) -> str:
        return f"Curve({len(self)} numbers: {self})" if self.value.ndim == 1 else f"Curve({self})"

    def to_ufloat(self) -> Any:
        """As an array of ``uncertainties.ufloat``; needs the package uncertainties."""
        module = importlib.import_module("uncertainties.unumpy")
        return module.uarray(self.value, self.error)
