# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Between ROS messages and the monitoring floor's arrays and findings.

Diagnoses become the bytes of a DiagnosticArray here, because rclpy takes several times as long. The encoding is CDR
(OMG, Common Data Representation), little-endian, as every ROS 2 middleware reads it.
"""

from __future__ import annotations

import math
import struct
from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

from stickslip_ros.model.friction import steady_friction
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.output.diagnosis import Diagnosis

_ENCAPSULATION = b"\x00\x01\x00\x00"
_ALIGNED = 4  # alignment of numbers and of lengths of texts, bytes: CDR has it
_LENGTH = struct.Struct("<I")
_HEADER = struct.Struct("<iI")
_MOST_TEXTS = 4096  # number of cached texts, 1: keys, and names of at most 256 joints


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


@dataclass(frozen=True, kw_only=True)
class StatusBytes:
    """Serialized DiagnosticStatus, at any place of an array.

    Attributes
    ----------
    body : bytes after the level. filled : number of padding bytes at the end of the body.
    """

    level: int
    body: bytes
    filled: int


def status_bytes(diagnosis: Diagnosis, robot: str = "") -> StatusBytes:
    """Serialize a status.

    Parameters
    ----------
    robot : prefix of the names, "" or ending in a slash: robots have joints of the same names, and one /diagnostics.
    """
    body = bytearray(_known_text(robot + diagnosis.name))
    body += _text(diagnosis.message)
    body += _known_text(robot + diagnosis.hardware_id)
    body += _LENGTH.pack(len(diagnosis.values))
    last = b""
    for key, value in diagnosis.values:
        body += _known_text(key)
        last = _text(value)
        body += last
    filled = -(_LENGTH.unpack_from(last)[0]) % _ALIGNED if last else 0
    return StatusBytes(level=diagnosis.level, body=bytes(body), filled=filled)


def diagnostic_array_bytes(stamp: Time, statuses: Iterable[StatusBytes]) -> bytes:
    """A serialized DiagnosticArray."""
    statuses = list(statuses)
    data = bytearray(_ENCAPSULATION)
    data += _HEADER.pack(stamp.sec, stamp.nanosec)
    data += _text("")
    data += _LENGTH.pack(len(statuses))
    filled = 0
    for one in statuses:
        # A level is one byte, and needs no padding before it.
        if filled:
            data[-filled] = one.level
        else:
            data += bytes((one.level, 0, 0, 0))
        data += one.body
        filled = one.filled
    return bytes(data[: len(data) - filled])


def _text(text: str) -> bytes:
    """Serialized text: length, characters, the zero after them, and padding."""
    characters = text.encode("utf-8", "replace") + b"\x00"
    return _LENGTH.pack(len(characters)) + characters + bytes(-len(characters) % _ALIGNED)


_known_text = lru_cache(_MOST_TEXTS)(_text)  # keys and names are the same all the time
