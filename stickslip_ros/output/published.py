# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Everything that is published of a joint, one row each: its unit, where it comes from, and its name in every output.

A new number is a row in a section, and nothing else: diagnostics, `~/margins`, JSON and the table of a fleet have it
under the names that the row gives. Each output prints the sections in an order of its own, and the rows of a section
in the order that they have here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import Any

from stickslip_ros.model.friction import Friction, Gains
from stickslip_ros.model.units import in_ascii, unit_of
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.detection.status import Status

STATUS_NUMBERS = {status: index for index, status in enumerate(Status)}


@dataclass(frozen=True, kw_only=True)
class Known:
    """What there is to publish of a joint: the assessment, and verdicts on the present gains and on those on trial."""

    assessment: Assessment
    exact: ExactVerdict
    trial: ExactVerdict


@dataclass(frozen=True, kw_only=True)
class MarginField:
    """A field of `~/margins`. Others rely on ``place``: a new field has the next one. ``unknown`` : stands for None."""

    place: int
    name: str
    unknown: float = math.nan


@dataclass(frozen=True, kw_only=True)
class Published:
    """A number, an answer or a text that is published.

    Attributes
    ----------
    value : gives it, of what the section is about; None for an answer that is not known, NaN for such a number.
    unit : of a number, as diagnostics have it; "" of answers and texts.
    diagnostics, json, fleet : its names there, the first without the unit; "" where it is left out.
    margins : its field of `~/margins`, if it has one.
    """

    value: Callable[[Any], Any]
    unit: str = ""
    diagnostics: str = ""
    json: str = ""
    fleet: str = ""
    margins: MarginField | None = None

    def key(self, prefix: str = "") -> str:
        """The key in diagnostics, with the unit."""
        return prefix + self._key

    @cached_property
    def _key(self) -> str:
        return f"{self.diagnostics} [{self.unit}]" if self.unit else self.diagnostics


@dataclass(frozen=True)
class Section:
    """Rows about the same thing. ``of`` : gives this thing, None if there is none."""

    of: Callable[[Known], Any]
    rows: tuple[Published, ...]

    def for_diagnostics(self, subject: Any, prefix: str = "") -> list[tuple[str, object]]:
        """Keys and values; what has no answer, or an empty text, is left out."""
        found = [(row.key(prefix), row.value(subject)) for row in self.rows if row.diagnostics]
        return [(key, _as_text(value)) for key, value in found if value is not None and value != ""]

    def for_json(self, subject: Any) -> dict[str, Any]:
        """An object for JSON; null for what is unknown or infinite."""
        return {row.json: _as_json(row.value(subject)) for row in self.rows if row.json}

    def for_fleet(self, found: Mapping[str, Any] | None) -> dict[str, Any]:
        """Columns of a fleet's table, from the JSON object; all None without one."""
        return {row.fleet: None if found is None else found[row.json] for row in self.rows if row.fleet}


def number(value: Any) -> float | None:
    """A number that JSON can hold, or None."""
    return float(value) if math.isfinite(float(value)) else None


def _as_text(value: object) -> object:
    if isinstance(value, Enum):
        return value.value
    return str(value).lower() if isinstance(value, bool) else value


def _as_json(value: Any) -> Any:
    if isinstance(value, Enum):
        return value.value
    return value if value is None or isinstance(value, (bool, str)) else number(value)


_ENERGY = "M*stribeck_velocity^2"
_STIFFNESS, _DAMPING, _INTEGRAL = (in_ascii(unit_of(Gains, name)) for name in ("stiffness", "damping", "integral"))
_TORQUE = in_ascii(unit_of(Friction, "coulomb"))


def _field(place: int, name: str, unknown: float = math.nan) -> MarginField:
    return MarginField(place=place, name=name, unknown=unknown)


