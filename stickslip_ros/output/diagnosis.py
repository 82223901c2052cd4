# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What is known of a joint as a diagnosis: a summary for a person, key and value for programs.

Diagnoses become the bytes of a DiagnosticArray here, for the node and for bags, because rclpy takes several times as
long. The encoding is CDR (OMG, Common Data Representation), little-endian, as every ROS 2 middleware reads it.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from typing import Any

from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import JOINT_PARAMETERS
from stickslip_ros.model.margin import StabilityMargin
from stickslip_ros.model.outcome import Outcome
from stickslip_ros.model.units import in_ascii, unit_of
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.advice.compensations import (
    CompensatedGains,
    CompensationQuestion,
)
from stickslip_ros.monitoring.advice.limits import Criterion
from stickslip_ros.monitoring.advice.recommendation import Advice, Kind
from stickslip_ros.monitoring.advice.sensitivity import in_words
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.monitoring.friction.estimate import COULOMB_AND_LOAD, FrictionEstimate
from stickslip_ros.output import published
from stickslip_ros.output.wording import (
    OUTCOME_TEXTS,
    angle_text,
    constant_effort_text,
    friction_change_text,
    kept_gains_text,
    reason_text,
)

Values = list[tuple[str, object]]  # keys and values

_MOST_KEPT = 1024  # number of lists of values that are kept, 1: some of each of 256 joints
_ONLY_ABSOLUTE = ("inertia", "coulomb", "load")  # per inertia the slips say nothing of them
_LEAST_SHARE = 0.1  # of the friction, below which compensation is not worth having
_ENCAPSULATION = b"\x00\x01\x00\x00"
_ALIGNED = 4  # alignment of numbers and of lengths of texts, bytes: CDR has it
_LENGTH = struct.Struct("<I")
_HEADER = struct.Struct("<iI")
_MOST_TEXTS = 4096  # number of cached texts, 1: keys, and names of at most 256 joints


