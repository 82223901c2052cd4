# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Two recordings of the same joints, before and after a change: did it help?

**A change is significant** where the two values are further apart than 1.96 times their combined standard errors: by
chance alone one in twenty is. What is not known with an error in both recordings, and what the motion does not
identify, is not compared, and the reason is given.
**That stick-slip is gone, or new**, is significant if it had a chance below 5 % were it as frequent in both recordings:
of m events that all lie in one of them the chance is (T₁/(T₁ + T₂))^m, T₁ and T₂ being the times watched. Of a joint
that stuck steadily the cycles are the events; else the stretches of stick-slip, for the cycles of one come together.
**The error of the share of stick-slip** of joints that stuck in both is that of the mean of ten parts of the moving
time, wider where neighbours are alike, and at least that of a cycle in the time watched.
**The error of the slip** is that of the median of its slips, wider where successive ones are alike, with half a count
of the encoder.
**At one speed**: stick-slip depends on the speed. That it is gone counts only if the joint moved at the speed at which
it stuck, or slower.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np

from stickslip_ros.analysis.analysis import BagAnalysis
from stickslip_ros.analysis.joint_analysis import JointAnalysis
from stickslip_ros.analysis.judgement import JUDGED, moves
from stickslip_ros.analysis.trend import BEYOND_CHANCE, Measured
from stickslip_ros.analysis.words import percent
from stickslip_ros.model.friction import JOINT_PARAMETERS, Gains
from stickslip_ros.model.units import unit_of
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.monitoring.friction.estimate import COULOMB_AND_LOAD, FrictionEstimate
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.output.published import number, numbers
from stickslip_ros.output.wording import OUTCOME_TEXTS

_SAME_SPEED = 1.25  # a ratio of speeds up to which they are the same
_PARTS = 10  # of the moving time
_LEAST_SLIPS = 5  # that have an error
_CHANCE = 0.05
_OF_THE_MARGIN = ("viscous", "stribeck", "stribeck_velocity", "lag", "rise_time")
_SHARE = "stick_slip_share"


class Verdict(Enum):
    """Whether the change helped a joint: as JSON has it; ``words``; ``like``: the status which it resembles, or ""."""

    HELPED = "helped", "it helped", Status.SMOOTH
    HELPED_IN_PART = "helped_in_part", "it helped in part", Status.SMOOTH
    SMALLER_SLIPS = "smaller_slips", "it helped in part: it sticks as often, with smaller slips", Status.SMOOTH
    NO_CHANGE = "no_change", "no significant change"
    NEVER_STUCK = "never_stuck", "it stuck neither before nor after"
    LARGER_SLIPS = "larger_slips", "it got worse: it sticks as often, with larger slips", Status.STICK_SLIP
    WORSE = "worse", "it got worse", Status.STICK_SLIP
    CANNOT_SAY = "cannot_say", "not enough data to judge whether it helped", Status.AT_RISK

    words: str
    like: str

    def __new__(cls, value: str, words: str, status: Status | None = None) -> Verdict:
        """A member; its value is the first word alone."""
        one = object.__new__(cls)
        one._value_, one.words, one.like = value, words, "" if status is None else status.value
        return one


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One number of a joint, before and after.

    Attributes
    ----------
    name : as in JSON. label, unit : for people. missing : why it is not compared, "" if it is.
    certain : whether it changed, where that is told by counts and not by errors; else None.
    """

    name: str
    label: str
    unit: str
    before: Measured
    after: Measured
    missing: str = ""
    certain: bool | None = None

    @property
    def change(self) -> float:
        """After less before."""
        return self.after.value - self.before.value

    @property
    def significant(self) -> bool | None:
        """Whether it changed beyond the combined errors; None where it is not compared."""
        if self.missing:
            return None
        if self.certain is not None:
            return self.certain
        if self.before.exact and self.after.exact:
            return self.change != 0.0
        return abs(self.change) > BEYOND_CHANCE * math.hypot(self.before.error, self.after.error)


@dataclass(frozen=True, kw_only=True)
class JointComparison:
    """One joint before and after; ``reason``: why it cannot be said whether the change helped, "" if it can."""

    name: str
    before: JointAnalysis
    after: JointAnalysis
    share: Quantity
    slip: Quantity
    reserve: Quantity
    gains: tuple[Quantity, ...]
    friction: tuple[Quantity, ...]
    verdict: Verdict
    reason: str = ""

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """All that was looked at, in the order of tables."""
        return (self.share, self.slip, self.reserve, *self.gains, *self.friction)


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Two recordings; ``alone``: joints that are in one of them only, and in which."""

    before: BagAnalysis
    after: BagAnalysis
    joints: tuple[JointComparison, ...]
    alone: dict[str, str]


