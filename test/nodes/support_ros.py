# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A node that listens to the monitor under test; all waiting is bounded."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import rclpy
from conftest import LIMIT
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import ParameterDescriptor
from rcl_interfaces.srv import DescribeParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from stickslip_ros.cli.monitor_client import margins_of, values_of
from stickslip_ros.messages.joint_states import seconds
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.joint_simulation import simulate
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.nodes.conversion import stamp
from stickslip_ros.output.published import MARGIN_FIELDS
from stickslip_ros.settings.known_joints import load_joint

NO_DATA = "no data"  # how the status of a joint begins whose data have ended
STALE = b"\x03"  # level of a joint whose data have ended
ROOM = 50_000  # messages, that nothing is dropped however long the node waits for a processor
_ASK_AGAIN = 3.0  # [s]
_SETTLED = 0.2  # [s]


class Probe:
    """Publishes what a robot would, and remembers what the monitor says.

    ``log`` gives what the monitor has printed, where it was begun by who set it.
    """

    def __init__(self) -> None:
        self.log: Callable[[], str] = str
        self.node = Node("probe")
        self.diagnostics: dict[str, tuple[bytes, str, dict[str, str]]] = {}
        self.margins: dict[str, dict[str, float]] = {}
        self.margin_times: list[tuple[float, float]] = []
        self.recommended: Float64MultiArray | None = None
        self.cycles: list[dict[str, str]] = []
        self.stamps: list[float] = []  # of all diagnostics [s]: on a busy machine a message is heard late
        self.silences: Counter[str] = Counter()  # of each joint, how often its data ended
        self._clients: dict[str, AsyncParameterClient] = {}
        self._lifecycle: dict[str, Client] = {}
        self._settled: list[Client] = []
        qos = QoSProfile(depth=ROOM)
        self.states = self.node.create_publisher(JointState, "joint_states", qos)
        self.references = self.node.create_publisher(JointState, "joint_references", qos)
        self.gains = self.node.create_publisher(Float64MultiArray, "pd_gains", 10)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, qos)
        self.node.create_subscription(DiagnosticArray, "/stickslip_monitor/cycles", self._on_cycles, qos)
        self.node.create_subscription(Float64MultiArray, "/stickslip_monitor/margins", self._on_margins, qos)
        self.node.create_subscription(Float64MultiArray, "/stickslip_monitor/recommended_gains", self._on_advice, qos)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.stamps.append(seconds(message.header.stamp))
        for status in message.status:
            if status.message.startswith(NO_DATA) and not self.is_silent(status.hardware_id):
                self.silences[status.hardware_id] += 1
            self.diagnostics[status.hardware_id] = (status.level, status.message, values_of(status))

    def _on_cycles(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.cycles.append({"joint": status.hardware_id, **values_of(status)})

    def _on_margins(self, message: Float64MultiArray) -> None:
        assert message.layout.dim[1].label == ",".join(MARGIN_FIELDS)
        self.margins |= (found := margins_of(message))
        self.margin_times += [(time.monotonic(), row["stiffness"]) for row in found.values()]

    def _on_advice(self, message: Float64MultiArray) -> None:
        self.recommended = message

    def status(self, joint: str) -> str:
        """The joint's status word, "" before the first."""
        return self.diagnostics[joint][2].get("status", "") if joint in self.diagnostics else ""

    def is_silent(self, joint: str) -> bool:
        """Whether the monitor said last that the joint's data have ended."""
        return joint in self.diagnostics and self.diagnostics[joint][1].startswith(NO_DATA)

    def wait(self, reached: Callable[[], bool], what: str, limit: float = LIMIT) -> None:
        """Spin until the goal is reached; fails after the limit [s]."""
        until = time.monotonic() + limit
        while not reached():
            assert time.monotonic() < until, f"waited {limit} s for {what}; diagnostics: {self.diagnostics}"
            rclpy.spin_once(self.node, timeout_sec=0.02)

    def spin(self, duration: float) -> None:
        """Take what comes for so many seconds."""
        until = time.monotonic() + duration
        while (left := until - time.monotonic()) > 0:
            rclpy.spin_once(self.node, timeout_sec=min(left, 0.02))

    def entities(self) -> dict[str, list[str]]:
        """Names of what the monitor has on the graph."""
        monitor = ("stickslip_monitor", "/")
        # What a node has can be known before its name is.
        self.wait(lambda: monitor in self.node.get_node_names_and_namespaces(), "the monitor's name")
        return {
            "publishers": sorted(name for name, _ in self.node.get_publisher_names_and_types_by_node(*monitor)),
            "subscriptions": sorted(name for name, _ in self.node.get_subscriber_names_and_types_by_node(*monitor)),
            "services": sorted(name for name, _ in self.node.get_service_names_and_types_by_node(*monitor)),
            "clients": sorted(name for name, _ in self.node.get_client_names_and_types_by_node(*monitor)),
        }

    def wait_for_monitor(self) -> None:
        """Wait until the monitor listens, is heard, and has nothing to compile."""
        self.wait(
            lambda: (
                self.states.get_subscription_count() > 0
                and "stickslip_monitor" in self.diagnostics
                and not self.diagnostics["stickslip_monitor"][2]["compiling"]
            ),
            "the monitor",
            180.0,
        )

    def wait_for_publishers(self, count: int) -> None:
        """Wait until the monitor knows so many of joint states.

        A listener that is known need not know of the publisher yet, and would miss its first messages.
        """
        key = "publishers of joint_states [1]"
        self.wait(
            lambda: self.diagnostics["stickslip_monitor"][2][key] == str(count),
            "the monitor to know the publishers",
        )

    def publish(self, names: list[str], at: float, **fields: list[float]) -> None:
        """One JointState with a stamp in seconds."""
        message = JointState(name=names, **fields)
        message.header.stamp = stamp(at)
        self.states.publish(message)

    def publish_until(self, reached: Callable[[], bool], what: str) -> None:
        """Publish `joint1` at rest until the goal is reached.

        A message that is sent before the monitor has found the probe reaches nobody.
        """
        begun = time.monotonic()

        def tried() -> bool:
            self.publish(["joint1"], 100.0 + time.monotonic() - begun, position=[0.0])
            return reached()

        self.wait(tried, what)

    def set_parameters(self, node: str, values: dict[str, object], limit: float = LIMIT) -> list[str]:
        """Set parameters; returns the reasons of refusal, "" for what was taken."""
        client = self._parameters_of(node)
        self.wait(client.services_are_ready, f"the parameter services of {node}")
        # Once: a controller that hangs over it would hang again.
        future = client.set_parameters([Parameter(name, value=value) for name, value in values.items()])
        self.wait(future.done, f"the answer of {node}", limit)
        return ["" if result.successful else result.reason or "refused" for result in future.result().results]

    def _answer(self, ask: Callable[[], Future], what: str) -> Any:
        """The answer to a question that may be asked twice.

        A server that is known to the client need not know the client yet: its first answer can go nowhere.
        """
        asked = [ask()]
        again = time.monotonic() + _ASK_AGAIN

        def done() -> bool:
            nonlocal again
            if time.monotonic() > again:
                asked.append(ask())
                again = time.monotonic() + _ASK_AGAIN
            return any(future.done() for future in asked)

        self.wait(done, what)
        return next(future.result() for future in asked if future.done())

    def known(self, client: Client, what: str) -> Client:
        """The client, once its server is there and has had time to know the client."""
        if not client.service_is_ready():
            self.wait(client.service_is_ready, what)
        if client not in self._settled:
            self.spin(_SETTLED)
            self._settled.append(client)
        return client

    def _parameters_of(self, node: str) -> AsyncParameterClient:
        """One client a node: ever new ones would keep the discovery busy."""
        if node not in self._clients:
            self._clients[node] = AsyncParameterClient(self.node, node)
            self.wait(self._clients[node].services_are_ready, f"the parameter services of {node}")
            self.spin(_SETTLED)
        return self._clients[node]

    def call(self, service: str) -> Future:
        """Call a Trigger service of the monitor; the answer comes when it comes."""
        client = self.node.create_client(Trigger, f"/stickslip_monitor/{service}")
        return self.known(client, f"the service {service}").call_async(Trigger.Request())

    def change_state(self, transition: int) -> bool:
        """Ask the monitor for a transition of lifecycle_msgs/Transition; returns whether it succeeded."""
        client = self._lifecycle_client(ChangeState, "change_state")
        future = client.call_async(ChangeState.Request(transition=Transition(id=transition)))
        self.wait(future.done, f"transition {transition}")
        return bool(future.result().success)

    def begin_anew(self, **parameters: object) -> None:
        """Let a monitor that several tests share forget everything, and begin with other parameters."""
        for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP):
            assert self.change_state(transition)
        refused = self.set_parameters("/stickslip_monitor", parameters) if parameters else []
        assert not any(refused), refused
        for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
            assert self.change_state(transition)
        self.diagnostics.clear()
        self.wait_for_monitor()
        # What it said of the test before, some of it when it was deactivated.
        for heard in (self.margins, self.margin_times, self.cycles, self.silences):
            heard.clear()
        self.recommended = None

    def state(self) -> str:
        """Label of the monitor's lifecycle state."""
        client = self._lifecycle_client(GetState, "get_state")
        answer = self._answer(lambda: client.call_async(GetState.Request()), "the lifecycle state")
        return str(answer.current_state.label)

    def _lifecycle_client(self, kind: type, name: str) -> Client:
        if name not in self._lifecycle:
            self._lifecycle[name] = self.node.create_client(kind, f"/stickslip_monitor/{name}")
        return self.known(self._lifecycle[name], f"the service {name}")

    def answer(self, service: str) -> Trigger.Response:
        """The answer of a Trigger service of the monitor."""
        future = self.call(service)
        self.wait(future.done, f"the answer of {service}")
        return future.result()

    def describe(self, node: str, names: list[str]) -> list[ParameterDescriptor]:
        """Descriptors of parameters."""
        client = self.node.create_client(DescribeParameters, f"{node}/describe_parameters")
        self.wait(client.service_is_ready, f"the parameter services of {node}")
        request = DescribeParameters.Request(names=names)
        return list(self._answer(lambda: client.call_async(request), f"the answer of {node}").descriptors)

    def get_parameters(self, node: str, names: list[str]) -> list[float]:
        """Double parameters of a node."""
        client = self._parameters_of(node)
        self.wait(client.services_are_ready, f"the parameter services of {node}")
        answer = self._answer(lambda: client.get_parameters(names), f"the answer of {node}")
        return [value.double_value for value in answer.values]


