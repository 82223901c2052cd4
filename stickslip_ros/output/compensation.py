# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What compensation buys beside advised gains: asked of an assessment, told as a diagnosis."""

from __future__ import annotations

import math

from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.monitoring.advice.compensations import (
    CompensatedGains,
    CompensationQuestion,
)
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.output.diagnosis import Diagnosis, Level, value_text
from stickslip_ros.output.wording import OUTCOME_TEXTS, angle_text

_LEAST_SHARE = 0.1  # of the friction, below which compensation is not worth having


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
    return Diagnosis(
        level=Level.OK,
        name=f"stickslip: compensation of {name}",
        hardware_id=name,
        message=compensation_words(found),
        values=tuple((key, value_text(value)) for key, value in values),
    )
