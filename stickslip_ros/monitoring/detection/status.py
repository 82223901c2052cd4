# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The status words used everywhere: diagnostics, JSON, reports."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Status(Enum):
    """What is observed of a joint's motion."""

    SMOOTH = "smooth"
    AT_RISK = "at_risk"
    STICK_SLIP = "stick_slip"
    AT_REST = "at_rest"
    NOT_JUDGED = "not_judged"
    UNKNOWN = "unknown"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A status with its reason (empty where the status says it all)."""

    status: Status
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class Segment:
    """A stretch of time of one status.

    Attributes
    ----------
    start, end : [s]; velocity : mean velocity [rad/s].
    """

    start: float
    end: float
    status: Status
    velocity: float
