# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Where gains come from: the topic `pd_gains`, and the parameters of one controller or several."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from time import monotonic

from rcl_interfaces.msg import ParameterEvent, ParameterType, ParameterValue
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_parameter_events
from std_msgs.msg import Float64MultiArray

from stickslip_ros.messages.gain_parameters import (
    INTERFACES,
    KINDS,
    HeardGains,
    elsewhere_text,
    gain_name,
    gain_value,
    gains_elsewhere,
    joint_and_kind,
    some,
    why_not_taken,
)
from stickslip_ros.messages.joint_states import MessageError, gains_from_message
from stickslip_ros.model.bounds import LARGEST
from stickslip_ros.model.friction import Gains
from stickslip_ros.nodes.gains.remote_parameters import PATIENCE, RemoteParameters
from stickslip_ros.nodes.intake.arrivals import DrainedSubscription
from stickslip_ros.nodes.intake.publishers import SCAN_EVERY
from stickslip_ros.nodes.watched_joints import MOST_JOINTS, WatchedJoints

PD_GAINS = "pd_gains"
_REREAD = 1.0  # time between two readings, s: an event of a change can be lost, and a reading makes up for it
_REREAD_AT_FIRST = 0.2  # time between two readings at first, s: events are lost while the graph is discovered
_AT_FIRST = 5.0  # time since the controller appeared, s: the graph is discovered then
_SILENT_FOR_GOOD = 3  # number of missing answers in a row, 1: a controller may be slow once
_QUEUE = 1000  # depth of a queue, messages: each joint may have a publisher of its own


