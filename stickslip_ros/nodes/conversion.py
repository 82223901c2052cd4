# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Between ROS messages and the monitoring floor's arrays."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

from stickslip_ros.errors import StickSlipError
from stickslip_ros.model.friction import Gains, steady_friction
from stickslip_ros.model.margin import StabilityMargin
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.status import Status


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
