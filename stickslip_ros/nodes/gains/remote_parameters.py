# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The parameters of another node, requested without waiting: every request has its answer, or None, in bounded time.

An answer is passed on as soon as it comes, so that values are used before they are old.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future

PATIENCE = 2.0  # time until an answer, s: gains in a later answer are too old to write by
_DEPTH = 10  # depth of parameter names, words: more than names of gains have

Then = Callable[[Any], None]
Listener = Callable[[Mapping[str, ParameterValue]], None]


@dataclass(frozen=True, eq=False)
class _Question:
    """A request that waits for its answer until a steady time [s]."""

    client: Client
    future: Future
    until: float
    then: Then


class RemoteParameters:
    """Client of one node's parameters; call :meth:`poll` now and then.

    Parameters
    ----------
    node : has the clients. remote : fully qualified name of the other node.

    ``listeners`` are called with changes of which the other node published events; see :meth:`hear`.
    """

    def __init__(self, node: Node, remote: str) -> None:
        self._node = node
        self.remote = remote
        self.listeners: list[Listener] = []
        self._list = node.create_client(ListParameters, f"{remote}/list_parameters")
        self._get = node.create_client(GetParameters, f"{remote}/get_parameters")
        self._set = node.create_client(SetParametersAtomically, f"{remote}/set_parameters_atomically")
        self._waiting: list[_Question] = []

    def hear(self, changes: Mapping[str, ParameterValue]) -> None:
        """Call the listeners with changed parameters of the other node, all at once."""
        for listener in list(self.listeners):
            listener(changes)

    def ready(self, *, to_set: bool = False) -> bool:
        """Whether the other node is there; ``to_set``: and can be told values."""
        clients = (self._list, self._get, self._set) if to_set else (self._list, self._get)
        return all(client.service_is_ready() for client in clients)

    @property
    def busy(self) -> bool:
        """Whether a request waits for its answer."""
        return bool(self._waiting)

    def list(self, prefixes: Sequence[str], now: float, then: Then) -> None:
        """Names of parameters that are, or stand below, one of some prefixes; of all for none."""
        request = ListParameters.Request(prefixes=list(prefixes), depth=_DEPTH)
        self._request(self._list, request, now, lambda answer: then(answer and list(answer.result.names)))

    def get(self, names: Sequence[str], now: float, then: Then) -> None:
        """Values of parameters, in this order."""
        self._request(
            self._get, GetParameters.Request(names=list(names)), now, lambda answer: then(answer and answer.values)
        )

    def set(self, values: Mapping[str, float | str], now: float, then: Then) -> None:
        """Set several at once or none; the answer is a SetParametersResult."""
        parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        request = SetParametersAtomically.Request(parameters=parameters)
        self._request(self._set, request, now, lambda answer: then(answer and answer.result))

    def _request(self, client: Client, request: Any, now: float, then: Then) -> None:
        question = _Question(client, client.call_async(request), now + PATIENCE, then)
        self._waiting.append(question)
        question.future.add_done_callback(lambda _: self._hand_over(question))

    def _hand_over(self, question: _Question) -> None:
        # A request that was overdue or dropped has had its answer.
        if question in self._waiting:
            self._waiting.remove(question)
            future = question.future
            question.then(None if future.cancelled() or future.exception() is not None else future.result())

    def poll(self, now: float) -> None:
        """Answer overdue requests by None; ``now`` is a steady time [s]."""
        for question in [one for one in self._waiting if now > one.until]:
            self._waiting.remove(question)
            question.client.remove_pending_request(question.future)
            question.then(None)

    def close(self) -> None:
        """Drop every request."""
        self._waiting.clear()
        self.listeners.clear()
        for client in (self._list, self._get, self._set):
            self._node.destroy_client(client)
