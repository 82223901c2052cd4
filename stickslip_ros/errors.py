# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The exceptions of the package: each message names the value and what would be right."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from stickslip_ros.visible import visible


def in_words(error: Exception) -> str:
    """An error as it is told: of the system's the file and the reason, without its number."""
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        return f"{error.filename}: {reason(error)}"
    return reason(error)


def reason(error: Exception) -> str:
    """What went wrong, on one line, without the file that it is about where the system has that beside it."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror[:1].lower()}{error.strerror[1:]}"
    return " ".join(str(error).split()) or type(error).__name__


_BY_APT = ("lz4", "zstandard")


def needs(error: ImportError) -> str:
    """The package whose module could not be imported, and the command that installs it."""
    package = (error.name or str(error)).partition(".")[0]
    command = f"sudo apt install python3-{package}, or " if package in _BY_APT else ""
    return f"needs the package {package}: {command}pip install {package}"


class StickSlipError(Exception):
    """Base of every error that the package raises on purpose.

    Its text may name what others named: it goes to terminals and logs, and is one line of visible characters.
    """

    def __str__(self) -> str:
        return visible(super().__str__())


@contextmanager
def optional_packages(output: str) -> Iterator[None]:
    """Context, or decorator, of what writes one output and imports packages that nothing else needs.

    Raises
    ------
    StickSlipError
        If one of them is missing.
    """
    try:
        yield
    except ImportError as error:
        raise StickSlipError(f"{output} {needs(error)}") from error


class InvalidParameterError(StickSlipError, ValueError):
    """A parameter is outside the range in which the physics means something.

    Attributes
    ----------
    name : of the parameter, as those who raise know it; :meth:`as_typed` makes it the user's.
    """

    def __init__(self, name: str, requirement: str, value: object) -> None:
        self.name, self.requirement, self.value = name, requirement, value
        super().__init__(f"{name!r} must be {requirement}: {_shown(value)}")

    def as_typed(self, names: Sequence[str], values: Sequence[object] = ()) -> InvalidParameterError:
        """The same error in the words of who typed the value.

        Parameters
        ----------
        names : of the parameters or options that the value was made of. values : theirs, in the units they were
            typed in; none: that of the error.
        """
        error = InvalidParameterError(names[0], self.requirement, self.value)
        shown = " and ".join(map(_shown, values)) if values else _shown(self.value)
        error.args = (f"{' and '.join(map(repr, names))} must be {self.requirement}: {shown}",)
        return error


def _shown(value: object) -> str:
    """A value as it was typed; what is empty is seen, and a range reads as one."""
    if isinstance(value, tuple):
        return " to ".join(map(str, value))
    return str(value) or "''"


class UnknownJointError(StickSlipError, KeyError):
    """A joint name that is not there; the message lists those that are."""

    def __init__(self, name: str, known: list[str]) -> None:
        super().__init__(f"unknown joint {name!r}; known joints: {', '.join(sorted(known))}")

    def __str__(self) -> str:
        return visible(str(self.args[0]))


class JointFileError(StickSlipError, ValueError):
    """A joint file that cannot be read as a joint."""
