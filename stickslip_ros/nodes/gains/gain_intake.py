# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Where gains come from: the topic `pd_gains`, and the parameters of one controller or several."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial

from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_parameter_events
from std_msgs.msg import Float64MultiArray

from stickslip_ros.messages.content import MessageError, gains_from_message
from stickslip_ros.model.friction import Gains
from stickslip_ros.nodes.gains.gain_source import ControllerGains
from stickslip_ros.nodes.gains.remote_parameters import RemoteParameters
from stickslip_ros.nodes.intake.drain import DrainedSubscription

PD_GAINS = "pd_gains"
_QUEUE = 1000  # messages, for each joint may have a publisher of its own
_MOST_EARLY = 256  # joints whose gains are kept; names come from the graph


class GainIntake:
    """Hears gains and passes them on, in the controller's units; those on the topic when :meth:`hear` is called.

    Parameters
    ----------
    node : does the talking. joints : names of those watched; welcomes : whether others may join them, whose gains are
        kept until then.
    on_gains : called with a joint's name and its gains, None once they are known no more.
    refuse : called with the reason for what is not taken.
    """

    def __init__(
        self,
        node: Node,
        joints: Callable[[], Iterable[str]],
        welcomes: Callable[[], bool],
        on_gains: Callable[[str, Gains | None], None],
        refuse: Callable[[str], None],
    ) -> None:
        self._node, self._joints, self._on_gains, self._refuse = node, joints, on_gains, refuse
        self._welcomes = welcomes
        self._early: dict[str, Gains] = {}
        self._controllers: list[ControllerGains] = []
        qos = QoSProfile(depth=1000, reliability=qos_profile_parameter_events.reliability)
        self.topic = DrainedSubscription(node, Float64MultiArray, PD_GAINS, QoSProfile(depth=_QUEUE))
        self._events = node.create_subscription(ParameterEvent, "/parameter_events", self._on_event, qos)

    def follow(self, names: Sequence[str]) -> None:
        """Follow these controllers from now on; the earlier in the list, the more it has to say."""
        if names == [controller.name for controller in self._controllers]:
            return
        before, self._controllers = self._controllers, []
        for controller in before:
            controller.forget()
            controller.close()
        self._controllers = [
            ControllerGains(self._node, name, partial(self._on_controller, name), self._joints) for name in names
        ]

    def close(self) -> None:
        """Hear no more."""
        for controller in self._controllers:
            controller.close()
        self._controllers = []
        self.topic.close()
        self._node.destroy_subscription(self._events)

    def hear(self) -> None:
        """Take what has come on the topic; before the samples that have come with it, which are of these gains."""
        for message, _ in self.topic.take_all():
            self._on_message(message)

    def poll(self, now: float) -> None:
        """Ask for what is not known yet; call now and then with a steady time [s]."""
        for controller in self._controllers:
            controller.poll(now)

    def controller_of(self, joint: str) -> RemoteParameters | None:
        """The controller that has a joint's gains, None if none has."""
        return next((one.parameters for one in self._controllers if one.has(joint)), None)

    def heard_of(self, joint: str) -> Gains | None:
        """Gains on the topic that came before the joint did."""
        return self._early.pop(joint, None)

    @property
    def early(self) -> list[str]:
        """Joints whose gains were heard, and which have not been heard of themselves."""
        return sorted(self._early)

    @property
    def state(self) -> str:
        """How far it has got with each controller, in words."""
        return "; ".join(controller.state for controller in self._controllers) or "none configured"

    @property
    def waiting(self) -> bool:
        """Whether some controller is missing or silent."""
        return any(controller.waiting for controller in self._controllers)

    def why_unknown(self, joint: str) -> str:
        """Why a controller that is configured gave no gains of a joint, "" if one did or none is configured."""
        if not self._controllers or any(controller.has(joint) for controller in self._controllers):
            return ""
        waiting = [controller.state for controller in self._controllers if controller.waiting]
        names = ", ".join(controller.name for controller in self._controllers)
        return "; ".join(waiting) or f"{names} has no parameter gains.{joint}.p"

    def _on_controller(self, name: str, joint: str, gains: Gains | None) -> None:
        if gains is None:
            # Of another controller that has the joint's gains too, the next reading tells.
            if not any(one.has(joint) for one in self._controllers):
                self._on_gains(joint, None)
            return
        first = next(one.name for one in self._controllers if one.has(joint))
        if first == name:
            self._on_gains(joint, gains)
        else:
            self._refuse(f"{name} has gains of {joint} too; those of {first} count, which is named first")

    def _on_event(self, event: ParameterEvent) -> None:
        for controller in self._controllers:
            controller.on_event(event)

    def _on_message(self, message: Float64MultiArray) -> None:
        try:
            gains = gains_from_message(message)
        except MessageError as error:
            self._refuse(f"{PD_GAINS}: {error}")
            return
        known = set(self._joints())
        for joint, value in gains.items():
            if joint in known:
                self._on_gains(joint, value)
            elif self._welcomes() and len(self._early) < _MOST_EARLY:
                self._early[joint] = value
            else:
                self._refuse(
                    f"{PD_GAINS}: unknown joint {joint[:64]!r}; known: {', '.join(sorted(known)) or 'none yet'}"
                )
