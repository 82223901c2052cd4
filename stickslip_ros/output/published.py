# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Everything that is published of a joint, one row each: its unit, where it comes from, and its name in every output.

A new number is a row in a section, and nothing else: diagnostics, `~/margins`, JSON and the table of a fleet have it
under the names that the row gives. Each output prints the sections in an order of its own, and the rows of a section
in the order that they have here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import Enum
from functools import cached_property
from operator import attrgetter
from typing import Any, NamedTuple

from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import (
    FRICTION_PARAMETERS,
    PRESLIDING_PARAMETERS,
    Friction,
    Gains,
    Joint,
    Transmission,
)
from stickslip_ros.model.units import in_ascii, unit_of
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.assessment import NOT_COMPUTED, Assessment
from stickslip_ros.monitoring.detection.status import Status

_STATUS_NUMBERS = {status: index for index, status in enumerate(Status)}


@dataclass(frozen=True, kw_only=True)
class Findings:
    """What there is to publish of a joint.

    Attributes
    ----------
    exact, trial : verdicts on the present gains and on those on trial. here : on the present gains at the present
        position and load, None where friction is not known to vary; the others are of the worst place then.
    silent_for : time without samples [s], None if samples come, infinite if none ever came.
    trouble : why the joint cannot be judged, or "".
    missing : why states, gains or references are missing, or "".
    applied : last outcome of `~/apply_recommendation`, or "".
    conditions : beyond the paper, as configured.
    """

    assessment: Assessment
    exact: ExactVerdict
    trial: ExactVerdict = NOT_COMPUTED
    here: ExactVerdict | None = None
    silent_for: float | None = None
    trouble: str = ""
    missing: str = ""
    applied: str = ""
    conditions: OperatingConditions = field(default_factory=OperatingConditions)


class MarginField(NamedTuple):
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

    of: Callable[[Findings], Any]
    rows: tuple[Published, ...]

    def for_diagnostics(self, subject: Any, prefix: str = "") -> list[tuple[str, object]]:
        """Keys and values; what has no answer, or an empty text, is left out. Nothing if there is no subject."""
        if subject is None:
            return []
        found = [(row.key(prefix), row.value(subject)) for row in self.rows if row.diagnostics]
        return [(key, _as_text(value)) for key, value in found if value is not None and value != ""]

    def for_json(self, subject: Any) -> dict[str, Any]:
        """An object for JSON; null for what is unknown or infinite."""
        return {row.json: _as_json(row.value(subject)) for row in self.rows if row.json}

    def for_fleet(self, found: Mapping[str, Any] | None) -> dict[str, Any]:
        """Columns of a fleet's table, from the JSON object; all None without one."""
        return {row.fleet: None if found is None else found[row.json] for row in self.rows if row.fleet}


def for_json(subject: Any, *sections: Section) -> Any:
    """Sections about one thing as an object for JSON; None without it."""
    return None if subject is None else {key: one for each in sections for key, one in each.for_json(subject).items()}


def number(value: Any) -> float | None:
    """A number that JSON can hold, or None."""
    return float(value) if math.isfinite(float(value)) else None


def numbers(subject: Any, *names: str) -> dict[str, float | None]:
    """Attributes of an object, each a number that JSON can hold, or None."""
    return {name: number(getattr(subject, name)) for name in names}


def numbers_or_null(subject: Any, names: Sequence[str]) -> dict[str, float | None] | None:
    """The same of an object that need not be there."""
    return None if subject is None else numbers(subject, *names)


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


def _on_trial(section: Section, of: Callable[[Findings], Any], places: Mapping[str, int]) -> Section:
    """The section about the gains on trial: in `~/margins` those of its fields that are given places."""

    def row_of(row: Published) -> Published:
        name = row.margins.name if row.margins is not None else ""
        margins = MarginField(places[name], f"trial_{name}") if name in places else None
        return replace(row, diagnostics=row.diagnostics and f"trial {row.diagnostics}", margins=margins)

    return Section(of, tuple(map(row_of, section.rows)))


def _row(
    name: str,
    unit: str = "",
    place: int | None = None,
    *,
    value: Callable[[Any], Any] | None = None,
    diagnostics: str | None = None,
    json: str | None = None,
    fleet: str = "",
    margins: str = "",
) -> Published:
    """The row of an attribute; where no other name or value is given, it has the attribute's. ``place`` : in
    `~/margins`.
    """
    return Published(
        value=value or attrgetter(name),
        unit=unit,
        diagnostics=name if diagnostics is None else diagnostics,
        json=name if json is None else json,
        fleet=fleet,
        margins=None if place is None else MarginField(place, margins or name),
    )


