# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Messages of other encodings (ROS 1, JSON) as those of ROS 2, so that whoever reads a bag sees one encoding."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from stickslip_ros.bags.decoding import types_of, types_of_ros
from stickslip_ros.bags.topics import READ_TYPES
from stickslip_ros.messages.joint_states import Channel, MessageError

Transcode = Callable[[bytes], bytes]
_OTHER_NAMES = {"nanosec": "nsec"}  # as Foxglove has it


def transcoded(channel: Channel) -> tuple[Channel, Transcode | None]:
    """A channel as ROS 2 has it, and what makes its messages of it; the channel itself and None if it is so, or of an
    encoding that is not known.
    """
    kind = _of_ros2(channel.type)
    if channel.encoding not in _ENCODINGS or kind not in READ_TYPES:
        return channel, None
    types, to_cdr = _ENCODINGS[channel.encoding]
    store = types(kind, channel.schema)
    if store is None or kind not in store.fielddefs:
        return channel, None
    try:
        schema = store.generate_msgdef(kind, ros_version=2)[0]
    except Exception:
        # It names a type that it does not define: what the generator raises then cannot be listed.
        return channel, None
    found = replace(channel, type=kind, encoding="cdr", schema_encoding="ros2msg", schema=schema)

    def transcode(message: bytes) -> bytes:
        try:
            return bytes(to_cdr(store, kind, message))
        except Exception as error:
            # What damaged bytes make generated code raise cannot be listed.
            raise MessageError(f"it is no {kind} in {channel.encoding}") from error

    return found, transcode


def _of_ros2(kind: str) -> str:
    """sensor_msgs/JointState, sensor_msgs.msg.JointState: as ROS 2 writes a type."""
    parts = kind.replace(".", "/").split("/")
    return "/".join((parts[0], "msg", parts[-1])) if len(parts) in (2, 3) else kind


def _made(store: Any, kind: str, values: Any) -> Any:
    """An object of a type, of what JSON has of it; what is missing is zero or empty."""
    if not isinstance(values, dict):
        raise MessageError(f"{kind} must be an object of JSON")
    fields = {}
    for name, description in store.fielddefs[kind][1]:
        value = values.get(name, values.get(_OTHER_NAMES.get(name, name)))
        fields[name] = _value(store, description, value)
    return store.types[kind](**fields)


def _value(store: Any, description: tuple[Any, Any], value: Any) -> Any:
    sort, of = description
    if sort.name == "NAME":
        return _made(store, of, {} if value is None else value)
    if sort.name == "BASE":
        return _number(of[0], value)
    (element, name), _ = of
    listed = [] if value is None else list(value)
    if element.name == "NAME":
        return [_made(store, name, one) for one in listed]
    if name[0] == "string":
        return [str(one) for one in listed]
    return np.array([_number(name[0], one) for one in listed], dtype=np.dtype(name[0]))


def _number(name: str, value: Any) -> Any:
    if name == "string":
        return "" if value is None else str(value)
    if name.startswith("float"):
        # JSON has no NaN but null.
        return math.nan if value is None else float(value)
    return bool(value) if name == "bool" else int(value or 0)


# Of each encoding the types, and what makes a message one of ROS 2. JSON's schemas do not say which integers and floats
# are meant: the types are ROS 2's own.
_ENCODINGS: dict[str, tuple[Callable[[str, str], Any], Callable[[Any, str, bytes], Any]]] = {
    "ros1": (
        lambda kind, schema: types_of(kind, "ros1msg", schema),
        lambda store, kind, message: store.ros1_to_cdr(message, kind),
    ),
    "json": (
        lambda _, __: types_of_ros(),
        lambda store, kind, message: store.serialize_cdr(_made(store, kind, json.loads(message)), kind),
    ),
}