class Level(IntEnum):
    """Of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """A diagnostic status, whoever publishes or records it.

    Attributes
    ----------
    message : a summary for a person. values : keys with their units, and texts; numbers bare and in full, so that
        plotting tools take them.
    """

    level: Level
    name: str
    hardware_id: str
    message: str
    values: tuple[tuple[str, str], ...]


def diagnosis(
    level: Level, message: str, values: Iterable[tuple[str, object]], name: str, hardware_id: str
) -> Diagnosis:
    """A diagnosis whose values are numbers, in full, or texts."""
    texts = tuple(
        (key, value if type(value) is str else repr(float(value)) if isinstance(value, float) else str(value))
        for key, value in values
    )
    return Diagnosis(level=level, name=name, hardware_id=hardware_id, message=message, values=texts)


def _of_joint(level: Level, joint: str, message: str, values: Iterable[tuple[str, object]]) -> Diagnosis:
    return diagnosis(level, message, values, f"stickslip_monitor: {joint}", joint)


def _once(function: Callable[..., Values]) -> Callable[..., Values]:
    """Let values be computed once for the same objects, which do not change: a status repeats most of the last one."""
    kept: dict[tuple[int, ...], tuple[tuple[Any, ...], Values]] = {}

    def values(*subjects: Any) -> Values:
        identity = tuple(map(id, subjects))
        if identity not in kept:
            if len(kept) >= _MOST_KEPT:
                kept.clear()
            # The subjects are kept too, so that no other object gets one of their identities.
            kept[identity] = subjects, function(*subjects)
        return kept[identity][1]

    return values


def waiting_diagnostic(joint: str, reason: str) -> Diagnosis:
    """Status of a joint of which nothing can be said yet."""
    return _of_joint(Level.WARN, joint, reason, [("status", Status.UNKNOWN.value), ("reason", reason)])


@_once
def _friction_values(estimate: FrictionEstimate) -> Values:
    """What was learnt, one number a key, and the whole in words."""
    values: Values = []
    words = []
    learnt = [
        (one.name, one.unit_where(per_inertia=estimate.normalised), estimate[one.name]) for one in JOINT_PARAMETERS
    ]
    torque = unit_of(OperatingConditions, "load")
    beside = (("load", torque, estimate.load), (COULOMB_AND_LOAD, torque, estimate.coulomb_and_load))
    for name, unit, found in (*learnt, *beside):
        if math.isnan(found.value) or (estimate.normalised and name in _ONLY_ABSOLUTE):
            continue
        unit = in_ascii(unit)
        values += [(f"{name} [{unit}]", found.value), (f"{name} std [{unit}]", found.std)]
        words.append(f"{name.replace('_', ' ')} {found.value:.4g} ± {found.std:.2g}{'' if found.identified else '?'}")
    if estimate.normalised:
        frequency = estimate.natural_frequency
        values += [
            ("natural_frequency learnt [rad/s]", frequency.value),
            ("natural_frequency std [rad/s]", frequency.std),
        ]
        words.insert(0, f"natural frequency {frequency.value:.4g} ± {frequency.std:.2g}")
    values += [
        ("friction learnt", "; ".join(words)),
        ("not identified", ", ".join(estimate.unidentified)),
        *_growth_values(estimate),
        ("slips learnt from [1]", estimate.slips),
        ("slips not explained [1]", estimate.aside),
        ("friction fit mean square [1]", estimate.mean_square),
    ]
    return values


def _growth_values(estimate: FrictionEstimate) -> Values:
    """By how much friction varies with place or load; nothing where it is not known to."""
    friction_factor = estimate.friction_factor
    if friction_factor is None:
        return []
    values: Values = [
        ("friction varies", friction_factor.text),
        ("stribeck share that varies [1]", friction_factor.share),
        ("stribeck share that varies std [1]", friction_factor.std),
    ]
    slope, std = friction_factor.over_load(estimate["stribeck"].value)
    if math.isfinite(slope):
        values += [("stribeck over load [1]", slope), ("stribeck over load std [1]", std)]
    return values


def joint_diagnostic(name: str, found: published.Findings, warn_margin: float) -> Diagnosis:
    """One joint's status: a summary for a person, every number as a key with its unit for programs; all in SI units."""
    assessment, exact = found.assessment, found.exact
    reason = "" if assessment.finding.reason is None else reason_text(assessment.finding)
    level, message = _summary(found, reason, warn_margin)
    if found.trouble:
        level, message = Level.WARN, found.trouble
    if found.missing:
        level, message = max(level, Level.WARN), f"{message}; {found.missing}"

    def rows(*sections: published.Section) -> Values:
        return [row for one in sections for row in one.for_diagnostics(one.of(found))]

    values: Values = [
        *rows(published.STATUS),
        ("reason", reason),
        *rows(published.VELOCITY),
        ("velocity is from", assessment.velocity_source),
        ("margin reason", assessment.margin_reason),
        ("missing", found.missing),
        *_margin_values(published.MARGIN, assessment.margin),
    ]
    if assessment.margin is not None:
        values += rows(published.MARGIN_TERMS, published.LOWEST_SMOOTH_VELOCITY)
    if exact.smooth is not None:
        values += rows(published.EXACT)
    if not math.isnan(exact.damping_reserve):
        values += rows(published.RESERVE)
    if found.here is not None and found.here.smooth is not None:
        values.append(("exact smooth here", str(found.here.smooth).lower()))
    if exact.reason:
        values.append(("exact reason", exact.reason))
    values += rows(published.GAINS, published.INTEGRAL_GAIN)
    if assessment.advice is not None:
        values.append(("recommendation", assessment.advice_text))
        values += _advice_values(assessment.advice, assessment.variant)
    values += _trial_values(assessment, found.trial)
    if found.applied:
        values.append(("applied", found.applied))
    values += rows(published.BELIEF)
    if assessment.joint is not None and not assessment.per_inertia:
        values += _joint_values(assessment.joint)
    if math.isfinite(assessment.margin_std):
        values += rows(published.UNCERTAINTY)
    if math.isfinite(exact.stick_slip_probability):
        values += rows(published.EXACT_UNCERTAINTY)
    if assessment.estimate is not None:
        values += _friction_values(assessment.estimate)
    if assessment.change is not None:
        values.append(("friction change", friction_change_text(assessment.change)))
    values += rows(published.CYCLES)
    values += _last_cycle_values(assessment.last_cycle)
    values += rows(published.REVERSALS, published.PRESLIDING, published.RING, published.POSITION, published.SAMPLING)
    samples = [f"{reason}: {count}" for reason, count in assessment.dropped.items()]
    single = [f"{reason}: {count}" for reason, count in assessment.blanked.items()]
    if math.isfinite(assessment.constant_effort):
        single.append(constant_effort_text(assessment.constant_effort))
    values += [("samples left out", "; ".join(samples)), ("values left out", "; ".join(single))]
    return _of_joint(level, name, message, values)


def _advised_exactly(assessment: Assessment) -> bool:
    """Whether the exact condition is the one that counts."""
    return assessment.advice is not None and assessment.advice.recommendation.condition is Criterion.EXACT


