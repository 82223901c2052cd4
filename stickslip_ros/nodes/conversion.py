# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Between ROS messages and the monitoring floor's arrays."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

from stickslip_ros.errors import StickSlipError
from stickslip_ros.model.friction import Gains, steady_friction
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.detection import Cycle
from stickslip_ros.monitoring.estimation import FrictionEstimate
from stickslip_ros.monitoring.joint_monitor import Assessment
from stickslip_ros.monitoring.status import Status
from stickslip_ros.nodes.joint_parameters import FRICTION_UNITS

ESTIMATE_UNITS = {"inertia": "kg*m^2", **FRICTION_UNITS, "load": "N*m"}
PER_INERTIA = {"viscous": "1/s", "stribeck": "rad/s^2"}


class MessageError(StickSlipError, ValueError):
    """A message that cannot mean anything; the text says what is wrong with it."""


def seconds(stamp: Time) -> float:
    """A stamp as seconds."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def stamp(time: float) -> Time:
    """Seconds as a stamp."""
    nanoseconds = round(time * 1e9)
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def joint_rows(message: JointState) -> dict[str, tuple[float, float, float]]:
    """Position, velocity and effort of every joint in a message; NaN for what is missing.

    Raises
    ------
    MessageError
        If an array is neither empty nor as long as the names, or a name occurs twice.
    """
    names = message.name
    columns = []
    for field in ("position", "velocity", "effort"):
        values = getattr(message, field)
        if len(values) not in (0, len(names)):
            raise MessageError(f"{field} has {len(values)} values for {len(names)} names; it must have as many or none")
        columns.append(values if len(values) else [math.nan] * len(names))
    if len(set(names)) != len(names):
        raise MessageError(f"a joint name occurs twice in {', '.join(names)}")
    return dict(zip(names, zip(*columns, strict=True), strict=True))


def gains_from_message(message: Float64MultiArray) -> dict[str, Gains]:
    """Gains of every joint in a `pd_gains` message.

    Raises
    ------
    MessageError
        If the layout is not [joint (names joined by commas), gain ("p,d" or "p,i,d")], or a gain is
        not finite.
    """
    dimensions = message.layout.dim
    if len(dimensions) != 2:
        raise MessageError(f"pd_gains needs layout.dim = [joints, gains], got {len(dimensions)} dimensions")
    joints = [name.strip() for name in dimensions[0].label.split(",")]
    kinds = [name.strip() for name in dimensions[1].label.split(",")]
    if kinds not in (["p", "d"], ["p", "i", "d"]):
        raise MessageError(f"the gains' label must be 'p,d' or 'p,i,d': {dimensions[1].label!r}")
    expected = len(joints) * len(kinds)
    if len(message.data) != expected:
        raise MessageError(
            f"pd_gains needs {expected} values for {len(joints)} joints by {len(kinds)} gains, got {len(message.data)}"
        )
    gains = {}
    for index, joint in enumerate(joints):
        row = dict(zip(kinds, message.data[index * len(kinds) : (index + 1) * len(kinds)], strict=True))
        for kind, value in row.items():
            if not math.isfinite(value):
                raise MessageError(f"gain {kind} of {joint} must be finite: {value}")
        gains[joint] = Gains(stiffness=row["p"], damping=row["d"], integral=row.get("i", 0.0))
    return gains


def table(rows: Sequence[str], columns: Sequence[str], values: Sequence[float]) -> Float64MultiArray:
    """A labelled table, row by row, in the layout of `pd_gains`."""
    message = Float64MultiArray()
    message.layout.dim = [
        MultiArrayDimension(label=",".join(rows), size=len(rows), stride=len(rows) * len(columns)),
        MultiArrayDimension(label=",".join(columns), size=len(columns), stride=len(columns)),
    ]
    message.data = [float(value) for value in values]
    return message


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
)
STATUS_NUMBERS = {status: index for index, status in enumerate(Status)}


def margin_row(assessment: Assessment, exact: ExactVerdict) -> list[float]:
    """The numbers of :data:`MARGIN_FIELDS`; NaN for what is unknown or not applicable."""
    margin, gains = assessment.margin, assessment.gains
    from_margin = MARGIN_FIELDS[2:8]
    return [
        float(STATUS_NUMBERS[assessment.finding.status]),
        float(margin is not None and bool(margin.applicable)),
        *(math.nan if margin is None else float(getattr(margin, name)) for name in from_margin),
        assessment.velocity,
        assessment.lowest_smooth_velocity,
        math.nan if gains is None else float(gains.stiffness),
        math.nan if gains is None else float(gains.damping),
        float(assessment.cycles),
        math.nan if exact.smooth is None else float(exact.smooth),
        exact.critical_damping_ratio,
        exact.lowest_smooth_velocity,
        exact.least_smooth_stiffness,
        assessment.margin_std,
        assessment.stick_slip_probability,
        *_factors(assessment),
    ]


def _factors(assessment: Assessment) -> tuple[float, float]:
    """Advice as factors on stiffness and damping."""
    advice = assessment.recommendation
    return (math.nan, math.nan) if advice is None else (advice.stiffness_factor, advice.damping_factor)


def friction_message(time: Time, assessments: Mapping[str, Assessment]) -> JointState:
    """Friction of every joint at its speed, by the joint that its margin uses; NaN where none is known."""
    message = JointState(name=list(assessments))
    message.header.stamp = time
    for assessment in assessments.values():
        message.position.append(assessment.position)
        message.velocity.append(assessment.mean_velocity)
        known = assessment.joint is not None and math.isfinite(assessment.mean_velocity)
        friction = math.nan
        if known and assessment.joint is not None and not assessment.per_inertia:
            friction = float(steady_friction(assessment.joint.friction, assessment.mean_velocity))
        message.effort.append(friction)
    return message


def friction_values(estimate: FrictionEstimate) -> list[tuple[str, object]]:
    """What was learnt, one number a key, and the whole in words."""
    values: list[tuple[str, object]] = []
    words = []
    for name, unit in ESTIMATE_UNITS.items():
        found = estimate.load if name == "load" else estimate[name]
        if estimate.normalised:
            if name in ("inertia", "coulomb", "load"):
                continue
            unit = PER_INERTIA.get(name, unit)
        if math.isnan(found.value):
            continue
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
        ("slips learnt from [1]", estimate.slips),
        ("slips not explained [1]", estimate.aside),
        ("friction fit mean square [1]", estimate.mean_square),
    ]
    return values


def joint_diagnostic(
    name: str, assessment: Assessment, exact: ExactVerdict, *, warn_margin: float, silent_for: float | None
) -> DiagnosticStatus:
    """One joint's status: a summary for a person, every number as a key with its unit for programs."""
    status = DiagnosticStatus(name=f"stickslip_monitor: {name}", hardware_id=name)
    status.level, status.message = _summary(assessment, warn_margin, silent_for)
    gains, margin, advice, cycle = assessment.gains, assessment.margin, assessment.recommendation, assessment.last_cycle
    values: list[tuple[str, object]] = [
        ("status", assessment.finding.status.value),
        ("reason", assessment.finding.reason),
        ("velocity [rad/s]", assessment.velocity),
        ("velocity is from", assessment.velocity_source),
        ("margin applicable", "" if margin is None else str(bool(margin.applicable)).lower()),
        ("margin reason", assessment.margin_reason),
    ]
    if margin is not None:
        values += [
            ("energy_margin [M*stribeck_velocity^2]", margin.energy_margin),
            ("damping_ratio [1]", margin.damping_ratio),
            ("critical_damping_ratio [1]", margin.critical_damping_ratio),
            ("reduction_factor [1]", margin.reduction_factor),
            ("steady_stribeck [N*m]", margin.steady_stribeck),
            ("natural_frequency [rad/s]", margin.natural_frequency),
            ("lowest_smooth_velocity [rad/s]", assessment.lowest_smooth_velocity),
        ]
    if exact.smooth is not None:
        values += [
            ("exact smooth", str(exact.smooth).lower()),
            ("exact critical_damping_ratio [1]", exact.critical_damping_ratio),
            ("exact lowest_smooth_velocity [rad/s]", exact.lowest_smooth_velocity),
            ("exact least_smooth_stiffness [N*m/rad]", exact.least_smooth_stiffness),
        ]
    if exact.reason:
        values.append(("exact reason", exact.reason))
    if gains is not None:
        values += [
            ("stiffness [N*m/rad]", gains.stiffness),
            ("damping [N*m*s/rad]", gains.damping),
            ("integral [N*m/(rad*s)]", gains.integral),
        ]
    if advice is not None:
        values += [
            ("recommended stiffness_factor [1]", advice.stiffness_factor),
            ("recommended damping_factor [1]", advice.damping_factor),
            ("recommendation", advice.reason),
        ]
        if gains is not None:
            values += [
                ("recommended stiffness [N*m/rad]", advice.stiffness),
                ("recommended damping [N*m*s/rad]", advice.damping),
            ]
    if assessment.rests_on:
        values.append(("margin rests on", assessment.rests_on))
    if math.isfinite(assessment.margin_std):
        values += [
            ("energy_margin std [M*stribeck_velocity^2]", assessment.margin_std),
            ("stick_slip_probability [1]", assessment.stick_slip_probability),
        ]
    if assessment.estimate is not None:
        values += friction_values(assessment.estimate)
    if assessment.notice:
        values.append(("friction change", assessment.notice))
    values.append(("cycles [1]", assessment.cycles))
    if cycle is not None:
        values += [
            ("last slip_distance [rad]", cycle.slip_distance),
            ("last dwell [s]", cycle.dwell),
            ("last slip duration [s]", cycle.slip_duration),
        ]
    values += [
        ("position resolution [rad]", assessment.resolution),
        ("position noise [rad]", assessment.noise),
        ("sample rate [Hz]", assessment.sample_rate),
        ("samples left out", "; ".join(f"{reason}: {count}" for reason, count in assessment.dropped.items())),
    ]
    status.values = [KeyValue(key=key, value=_value_text(value)) for key, value in values]
    return status


