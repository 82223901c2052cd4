# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A service that answers when it has something to say, which may be seconds later.

In Jazzy a coroutine as a service's callback would keep the executor spinning at full load until it answers.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node

from stickslip_ros.nodes.intake.drain import NeverExecuted

Answer = Callable[[Any], None]


class DeferredService:
    """A service whose requests wait until they are taken, and then for their answer.

    Parameters
    ----------
    on_request : called with a request and the means to answer it, once.
    """

    def __init__(self, node: Node, service_type: Any, name: str, on_request: Callable[[Any, Answer], None]) -> None:
        self._node, self._type = node, service_type
        self._on_request = on_request
        self._service = node.create_service(
            service_type, name, lambda _, response: response, callback_group=NeverExecuted()
        )

    def take_all(self) -> None:
        """Hand over the requests waiting, oldest first."""
        while True:
            with self._service.handle:
                request, header = self._service.handle.service_take_request(self._type.Request)
            if header is None:
                return
            self._on_request(request, partial(self._send, header))

    def close(self) -> None:
        """Take the service from the graph."""
        self._node.destroy_service(self._service)

    def _send(self, header: Any, response: Any) -> None:
        self._service.send_response(response, header)
