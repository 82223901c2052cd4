# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Margins and advice as the JSON objects that `margin`, `recommend` and `analyze` print."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from functools import partial
from typing import Any

from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.margin import lowest_smooth_velocity, stability_margin
from stickslip_ros.model.verdict import ExactVerdict, verdict
from stickslip_ros.monitoring.advice.recommendation import Kind, Recommendation, Variant
from stickslip_ros.monitoring.advice.sensitivity import Sensitivity
from stickslip_ros.monitoring.friction.dry_friction import DryFriction
from stickslip_ros.monitoring.friction.estimate import FrictionEstimate, ParameterEstimate
from stickslip_ros.output import published
from stickslip_ros.output.published import number, numbers, numbers_or_null
from stickslip_ros.output.wording import dry_friction_text


def json_text(content: Any) -> str:
    """A JSON object on one line, as it may reach a terminal: what is not seen of a name is escaped."""
    text = json.dumps(content, ensure_ascii=False)
    # Only names hold such characters: JSON writes the others of its own as they are.
    return text if text.isprintable() else "".join(one if one.isprintable() else _escaped(one) for one in text)


def _escaped(character: str) -> str:
    return json.dumps(character)[1:-1]


def margin_json(
    joint: Joint,
    gains: Gains,
    velocity: float,
    conditions: OperatingConditions | None = None,
    *,
    exact: ExactVerdict | None = None,
) -> dict[str, Any]:
    """The margin; null for what is not applicable or infinite. The exact verdict is worked out unless it is given."""
    margin = stability_margin(joint, gains, velocity)
    exact = exact or verdict(joint, gains, velocity, conditions)
    lowest = float(lowest_smooth_velocity(joint, gains)) if margin.applicable else math.nan
    return {
        **published.for_json(margin, published.MARGIN, published.MARGIN_TERMS),
        **published.LOWEST_SMOOTH_VELOCITY.for_json(lowest),
        "exact": published.for_json(exact, published.EXACT, published.RESERVE),
    }


def recommendation_json(advice: Recommendation, found: Sequence[Sensitivity] = ()) -> dict[str, Any]:
    """The advice as in the JSON of `analyze`, and more; null for what is not there, unknown or infinite."""
    obstruction = advice.obstruction
    best = obstruction.best if obstruction is not None else None
    return {
        **_variant_json(advice[Kind.LEAST_CHANGE]),
        **published.for_json(advice, published.ADVICE, published.ADVICE_REACHES),
        "variants": {variant.kind.value: _variant_json(variant) for variant in advice.variants},
        "present": advice.present and _variant_json(advice.present),
        "by_the_other_condition": advice.beside and _variant_json(advice.beside),
        "obstruction": None
        if obstruction is None
        else {
            "bounds": list(obstruction.bounds),
            "together": obstruction.together,
            "best_stiffness": None if best is None else number(best.stiffness),
            "best_damping": None if best is None else number(best.damping),
            "best_reserve": number(obstruction.reserve),
        },
        "resonance": advice.resonance or None,
        "sensitivities": {one.parameter: numbers(one, "elasticity", "factor") for one in found},
    }


def parameter_json(found: ParameterEstimate) -> dict[str, Any]:
    """One parameter of the friction as it was learnt; null for what is not known."""
    return {**numbers(found, "value", "std"), "identified": found.identified}


def dry_friction_json(dry: DryFriction) -> dict[str, Any]:
    """What the kinetic friction depends on; null for what is not significant, or cannot be known."""
    ripple = dry.ripple
    term = partial(numbers_or_null, names=("value", "std", "significance"))
    return {
        "slips": len(dry.kinetic),
        "coulomb": term(dry.coulomb),
        "load": term(dry.load),
        "drift": term(dry.drift),
        "time_and_position_told_apart": dry.distinguished,
        "ripple": None
        if ripple is None
        else {
            **numbers(ripple, "amplitude", "amplitude_std", "period", "period_std", "phase", "phase_std"),
            **numbers(ripple, "about", "significance"),
            "aliases": [number(period) for period in ripple.aliases],
        },
        "load_dependence": term(dry.load_dependence),
        "scatter": number(dry.scatter),
        "places": [
            {"direction": place.direction, **numbers(place, "position", "mean", "std"), "slips": place.slips}
            for place in dry.places
        ],
        "summary": dry_friction_text(dry),
    }


def growth_json(estimate: FrictionEstimate, position: float) -> dict[str, Any] | None:
    """Friction that varies with place or load, at the worst place and at a position [rad]; None where it does not."""
    friction_factor = estimate.friction_factor
    if friction_factor is None:
        return None
    slope, std = friction_factor.over_load(estimate["stribeck"].value)
    known = math.isfinite(position)
    return {
        "with": "load" if friction_factor.position_disturbance.with_load else "position",
        "share": number(friction_factor.share),
        "share_std": number(friction_factor.std),
        "coulomb": number(friction_factor.coulomb),
        "coulomb_std": number(friction_factor.coulomb_std),
        "stribeck_over_load": number(slope),
        "stribeck_over_load_std": number(std),
        "worst_position": number(friction_factor.worst_position),
        "least_load": number(friction_factor.loads[0]),
        "largest_load": number(friction_factor.loads[1]),
        "load_here": number(friction_factor.load_at(position)) if known else None,
        "stribeck_here": number(friction_factor.factor(position) * estimate["stribeck"].value) if known else None,
        "summary": friction_factor.text,
    }


def _variant_json(variant: Variant) -> dict[str, Any]:
    return {**published.for_json(variant, *published.OF_VARIANT), "reason": variant.reason}
