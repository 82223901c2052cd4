# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A comparison in words, and as JSON."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from stickslip_ros.analysis.comparison import Comparison, JointComparison, Quantity, Verdict
from stickslip_ros.analysis.joint_analysis import JointAnalysis
from stickslip_ros.analysis.trend import Measured
from stickslip_ros.analysis.words import percent
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.output.published import number, numbers
from stickslip_ros.output.wording import OUTCOME_TEXTS

_SHARE = "stick_slip_share"
_HEADS = {
    Verdict.HELPED: "it helped",
    Verdict.HELPED_IN_PART: "it helped in part",
    Verdict.SMALLER_SLIPS: "it helped in part: it sticks as often, with smaller slips",
    Verdict.NO_CHANGE: "no significant change",
    Verdict.NEVER_STUCK: "it stuck neither before nor after",
    Verdict.LARGER_SLIPS: "it got worse: it sticks as often, with larger slips",
    Verdict.WORSE: "it got worse",
    Verdict.CANNOT_SAY: "not enough data to judge whether it helped",
}


# The colour of a verdict is that of the status which it resembles.
VERDICT_COLOURS = {
    Verdict.HELPED: Status.SMOOTH.value,
    Verdict.HELPED_IN_PART: Status.SMOOTH.value,
    Verdict.SMALLER_SLIPS: Status.SMOOTH.value,
    Verdict.WORSE: Status.STICK_SLIP.value,
    Verdict.LARGER_SLIPS: Status.STICK_SLIP.value,
    Verdict.CANNOT_SAY: Status.AT_RISK.value,
}


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
    return f"{joint.name}: {_HEADS[joint.verdict]}"


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
