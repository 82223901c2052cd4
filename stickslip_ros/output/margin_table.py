# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The numbers of `~/margins`, published live and written beside recordings."""

from __future__ import annotations

from typing import Any

from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.output.published import SECTIONS, STATUS_NUMBERS, Known, MarginField

_ROWS = sorted(
    ((row.margins, section, row) for section in SECTIONS for row in section.rows if row.margins is not None),
    key=lambda found: found[0].place,
)
MARGIN_FIELDS = tuple(field.name for field, _, _ in _ROWS)
RESERVE = "exact_damping_reserve"  # the field that tells in one number how far a joint is from stick-slip


def margin_row(assessment: Assessment, exact: ExactVerdict, trial: ExactVerdict) -> list[float]:
    """The numbers of :data:`MARGIN_FIELDS`; NaN for what is unknown or not applicable."""
    known = Known(assessment=assessment, exact=exact, trial=trial)
    numbers = []
    for field, section, row in _ROWS:
        subject = section.of(known)
        numbers.append(_as_number(None if subject is None else row.value(subject), field))
    return numbers


def _as_number(value: Any, field: MarginField) -> float:
    if isinstance(value, Status):
        return float(STATUS_NUMBERS[value])
    return field.unknown if value is None else float(value)
