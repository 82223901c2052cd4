# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Gains read from a controller's parameters, and followed through /parameter_events."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from rcl_interfaces.msg import ParameterEvent, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile, qos_profile_parameter_events
from rclpy.task import Future

from stickslip_ros.model.friction import Gains

_KINDS = ("p", "i", "d")
_PATIENCE = 2.0  # [s] for an answer, after which the controller is asked again
# An event can be lost, above all while the graph is being discovered; reading again makes up for it.
_REREAD = 1.0  # [s]
_REREAD_AT_FIRST = 0.2
_AT_FIRST = 5.0  # [s] since the controller appeared


class ControllerGains:
    """Keeps the gains `gains.<joint>.p/.i/.d` of one controller; never blocks.

    Parameters
    ----------
    node : does the talking.
    controller : fully qualified name of the controller's node.
    on_gains : called with a joint's name and its gains whenever they are read or change.
    joints : names of the joints to ask for.

    ``state`` says in words how far it has got, for diagnostics.
    """

    def __init__(
        self, node: Node, controller: str, on_gains: Callable[[str, Gains], None], joints: Callable[[], Iterable[str]]
    ) -> None:
        self._node = node
        self._controller = controller
        self._on_gains = on_gains
        self._joints = joints
        self._values: dict[str, dict[str, float]] = {}
        self._client = AsyncParameterClient(node, controller)
        self._pending: Future | None = None
        self._asked_at = -math.inf
        self._appeared_at = math.inf
        self.state = f"waiting for {controller}"
        qos = QoSProfile(depth=1000, reliability=qos_profile_parameter_events.reliability)
        node.create_subscription(ParameterEvent, "/parameter_events", self._on_event, qos)

    def poll(self, now: float) -> None:
        """Ask for what is not known yet; call now and then with a steady time [s]."""
        if not self._client.services_are_ready():
            self._pending = None
            self._appeared_at = math.inf
            self._asked_at = -math.inf
            self.state = f"waiting for {self._controller}"
            return
        self._appeared_at = min(self._appeared_at, now)
        waited = now - self._asked_at
        if self._pending is not None and waited < _PATIENCE:
            return
        if self._pending is not None:
            self.state = f"{self._controller} has not answered for {_PATIENCE:g} s"
        elif waited < (_REREAD_AT_FIRST if now - self._appeared_at < _AT_FIRST else _REREAD):
            return
        self._asked_at = now
        # Asked by name, many controllers answer nothing at all if one name is not theirs; so they are listed first.
        self._ask(self._client.list_parameters(["gains"], 10), self._on_names)

    def _ask(self, future: Future, on_answer: Callable[[Any], None]) -> None:
        self._pending = future
        future.add_done_callback(partial(self._on_answer, on_answer))

    def _on_answer(self, on_answer: Callable[[Any], None], future: Any) -> None:
        if self._pending is None or self._pending is not future:
            return
        self._pending = None
        if future.result() is not None:
            on_answer(future.result())

    def _on_names(self, answer: ListParameters.Response) -> None:
        wanted = {f"gains.{joint}.{kind}" for joint in self._joints() for kind in _KINDS}
        names = [name for name in answer.result.names if name in wanted]
        if not names:
            self.state = f"{self._controller} has no parameters gains.<joint>.p/.i/.d of the joints watched"
            return
        self._ask(self._client.get_parameters(names), partial(self._on_values, names))

    def _on_values(self, names: list[str], answer: GetParameters.Response) -> None:
        self.state = f"following {self._controller}"
        self._take(zip(names, answer.values, strict=False))

    def _on_event(self, event: ParameterEvent) -> None:
        if event.node != self._controller:
            return
        self._take(
            (parameter.name, parameter.value) for parameter in [*event.new_parameters, *event.changed_parameters]
        )

    def _take(self, parameters: Iterable[tuple[str, ParameterValue]]) -> None:
        """Remember what are gains of joints watched, and tell of each joint once."""
        watched, told = set(self._joints()), []
        for name, value in parameters:
            prefix, _, rest = name.partition(".")
            joint, _, kind = rest.rpartition(".")
            if prefix == "gains" and kind in _KINDS and joint in watched:
                self._remember(joint, kind, value)
                told.append(joint)
        for joint in dict.fromkeys(told):
            self._tell(joint)

    def _remember(self, joint: str, kind: str, value: ParameterValue) -> None:
        if value.type == ParameterType.PARAMETER_DOUBLE and math.isfinite(value.double_value):
            self._values.setdefault(joint, {})[kind] = value.double_value
        elif value.type == ParameterType.PARAMETER_INTEGER:
            self._values.setdefault(joint, {})[kind] = float(value.integer_value)
        elif value.type != ParameterType.PARAMETER_NOT_SET:
            self._node.get_logger().warning(
                f"gain {kind} of {joint} in {self._controller} is not a finite number; ignored"
            )

    def _tell(self, joint: str) -> None:
        values = self._values.get(joint, {})
        if "p" in values:
            self._on_gains(
                joint, Gains(stiffness=values["p"], damping=values.get("d", 0.0), integral=values.get("i", 0.0))
            )
