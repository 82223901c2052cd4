# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""An analysis in words: what a joint does, and what to do about it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from stickslip_ros.analysis.joint_analysis import OTHERWISE, JointAnalysis, sticking_speed
from stickslip_ros.analysis.judgement import NOT_JUDGED, lacks_data
from stickslip_ros.bags.topics import Topics
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.units import unit_of
from stickslip_ros.monitoring.detection._judgement_kernel import DIP_AGAIN
from stickslip_ros.monitoring.detection.status import Finding, Status
from stickslip_ros.output.wording import (
    angle_text,
    dry_friction_text,
    kept_gains_text,
    presliding_text,
    reason_text,
    reversals_text,
    times_text,
)

_LEAST_SHARE = 0.001  # that is told as a number
_WHOLE_PERCENTS = 0.1  # a share from which on whole percents are enough
_MOST = 0.5  # share of the moving time, 1: of a joint that was smooth for less it is not said that all is well
_LEAST_TOLD = 1e-9  # way of a slip, rad: what is unseen below is rounding
_MOST_NAMED = 5  # joints
_SLOW_SHARE = 0.1  # share of the time of stick-slip, 1: what is shorter may be a start
_SLOWER = 0.8  # speed, of that of the advice: gains with the wanted reserve are enough to it
_PRINTED = 0.1  # error of three printed digits, %: a smaller one is printed so
_MATTERS = (Status.STICK_SLIP, Status.AT_RISK)


def matters(joint: JointAnalysis) -> bool:
    """Whether something may have to be done: whether the joint stuck, or may have stuck, or was at risk."""
    perhaps_stuck = joint.status is Status.SMOOTH and joint.caveat[1] > 0.0
    return joint.worst in _MATTERS or joint.stuck is not None or perhaps_stuck


def not_judged(joints: Sequence[JointAnalysis]) -> dict[str, list[str]]:
    """Reasons why joints could not be judged, each with the names of those that nothing else is said of."""
    found: dict[str, list[str]] = {}
    for joint in joints:
        reported = matters(joint) or lacks_data(joint.status, joint.assessment)
        if joint.status is Status.NOT_JUDGED and joint.reason and not reported:
            found.setdefault(joint.reason, []).append(joint.name)
    return found


def nothing_judged(found: Mapping[str, Any]) -> str:
    """Why no joint of a bag could be judged; "" if one could, or if the bag has an error of its own.

    Parameters
    ----------
    found : the bag's answer, as `analysis_json.bag_json` has it.
    """
    joints: Mapping[str, Mapping[str, Any]] = found.get("joints", {})
    if not joints or any(Status(joint["worst_status"]) not in NOT_JUDGED for joint in joints.values()):
        return ""
    texts = [f"{name}: {joint['reason'] or OTHERWISE}" for name, joint in joints.items()]
    more = [f"and {len(texts) - _MOST_NAMED} more joints"] if len(texts) > _MOST_NAMED else []
    return f"bag {found['path']}: no joint could be judged: {'; '.join([*texts[:_MOST_NAMED], *more])}"


def finding(joint: JointAnalysis) -> str:
    """What the joint does: what holds for most of the time, and what was worse than that."""
    speed = f" at {joint.velocity:.3g} rad/s" if math.isfinite(joint.velocity) else ""
    if joint.worst is Status.STICK_SLIP:
        return f"{_sticking(joint, speed)}{_in_the_end(joint)}"
    usual = {
        Status.AT_RISK: f"{joint.name} moves unevenly{speed}",
        Status.SMOOTH: f"{joint.name} moves smoothly{'' if matters(joint) else speed}",
        Status.AT_REST: f"{joint.name} is at rest",
        Status.NOT_JUDGED: f"{joint.name} is not judged",
        Status.UNKNOWN: f"{joint.name} cannot be judged",
    }
    text = usual[Status.UNKNOWN if lacks_data(joint.status, joint.assessment) else joint.status]
    text += f": {joint.reason}" if joint.reason else ""
    if joint.worst is Status.AT_RISK and joint.status is not Status.AT_RISK:
        share = percent(joint.time_in(Status.AT_RISK) / joint.moving_time)
        when = f"for {share} of its moving time{f',{speed},' if speed else ''}"
        text += f"; {when} its speed fell below a fifth of its mean, or again and again below {100.0 * DIP_AGAIN:.0f} %"
    text += _unseen([joint]) if joint.status is Status.SMOOTH and joint.worst is Status.SMOOTH else ""
    return f"{text}.{_in_the_end(joint)}{_stuck(joint)}{_caveat(joint)}"


def _caveat(joint: JointAnalysis) -> str:
    """That it stopped and went, or did not follow, beside what its status says."""
    caveat, lasted = joint.caveat
    if joint.status is Status.NOT_JUDGED or caveat is None:
        return ""
    return f" For {lasted:.2g} s it {reason_text(Finding(status=joint.status, reason=caveat))}."


