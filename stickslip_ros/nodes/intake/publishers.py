# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Publishers on a topic, by the names of their nodes."""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.node import Node, NodeNameNonExistentError
from rclpy.topic_endpoint_info import TopicEndpointInfo

NAMED = 3  # number of names in a sentence, 1: a longer list is not read
SCAN_EVERY = 1.0  # time between two scans of the graph for missing publishers and nodes, s: each goes through all nodes
_UNKNOWN = "_NODE_NAME_UNKNOWN_"  # name in the graph before the name of a node is known


def is_named(publisher: TopicEndpointInfo) -> bool:
    """Whether the name of its node is known yet."""
    return _UNKNOWN not in publisher.node_name


def names_of(publishers: Iterable[TopicEndpointInfo]) -> list[str]:
    """Fully qualified names of their nodes, each once."""
    return sorted({name_of(one) for one in publishers})


def publishers_by_topic(node: Node, message_type: str) -> dict[str, list[str]]:
    """Topics on which other nodes publish messages of a type, each with their fully qualified names.

    A query of the graph by topic would apply the node's own remappings, which other nodes do not have.
    """
    found: dict[str, list[str]] = {}
    for name, space in sorted(node.get_node_names_and_namespaces()):
        full = f"{space.rstrip('/')}/{name}"
        if full == node.get_fully_qualified_name():
            continue
        try:
            topics = node.get_publisher_names_and_types_by_node(name, space)
        except NodeNameNonExistentError:  # it has gone meanwhile
            continue
        for topic, kinds in topics:
            if message_type in kinds:
                found.setdefault(topic, []).append(full)
    return found


def name_of(publisher: TopicEndpointInfo) -> str:
    """Fully qualified name of its node."""
    if not is_named(publisher):
        return "a node without a name"
    return f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}"
