# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Gains read from a controller's parameters, and followed through /parameter_events."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from rcl_interfaces.msg import ParameterEvent, ParameterType, ParameterValue
from rclpy.node import Node
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile, qos_profile_parameter_events
from rclpy.task import Future

from stickslip_ros.model.friction import Gains

_KINDS = ("p", "i", "d")
_PATIENCE = 2.0  # [s] for an answer, after which the controller is asked again


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
        self._asked: dict[str, float] = {}
        self._pending: dict[str, Future] = {}
        self._was_there = False
        self.state = f"waiting for {controller}"
        qos = QoSProfile(depth=1000, reliability=qos_profile_parameter_events.reliability)
        node.create_subscription(ParameterEvent, "/parameter_events", self._on_event, qos)

    def poll(self, now: float) -> None:
        """Ask for what is not known yet; call now and then with a steady time [s]."""
        there = self._client.services_are_ready()
        if not there:
            if self._was_there:
                # It may come back with other gains.
                self._asked.clear()
                self._pending.clear()
            self._was_there = False
            self.state = f"waiting for {self._controller}"
            return
        self._was_there = True
        for joint in self._joints():
            if joint in self._asked and (joint not in self._pending or now - self._asked[joint] < _PATIENCE):
                continue
            self._asked[joint] = now
            future = self._client.get_parameters([f"gains.{joint}.{kind}" for kind in _KINDS])
            self._pending[joint] = future
            future.add_done_callback(partial(self._on_answer, joint))
        slow = list(self._pending)
        self.state = (
            f"{self._controller} has not answered for {', '.join(slow)}" if slow else f"following {self._controller}"
        )

    def _on_answer(self, joint: str, future: Any) -> None:
        asked = self._pending.get(joint)
        if asked is None or asked is not future:
            return
        del self._pending[joint]
        answer = future.result()
        if answer is None:
            return
        for kind, value in zip(_KINDS, answer.values, strict=False):
            self._remember(joint, kind, value)
        self._tell(joint)

    def _on_event(self, event: ParameterEvent) -> None:
        if event.node != self._controller:
            return
        changed = set()
        for parameter in [*event.new_parameters, *event.changed_parameters]:
            prefix, _, rest = parameter.name.partition(".")
            joint, _, kind = rest.rpartition(".")
            if prefix == "gains" and kind in _KINDS and joint in set(self._joints()):
                self._remember(joint, kind, parameter.value)
                changed.add(joint)
        for joint in sorted(changed):
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