def _exact(name: str, unit: str = "", place: int | None = None, **names: Any) -> Published:
    """The row of an attribute of an ExactVerdict."""
    return _row(name, unit, place, diagnostics=f"exact {name}", margins=f"exact_{name}", **names)


def _itself(subject: Any) -> Any:
    return subject


STATUS = Section(
    lambda found: found.assessment.finding.status, (_row("status", place=0, value=_itself, fleet="status"),)
)
VELOCITY = Section(
    lambda found: found.assessment.velocity, (_row("velocity", "rad/s", 8, value=_itself, fleet="velocity"),)
)
# What Eq. (43) says of gains, a StabilityMargin; of those on trial it is published too.
MARGIN = Section(
    lambda found: found.assessment.margin,
    (
        Published(value=lambda margin: bool(margin.applicable), diagnostics="margin applicable", json="applicable",
                  margins=MarginField(1, "applicable", unknown=0.0)),
        _row("reason", diagnostics=""),
        _row("smooth", value=lambda margin: bool(margin.smooth) if margin.applicable else None, diagnostics=""),
        _row("energy_margin", _ENERGY, 2, fleet="energy_margin"),
        _row("damping_ratio", "1", 3, fleet="damping_ratio"),
        _row("critical_damping_ratio", "1", 4, fleet="critical_damping_ratio"),
    ),
)  # fmt: skip
# What it says more of the present gains.
MARGIN_TERMS = Section(
    MARGIN.of,
    (
        _row("reduction_factor", "1", 5),
        _row("steady_stribeck", _TORQUE, 6),
        _row("natural_frequency", "rad/s", 7, json=""),
    ),
)
LOWEST_SMOOTH_VELOCITY = Section(
    lambda found: found.assessment.lowest_smooth_velocity,
    (_row("lowest_smooth_velocity", "rad/s", 9, value=_itself, fleet="lowest_smooth_velocity"),),
)
# By integration of Eqs (4)-(6), an ExactVerdict.
EXACT = Section(
    lambda found: found.exact,
    (
        _exact("smooth", place=13, fleet="exactly_smooth"),
        _exact("outcome", fleet="exact_outcome"),
        _exact("depends_on_start", value=lambda exact: None if exact.outcome is None else exact.depends_on_start),
        _row("reason", diagnostics=""),  # diagnostics have it where all else is unknown
        _exact("critical_damping_ratio", "1", 14),
        _exact("steady_damping_ratio", "1", 25, fleet="steady_damping_ratio"),
        _exact("lowest_smooth_velocity", "rad/s", 15),
        _exact("least_smooth_stiffness", _STIFFNESS, 16),
    ),
)
# Of an ExactVerdict too; known before all else of it.
RESERVE = Section(EXACT.of, (_exact("damping_reserve", "1", 28, fleet="reserve"),))
GAINS = Section(
    lambda found: found.assessment.gains,
    (_row("stiffness", _STIFFNESS, 10, fleet="stiffness"), _row("damping", _DAMPING, 11, fleet="damping")),
)
INTEGRAL_GAIN = Section(GAINS.of, (_row("integral", _INTEGRAL),))
# Of an assessment, where the friction is learnt.
UNCERTAINTY = Section(
    lambda found: found.assessment,
    (
        _row("margin_std", _ENERGY, 17, diagnostics="energy_margin std", json="std"),
        _row("stick_slip_probability", "1", 18),
    ),
)
# Of an ExactVerdict, where the friction is learnt.
EXACT_UNCERTAINTY = Section(
    EXACT.of,
    (_exact("stick_slip_probability", "1", json="exact_stick_slip_probability", fleet="exact_stick_slip_probability"),),
)
BELIEF = Section(
    lambda found: found.assessment,
    (_row("rests_on", diagnostics="margin rests on"), _row("per_inertia", diagnostics="", fleet="per_inertia")),
)
# Of a Recommendation.
ADVICE = Section(
    lambda found: found.assessment.recommendation,
    (
        _row("keep", diagnostics=""),
        _row("condition", diagnostics="recommendation is by"),
        _row("velocity", "rad/s", diagnostics="recommended for velocity"),
        _row("gains_known", diagnostics=""),
    ),
)
ADVICE_REACHES = Section(
    ADVICE.of,
    (_row("slowest_smooth_velocity", "rad/s", diagnostics="recommended lowest_smooth_velocity",
          json="lowest_smooth_velocity"),),
)  # fmt: skip
# Of a Variant of it; in diagnostics with a prefix, "recommended " or the variant's own.
ADVISED_GAINS = Section(
    lambda found: found.assessment.recommended,
    (
        _row("stiffness", _STIFFNESS, fleet="advised_stiffness"),
        _row("damping", _DAMPING, fleet="advised_damping"),
    ),
)
ADVISED_MARGIN = Section(
    ADVISED_GAINS.of,
    (_row("energy_margin", diagnostics=""), _row("reserve", "1", diagnostics="damping reserve")),
)
ADVISED_ANSWERS = Section(
    ADVISED_GAINS.of,
    (
        _row("exactly_smooth", diagnostics="exact smooth"),
        _row("slides_steadily", diagnostics="slides steadily"),
        _row("outcome"),
    ),
)
ADVISED_FACTORS = Section(
    ADVISED_GAINS.of,
    (
        _row("stiffness_factor", "1", 19),
        _row("damping_factor", "1", 20),
        _row("damping_time", "s"),
        _row("change", diagnostics=""),
    ),
)
ADVISED_COST = Section(
    ADVISED_GAINS.of,
    (_row("bandwidth", "rad/s"), _row("tracking_error_factor", "1"), _row("noise_factor", "1")),
)
TRIAL_GAINS = _on_trial(GAINS, lambda found: found.assessment.trial, {})
TRIAL_MARGIN = _on_trial(
    MARGIN,
    lambda found: found.assessment.trial_margin,
    {"energy_margin": 21, "damping_ratio": 22, "critical_damping_ratio": 23},
)
TRIAL_EXACT = Section(
    lambda found: found.trial,
    (
        _row("smooth", place=24, diagnostics="trial exact smooth", json="", margins="trial_exact_smooth"),
        _row("outcome", diagnostics="trial exact outcome", json=""),
    ),
)
CYCLES = Section(lambda found: found.assessment.cycles, (_row("cycles", "1", 12, value=_itself, json=""),))
# Of a Cycle: one alone, and the size of the last one, with a prefix in diagnostics.
CYCLE_BEGINS = Section(lambda found: found.assessment.last_cycle, (_row("breakaway", "s"), _row("arrest", "s")))
CYCLE_SIZE = Section(
    CYCLE_BEGINS.of,
    (
        _row("slip_distance", "rad"),
        _row("dwell", "s"),
        _row("slip_duration", "s", diagnostics="slip duration", json=""),
    ),
)
CYCLE_PLACE = Section(
    CYCLE_BEGINS.of,
    (
        _row("position", "rad"),
        _row("effort", _TORQUE, diagnostics="breakaway_effort", json="breakaway_friction"),
        _row("hunting", diagnostics=""),
    ),
)
# Of a ReversalRecord.
REVERSALS = Section(
    lambda found: found.assessment.reversals,
    (
        _row("count", "1", diagnostics="reversals"),
        _row("standing", "s", 26, diagnostics="reversal standing", fleet="reversal_standing",
             margins="reversal_standing"),
        _row("lost_motion", "rad", diagnostics="reversal lost_motion"),
        _row("peak_error", "rad", 27, diagnostics="reversal peak_error", fleet="reversal_peak_error",
             margins="reversal_peak_error"),
        _row("largest_error", "rad", diagnostics="reversal largest peak_error"),
    ),
)  # fmt: skip
# Of a PreslidingEstimate.
PRESLIDING = Section(
    lambda found: found.assessment.presliding,
    (
        _row("stiffness.value", _STIFFNESS, diagnostics="presliding_stiffness", json="value",
             fleet="presliding_stiffness"),
        _row("stiffness.std", _STIFFNESS, diagnostics="presliding_stiffness std", json="std",
             fleet="presliding_stiffness_std"),
        _row("stiffness.identified", diagnostics="presliding_stiffness identified", json="identified",
             fleet="presliding_stiffness_identified"),
        _row("at_least", _STIFFNESS, diagnostics="presliding_stiffness at least",
             fleet="presliding_stiffness_at_least"),
        _row("contact", diagnostics="presliding contact"),
        _row("rests", "1", diagnostics="rests learnt from"),
    ),
)  # fmt: skip
# Of a RingEstimate.
RING = Section(
    lambda found: found.assessment.ring,
    (
        _row("frequency", "Hz", diagnostics="ring frequency", fleet="ring_frequency"),
        _row("frequency_std", "Hz", diagnostics="ring frequency std", fleet="ring_frequency_std"),
        _row("damping_ratio", "1", diagnostics="ring damping ratio", fleet="ring_damping_ratio"),
        _row("damping_ratio_std", "1", diagnostics="ring damping ratio std", fleet="ring_damping_ratio_std"),
        _row("rests", "1", diagnostics="rests that ring"),
    ),
)
POSITION = Section(
    lambda found: found.assessment,
    (
        _row("resolution", "rad", diagnostics="position resolution"),
        _row("noise", "rad", diagnostics="position noise"),
    ),
)
SAMPLING = Section(
    lambda found: found.assessment,
    (_row("sample_rate", "Hz", diagnostics="sample rate", fleet="sample_rate"),),
)
OF_VARIANT = (ADVISED_GAINS, ADVISED_MARGIN, ADVISED_ANSWERS, ADVISED_FACTORS, ADVISED_COST)
OF_ADVICE = (ADVICE, ADVICE_REACHES, *OF_VARIANT)
OF_CYCLE = (CYCLE_BEGINS, CYCLE_SIZE, CYCLE_PLACE)
SECTIONS = tuple(one for one in list(globals().values()) if isinstance(one, Section))