class ControllerGains:
    """The gains `gains.<joint>.p/.i/.d` of one controller, read from its parameters and followed by their events.

    Parameters
    ----------
    node : has the clients. controller : fully qualified name of the controller's node.
    on_gains : called with a joint's name and its gains, in the controller's units, whenever they are read or change;
        with None once the controller is gone, or has been silent for long: gains are known as long as it lives.
    joints : names of the joints, which may grow. refuse : called with the reason why a value is refused.

    ``state`` has a sentence for diagnostics; ``waiting`` is whether it is a fault.
    """

    def __init__(
        self,
        node: Node,
        controller: str,
        on_gains: Callable[[str, Gains | None], None],
        joints: Collection[str],
        refuse: Callable[[str], None],
    ) -> None:
        self._node, self._refuse_value = node, refuse
        self.name = controller
        self._on_gains = on_gains
        self._joints = joints
        self._heard = HeardGains()
        self.parameters = RemoteParameters(node, controller)
        self._busy = False
        self._silent = 0
        self._requested_at = -math.inf
        self._appeared_at = math.inf
        self._next_scan = -math.inf
        self._missing_since = math.nan
        self._logged = ""
        self.state = f"waiting for {controller}"
        self.waiting = True

    def poll(self, now: float) -> None:
        """Request gains that are not known yet; call now and then with a steady time [s]."""
        self.parameters.poll(now)
        if not self.parameters.ready():
            self.forget()
            self._appeared_at = math.inf
            self._requested_at = -math.inf
            if math.isnan(self._missing_since):
                self._missing_since = now
            if not self.waiting or now >= self._next_scan:
                self._next_scan = now + SCAN_EVERY
                # A controller that starts together with the monitor is not logged.
                late = self._logged != "" or now - self._missing_since >= _AT_FIRST
                self._set_state(f"waiting for {self.name}{self._others()}", "missing" if late else "", waiting=True)
            return
        self._missing_since = math.nan
        self._appeared_at = min(self._appeared_at, now)
        interval = _REREAD_AT_FIRST if now - self._appeared_at < _AT_FIRST else _REREAD
        # A slow controller that a ramp reads already gets no further question.
        if self._busy or self.parameters.busy or now - self._requested_at < interval:
            return
        self._requested_at = now
        self._busy = True
        # Many controllers give no values at all if one name is not theirs, so the names are listed first.
        self.parameters.list(["gains", *INTERFACES], now, partial(self._on_names, now))

    def close(self) -> None:
        """Drop questions to the controller."""
        self.parameters.close()

    def has(self, joint: str) -> bool:
        """Whether the controller has gains of a joint."""
        return self._heard.of(joint) is not None

    def _set_state(self, state: str, kind: str, *, waiting: bool, detail: str = "") -> None:
        """Set the sentence for the diagnostics, and log it where its kind is new; the kind "" is not logged.

        Parameters
        ----------
        detail : end of the line in the log.
        """
        if kind not in ("", self._logged):
            self._logged = kind
            # Two lines of code: rclpy wants one severity from each.
            if waiting:
                self._node.get_logger().warning(state)
            else:
                self._node.get_logger().info(f"{state}{detail}")
        self.state, self.waiting = state, waiting

    def _others(self) -> str:
        """Names of the other nodes: the controller may have been renamed."""
        own = self._node.get_fully_qualified_name()
        names = {f"{space.rstrip('/')}/{name}" for name, space in self._node.get_node_names_and_namespaces()}
        others = sorted(name for name in names - {own} if not name.rpartition("/")[2].startswith("_"))
        if not others:
            return "; no other node is there"
        return f"; there are {some(others)}"

    def _on_names(self, now: float, found: list[str] | None) -> None:
        if found is None:
            return self._no_answer()
        wanted = {gain_name(joint, kind) for joint in self._joints for kind in KINDS}
        names = [name for name in found if name in wanted]
        if not names:
            # Only then the names of all parameters are requested.
            return self.parameters.list([], now, self._on_other_names)
        names += [name for name in INTERFACES if name in found]
        return self.parameters.get(names, now, partial(self._on_values, names))

    def _on_other_names(self, found: list[str] | None) -> None:
        if found is None:
            return self._no_answer()
        self._busy = False
        joints = sorted({of_joint[0] for name in found if (of_joint := joint_and_kind(name))})
        other_layout = gains_elsewhere(found)
        others = ""
        if joints:
            others = f"; it has those of {some(joints)}"
        elif other_layout:
            others = f"; {elsewhere_text(other_layout)}"
        return self._set_state(
            f"{self.name} has no parameters gains.<joint>.p/.i/.d of the joints watched{others}", "none", waiting=True
        )

    def _no_answer(self) -> None:
        self._busy = False
        self._silent += 1
        if self._silent >= _SILENT_FOR_GOOD:
            self.forget()
        self._set_state(f"{self.name} has not answered for {self._silent * PATIENCE:g} s", "silent", waiting=True)

    def _on_values(self, names: list[str], values: list[ParameterValue] | None) -> None:
        if values is None:
            return self._no_answer()
        self._busy = False
        self._silent = 0
        self._process_changes(dict(zip(names, values, strict=False)))
        if self._heard.refusal:
            return self._set_state(f"{self.name}: {self._heard.refusal}", "refused", waiting=True)
        taken = [name for name in names if name not in INTERFACES]
        return self._set_state(f"following {self.name}", "following", waiting=False, detail=f": {some(taken)}")

    def on_event(self, event: ParameterEvent) -> None:
        """Process an event of changed parameters, if it is the controller's."""
        if event.node == self.name:
            changes = {one.name: one.value for one in [*event.new_parameters, *event.changed_parameters]}
            self.parameters.hear(changes)
            self._process_changes(changes)

    def _process_changes(self, parameters: Mapping[str, ParameterValue]) -> None:
        """Store gains of watched joints, and report each joint once."""
        if any(name in parameters for name in INTERFACES):
            self._refuse(why_not_taken(parameters))
        watched, changed = set(self._joints), []
        for name, value in parameters.items():
            found = joint_and_kind(name)
            if found is not None and found[0] in watched:
                self._store(*found, value)
                changed.append(found[0])
        for joint in dict.fromkeys(changed):
            gains = self._heard.of(joint)
            if gains is not None:
                self._on_gains(joint, gains)

    def _refuse(self, reason: str) -> None:
        """Refuse the gains for a reason, "" for none: the interfaces of an inactive controller may change."""
        if reason and not self._heard.refusal:
            self.forget()
        self._heard.refusal = reason

    def forget(self) -> None:
        """Discard the gains, and report it."""
        for joint in self._heard.forget():
            self._on_gains(joint, None)

    def _store(self, joint: str, kind: str, value: ParameterValue) -> None:
        found = gain_value(value)
        if math.isfinite(found):
            self._heard.set(joint, kind, found)
        elif value.type != ParameterType.PARAMETER_NOT_SET:
            self._refuse_value(f"gain {kind} of {joint} in {self.name} is not finite and less than {LARGEST:g}")


