# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Messages of any type, by the definition that the bag carries; JointStates have a faster way of their own."""

from __future__ import annotations

from typing import Any

from stickslip_ros.messages.blocks import Channel
from stickslip_ros.messages.content import MessageError


class Decoder:
    """Decodes the messages of one channel.

    Raises
    ------
    MessageError
        If the type is neither defined in the bag nor known.
    """

    def __init__(self, channel: Channel) -> None:
        from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

        self._type = channel.type
        if channel.encoding != "cdr":
            raise MessageError(f"its encoding is {channel.encoding!r}, not 'cdr'")
        if not channel.schema.strip():
            # All that a distribution defines, and those before it, takes a tenth of a second to load.
            self._store = get_typestore(Stores.ROS2_JAZZY)
        else:
            try:
                if channel.schema_encoding == "ros2idl":
                    types = get_types_from_idl(channel.schema)
                else:
                    types = get_types_from_msg(channel.schema, channel.type)
                self._store = get_typestore(Stores.EMPTY)
                self._store.register(types)
            except Exception as error:
                # The parser's exceptions for text that is no definition are many.
                raise MessageError(f"its definition of {channel.type} cannot be read") from error
        if self._type not in self._store.fielddefs:
            raise MessageError(f"the bag does not define {channel.type}; record it with its package installed")

    def fields(self, type_name: str | None = None) -> list[str]:
        """Names of a type's fields, in order."""
        return [name for name, _ in self._store.fielddefs[type_name or self._type][1]]

    def decode(self, message: bytes) -> Any:
        """One message.

        Raises
        ------
        MessageError
            If it is not of the type.
        """
        try:
            return self._store.deserialize_cdr(message, self._type)
        except Exception as error:
            # What damaged bytes make generated code raise cannot be listed.
            raise MessageError(f"it is no {self._type}") from error