@contextmanager
def probe() -> Iterator[Probe]:
    """A probe on the domain of the environment."""
    rclpy.init(args=[])
    one = Probe()
    try:
        yield one
    finally:
        one.node.destroy_node()
        rclpy.try_shutdown()


def staircase(count: int, *, rate: float = 200.0) -> tuple[list[float], list[float]]:
    """Times and positions of an unmistakable staircase, at 0.01 rad/s, one step of 0.01 rad a second."""
    times = [index / rate for index in range(count)]
    positions = []
    for time_ in times:
        phase = min(max((time_ % 1.0 - 0.6) / 0.4, 0.0), 1.0)
        positions.append(
            1e-5 * round((0.01 * (math.floor(time_) + phase**3 * (10 - 15 * phase + 6 * phase**2))) / 1e-5)
        )
    return times, positions


def sticking_motion(duration: float, *, rate: float = 200.0) -> Batch:
    """The paper's joint that sticks and slips at 0.005 rad/s, as an encoder gives it, with its reference."""
    times = np.arange(round(duration * rate)) / rate
    references, velocities = 0.005 * times, np.full(times.shape, 0.005)
    joint = load_joint("puma560_joint1").joint
    found = simulate(joint, Gains(stiffness=630.0), references, velocities, period=1.0 / rate)
    positions = 2.5e-5 * np.round(found.position[: len(times)] / 2.5e-5)
    return Batch(time=times, position=positions, reference_position=references, reference_velocity=velocities)


def play(
    one: Probe,
    joint: str,
    times: Iterable[float],
    positions: Iterable[float],
    references: Iterable[float] = (),
    *,
    begin: float,
) -> None:
    """Publish a motion some five times as fast as it was: of more a busy machine loses hundreds at once."""
    desired = list(references)
    for index, (at, position) in enumerate(zip(times, positions, strict=True)):
        if desired:
            message = JointState(name=[joint], position=[desired[index]])
            message.header.stamp = stamp(begin + at)
            one.references.publish(message)
        one.publish([joint], begin + at, position=[float(position)])
        if index % 10 == 0:
            one.spin(0.01)
