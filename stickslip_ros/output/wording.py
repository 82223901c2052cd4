# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the monitor finds, in the sentences that people read: in diagnostics, warnings and reports alike."""

from __future__ import annotations

import math
from collections.abc import Iterable

from stickslip_ros.model.friction import Friction
from stickslip_ros.model.outcome import Outcome
from stickslip_ros.model.units import unit_of
from stickslip_ros.model.verdict import HUNTING, ExactVerdict
from stickslip_ros.monitoring.detection import status as reasons
from stickslip_ros.monitoring.detection.reversals import ReversalRecord
from stickslip_ros.monitoring.detection.status import Finding
from stickslip_ros.monitoring.friction.change import FrictionChange
from stickslip_ros.monitoring.friction.dry_friction import DryFriction
from stickslip_ros.monitoring.friction.presliding import PreslidingEstimate

_MINUTE = 60.0  # [s]
_PREFIXES = ((1.0, ""), (1e3, "m"), (1e6, "µ"))  # factor, and what stands before the unit then
_STIFFNESS = unit_of(Friction, "presliding_stiffness")


OUTCOME_TEXTS = {Outcome.STEADY: "moves steadily", Outcome.SWINGS: "swings", Outcome.STICKS: "sticks"}
_COLOURS = {Outcome.STEADY: "green", Outcome.SWINGS: "yellow", Outcome.STICKS: "red"}  # rich's
# For a terminal, by what JSON calls it.
OUTCOME_WORDS = {outcome.value: f"[{_COLOURS[outcome]}]{text}[/]" for outcome, text in OUTCOME_TEXTS.items()}


def status_words(status: str) -> str:
    """A status as a page writes it."""
    return status.replace("stick_slip", "stick-slip").replace("_", " ")


