"""What can go wrong."""

from __future__ import annotations


class VibroimpactError(Exception):
    """Any failure of this package: ``key`` of the scene, its ``value`` and what would have been ``accepted``, as text;
    None where there is none."""

    def __init__(
        self,
        message: str,
        key: str | None = None,
        value: str | None = None,
        accepted: str | None = None,
    ) -> None:
        super().__init__(message)
        self.key = key
        self.value = value
        self.accepted = accepted

    def __reduce__(self) -> tuple[type[VibroimpactError], tuple[str | None, ...]]:
        return type(self), (str(self), self.key, self.value, self.accepted)


class SceneError(VibroimpactError, ValueError):
    """A scene or an argument that is wrong."""


class LimitError(VibroimpactError):
    """A limit of the scene, ``accuracy.max_seconds`` or ``accuracy.max_memory``, was reached before the answer."""


class ToleranceWarning(UserWarning):
    """A number that the program was free to refine did not reach ``accuracy.tolerance``; its error says so too."""


def not_accepted(key: str, value: object, accepted: str) -> SceneError:
    """The error of an argument or a key."""
    text = repr(value)
    message = f"{key} = {text} is not accepted\naccepted: {accepted}"
    return SceneError(message, key, text, accepted)
