# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Functions under names that they had in an earlier version, for one version."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any


def earlier_names(module: str, functions: dict[str, tuple[str, Callable[..., Any]]]) -> Callable[[str], Any]:
    """``__getattr__`` of a module that has functions under earlier names too, and warns of them.

    Parameters
    ----------
    functions : by the earlier name, what to write instead, and the function.
    """

    def attribute(name: str) -> Any:
        if name not in functions:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        now, function = functions[name]
        warnings.warn(f"{module}.{name} is {now} now", DeprecationWarning, stacklevel=2)
        return function

    return attribute