def compare(before: BagAnalysis, after: BagAnalysis) -> Comparison:
    """Compare what two recordings show of the joints that are in both."""
    alone = {name: "before" for name in before.joints if name not in after.joints}
    alone |= {name: "after" for name in after.joints if name not in before.joints}
    joints = tuple(
        compare_joints(joint, after.joints[name]) for name, joint in before.joints.items() if name not in alone
    )
    return Comparison(before=before, after=after, joints=joints, alone=alone)


def compare_joints(before: JointAnalysis, after: JointAnalysis) -> JointComparison:
    """Compare one joint with itself."""
    share = _share_of(before, after)
    slip = _quantity("usual_slip", "usual slip", "rad", _slip(before), _slip(after), f"fewer than {_LEAST_SLIPS} slips")
    reserve = _quantity(
        "reserve", "damping reserve", "1", _reserve(before), _reserve(after),
        "the motion does not identify the friction from which it is computed",
    )  # fmt: skip
    verdict, reason = _verdict(before, after, share, slip)
    if verdict is Verdict.CANNOT_SAY:
        why = "not at one speed" if all(one.worst in JUDGED for one in (before, after)) else "not judged in both"
        share, slip = (replace(one, missing=one.missing or why) for one in (share, slip))
    return JointComparison(
        name=before.name,
        before=before,
        after=after,
        share=share,
        slip=slip,
        reserve=reserve,
        gains=_gains(before, after),
        friction=_friction(before, after),
        verdict=verdict,
        reason=reason,
    )


def _quantity(name: str, label: str, unit: str, before: Measured, after: Measured, lacking: str) -> Quantity:
    """A quantity, and why it is not compared if that is so: ``lacking`` is the case."""
    sides = [side for side, one in (("before", before), ("after", after)) if not (one.exact or one.error >= 0.0)]
    missing = f"{' and '.join(sides)}: {lacking}" if sides else ""
    if not sides and before.exact is not after.exact:
        missing = "configured in one recording, learnt in the other"
    return Quantity(name=name, label=label, unit=unit, before=before, after=after, missing=missing)


def _share_of(before: JointAnalysis, after: JointAnalysis) -> Quantity:
    """The share of stick-slip; where one of the two never stuck, whether that is certain is told by counts."""
    share = _quantity(
        "stick_slip_share", "stick-slip", "of moving time", _share(before), _share(after),
        "it did not move for long enough",
    )  # fmt: skip
    if share.missing or (before.worst is Status.STICK_SLIP) is (after.worst is Status.STICK_SLIP):
        return share
    sticks, moves = (before, after) if before.worst is Status.STICK_SLIP else (after, before)
    stretches = sum(one.status is Status.STICK_SLIP for one in sticks.segments)
    events = len(sticks.cycles) if sticks.status is Status.STICK_SLIP else stretches
    chance = (sticks.moving_time / (sticks.moving_time + _slow_time(moves, sticks.velocity))) ** events
    plain = [Measured(value=one.value) for one in (share.before, share.after)]
    return replace(share, before=plain[0], after=plain[1], certain=chance < _CHANCE)


def _slow_time(joint: JointAnalysis, speed: float) -> float:
    """How long a joint moved at a speed [rad/s], or slower [s]."""
    slow = (one for one in joint.segments if moves(one) and abs(one.velocity) <= _SAME_SPEED * speed)
    return sum(one.end - one.start for one in slow)


def _share(joint: JointAnalysis) -> Measured:
    """Share of stick-slip in the moving time, with the error described in the module."""
    moving = [one for one in joint.segments if moves(one)]
    lengths = np.array([one.end - one.start for one in moving])
    total = float(lengths.sum()) if len(moving) else 0.0
    if not total > 0.0:
        return Measured()
    # Of how much stick-slip there was up to each moment of the moving time.
    sticking = np.array([one.status is Status.STICK_SLIP for one in moving], dtype=float)
    ends = np.append(0.0, np.cumsum(lengths))
    until = np.interp(np.linspace(0.0, total, _PARTS + 1), ends, np.append(0.0, np.cumsum(lengths * sticking)))
    error = _error_of_mean(np.diff(until) * _PARTS / total)
    watched = float(np.median([cycle.period for cycle in joint.cycles])) / total if joint.cycles else 0.0
    return Measured(value=joint.stick_slip_share, error=math.hypot(error, watched))


