# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Margins and advice as the JSON objects that `margin`, `recommend` and `analyze` print."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from stickslip_ros.model.controlled import Conditions
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.margin import lowest_smooth_velocity, stability_margin
from stickslip_ros.model.verdict import ExactVerdict, exact_verdict
from stickslip_ros.monitoring.advice.recommendation import Kind, Recommendation, Variant
from stickslip_ros.monitoring.advice.sensitivity import Sensitivity


def number(value: Any) -> float | None:
    """A number that JSON can hold, or None."""
    return float(value) if math.isfinite(float(value)) else None


def margin_json(
    joint: Joint,
    gains: Gains,
    velocity: float,
    conditions: Conditions | None = None,
    *,
    exact: ExactVerdict | None = None,
) -> dict[str, Any]:
    """The margin; null for what is not applicable or infinite. The exact verdict is worked out unless it is given."""
    margin = stability_margin(joint, gains, velocity)
    exact = exact or exact_verdict(joint, gains, velocity, conditions)
    lowest = float(lowest_smooth_velocity(joint, gains)) if margin.applicable else math.nan
    return {
        "applicable": margin.applicable,
        "reason": margin.reason,
        "smooth": margin.smooth if margin.applicable else None,
        "energy_margin": number(margin.energy_margin),
        "damping_ratio": number(margin.damping_ratio),
        "critical_damping_ratio": number(margin.critical_damping_ratio),
        "reduction_factor": number(margin.reduction_factor),
        "steady_stribeck": number(margin.steady_stribeck),
        "lowest_smooth_velocity": number(lowest),
        "exact": {
            "smooth": exact.smooth,
            "reason": exact.reason,
            "critical_damping_ratio": number(exact.critical_damping_ratio),
            "lowest_smooth_velocity": number(exact.lowest_smooth_velocity),
            "least_smooth_stiffness": number(exact.least_smooth_stiffness),
        },
    }


def recommendation_json(advice: Recommendation, found: Sequence[Sensitivity] = ()) -> dict[str, Any]:
    """The advice as in the JSON of `analyze`, and more; null for what is not there, unknown or infinite."""
    obstruction = advice.obstruction
    best = obstruction.best if obstruction is not None else None
    return {
        **_variant_json(advice[Kind.LEAST_CHANGE]),
        "keep": advice.keep,
        "condition": advice.condition.value,
        "velocity": number(advice.velocity),
        "gains_known": advice.gains_known,
        "lowest_smooth_velocity": number(advice.slowest_smooth_velocity),
        "variants": {variant.kind.value: _variant_json(variant) for variant in advice.variants},
        "obstruction": None
        if obstruction is None
        else {
            "bounds": list(obstruction.bounds),
            "together": obstruction.together,
            "best_stiffness": None if best is None else number(best.stiffness),
            "best_damping": None if best is None else number(best.damping),
            "best_reserve": number(obstruction.reserve),
        },
        "sensitivities": {
            one.parameter: {"elasticity": number(one.elasticity), "factor": number(one.factor)} for one in found
        },
    }


def _variant_json(variant: Variant) -> dict[str, Any]:
    return {
        "stiffness": number(variant.stiffness),
        "damping": number(variant.damping),
        "energy_margin": number(variant.energy_margin),
        "reserve": number(variant.reserve),
        "exactly_smooth": variant.exactly_smooth,
        "slides_steadily": variant.slides_steadily,
        "stiffness_factor": number(variant.stiffness_factor),
        "damping_factor": number(variant.damping_factor),
        "change": number(variant.change),
        "reason": variant.reason,
    }