_MARGIN_ROWS = sorted(
    ((row.margins, section, row) for section in SECTIONS for row in section.rows if row.margins is not None),
    key=lambda found: found[0].place,
)
MARGIN_FIELDS = tuple(field.name for field, _, _ in _MARGIN_ROWS)
RESERVE_FIELD = "exact_damping_reserve"  # the field that tells in one number how far a joint is from stick-slip


def margin_row(found: Findings) -> list[float]:
    """The numbers of :data:`MARGIN_FIELDS`; NaN for what is unknown or not applicable."""
    numbers = []
    for margins, section, row in _MARGIN_ROWS:
        subject = section.of(found)
        numbers.append(_as_number(None if subject is None else row.value(subject), margins))
    return numbers


def _as_number(value: Any, field: MarginField) -> float:
    if isinstance(value, Status):
        return float(_STATUS_NUMBERS[value])
    return field.unknown if value is None else float(value)


# The joint that a monitor believes in, as keys of its diagnostics: a listener can compute with it.
_UNITS = {one.name: one.metadata.get("unit") for owner in (Joint, Friction, Transmission) for one in fields(owner)}
_PRESLIDING = tuple(one.name for one in PRESLIDING_PARAMETERS)
_BELIEVED = (
    "inertia", *(one.name for one in FRICTION_PARAMETERS), *_PRESLIDING, "actuation_delay",
    *(one.name for one in fields(Transmission)), "law", "contact",
)  # fmt: skip
_KEYS = {
    name: f"believed {name} [{in_ascii(unit)}]" if (unit := _UNITS[name]) else f"believed {name}" for name in _BELIEVED
}


def joint_values(joint: Joint) -> list[tuple[str, object]]:
    """Keys and values of a joint that is known with its inertia; SI units."""
    values = vars(joint) | vars(joint.friction) | ({} if joint.transmission is None else vars(joint.transmission))
    left_out = {*_PRESLIDING, "contact"} if joint.friction.rigid else set()
    left_out |= set() if joint.actuation_delay else {"actuation_delay"}
    known = {key: values[name] for name, key in _KEYS.items() if name in values and name not in left_out}
    return [(key, value if isinstance(value, str) else float(value)) for key, value in known.items()]


def published_joint(values: Mapping[str, str]) -> Joint | None:
    """The joint that diagnostics tell of; None if they tell of none, or of one that cannot be."""
    texts = {name: values[key] for name, key in _KEYS.items() if key in values}
    try:
        known: dict[str, Any] = {name: float(text) if _UNITS[name] else text for name, text in texts.items()}
        return Joint(
            inertia=known["inertia"],
            friction=Friction(**{one.name: known[one.name] for one in fields(Friction) if one.name in known}),
            transmission=Transmission.given(known),
            actuation_delay=known.get("actuation_delay", 0.0),
        )
    except (KeyError, TypeError, ValueError):
        return None