def _slip(joint: JointAnalysis) -> Measured:
    slips = np.array([abs(cycle.slip_distance) for cycle in joint.cycles])
    if len(slips) < _LEAST_SLIPS:
        return Measured(value=joint.usual_slip)
    resolution = joint.assessment.resolution
    counts = 0.5 * resolution if math.isfinite(resolution) else 0.0
    # Of a normal distribution the median has an error √(π/2) times that of the mean.
    error = math.sqrt(0.5 * math.pi) * _error_of_mean(slips)
    return Measured(value=joint.usual_slip, error=math.hypot(error, counts))


def _error_of_mean(values: FloatArray) -> float:
    """Standard error of the mean of consecutive values: of fewer independent ones, where neighbours are correlated."""
    apart = values - values.mean()
    variance = float(apart @ apart)
    if variance == 0.0:
        return 0.0
    autocorrelation = min(max(float(apart[1:] @ apart[:-1]) / variance, 0.0), 0.95)
    independent = max(len(values) * (1.0 - autocorrelation) / (1.0 + autocorrelation), 1.0)
    return math.sqrt(variance / (len(values) - 1) / independent)


def _reserve(joint: JointAnalysis) -> Measured:
    """Relative damping reserve, with the error that those of the friction make; none where friction is configured."""
    state = joint.assessment
    drawn = state.uncertainty
    if drawn is None or state.margin_gains is None or state.estimate is None or math.isnan(joint.reserve):
        return Measured(value=joint.reserve, exact=not math.isnan(joint.reserve))
    # What is not identified rests on the prior, and so would the comparison.
    if not all(state.estimate[name].identified for name in _OF_THE_MARGIN):
        return Measured(value=joint.reserve)
    reserves = drawn.damping_reserves(state.margin_gains, joint.velocity)
    known = reserves[np.isfinite(reserves)]
    if 2 * len(known) < len(reserves):
        return Measured(value=joint.reserve)
    # A few draws may be wild: half of what two thirds of them span is a standard error.
    low, high = np.percentile(known, [15.87, 84.13])
    return Measured(value=joint.reserve, error=0.5 * float(high - low))


def _gains(before: JointAnalysis, after: JointAnalysis) -> tuple[Quantity, ...]:
    gains = [one.assessment.gains if one.assessment.gains_known else None for one in (before, after)]
    found = []
    for name in ("stiffness", "damping", "integral"):
        values = [Measured() if one is None else Measured(value=float(getattr(one, name)), exact=True) for one in gains]
        known = [one.value for one in values if one.exact]
        if known and (name != "integral" or any(known)):
            found.append(
                _quantity(name, f"gain: {name}", unit_of(Gains, name), values[0], values[1], "gains not known")
            )
    return tuple(found)


def _friction(before: JointAnalysis, after: JointAnalysis) -> tuple[Quantity, ...]:
    estimates = [joint.assessment.estimate for joint in (before, after)]
    normalised = [one.normalised for one in estimates if one is not None]
    units_differ = len(set(normalised)) > 1
    per_inertia = bool(normalised) and normalised[0]
    found = []
    for parameter in JOINT_PARAMETERS:
        if parameter.name == "inertia" and per_inertia:
            continue
        name, label = parameter.name, parameter.label
        if name == "coulomb" and any(
            one is not None and math.isfinite(one.coulomb_and_load.value) for one in estimates
        ):
            name, label = COULOMB_AND_LOAD, "Coulomb friction with any load"
        values = [_learnt(one, name) for one in estimates]
        if any(math.isfinite(one.value) for one in values):
            unit = parameter.unit_where(per_inertia=per_inertia)
            quantity = _quantity(name, label, unit, values[0], values[1], "the motion does not identify it")
            if units_differ:
                quantity = replace(quantity, missing="gains are known in one recording only: its units are others")
            found.append(quantity)
    return tuple(found)


def _learnt(estimate: FrictionEstimate | None, name: str) -> Measured:
    if estimate is None or not estimate.usable:
        return Measured()
    found = estimate[name]
    return Measured(value=found.value, error=found.std if found.identified else math.nan)