@_once
def _advice_values(advice: Advice, recommended: Kind) -> Values:
    """The recommended variant under plain names, then all three, and what mechanics could do."""
    chosen, known, before = advice.recommendation[recommended], advice.recommendation.gains_known, "recommended "
    values: Values = [
        *published.ADVICE.for_diagnostics(advice.recommendation),
        *published.ADVISED_FACTORS.for_diagnostics(chosen, before),
        *published.ADVISED_COST.for_diagnostics(chosen, before),
        *published.ADVISED_MARGIN.for_diagnostics(chosen, before),
        *published.ADVICE_REACHES.for_diagnostics(advice.recommendation),
        *published.ADVISED_ANSWERS.for_diagnostics(chosen, before),
    ]
    if known:
        values += published.ADVISED_GAINS.for_diagnostics(chosen, before)
    for variant in advice.recommendation.variants:
        name = variant.kind.value
        values.append((f"advice, {name.replace('_', ' ')}", variant.reason))
        values += (published.ADVISED_GAINS if known else published.ADVISED_FACTORS).for_diagnostics(variant, f"{name} ")
    if advice.recommendation.resonance:
        values.append(("advice, gains that excite", advice.recommendation.resonance))
    obstruction = advice.recommendation.obstruction
    if obstruction is not None:
        values.append(("advice, bounds in the way", ", ".join(obstruction.bounds)))
    values += [(f"reserve elasticity to {one.parameter} [1]", one.elasticity) for one in advice.sensitivities]
    mechanics = in_words(advice.sensitivities)
    if mechanics:
        values.append(("advice, lubricant and mechanics", mechanics))
    return values


_joint_values = _once(published.joint_values)
_last_cycle_values = _once(lambda cycle: published.CYCLE_SIZE.for_diagnostics(cycle, "last "))


def _margin_values(section: published.Section, margin: StabilityMargin | None) -> Values:
    """What Eq. (43) says of gains; that it says nothing has the key of its first row."""
    return [(section.rows[0].key(), "")] if margin is None else section.for_diagnostics(margin)


def _trial_values(assessment: Assessment, exact: ExactVerdict) -> Values:
    """What the gains on trial would do."""
    if assessment.trial is None:
        return []
    return [
        *published.TRIAL_GAINS.for_diagnostics(assessment.trial),
        *_margin_values(published.TRIAL_MARGIN, assessment.trial_margin),
        *published.TRIAL_EXACT.for_diagnostics(exact),
    ]


def _summary(found: published.Findings, reason: str, warn_margin: float) -> tuple[Level, str]:
    assessment, exact = found.assessment, found.exact
    finding, margin = assessment.finding, assessment.margin
    text = finding.status.value + (f": {reason}" if reason else "")
    if found.silent_for is not None:
        if math.isinf(found.silent_for):
            return Level.STALE, "no data yet"
        return Level.STALE, f"no data for {found.silent_for:.1f} s (was {finding.status.value})"
    if finding.status is Status.STICK_SLIP:
        if assessment.change is not None and assessment.change.learning_anew:
            text += f"; {friction_change_text(assessment.change)}"
        recommendation = assessment.recommendation
        if recommendation is not None and recommendation.keep:
            text += f"; {kept_gains_text(recommendation.velocity, assessment.velocity, exact)}"
            return Level.ERROR, text
        return Level.ERROR, f"{text}; {assessment.advice_text}" if assessment.advice_text else text
    if finding.status in (Status.AT_RISK, Status.UNKNOWN):
        return Level.WARN, text
    if assessment.estimate is not None and assessment.estimate.mismatch:
        return Level.WARN, f"{text}; {assessment.estimate.mismatch}"
    if margin is None:
        return Level.WARN, f"{text}; no margin: {assessment.margin_reason}"
    if _advised_exactly(assessment):
        if exact.smooth is False:
            return Level.WARN, f"{text}; the model predicts that it sticks"
        if exact.outcome is Outcome.SWINGS:
            return Level.OK, f"{text}; the model predicts that it swings about its speed"
    elif margin.applicable and not margin.damping_ratio >= (1.0 + warn_margin) * margin.critical_damping_ratio:
        return Level.WARN, f"{text}; the margin of Eq. (43) is small: {margin.energy_margin:.3g}"
    return Level.OK, text


def cycle_diagnostic(name: str, cycle: Cycle) -> Diagnosis:
    """One completed cycle."""
    values = [row for section in published.OF_CYCLE for row in section.for_diagnostics(cycle)]
    message = f"slip of {cycle.slip_distance:.4g} rad after {cycle.dwell:.3g} s at rest"
    return _of_joint(Level.WARN, name, message, values)


def compensation_question(
    assessment: Assessment, velocity: float, conditions: OperatingConditions
) -> CompensationQuestion | None:
    """What is to be answered of a joint at a velocity [rad/s]: with the advised gains, or with the present ones where
    none are found. None where friction, gains, inertia or advice are not known yet, or the speed is none. Of an unknown
    Coulomb friction, which is 0, there would be nothing to compensate.
    """
    joint, gains, advised = assessment.joint, assessment.margin_gains, assessment.recommended
    if joint is None or gains is None or advised is None or assessment.per_inertia or not assessment.gains_known:
        return None
    if not (math.isfinite(velocity) and velocity != 0.0):
        return None
    if advised.found:
        gains = advised.gains
    if not float(gains.stiffness) > 0.0 or not float(joint.friction.coulomb) > 0.0:
        return None
    resolution = assessment.resolution if math.isfinite(assessment.resolution) else 0.0
    return CompensationQuestion(
        joint=joint, gains=gains, velocity=abs(velocity), conditions=conditions, resolution=resolution
    )