def _summary(assessment: Assessment, warn_margin: float, silent_for: float | None) -> tuple[bytes, str]:
    finding, margin = assessment.finding, assessment.margin
    text = finding.status.value + (f": {finding.reason}" if finding.reason else "")
    if silent_for is not None:
        return DiagnosticStatus.STALE, f"no data for {silent_for:.1f} s (was {finding.status.value})"
    if finding.status is Status.STICK_SLIP:
        advice = assessment.recommendation
        if assessment.notice.endswith("learning anew"):
            text += f"; {assessment.notice}"
        return DiagnosticStatus.ERROR, f"{text}; {advice.reason}" if advice is not None else text
    if finding.status in (Status.AT_RISK, Status.UNKNOWN):
        return DiagnosticStatus.WARN, text
    if assessment.estimate is not None and assessment.estimate.mismatch:
        return DiagnosticStatus.WARN, f"{text}; {assessment.estimate.mismatch}"
    if margin is None:
        return DiagnosticStatus.WARN, f"{text}; no margin: {assessment.margin_reason}"
    if margin.applicable and not margin.damping_ratio >= (1.0 + warn_margin) * margin.critical_damping_ratio:
        return DiagnosticStatus.WARN, f"{text}; margin of Eq. (43) is thin: {margin.energy_margin:.3g}"
    return DiagnosticStatus.OK, text


def cycle_diagnostic(name: str, cycle: Cycle) -> DiagnosticStatus:
    """One completed cycle."""
    values = [
        ("breakaway [s]", cycle.breakaway),
        ("arrest [s]", cycle.arrest),
        ("slip_distance [rad]", cycle.slip_distance),
        ("dwell [s]", cycle.dwell),
        ("slip duration [s]", cycle.slip_duration),
        ("position [rad]", cycle.position),
        ("breakaway_effort [N*m]", cycle.effort),
    ]
    return DiagnosticStatus(
        level=DiagnosticStatus.WARN,
        name=f"stickslip_monitor: {name}",
        hardware_id=name,
        message=f"slip of {cycle.slip_distance:.4g} rad after {cycle.dwell:.3g} s at rest",
        values=[KeyValue(key=key, value=_value_text(value)) for key, value in values],
    )


def _value_text(value: object) -> str:
    """Numbers bare and in full, so that plotting tools take them."""
    return repr(float(value)) if isinstance(value, float) else str(value)
