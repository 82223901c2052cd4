# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Names of other nodes that parameters give, and what none can be called."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name

from stickslip_ros.errors import InvalidParameterError

_LONGEST_SERVICE = "set_parameters_atomically"  # that is asked of another node


def other_nodes(node: Node, parameter: str, given: object) -> list[str]:
    """Fully qualified names in a parameter that holds one name or a list; "" is none.

    Raises
    ------
    InvalidParameterError
        If it holds something else, a name that no node can have, or one twice.
    """
    # An empty list in a parameter file has no type, and comes as None.
    words = [given] if isinstance(given, str) else [] if given is None else given
    if not isinstance(words, Sequence) or not all(isinstance(word, str) for word in words):
        raise InvalidParameterError(parameter, "the name of a node, or a list of names", given)
    names = []
    for word in (word.strip() for word in words):
        name = word if word.startswith("/") or not word else f"{node.get_namespace().rstrip('/')}/{word}"
        if name:
            _check(parameter, word, name)
            names.append(name)
    if len(set(names)) < len(names):
        raise InvalidParameterError(parameter, "names of different nodes", list(words))
    return names


def _check(parameter: str, word: str, name: str) -> None:
    space, _, own = name.rpartition("/")
    try:
        validate_namespace(space or "/")
        validate_node_name(own)
        validate_full_topic_name(f"{name}/{_LONGEST_SERVICE}", is_service=True)
    except NameValidationException as error:
        why = str(error).splitlines()[0].rstrip(":")
        why = why[:1].lower() + why[1:]
        raise InvalidParameterError(parameter, f"a name that a node can have ({why})", f"{word[:80]!r}") from error
    except TypeError as error:
        # What is no text in UTF-8 is not taken at all.
        raise InvalidParameterError(parameter, "a name that a node can have", ascii(word[:80])) from error
