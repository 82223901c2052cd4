# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The parameters of another node, asked without waiting: every question has its answer, or None, in bounded time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future

PATIENCE = 2.0  # [s] for an answer

Then = Callable[[Any], None]


class RemoteParameters:
    """Asks one node; call :meth:`poll` now and then.

    Parameters
    ----------
    node : does the talking. remote : fully qualified name of the other one.
    """

    def __init__(self, node: Node, remote: str) -> None:
        self._node = node
        self.remote = remote
        self._list = node.create_client(ListParameters, f"{remote}/list_parameters")
        self._get = node.create_client(GetParameters, f"{remote}/get_parameters")
        self._set = node.create_client(SetParametersAtomically, f"{remote}/set_parameters_atomically")
        self._waiting: list[tuple[Client, Future, float, Then]] = []

    def ready(self) -> bool:
        """Whether the other node is there."""
        return bool(self._list.service_is_ready() and self._get.service_is_ready())

    def list(self, prefix: str, now: float, then: Then) -> None:
        """Names of parameters below a prefix."""
        request = ListParameters.Request(prefixes=[prefix], depth=10)
        self._ask(self._list, request, now, lambda answer: then(answer and list(answer.result.names)))

    def get(self, names: Sequence[str], now: float, then: Then) -> None:
        """Values of parameters, in this order."""
        self._ask(
            self._get, GetParameters.Request(names=list(names)), now, lambda answer: then(answer and answer.values)
        )

    def set(self, values: Mapping[str, float], now: float, then: Then) -> None:
        """Set several at once or none; the answer is a SetParametersResult."""
        parameters = [
            Parameter(name, Parameter.Type.DOUBLE, value).to_parameter_msg() for name, value in values.items()
        ]
        request = SetParametersAtomically.Request(parameters=parameters)
        self._ask(self._set, request, now, lambda answer: then(answer and answer.result))

    def _ask(self, client: Client, request: Any, now: float, then: Then) -> None:
        self._waiting.append((client, client.call_async(request), now + PATIENCE, then))

    def poll(self, now: float) -> None:
        """Hand over the answers that have come, and None for those that are overdue; ``now`` is a steady time [s]."""
        waiting, self._waiting = self._waiting, []
        for client, future, until, then in waiting:
            if future.done():
                then(None if future.cancelled() or future.exception() is not None else future.result())
            elif now > until:
                client.remove_pending_request(future)
                then(None)
            else:
                self._waiting.append((client, future, until, then))

    def close(self) -> None:
        """Drop every question."""
        self._waiting.clear()
        for client in (self._list, self._get, self._set):
            self._node.destroy_client(client)