def _on_trial(section: Section, of: Callable[[Known], Any], places: Mapping[str, int]) -> Section:
    """The section about the gains on trial: in `~/margins` those of its fields that are given places."""

    def row_of(row: Published) -> Published:
        name = row.margins.name if row.margins is not None else ""
        margins = _field(places[name], f"trial_{name}") if name in places else None
        return replace(row, diagnostics=row.diagnostics and f"trial {row.diagnostics}", margins=margins)

    return Section(of, tuple(map(row_of, section.rows)))


_row = Published

STATUS = Section(
    lambda known: known.assessment.finding.status,
    (_row(value=lambda status: status, diagnostics="status", json="status", fleet="status",
          margins=_field(0, "status")),),
)  # fmt: skip
VELOCITY = Section(
    lambda known: known.assessment.velocity,
    (_row(value=lambda velocity: velocity, unit="rad/s", diagnostics="velocity", json="velocity", fleet="velocity",
          margins=_field(8, "velocity")),),
)  # fmt: skip
# What Eq. (43) says of gains, a StabilityMargin; of those on trial it is published too.
MARGIN = Section(
    lambda known: known.assessment.margin,
    (
        _row(value=lambda margin: bool(margin.applicable), diagnostics="margin applicable", json="applicable",
             margins=_field(1, "applicable", unknown=0.0)),
        _row(value=lambda margin: margin.reason, json="reason"),
        _row(value=lambda margin: bool(margin.smooth) if margin.applicable else None, json="smooth"),
        _row(value=lambda margin: margin.energy_margin, unit=_ENERGY,
             diagnostics="energy_margin", json="energy_margin", fleet="energy_margin",
             margins=_field(2, "energy_margin")),
        _row(value=lambda margin: margin.damping_ratio, unit="1",
             diagnostics="damping_ratio", json="damping_ratio", fleet="damping_ratio",
             margins=_field(3, "damping_ratio")),
        _row(value=lambda margin: margin.critical_damping_ratio, unit="1",
             diagnostics="critical_damping_ratio", json="critical_damping_ratio", fleet="critical_damping_ratio",
             margins=_field(4, "critical_damping_ratio")),
    ),
)  # fmt: skip
# What it says more of the present gains.
MARGIN_TERMS = Section(
    MARGIN.of,
    (
        _row(value=lambda margin: margin.reduction_factor, unit="1",
             diagnostics="reduction_factor", json="reduction_factor", margins=_field(5, "reduction_factor")),
        _row(value=lambda margin: margin.steady_stribeck, unit=_TORQUE,
             diagnostics="steady_stribeck", json="steady_stribeck", margins=_field(6, "steady_stribeck")),
        _row(value=lambda margin: margin.natural_frequency, unit="rad/s",
             diagnostics="natural_frequency", margins=_field(7, "natural_frequency")),
    ),
)  # fmt: skip
LOWEST_SMOOTH_VELOCITY = Section(
    lambda known: known.assessment.lowest_smooth_velocity,
    (_row(value=lambda velocity: velocity, unit="rad/s", diagnostics="lowest_smooth_velocity",
          json="lowest_smooth_velocity", fleet="lowest_smooth_velocity",
          margins=_field(9, "lowest_smooth_velocity")),),
)  # fmt: skip
# By integration of Eqs (4)-(6), an ExactVerdict.
EXACT = Section(
    lambda known: known.exact,
    (
        _row(value=lambda exact: exact.smooth, diagnostics="exact smooth", json="smooth", fleet="exactly_smooth",
             margins=_field(13, "exact_smooth")),
        _row(value=lambda exact: exact.outcome, diagnostics="exact outcome", json="outcome", fleet="exact_outcome"),
        _row(value=lambda exact: None if exact.outcome is None else exact.depends_on_start,
             diagnostics="exact depends_on_start", json="depends_on_start"),
        _row(value=lambda exact: exact.reason, json="reason"),  # diagnostics have it where all else is unknown
        _row(value=lambda exact: exact.critical_damping_ratio, unit="1",
             diagnostics="exact critical_damping_ratio", json="critical_damping_ratio",
             margins=_field(14, "exact_critical_damping_ratio")),
        _row(value=lambda exact: exact.steady_damping_ratio, unit="1",
             diagnostics="exact steady_damping_ratio", json="steady_damping_ratio", fleet="steady_damping_ratio",
             margins=_field(25, "exact_steady_damping_ratio")),
        _row(value=lambda exact: exact.lowest_smooth_velocity, unit="rad/s",
             diagnostics="exact lowest_smooth_velocity", json="lowest_smooth_velocity",
             margins=_field(15, "exact_lowest_smooth_velocity")),
        _row(value=lambda exact: exact.least_smooth_stiffness, unit=_STIFFNESS,
             diagnostics="exact least_smooth_stiffness", json="least_smooth_stiffness",
             margins=_field(16, "exact_least_smooth_stiffness")),
    ),
)  # fmt: skip
# Of an ExactVerdict too; known before all else of it.
RESERVE = Section(
    EXACT.of,
    (_row(value=lambda exact: exact.damping_reserve, unit="1", diagnostics="exact damping_reserve",
          json="damping_reserve", fleet="reserve", margins=_field(28, "exact_damping_reserve")),),
)  # fmt: skip
GAINS = Section(
    lambda known: known.assessment.gains,
    (
        _row(value=lambda gains: gains.stiffness, unit=_STIFFNESS, diagnostics="stiffness", json="stiffness",
             fleet="stiffness", margins=_field(10, "stiffness")),
        _row(value=lambda gains: gains.damping, unit=_DAMPING, diagnostics="damping", json="damping",
             fleet="damping", margins=_field(11, "damping")),
    ),
)  # fmt: skip
INTEGRAL_GAIN = Section(
    GAINS.of,
    (_row(value=lambda gains: gains.integral, unit=_INTEGRAL, diagnostics="integral", json="integral"),),
)
# Of an assessment, where the friction is learnt.
UNCERTAINTY = Section(
    lambda known: known.assessment,
    (
        _row(value=lambda state: state.margin_std, unit=_ENERGY, diagnostics="energy_margin std",
             json="std", margins=_field(17, "margin_std")),
        _row(value=lambda state: state.stick_slip_probability, unit="1", diagnostics="stick_slip_probability",
             json="stick_slip_probability", margins=_field(18, "stick_slip_probability")),
    ),
)  # fmt: skip
# Of an ExactVerdict, where the friction is learnt.
EXACT_UNCERTAINTY = Section(
    lambda known: known.exact,
    (_row(value=lambda exact: exact.stick_slip_probability, unit="1", diagnostics="exact stick_slip_probability",
          json="exact_stick_slip_probability", fleet="exact_stick_slip_probability"),),
)  # fmt: skip
BELIEF = Section(
    lambda known: known.assessment,
    (
        _row(value=lambda state: state.rests_on, diagnostics="margin rests on", json="rests_on"),
        _row(value=lambda state: state.per_inertia, json="per_inertia", fleet="per_inertia"),
    ),
)
# Of a Recommendation.
ADVICE = Section(
    lambda known: known.assessment.recommendation,
    (
        _row(value=lambda advice: advice.keep, json="keep"),
        _row(value=lambda advice: advice.condition, diagnostics="recommendation is by", json="condition"),
        _row(value=lambda advice: advice.velocity, unit="rad/s", diagnostics="recommended for velocity",
             json="velocity"),
        _row(value=lambda advice: advice.gains_known, json="gains_known"),
    ),
)  # fmt: skip
ADVICE_REACHES = Section(
    ADVICE.of,
    (_row(value=lambda advice: advice.slowest_smooth_velocity, unit="rad/s",
          diagnostics="recommended lowest_smooth_velocity", json="lowest_smooth_velocity"),),
)  # fmt: skip
# Of a Variant of it; in diagnostics with a prefix, "recommended " or the variant's own.
ADVISED_GAINS = Section(
    lambda known: known.assessment.recommended,
    (
        _row(value=lambda variant: variant.stiffness, unit=_STIFFNESS, diagnostics="stiffness", json="stiffness",
             fleet="advised_stiffness"),
        _row(value=lambda variant: variant.damping, unit=_DAMPING, diagnostics="damping", json="damping",
             fleet="advised_damping"),
    ),
)  # fmt: skip
ADVISED_MARGIN = Section(
    ADVISED_GAINS.of,
    (
        _row(value=lambda variant: variant.energy_margin, json="energy_margin"),
        _row(value=lambda variant: variant.reserve, unit="1", diagnostics="damping reserve", json="reserve"),
    ),
)
ADVISED_ANSWERS = Section(
    ADVISED_GAINS.of,
    (
        _row(value=lambda variant: variant.exactly_smooth, diagnostics="exact smooth", json="exactly_smooth"),
        _row(value=lambda variant: variant.slides_steadily, diagnostics="slides steadily", json="slides_steadily"),
        _row(value=lambda variant: variant.outcome, diagnostics="outcome", json="outcome"),
    ),
)
ADVISED_FACTORS = Section(
    ADVISED_GAINS.of,
    (
        _row(value=lambda variant: variant.stiffness_factor, unit="1", diagnostics="stiffness_factor",
             json="stiffness_factor", margins=_field(19, "stiffness_factor")),
        _row(value=lambda variant: variant.damping_factor, unit="1", diagnostics="damping_factor",
             json="damping_factor", margins=_field(20, "damping_factor")),
        _row(value=lambda variant: variant.change, json="change"),
    ),
)  # fmt: skip
ADVISED_COST = Section(
    ADVISED_GAINS.of,
    (
        _row(value=lambda variant: variant.bandwidth, unit="rad/s", diagnostics="bandwidth", json="bandwidth"),
        _row(value=lambda variant: variant.tracking_error_factor, unit="1", diagnostics="tracking_error_factor",
             json="tracking_error_factor"),
        _row(value=lambda variant: variant.noise_factor, unit="1", diagnostics="noise_factor", json="noise_factor"),
    ),
)  # fmt: skip
TRIAL_GAINS = _on_trial(GAINS, lambda known: known.assessment.trial, {})
TRIAL_MARGIN = _on_trial(
    MARGIN,
    lambda known: known.assessment.trial_margin,
    {"energy_margin": 21, "damping_ratio": 22, "critical_damping_ratio": 23},
)
TRIAL_EXACT = Section(
    lambda known: known.trial,
    (
        _row(value=lambda exact: exact.smooth, diagnostics="trial exact smooth",
             margins=_field(24, "trial_exact_smooth")),
        _row(value=lambda exact: exact.outcome, diagnostics="trial exact outcome"),
    ),
)  # fmt: skip
CYCLES = Section(
    lambda known: known.assessment.cycles,
    (_row(value=lambda count: count, unit="1", diagnostics="cycles", margins=_field(12, "cycles")),),
)
# Of a Cycle: one alone, and the size of the last one, with a prefix in diagnostics.
CYCLE_BEGINS = Section(
    lambda known: known.assessment.last_cycle,
    (
        _row(value=lambda cycle: cycle.breakaway, unit="s", diagnostics="breakaway", json="breakaway"),
        _row(value=lambda cycle: cycle.arrest, unit="s", diagnostics="arrest", json="arrest"),
    ),
)
CYCLE_SIZE = Section(
    CYCLE_BEGINS.of,
    (
        _row(value=lambda cycle: cycle.slip_distance, unit="rad", diagnostics="slip_distance", json="slip_distance"),
        _row(value=lambda cycle: cycle.dwell, unit="s", diagnostics="dwell", json="dwell"),
        _row(value=lambda cycle: cycle.slip_duration, unit="s", diagnostics="slip duration"),
    ),
)
CYCLE_PLACE = Section(
    CYCLE_BEGINS.of,
    (
        _row(value=lambda cycle: cycle.position, unit="rad", diagnostics="position", json="position"),
        _row(value=lambda cycle: cycle.effort, unit=_TORQUE, diagnostics="breakaway_effort", json="breakaway_friction"),
        _row(value=lambda cycle: cycle.hunting, json="hunting"),
    ),
)
# Of a ReversalRecord.
REVERSALS = Section(
    lambda known: known.assessment.reversals,
    (
        _row(value=lambda seen: seen.count, unit="1", diagnostics="reversals", json="count"),
        _row(value=lambda seen: seen.standing, unit="s", diagnostics="reversal standing", json="standing",
             fleet="reversal_standing", margins=_field(26, "reversal_standing")),
        _row(value=lambda seen: seen.lost_motion, unit="rad", diagnostics="reversal lost_motion", json="lost_motion"),
        _row(value=lambda seen: seen.peak_error, unit="rad", diagnostics="reversal peak_error", json="peak_error",
             fleet="reversal_peak_error", margins=_field(27, "reversal_peak_error")),
        _row(value=lambda seen: seen.largest_error, unit="rad", diagnostics="reversal largest peak_error",
             json="largest_error"),
    ),
)  # fmt: skip
# Of a PreslidingEstimate.
PRESLIDING = Section(
    lambda known: known.assessment.presliding,
    (
        _row(value=lambda seen: seen.stiffness.value, unit=_STIFFNESS, diagnostics="presliding_stiffness",
             json="value", fleet="presliding_stiffness"),
        _row(value=lambda seen: seen.stiffness.std, unit=_STIFFNESS, diagnostics="presliding_stiffness std",
             json="std", fleet="presliding_stiffness_std"),
        _row(value=lambda seen: seen.stiffness.identified, diagnostics="presliding_stiffness identified",
             json="identified", fleet="presliding_stiffness_identified"),
        _row(value=lambda seen: seen.at_least, unit=_STIFFNESS, diagnostics="presliding_stiffness at least",
             json="at_least", fleet="presliding_stiffness_at_least"),
        _row(value=lambda seen: seen.contact, diagnostics="presliding contact", json="contact"),
        _row(value=lambda seen: seen.rests, unit="1", diagnostics="rests learnt from", json="rests"),
    ),
)  # fmt: skip
POSITION = Section(
    lambda known: known.assessment,
    (
        _row(value=lambda state: state.resolution, unit="rad", diagnostics="position resolution", json="resolution"),
        _row(value=lambda state: state.noise, unit="rad", diagnostics="position noise", json="noise"),
    ),
)
SAMPLING = Section(
    lambda known: known.assessment,
    (_row(value=lambda state: state.sample_rate, unit="Hz", diagnostics="sample rate", json="sample_rate",
          fleet="sample_rate"),),
)  # fmt: skip
OF_ADVICE = (ADVICE, ADVICE_REACHES, ADVISED_GAINS, ADVISED_MARGIN, ADVISED_ANSWERS, ADVISED_FACTORS, ADVISED_COST)
SECTIONS = (
    STATUS, VELOCITY, MARGIN, MARGIN_TERMS, LOWEST_SMOOTH_VELOCITY, EXACT, RESERVE, GAINS, INTEGRAL_GAIN, UNCERTAINTY,
    EXACT_UNCERTAINTY, BELIEF,
    *OF_ADVICE, TRIAL_GAINS, TRIAL_MARGIN, TRIAL_EXACT, CYCLES, CYCLE_BEGINS, CYCLE_SIZE, CYCLE_PLACE, REVERSALS,
    PRESLIDING, POSITION, SAMPLING,
)  # fmt: skip
