# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""State files of version 1, which had an abrupt change of friction as a sentence."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from stickslip_ros.monitoring.friction.change import FrictionChange, ParameterDifference
from stickslip_ros.nodes.state.plain_data import to_plain

# As it was written then, whatever the sentence is by now.
_SENTENCE = re.compile(r"friction changed abruptly at (?P<time>\S+) s(?P<anew>; learning anew)?(?:: (?P<what>.*))?")
_DIFFERENCE = re.compile(r"(?P<name>[a-z ]+) (?P<old>\S+) to (?P<new>\S+)")


def as_of_now(joint: Any) -> Any:
    """A joint's plain data of version 1 as this version has them; what is not as expected stays, to be refused."""
    friction = joint.get("friction") if isinstance(joint, Mapping) else None
    if not isinstance(friction, Mapping) or not isinstance(friction.get("notice"), str):
        return joint
    kept = {name: value for name, value in friction.items() if name != "notice"}
    return {**joint, "friction": {**kept, "change": to_plain(_change(friction["notice"]))}}


def _change(sentence: str) -> FrictionChange | None:
    """The change that a sentence told of; None for none, and for words that say nothing here."""
    match = _SENTENCE.fullmatch(sentence)
    if match is None:
        return None
    parts = [_DIFFERENCE.fullmatch(part) for part in (match["what"] or "").split(", ")]
    try:
        return FrictionChange(
            time=float(match["time"]),
            learning_anew=match["anew"] is not None,
            differences=tuple(
                ParameterDifference(name=part["name"].replace(" ", "_"), old=float(part["old"]), new=float(part["new"]))
                for part in parts
                if part is not None
            ),
        )
    except ValueError:
        return None
