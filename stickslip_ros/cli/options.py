# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Options that many commands have, in one form; and those that have no effect beside the others, which are refused: who
gave them believes that they have one.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from typing import Any

from stickslip_ros.errors import InvalidParameterError, StickSlipError


def add_option(group: Any, name: str, metavar: str | None, text: str, default: Any = None, **more: Any) -> None:
    """Add an option that takes a value; its help ends with the default, if it has one. ``more`` is argparse's."""
    shown = " (default: %(default)s)" if default else ""
    group.add_argument(name, metavar=metavar, default=default, help=f"{text}{shown}", **more)


def add_repeated(group: Any, name: str, metavar: str, text: str, **more: Any) -> None:
    """Add an option that may be given several times; what was given is a list."""
    add_option(group, name, metavar, text, [], action="append", **more)


def add_number(group: Any, name: str, metavar: str, text: str, default: float | None = None) -> None:
    """Add an option that takes a number; its help ends with the default, where that is a finite number."""
    shown = "" if default is None or not math.isfinite(default) else f" (default: {default:g})"
    group.add_argument(name, type=float, metavar=metavar, default=default, help=f"{text}{shown}")


def add_flag(group: Any, name: str, text: str) -> None:
    """Add an option without a value."""
    group.add_argument(name, action="store_true", help=text)


def add_json(group: Any) -> None:
    """Add ``--json``."""
    add_flag(group, "--json", "print one JSON object and nothing else")


def option_of(name: str) -> str:
    """An option as it is typed, by its name among the values that were read."""
    return f"--{name.replace('_', '-')}"


def refuse_given(options: argparse.Namespace, defaults: Mapping[str, Any], rule: str) -> None:
    """Refuse options with another value than their default, which are here by their names; ``rule``: what they must be,
    such as left out.
    """
    for name, default in defaults.items():
        if (given := getattr(options, name)) != default:
            raise InvalidParameterError(option_of(name), rule, given)


def refuse_without_effect(options: argparse.Namespace, *names: str, met: bool, needs: str) -> None:
    """Refuse options that were given and have no effect, for what they need is not there; None and False are what
    nobody gave.

    Parameters
    ----------
    met : whether what they need is there. needs : what that is, for a person.
    """
    for name in names:
        given = getattr(options, name)
        if not met and given is not None and given is not False:
            raise StickSlipError(f"{option_of(name)} has no effect here: it needs {needs}")
