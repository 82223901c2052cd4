# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The name that was probably meant."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

_ALIKE = 0.7  # of difflib's ratio


def nearest_name(name: str, known: Iterable[str], similarity: float = _ALIKE) -> str:
    """The known name that is most like another, "" if none is alike.

    Parameters
    ----------
    similarity : the least one as of :class:`difflib.SequenceMatcher`, 0 to 1.
    """
    found = get_close_matches(name, sorted(set(known) - {name}), n=1, cutoff=similarity)
    return found[0] if found else ""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """What to add to a sentence about a name that is not known; "" if no other is alike."""
    near = nearest_name(name, known)
    return f"; did you mean {near!r}?" if near else ""