def _stuck(joint: JointAnalysis) -> str:
    """That it stood while its reference went on, where the reason of its status does not say it."""
    text = reason_text(Finding(status=Status.AT_REST, reason=joint.stuck))
    return f" It was {text}." if text and text not in joint.reason else ""


def _sticking(joint: JointAnalysis, speed: str) -> str:
    driven = [cycle for cycle in joint.cycles if cycle.driven]
    period = sum(cycle.period for cycle in driven)
    rest = sum(cycle.dwell for cycle in driven)
    hunts = any(cycle.hunting for cycle in joint.cycles[-3:])
    what = "hunts about its reference" if hunts else "sticks and slips"
    usual = {
        Status.SMOOTH: "moves smoothly most of the time, but ",
        Status.AT_RISK: "is at risk most of the time, and ",
    }
    at_rest = f", at rest for {100.0 * rest / period:.0f} % of it" if period > 0 else ""
    return (
        f"{joint.name} {usual.get(joint.status, '')}{what}{speed} for {percent(joint.stick_slip_share)} of its moving "
        f"time: {len(joint.cycles)} cycles in {joint.time_in(Status.STICK_SLIP):.3g} s{at_rest}, "
        f"slips of {joint.usual_slip:.3g} rad."
    )


def _in_the_end(joint: JointAnalysis) -> str:
    """That stick-slip died out, where it did."""
    if joint.transient is None:
        return ""
    return f" It stuck {times_text(joint.transient.cycles)} after starting and has moved smoothly since."


def percent(share: float) -> str:
    """A share as people read it: no more digits than they need, but what is there is not 0 %; "-" if unknown."""
    if not math.isfinite(share):
        return "-"
    if 0.0 < share < _LEAST_SHARE:
        return f"< {100.0 * _LEAST_SHARE:.1f} %"
    return f"{100.0 * share:.1f} %" if 0.0 < share < _WHOLE_PERCENTS else f"{100.0 * share:.0f} %"


def advice(joint: JointAnalysis) -> str:
    """What to do, in a few sentences; "" where the joint is not judged and nothing is advised."""
    state = joint.assessment
    advised = state.recommended
    keeps = state.recommendation is not None and state.recommendation.keep
    if joint.worst in NOT_JUDGED and (advised is None or keeps):
        return ""
    if advised is None:
        if not matters(joint):
            return "" if joint.status in NOT_JUDGED or _for_a_little_while(joint) else _sentence(_nothing(joint))
        return f"No gains can be advised: {state.margin_reason or 'its friction is unknown'}."
    recommendation = state.recommendation
    if recommendation is not None and recommendation.keep:
        # A joint that sticks only after starting is no witness against friction that promises smooth motion.
        if joint.worst is Status.STICK_SLIP and joint.transient is None:
            return _sentence(kept_gains_text(recommendation.velocity, joint.velocity, joint.exact))
        return "Its gains have the wanted reserve: keep them."
    slowest = joint.exact.lowest_smooth_velocity
    # A model that does not fit is good for no speed.
    known = math.isfinite(slowest) and slowest > joint.velocity and not state.misfit_text
    faster = f"keep the present gains and move faster than {slowest:.3g} rad/s" if known else ""
    if not advised.found:
        return " ".join(_sentence(text) for text in (advised.reason.rstrip("."), faster and f"or {faster}") if text)
    faster = faster and f", or {faster}"
    if state.gains is None or not state.gains_known:
        kept = abs(advised.stiffness_factor - 1.0) < 1e-3
        stiffness = "keep the stiffness" if kept else f"multiply the stiffness by {advised.stiffness_factor:.3g}"
        damping = "the damping of controller and joint together"
        if 0.0 < advised.damping_factor < math.inf:
            damping = f"multiply {damping} by {advised.damping_factor:.3g}"
        else:
            damping = f"make {damping} {advised.damping_time:.3g} s times the stiffness"
        text = f"{stiffness} and {damping} (the gains of the controller were not recorded)"
    else:
        changes = []
        for name in ("stiffness", "damping"):
            now, then = float(getattr(state.gains, name)), float(getattr(advised, name))
            if abs(then - now) > 1e-3 * max(abs(now), abs(then)):
                changes.append(f"{name} from {now:.4g} to {then:.4g} {unit_of(Gains, name)}")
        if not changes:
            return _sentence(advised.reason.rstrip("."))
        text = f"change {' and '.join(changes)}"
    text = f"perhaps {text}{faster}: {state.misfit_text}" if state.misfit_text else f"{text}{faster}"
    return _sentence(text) + _slower_too(joint)


