# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Messages of any type, by the definition that the bag carries; JointStates have a faster way of their own."""

from __future__ import annotations

import re
from functools import lru_cache
from importlib import import_module
from typing import Any

from stickslip_ros.errors import needs
from stickslip_ros.messages.joint_states import Channel, MessageError

_DEFINITIONS_KEPT = 64
_OF_ROS_1 = ("std_msgs/msg/Header", "builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
_NEXT_TYPE = re.compile(r"^=+$", re.MULTILINE)
# Type and name; constants have names in capitals.
_FIELD = re.compile(r"^\s*[a-zA-Z][\w/]*(?:<=\d+)?(?:\[[^]]*\])?[ \t]+([a-z]\w*)", re.MULTILINE)
_LONGEST_DEFINITION = 1_000_000  # characters; the longest that is known has thirty thousand


class Decoder:
    """Decodes the messages of one channel.

    Raises
    ------
    MessageError
        If the type is neither defined in the bag nor known.
    """

    def __init__(self, channel: Channel) -> None:
        self._type = channel.type
        if channel.encoding != "cdr":
            raise MessageError(f"its encoding is {channel.encoding!r}, not 'cdr'")
        try:
            found = (
                types_of(channel.type, channel.schema_encoding, channel.schema)
                if channel.schema.strip()
                else types_of_ros()
            )
        except ImportError as error:
            found = _InstalledType(channel, error)
        if found is None:
            raise MessageError(f"its definition of {channel.type} cannot be read")
        self._store = found
        if self._type not in self._store.fielddefs:
            raise MessageError(f"the bag does not define {channel.type}; record it with its package installed")

    def fields(self) -> list[str]:
        """Names of the type's fields, in order."""
        return [name for name, _ in self._store.fielddefs[self._type][1]]

    def decode(self, message: bytes) -> Any:
        """One message.

        Raises
        ------
        MessageError
            If it is not of the type.
        """
        try:
            return self._store.deserialize_cdr(message, self._type)
        except MessageError:
            raise
        except Exception as error:
            # What damaged bytes make generated code raise cannot be listed.
            raise MessageError(f"it is no {self._type}") from error


def why_unreadable(channel: Channel) -> str:
    """Why the messages of a channel cannot be decoded, "" if they can."""
    try:
        Decoder(channel)
    except MessageError as error:
        return str(error)
    return ""


class _InstalledType:
    """The type of a channel where the package rosbags is missing: fields by the bag's definition, messages by ROS.

    It has those names of rosbags that :class:`Decoder` uses. ROS is loaded with the first message: JointStates need
    none of it.

    Raises
    ------
    MessageError
        If the definition is in a language that only rosbags reads.
    """

    def __init__(self, channel: Channel, missing: ImportError) -> None:
        if channel.schema.strip() and channel.schema_encoding != "ros2msg":
            raise MessageError(f"its definition of {channel.type} {needs(missing)}")
        self._missing = missing
        self._names = _FIELD.findall(_NEXT_TYPE.split(channel.schema)[0])
        self.fielddefs = {channel.type: ((), [(name, None) for name in self._names])}

    def deserialize_cdr(self, message: bytes, kind: str) -> Any:
        """One message; MessageError if ROS is not there, or has another definition of the type."""
        package, _, name = kind.split("/")
        try:
            from rclpy.serialization import deserialize_message

            found = getattr(import_module(f"{package}.msg"), name)
        except ImportError as error:
            raise MessageError(f"{kind} {needs(self._missing)}") from error
        if self._names and self._names != list(found.get_fields_and_field_types()):
            raise MessageError(
                f"its definition of {kind} is another one than that installed; it {needs(self._missing)}"
            )
        return deserialize_message(message, found)


@lru_cache(maxsize=1)
def types_of_ros() -> Any:
    """All that a distribution defines, and those before it; it takes a tenth of a second to load."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


@lru_cache(maxsize=_DEFINITIONS_KEPT)
def types_of(kind: str, encoding: str, schema: str) -> Any:
    """The types that a definition holds, None if it cannot be read: once for all channels that have it."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if len(schema) > _LONGEST_DEFINITION:
        return None
    try:
        types = get_types_from_idl(schema) if encoding == "ros2idl" else get_types_from_msg(schema, kind)
        if encoding == "ros1msg":
            # Times are no types of their own there, and a header has a number that ROS 2's has not.
            types |= {name: types_of_ros().fielddefs[name] for name in _OF_ROS_1}
        store = get_typestore(Stores.EMPTY)
        store.register(types)
    except Exception:
        # The parser's exceptions for text that is no definition are many.
        return None
    return store
