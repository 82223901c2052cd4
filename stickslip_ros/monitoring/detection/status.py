# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The status words used everywhere: diagnostics, JSON, reports."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from stickslip_ros.monitoring.detection.reversals import ReversalRecord


class Status(Enum):
    """What is observed of a joint's motion."""

    SMOOTH = "smooth"
    AT_RISK = "at_risk"
    STICK_SLIP = "stick_slip"
    AT_REST = "at_rest"
    NOT_JUDGED = "not_judged"
    UNKNOWN = "unknown"


@dataclass(frozen=True, kw_only=True)
class NoSamples:
    """None came, or none could be used.

    Attributes
    ----------
    left_out : why, if some came.
    """

    left_out: tuple[str, ...] = ()


@dataclass(frozen=True)
class TooFewSamples:
    """Too few for any judgement."""


@dataclass(frozen=True)
class Hunting:
    """The joint slips to and fro about a reference that stands."""


@dataclass(frozen=True, kw_only=True)
class Stuck:
    """The joint is at rest while its reference moves.

    Attributes
    ----------
    duration : at rest [s]; travel : of the reference meanwhile [rad].
    """

    duration: float
    travel: float


@dataclass(frozen=True, kw_only=True)
class Reversing:
    """The joint turns before its motion can be judged.

    Attributes
    ----------
    record : what its reversals show; None if nothing yet.
    """

    record: ReversalRecord | None = None


@dataclass(frozen=True, kw_only=True)
class TooShort:
    """The joint has not moved for long.

    Attributes
    ----------
    moving, needed : time without a rest, and how much of it a judgement needs [s].
    """

    moving: float
    needed: float


@dataclass(frozen=True)
class StopsAndGoes:
    """The joint stops and goes, and without a reference nothing tells commanded stops from sticking."""


@dataclass(frozen=True, kw_only=True)
class NotFollowing:
    """The joint moves, but not with its reference, although that goes on evenly.

    Attributes
    ----------
    share : way of the joint, of its reference's; negative if they go opposite ways [1].
    """

    share: float


@dataclass(frozen=True, kw_only=True)
class TooCoarse:
    """The joint steps by so few counts of its encoder that slips cannot be told from smooth motion.

    Attributes
    ----------
    counts : from one stand to the next [1]; NaN if it is so slow that a cycle has too few.
    """

    counts: float


@dataclass(frozen=True)
class TooFewCounts:
    """The joint has moved by too few counts of its encoder for any judgement."""


@dataclass(frozen=True)
class StampsInBursts:
    """By the stamps of its samples the joint stops and goes, or its speed falls; by their number it does not."""


@dataclass(frozen=True, kw_only=True)
class SampledTooSlowly:
    """Between two samples the joint could stick and slip unseen.

    Attributes
    ----------
    rate : of the samples; needed : at least [Hz].
    """

    rate: float
    needed: float


@dataclass(frozen=True, kw_only=True)
class SpeedFalls:
    """The speed falls far, though not to a rest.

    Attributes
    ----------
    share : that is left of the mean speed, 0 to 1. at_most : whether less may be left.
    """

    share: float
    at_most: bool = False


@dataclass(frozen=True, kw_only=True)
class ThinReserve:
    """The joint moves smoothly with little damping to spare.

    Attributes
    ----------
    reserve : relative damping reserve ρ/ρ_c - 1. exactly : whether by the exact condition, not by Eq. (43).
    """

    reserve: float
    exactly: bool


Reason = (
    NoSamples
    | TooFewSamples
    | Hunting
    | Stuck
    | Reversing
    | TooShort
    | StopsAndGoes
    | NotFollowing
    | TooCoarse
    | TooFewCounts
    | StampsInBursts
    | SampledTooSlowly
    | SpeedFalls
    | ThinReserve
)


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A status with its reason, None where the status says it all; its words are in `output/wording.py`."""

    status: Status
    reason: Reason | None = None


@dataclass(frozen=True, kw_only=True)
class Segment:
    """A stretch of time of one status.

    Attributes
    ----------
    start, end : [s]; velocity : mean velocity [rad/s].
    stuck : time of it in which the joint stood while its reference went on [s]; travel : of the reference then [rad].
    led : way of the reference, 0 where there is none [rad].
    caveat : why it is not judged, where that bears on the rest of the recording; None if it does not.
    """

    start: float
    end: float
    status: Status
    velocity: float
    stuck: float = 0.0
    travel: float = 0.0
    led: float = 0.0
    caveat: StopsAndGoes | NotFollowing | None = None