def _verdict(before: JointAnalysis, after: JointAnalysis, share: Quantity, slip: Quantity) -> tuple[Verdict, str]:
    """Whether it helped; else why that cannot be said."""
    for side, joint in (("before", before), ("after", after)):
        if joint.worst not in JUDGED:
            what = joint.reason or ("the joint did not move" if joint.worst is Status.AT_REST else "it was not judged")
            return Verdict.CANNOT_SAY, f"{side}: {what}"
    stuck = before.worst is Status.STICK_SLIP, after.worst is Status.STICK_SLIP
    if not any(stuck):
        return Verdict.NEVER_STUCK, ""
    if all(stuck):
        return _of_two_that_stick(before, after, share, slip)
    sticks, moves, side = (before, after, "after") if stuck[0] else (after, before, "before")
    slow = _slow_time(moves, sticks.velocity)
    if not share.significant and slow < moves.moving_time:
        return Verdict.CANNOT_SAY, (
            f"it stuck at {sticks.velocity:.3g} rad/s, and {side} it moved so slowly for {slow:.2g} s only: "
            "record both at one speed"
        )
    if not share.significant:
        return Verdict.NO_CHANGE, ""
    return (Verdict.HELPED if stuck[0] else Verdict.WORSE), ""


def _of_two_that_stick(
    before: JointAnalysis, after: JointAnalysis, share: Quantity, slip: Quantity
) -> tuple[Verdict, str]:
    speeds = sorted((before.velocity, after.velocity))
    if not speeds[1] <= _SAME_SPEED * speeds[0]:
        return Verdict.CANNOT_SAY, (
            f"it stuck at {before.velocity:.3g} rad/s before and at {after.velocity:.3g} rad/s after; "
            "record both at one speed"
        )
    if share.significant:
        return (Verdict.HELPED_IN_PART if share.change < 0.0 else Verdict.WORSE), ""
    if slip.significant:
        return (Verdict.SMALLER_SLIPS if slip.change < 0.0 else Verdict.LARGER_SLIPS), ""
    return Verdict.NO_CHANGE, ""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One row of the table of a joint, as texts. is_status : whether before and after are words of statuses."""

    label: str
    before: str
    after: str
    change: str = ""
    significant: bool = False
    is_status: bool = False


def rows(joint: JointComparison) -> list[Row]:
    """The table of a joint, for the terminal and the page."""
    before, after = joint.before, joint.after
    statuses = [("status", before.status, after.status)]
    if any(one.worst is not one.status for one in (before, after)):
        statuses.append(("at worst", before.worst, after.worst))
    found = [
        Row(
            label=label, before=old.value, after=new.value,
            change="the same" if old is new else "changed", significant=old is not new, is_status=True,
        )
        for label, old, new in statuses
    ]  # fmt: skip
    found.append(Row(label="speed [rad/s]", before=f"{before.velocity:.3g}", after=f"{after.velocity:.3g}"))
    found.append(Row(label="cycles", before=str(len(before.cycles)), after=str(len(after.cycles))))
    for one in joint.quantities:
        unit = "" if one.name in (_SHARE, "reserve") else one.unit  # the values of these have it
        found.append(
            Row(
                label=f"{one.label} [{unit}]" if unit else one.label,
                before=value_text(one, one.before), after=value_text(one, one.after),
                change=_change_text(one), significant=bool(one.significant),
            )
        )  # fmt: skip
    outcomes = [one.exact.outcome for one in (before, after)]
    if any(one is not None for one in outcomes):
        old, new = ("–" if one is None else OUTCOME_TEXTS[one] for one in outcomes)
        found.append(Row(label="model predicts", before=old, after=new))
    return found


def verdict_text(joint: JointComparison) -> str:
    """Whether it helped, in a few words."""
    return f"{joint.name}: {joint.verdict.words}"


def sentence(joint: JointComparison) -> str:
    """Whether it helped, and what was changed, in one sentence."""
    verdict = verdict_text(joint)
    if joint.verdict is Verdict.CANNOT_SAY:
        return f"{verdict}; {joint.reason}."
    if joint.verdict is Verdict.NEVER_STUCK:
        return f"{verdict}; {_changed(joint)}."
    share = f"stick-slip for {percent(joint.share.before.value)} of its moving time before, {_after(joint)}"
    slips = ""
    if joint.slip.significant:
        slips = f", slips of {joint.slip.before.value:.3g} rad before, {joint.slip.after.value:.3g} rad after"
    return f"{verdict}: {share}{slips}; {_changed(joint)}."


def _after(joint: JointComparison) -> str:
    value = joint.share.after.value
    return f"none in {joint.after.moving_time:.3g} s after" if value == 0.0 else f"{percent(value)} after"


def _changed(joint: JointComparison) -> str:
    """What is another after than before: gains, friction."""
    gains = [one for one in joint.gains if one.significant]
    if gains:
        changes = ", ".join(f"{one.name} {_number(one.before)} to {_number(one.after)} {one.unit}" for one in gains)
    else:
        changes = "the gains are the same" if joint.gains and not joint.gains[0].missing else "the gains are not known"
    compared = [one for one in joint.friction if not one.missing]
    significant = [one for one in compared if one.significant]
    if significant:
        listed = [f"{one.label} {_number(one.before)} to {_number(one.after)} {one.unit}" for one in significant]
        return f"{changes}; friction changed: {', '.join(listed)}"
    if compared:
        return f"{changes}; friction is the same within its errors"
    if not joint.before.settings.options.learn:
        return changes
    silent = [side for side, one in (("before", joint.before), ("after", joint.after)) if not one.cycles]
    why = f"no slips {' and '.join(silent)} the change" if silent else "it was not estimated"
    why = joint.friction[0].missing if joint.friction and not silent else why
    return f"{changes}; friction cannot be compared ({why})"


def _number(one: Measured) -> str:
    return f"{one.value:.4g}"


def value_text(quantity: Quantity, one: Measured) -> str:
    """A value with its error, as a cell of a table."""
    if math.isnan(one.value):
        return "–"
    if quantity.name == _SHARE:
        known = math.isfinite(one.error)
        return f"{100.0 * one.value:.3g} ± {100.0 * one.error:.2g} %" if known else percent(one.value)
    if quantity.name == "reserve" and math.isinf(one.value):
        return "no damping needed"
    if quantity.name == "reserve":
        error = f" ± {100.0 * one.error:.2g}" if math.isfinite(one.error) else ""
        return f"{100.0 * one.value:+.3g}{error} %"
    return f"{one.value:.4g}" + (f" ± {one.error:.2g}" if math.isfinite(one.error) else "")


def _change_text(quantity: Quantity) -> str:
    """Whether a quantity changed, as a cell of a table."""
    if quantity.missing:
        return "not compared"
    if quantity.before.exact or quantity.after.exact:
        return "changed" if quantity.significant else "the same"
    if not quantity.significant:
        return "within the errors" if quantity.certain is None else "may be chance"
    return "significantly less" if quantity.change < 0.0 else "significantly more"


def not_compared(joint: JointComparison) -> list[str]:
    """What is not compared, and why: a text for each reason."""
    reasons: dict[str, list[str]] = {}
    for one in joint.quantities:
        if one.missing:
            reasons.setdefault(one.missing, []).append(one.label)
    return [f"{', '.join(labels)} ({reason})" for reason, labels in reasons.items()]


def comparison_json(comparison: Comparison) -> dict[str, Any]:
    """The JSON object that `stickslip compare` prints; null for what is unknown or not compared."""
    return {
        "before": comparison.before.path,
        "after": comparison.after.path,
        "joints": {joint.name: _joint_json(joint) for joint in comparison.joints},
        "only_in": comparison.alone,
        "warnings": {"before": list(comparison.before.warnings), "after": list(comparison.after.warnings)},
    }


def _joint_json(joint: JointComparison) -> dict[str, Any]:
    return {
        "verdict": joint.verdict.value,
        "summary": sentence(joint),
        "before": _side_json(joint.before),
        "after": _side_json(joint.after),
        "quantities": {
            one.name: {
                "unit": one.unit,
                "before": _measured_json(one.before),
                "after": _measured_json(one.after),
                "significant": one.significant,
                "not_compared": one.missing or None,
            }
            for one in joint.quantities
        },
    }


def _side_json(joint: JointAnalysis) -> dict[str, Any]:
    outcome = joint.exact.outcome
    return {
        "status": joint.status.value,
        "worst_status": joint.worst.value,
        "cycles": len(joint.cycles),
        **numbers(joint, "velocity", "moving_time"),
        "outcome": None if outcome is None else outcome.value,
    }


def _measured_json(one: Measured) -> dict[str, float | None]:
    return {"value": number(one.value), "std": 0.0 if one.exact else number(one.error)}