def counted(count: int, noun: str) -> str:
    """A number of things, in the singular where it is one."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def times_text(count: int) -> str:
    """How often something happened."""
    return "once" if count == 1 else f"{count} times"


def friction_change_text(change: FrictionChange | None) -> str:
    """What changed and when; "" if nothing did."""
    if change is None:
        return ""
    text = f"friction changed abruptly at {change.time:.1f} s"
    if change.learning_anew:
        return f"{text}; learning anew"
    what = ", ".join(f"{one.name.replace('_', ' ')} {one.old:.3g} to {one.new:.3g}" for one in change.differences)
    return f"{text}: {what or 'in ways that the slips since do not name'}"


def kept_gains_text(slowest: float, velocity: float, exact: ExactVerdict) -> str:
    """What is to be said of a joint that sticks with gains that advice keeps.

    Parameters
    ----------
    slowest : velocity from which on the gains have the wanted reserve [rad/s]. velocity : at which the joint sticks
        [rad/s]. exact : verdict on the gains at that velocity.
    """
    if exact.smooth is False:
        # The joint does what the estimate predicts.
        return (
            f"its gains have the wanted reserve from {slowest:.3g} rad/s on; "
            f"at {velocity:.3g} rad/s the model predicts stick-slip"
        )
    return "its gains have the wanted reserve by the friction estimate, which is therefore wrong"


def dry_friction_text(dry: DryFriction | None) -> str:
    """What the dry friction depends on, in one sentence; "" if nothing is known to matter."""
    if dry is None:
        return ""
    parts = []
    coulomb = abs(dry.coulomb.value)
    if dry.ripple is not None:
        ripple = dry.ripple
        parts.append(f"varies by ±{ripple.amplitude:.2g} N·m with position, {1.0 / ripple.period:.3g} times a radian")
        if ripple.aliases:
            others = " or ".join(f"{1.0 / period:.3g}" for period in ripple.aliases)
            parts[-1] += f" (or {others} times: the slips are spaced too evenly to distinguish them)"
    if dry.drift is not None:
        a_minute = _MINUTE * abs(dry.drift.value)
        size = f"{100.0 * a_minute / coulomb:.2g} %" if coulomb > 0 else f"{a_minute:.2g} N·m"
        parts.append(f"{'rises' if dry.drift.value > 0 else 'falls'} by {size} a minute")
        if not dry.distinguished:
            parts[-1] += " (or over position, which went with time)"
    if dry.load_dependence is not None:
        slope = dry.load_dependence.value
        parts.append(f"{'grows' if slope > 0 else 'falls'} by {100.0 * abs(slope):.2g} % of the load")
    name = "Coulomb friction" if dry.load is not None else "Coulomb friction with any load"
    return f"{name} {'; it '.join(parts)}." if parts else ""


def reversals_text(record: ReversalRecord) -> str:
    """What reversals do to a joint."""
    stands = f"stands for {record.standing:.2g} s" if record.standing > 0.0 else "does not stand still"
    differs = "is ahead of its reference" if record.peak_error < 0.0 else "falls behind"
    return f"at a reversal it {stands} and {differs} by {angle_text(abs(record.peak_error))}"


def constant_effort_text(effort: float) -> str:
    """What is to be said of an effort that never changes while its joint moves."""
    return f"its effort is always {effort:.3g}, so it is no measurement and counts as unknown"


def references_off_text(offset: float) -> str:
    """What is to be said of references that are not used, because their stamps are never near those of the samples.

    Parameters
    ----------
    offset : stamp of a reference less that of a joint state that comes with it [s].
    """
    return (
        f"the stamps of its references are {abs(offset):.1f} s {'ahead of' if offset > 0 else 'behind'} those of its "
        "joint states (do the clocks agree?), so they are not used"
    )


def in_metres_text(names: Iterable[str]) -> str:
    """What is to be said of joints whose positions are in metres."""
    return f"positions of {', '.join(names)} are in m; wherever rad is said, read m, and N for N·m"


def angle_text(value: float) -> str:
    """A value [rad] with three digits and the prefix that keeps it between 1 and 1000, of none, milli and micro."""
    size = abs(value)
    factor, prefix = next(((f, p) for f, p in _PREFIXES if size * f >= 1.0), _PREFIXES[-1])
    if not size or not math.isfinite(value):
        factor, prefix = _PREFIXES[0]
    return f"{factor * value:.3g} {prefix}rad"


def presliding_text(presliding: PreslidingEstimate, stiffness: float) -> str:
    """How a joint at rest gives way, in one sentence; "" where that was not seen.

    Parameters
    ----------
    stiffness : of the controller [N·m/rad], NaN if it is not known.
    """
    if not presliding.shown:
        return ""
    found = presliding.stiffness
    text = f"gives way at rest: presliding stiffness {found.value:.4g} ± {found.std:.2g} {_STIFFNESS}"
    if stiffness > 0:
        text += f", {found.value / stiffness:.3g} times the controller's stiffness"
    if not presliding.contact:
        return f"{text} (not identified: record reversals to find out how the contact yields)"
    return f"{text} ({presliding.contact}{'' if found.identified else ', not identified'})"


def reason_text(finding: Finding) -> str:
    """Why a joint is found to be so; "" where its status says it all."""
    match finding.reason:
        case None:
            return ""
        case reasons.NoSamples(left_out=left_out):
            return "; ".join(left_out) or "no samples yet"
        case reasons.TooFewSamples():
            return "too few samples"
        case reasons.Hunting():
            return HUNTING
        case reasons.Stuck(duration=duration, travel=travel):
            return f"stuck for {duration:.1f} s while the reference moved by {travel:.3g} rad"
        case reasons.Reversing(record=record):
            return "reversing" if record is None else f"reversing: {reversals_text(record)}"
        case reasons.TooShort(moving=moving, needed=needed):
            return f"only {moving:.3g} s of motion without a stop, {needed:.3g} s are needed"
        case reasons.StopsAndGoes():
            return (
                "stops and goes while no reference moves; publish the joint's own to tell commanded stops from sticking"
            )
        case reasons.NotFollowing(share=share):
            way = f"moves {abs(share):.2g} times as far as its reference{', the other way' if share < 0.0 else ''}"
            return f"{way}: check that the reference is this joint's own, in its unit"
        case reasons.TooCoarse(counts=counts):
            return f"the encoder is too coarse: {f'{counts:.0f}' if math.isfinite(counts) else 'too few'} counts a slip"
        case reasons.TooFewCounts():
            return "the joint has moved by too few counts of its encoder"
        case reasons.StampsInBursts():
            return "samples come in bursts: by their stamps the joint stops and goes, by their number it does not"
        case reasons.SampledTooSlowly(rate=rate, needed=needed):
            return f"sampled too slowly: {rate:.3g} Hz; at least {needed:.3g} Hz are needed"
        case reasons.SpeedFalls(share=share, at_most=at_most):
            return f"the speed fell {'below' if at_most else 'to'} {100 * share:.0f} % of its mean a short time ago"
        case reasons.ThinReserve(reserve=reserve, exactly=exactly):
            return f"damping reserve {100 * reserve:.0f} %{'' if exactly else ' by Eq. (43)'}"
