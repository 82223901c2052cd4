# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The log of what becomes of joints: a line when one begins to stick and slip, and one when that is over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.visible import visible

_APART, _FURTHEST_APART = 10.0, 600.0  # [s] from one line of a joint to the next: at first, and while it goes on so
_CALM = tuple(one.value for one in Status if one not in (Status.STICK_SLIP, Status.AT_RISK))


@dataclass
class _Entry:
    """What the log has of a joint.

    Attributes
    ----------
    latest, before : the word at the last look, and the one before the latest change; "" for none.
    at : of the last line, a steady time [s]. changes : since then. apart : least time to the next line [s].
    """

    at: float
    latest: str = ""
    before: str = ""
    changes: int = 0
    apart: float = 0.0


class StatusLog:
    """Writes a line at each change of a joint's status to or from one that is worth a warning.

    A joint whose status changes again before the next line may come has one line then, with the number of changes; the
    time to the next line doubles as long as that goes on.

    Parameters
    ----------
    warn, inform : write to the log.
    """

    def __init__(self, warn: Callable[[str], object], inform: Callable[[str], object]) -> None:
        self._warn, self._inform = warn, inform
        self._joints: dict[str, _Entry] = {}

    def note(self, joint: str, word: str, text: str, now: float) -> None:
        """Take the status of a joint.

        Parameters
        ----------
        word : of the status, or why there is none. text : the summary for a person. now : a steady time [s].
        """
        entry = self._joints.setdefault(joint, _Entry(now))
        if word != entry.latest and not (_is_calm(word) and _is_calm(entry.latest)):
            entry.before = entry.latest
            entry.changes += 1
        entry.latest = word
        if not entry.changes or now - entry.at < entry.apart:
            return
        if entry.changes == 1:
            entry.apart = _APART
            more = f" (was {entry.before})" if entry.before else ""
        else:
            entry.apart = min(2.0 * entry.apart, _FURTHEST_APART)
            more = f" ({entry.changes} changes in {now - entry.at:.0f} s)"
        entry.at, entry.changes = now, 0
        write = self._inform if _is_calm(word) else self._warn
        write(visible(f"{joint}: {text}{more}"))


def _is_calm(word: str) -> bool:
    return word in ("", *_CALM)
