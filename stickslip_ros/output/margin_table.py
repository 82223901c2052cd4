# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The numbers of `~/margins`, published live and written beside recordings."""

from __future__ import annotations

import math
from collections.abc import Sequence

from stickslip_ros.model.margin import StabilityMargin
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.detection.status import Status

MARGIN_FIELDS = (
    "status",
    "applicable",
    "energy_margin",
    "damping_ratio",
    "critical_damping_ratio",
    "reduction_factor",
    "steady_stribeck",
    "natural_frequency",
    "velocity",
    "lowest_smooth_velocity",
    "stiffness",
    "damping",
    "cycles",
    "exact_smooth",
    "exact_critical_damping_ratio",
    "exact_lowest_smooth_velocity",
    "exact_least_smooth_stiffness",
    "margin_std",
    "stick_slip_probability",
    "stiffness_factor",
    "damping_factor",
    "trial_energy_margin",
    "trial_damping_ratio",
    "trial_critical_damping_ratio",
    "trial_exact_smooth",
)
STATUS_NUMBERS = {status: index for index, status in enumerate(Status)}


def margin_row(assessment: Assessment, exact: ExactVerdict, trial: ExactVerdict) -> list[float]:
    """The numbers of :data:`MARGIN_FIELDS`; NaN for what is unknown or not applicable."""
    gains, advised = assessment.gains, assessment.recommended
    return [
        float(STATUS_NUMBERS[assessment.finding.status]),
        float(assessment.margin is not None and bool(assessment.margin.applicable)),
        *_of_margin(assessment.margin, MARGIN_FIELDS[2:8]),
        assessment.velocity,
        assessment.lowest_smooth_velocity,
        math.nan if gains is None else float(gains.stiffness),
        math.nan if gains is None else float(gains.damping),
        float(assessment.cycles),
        _as_number(exact.smooth),
        exact.critical_damping_ratio,
        exact.lowest_smooth_velocity,
        exact.least_smooth_stiffness,
        assessment.margin_std,
        assessment.stick_slip_probability,
        math.nan if advised is None else advised.stiffness_factor,
        math.nan if advised is None else advised.damping_factor,
        *_of_margin(assessment.trial_margin, ("energy_margin", "damping_ratio", "critical_damping_ratio")),
        _as_number(trial.smooth),
    ]


def _of_margin(margin: StabilityMargin | None, names: Sequence[str]) -> list[float]:
    return [math.nan if margin is None else float(getattr(margin, name)) for name in names]


def _as_number(answer: bool | None) -> float:
    return math.nan if answer is None else float(answer)