def compensation_words(found: tuple[CompensatedGains, ...]) -> str:
    """What compensation is worth, in one sentence for each kind."""
    alone = found[0].effect
    sentences = []
    for one in found[1:]:
        name = one.kind.capitalize()
        if one.share < _LEAST_SHARE:
            sentences.append(f"{name} of the friction does harm at any share.")
            continue
        if one.effect.unstable:
            sentences.append(f"With {one.kind} the loop is unstable.")
            continue
        then = [f"the error where the joint turns round is {angle_text(one.effect.peak_error)}"]
        if math.isfinite(alone.peak_error):
            then[0] += f", not {angle_text(alone.peak_error)}"
        if one.effect.outcome is not alone.outcome and one.effect.outcome is not None:
            then.append(f"at its speed it {OUTCOME_TEXTS[one.effect.outcome]}")
        if math.isfinite(one.harmless):
            then.append(f"it does no harm up to {one.harmless:.1f} times the friction")
        sentences.append(f"{name} of {100.0 * one.share:.0f} % of the friction: {'; '.join(then)}.")
    return " ".join(sentences)


def compensation_diagnosis(name: str, question: CompensationQuestion, found: tuple[CompensatedGains, ...]) -> Diagnosis:
    """For the topic: the sentence, and every number; SI units."""
    values: list[tuple[str, object]] = [
        ("velocity [rad/s]", question.velocity),
        ("stiffness [N*m/rad]", float(question.gains.stiffness)),
        ("damping [N*m*s/rad]", float(question.gains.damping)),
    ]
    for one in found:
        effect, label = one.effect, one.label
        if one.kind:
            values += [(f"{label}: share [1]", one.share), (f"{label}: harmless share [1]", one.harmless)]
        values += [
            (f"{label}: outcome", "" if effect.outcome is None else effect.outcome.value),
            (f"{label}: steady error [rad]", effect.steady_error),
            (f"{label}: swing [rad]", effect.swing),
            (f"{label}: swing at rest [rad]", effect.standing_swing),
            (f"{label}: peak error at a reversal [rad]", effect.peak_error),
        ]
    return diagnosis(Level.OK, compensation_words(found), values, f"stickslip: compensation of {name}", name)


@dataclass(frozen=True, kw_only=True)
class StatusBytes:
    """Serialized DiagnosticStatus, at any place of an array.

    Attributes
    ----------
    body : bytes after the level. filled : number of padding bytes at the end of the body.
    """

    level: int
    body: bytes
    filled: int


def status_bytes(diagnosis: Diagnosis, robot: str = "") -> StatusBytes:
    """Serialize a status.

    Parameters
    ----------
    robot : prefix of the names, "" or ending in a slash: robots have joints of the same names, and one /diagnostics.
    """
    body = bytearray(_known_text(robot + diagnosis.name))
    body += _text(diagnosis.message)
    body += _known_text(robot + diagnosis.hardware_id)
    body += _LENGTH.pack(len(diagnosis.values))
    last = b""
    for key, value in diagnosis.values:
        body += _known_text(key)
        last = _text(value)
        body += last
    filled = -(_LENGTH.unpack_from(last)[0]) % _ALIGNED if last else 0
    return StatusBytes(level=diagnosis.level, body=bytes(body), filled=filled)


def diagnostic_array_bytes(stamp: int, statuses: Sequence[StatusBytes]) -> bytes:
    """A serialized DiagnosticArray with a stamp [ns]."""
    data = bytearray(_ENCAPSULATION)
    data += _HEADER.pack(*divmod(stamp, 1_000_000_000))
    data += _text("")
    data += _LENGTH.pack(len(statuses))
    filled = 0
    for one in statuses:
        # A level is one byte, and needs no padding before it.
        if filled:
            data[-filled] = one.level
        else:
            data += bytes((one.level, 0, 0, 0))
        data += one.body
        filled = one.filled
    return bytes(data[: len(data) - filled])


def _text(text: str) -> bytes:
    """Serialized text: length, characters, the zero after them, and padding."""
    characters = text.encode("utf-8", "replace") + b"\x00"
    return _LENGTH.pack(len(characters)) + characters + bytes(-len(characters) % _ALIGNED)


_known_text = lru_cache(_MOST_TEXTS)(_text)  # keys and names are the same all the time