def _slower_too(joint: JointAnalysis) -> str:
    """That the joint also stuck where the advised gains need not be enough."""
    slow = sticking_speed(joint.cycles, _SLOW_SHARE) if joint.cycles else math.nan
    recommendation = joint.assessment.recommendation
    if recommendation is None or not slow < _SLOWER * recommendation.velocity:
        return ""
    return (
        f" These gains are for {recommendation.velocity:.3g} rad/s. It also stuck at {slow:.3g} rad/s: "
        f"--slowest-velocity {slow:.3g} advises gains for both."
    )


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def topics_read(robot: str, topics: Topics) -> list[str]:
    """What was read of a robot, "" for a bag's only one."""
    read = [f"states from {topics.states.topic}"]
    read += [f"references from {channel.topic}" for channel in topics.references]
    read += [f"gains from {channel.topic}" for channel in topics.gains]
    return [f"{robot}: {', '.join(read)}"] if robot else read


def depends_on(joint: JointAnalysis) -> str:
    """What the dry friction that was learnt depends on, in one sentence; "" if nothing is known to matter."""
    estimate = joint.assessment.estimate
    return dry_friction_text(estimate.dry) if estimate is not None and estimate.usable else ""


def reversals(joint: JointAnalysis, subject: str = "It") -> str:
    """What its reversals did to the joint, in one sentence; "" if none was seen."""
    record = joint.assessment.reversals
    if record is None:
        return ""
    text = f"{subject} reversed {times_text(record.count)}: {reversals_text(record)}"
    if record.count == 1:
        return f"{text}."
    if record.peak_error >= 0.0:
        most = "at most by"
    else:
        most = "at least by" if record.largest_error < 0.0 else "at most it falls behind by"
    return f"{text} (median); {most} {angle_text(abs(record.largest_error))}."


def presliding(joint: JointAnalysis, subject: str = "It") -> str:
    """How the joint gives way at rest, in one sentence; "" if that was not seen."""
    seen, gains = joint.assessment.presliding, joint.assessment.gains
    text = "" if seen is None else presliding_text(seen, float(gains.stiffness) if gains is not None else math.nan)
    return f"{subject} {text}." if text else ""


def ring(joint: JointAnalysis, subject: str = "It") -> str:
    """How the joint rings after its slips, in one sentence; "" if that was not seen."""
    found = joint.assessment.ring
    if found is None:
        return ""
    error = max(100.0 * found.frequency_std / found.frequency, _PRINTED)
    return (
        f"{subject} rings at {found.frequency:.3g} Hz ± {error:.1g} % after its slips (damping ratio "
        f"{found.damping_ratio:.2g}). Gains with a bandwidth near {2.0 * math.pi * found.frequency:.3g} rad/s would "
        f"excite that."
    )


def rests_on(joint: JointAnalysis) -> str:
    """Where the friction comes from that margin and advice use; "" without any."""
    text = joint.assessment.rests_on
    return _sentence(text) if text else ""


def smooth(joints: Sequence[JointAnalysis]) -> str:
    """What is to be said of the joints that move smoothly throughout, a line for each text; "" without any."""
    by_text: dict[str, list[JointAnalysis]] = {}
    for joint in joints:
        if joint.status is Status.SMOOTH and not matters(joint):
            by_text.setdefault(_smooth(joint), []).append(joint)
    return "\n".join(
        f"{', '.join(joint.name for joint in found)}: smooth{text}{_unseen(found)}." for text, found in by_text.items()
    )


def _smooth(joint: JointAnalysis) -> str:
    """What is said after "smooth": where, and that nothing has to be done."""
    if _for_a_little_while(joint):
        share = percent(joint.time_in(Status.SMOOTH) / joint.moving_time)
        return f" for {share} of its moving time; the rest could not be judged"
    return f"{' between reversals' if _stands_at_turns(joint) else ''}, {_nothing(joint)}"


def _for_a_little_while(joint: JointAnalysis) -> bool:
    """Whether it moved smoothly, and for more of the time could not be judged."""
    return joint.status is Status.SMOOTH and joint.time_in(Status.SMOOTH) < _MOST * joint.moving_time


def _stands_at_turns(joint: JointAnalysis) -> bool:
    """Whether it stands where it reverses, as lost motion or friction make it, which is no stick-slip."""
    record = joint.assessment.reversals
    return record is not None and record.standing > 0.0


def _nothing(joint: JointAnalysis) -> str:
    """That nothing has to be done; where the joint stands at its reversals, that this is so of stick-slip."""
    return f"nothing has to be done{' against stick-slip' if _stands_at_turns(joint) else ''}"


def _unseen(joints: Sequence[JointAnalysis]) -> str:
    """Which slips of joints that move smoothly the encoders or the noise may have hidden."""
    least = max(joint.assessment.least_slip_seen for joint in joints)
    return f"; slips of less than {angle_text(least)} may go unseen" if least > _LEAST_TOLD else ""
