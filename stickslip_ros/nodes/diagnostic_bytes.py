# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Diagnoses as the bytes of a DiagnosticArray, made here: rclpy takes several times as long, for all keys anew.

The encoding is CDR (OMG, Common Data Representation), little-endian, as every ROS 2 middleware takes it.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from functools import lru_cache

from builtin_interfaces.msg import Time

from stickslip_ros.output.diagnosis import Diagnosis

_ENCAPSULATION = b"\x00\x01\x00\x00"
_ALIGNED = 4  # numbers and lengths of texts begin at multiples of it
_LENGTH = struct.Struct("<I")
_HEADER = struct.Struct("<iI")
_MOST_KNOWN = 4096  # texts


def diagnostic_array_bytes(stamp: Time, diagnoses: Iterable[Diagnosis], robot: str = "") -> bytes:
    """A serialized DiagnosticArray.

    Parameters
    ----------
    robot : goes before their names, "" or ending in a slash: robots have joints of the same names, and one
        /diagnostics.
    """
    statuses = list(diagnoses)
    data = bytearray(_ENCAPSULATION)
    data += _HEADER.pack(stamp.sec, stamp.nanosec)
    data += _text("")
    data += _LENGTH.pack(len(statuses))
    filled = 0  # bytes at the end that only fill up to the next multiple
    for one in statuses:
        # A level is one byte, and follows at once.
        if filled:
            data[-filled] = one.level
        else:
            data += bytes((one.level, 0, 0, 0))
        data += _known_text(robot + one.name)
        data += _text(one.message)
        data += _known_text(robot + one.hardware_id)
        data += _LENGTH.pack(len(one.values))
        last = b""
        for key, value in one.values:
            data += _known_text(key)
            last = _text(value)
            data += last
        filled = -(_LENGTH.unpack_from(last)[0]) % _ALIGNED if last else 0
    return bytes(data[: len(data) - filled])


def _text(text: str) -> bytes:
    """Length, characters and the zero after them, filled up."""
    characters = text.encode("utf-8", "replace") + b"\x00"
    return _LENGTH.pack(len(characters)) + characters + bytes(-len(characters) % _ALIGNED)


_known_text = lru_cache(_MOST_KNOWN)(_text)  # keys and names are the same ones all the time
