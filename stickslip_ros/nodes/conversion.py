# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Messages of the monitoring floor's arrays and findings."""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping, Sequence

from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

from stickslip_ros.model.friction import steady_friction
from stickslip_ros.monitoring.assessment import Assessment


def stamp(time: float) -> Time:
    """Stamp of a time in seconds."""
    nanoseconds = round(time * 1e9)
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def table(rows: Sequence[str], columns: Sequence[str], values: Sequence[float]) -> Float64MultiArray:
    """Labelled table, row by row, in the layout of `pd_gains`."""
    message = Float64MultiArray()
    message.layout.dim = [
        MultiArrayDimension(label=",".join(rows), size=len(rows), stride=len(rows) * len(columns)),
        MultiArrayDimension(label=",".join(columns), size=len(columns), stride=len(columns)),
    ]
    message.data = array("d", values)
    return message


def friction_message(time: Time, assessments: Mapping[str, Assessment]) -> JointState:
    """Friction of every joint at its speed, by the friction that its margin uses; NaN where none is known."""
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