class GainIntake:
    """Gains of all sources, in the controller's units: they wait, each with its arrival, for :meth:`heard_until`.

    Parameters
    ----------
    node : has the subscriptions. joints : the watched joints; gains of others that may join them are kept until then.
    refuse : called with the reason why gains are refused.
    """

    def __init__(self, node: Node, joints: WatchedJoints, refuse: Callable[[str], None]) -> None:
        self._node, self._joints, self._refuse = node, joints, refuse
        self._heard: deque[tuple[float, str, Gains | None]] = deque()  # arrival, a steady time [s]
        self._early: dict[str, Gains] = {}
        self._controllers: list[ControllerGains] = []
        qos = QoSProfile(depth=_QUEUE, reliability=qos_profile_parameter_events.reliability)
        self.topic = DrainedSubscription(node, Float64MultiArray, PD_GAINS, QoSProfile(depth=_QUEUE))
        self._events = node.create_subscription(ParameterEvent, "/parameter_events", self._on_event, qos)

    def follow(self, names: Sequence[str]) -> None:
        """Follow these controllers from now on; an earlier one in the list has precedence."""
        if names == [controller.name for controller in self._controllers]:
            return
        before, self._controllers = self._controllers, []
        for controller in before:
            controller.forget()
            controller.close()
        self._controllers = [
            ControllerGains(self._node, name, partial(self._on_controller, name), self._joints, self._refuse)
            for name in names
        ]

    def close(self) -> None:
        """Close the subscriptions and clients."""
        for controller in self._controllers:
            controller.close()
        self._controllers = []
        self.topic.close()
        self._node.destroy_subscription(self._events)

    def keep(self) -> None:
        """Drain the messages on the topic, for :meth:`heard_until`."""
        for message, _ in self.topic.take_all():
            self._on_message(message)

    def heard_until(self, until: float) -> Iterator[tuple[float, str, Gains | None]]:
        """Arrival, joint and gains until a steady time [s], oldest first; None for gains that are known no more."""
        while self._heard and self._heard[0][0] <= until:
            yield self._heard.popleft()

    def poll(self, now: float) -> None:
        """Request gains that are not known yet; call now and then with a steady time [s]."""
        for controller in self._controllers:
            controller.poll(now)

    def controller_of(self, joint: str) -> RemoteParameters | None:
        """The controller that has a joint's gains, None if none has."""
        return next((one.parameters for one in self._controllers if one.has(joint)), None)

    def heard_before(self, joint: str) -> Gains | None:
        """Gains on the topic that came before the joint, None if none did; they are removed."""
        return self._early.pop(joint, None)

    @property
    def early(self) -> list[str]:
        """Joints whose gains were heard, and no samples."""
        return sorted(self._early)

    @property
    def state(self) -> str:
        """Sentence on each controller."""
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

    def _hear(self, joint: str, gains: Gains | None) -> None:
        self._heard.append((monotonic(), joint, gains))

    def _on_controller(self, name: str, joint: str, gains: Gains | None) -> None:
        if gains is None:
            # The next reading reports another controller that has the joint's gains too.
            if not any(one.has(joint) for one in self._controllers):
                self._hear(joint, None)
            return
        first = next(one.name for one in self._controllers if one.has(joint))
        if first == name:
            self._hear(joint, gains)
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
        for joint, value in gains.items():
            if joint in self._joints:
                self._hear(joint, value)
            elif self._joints.welcomes_others and len(self._early) < MOST_JOINTS:
                self._early[joint] = value
            else:
                self._refuse(
                    f"{PD_GAINS}: unknown joint {joint[:64]!r}; known: {', '.join(sorted(self._joints)) or 'none yet'}"
                )
