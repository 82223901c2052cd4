# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Whatever is on the graph, the node stays up and judges the healthy joint as if nothing else were there."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nodes.forked_nodes import NodeProcess
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterEvent, ParameterValue
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension
from support_ros import ROOM, Probe, probe, staircase

from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.nodes.conversion import stamp

EXAMPLES, AT_ONCE = int(os.environ.get("FUZZ_EXAMPLES", "20")), 100
RATE = 200.0
HEALTHY = "healthy"

numbers = st.floats(allow_nan=True, allow_infinity=True)
EVIL = ["", "../../etc/passwd", "%s%n", "{0}", "joint\n1", "a" * 300, "ä€", "joints", "recommended.healthy.p", "'; --"]
names = st.one_of(st.sampled_from(["a", "b", "c", *EVIL]), st.text(max_size=8).filter(lambda name: "\0" not in name))
few = st.lists(numbers, max_size=4)
stamps = st.sampled_from([0.0, 1.0, 99.0, 100.0, 1e9, 2e9])


@st.composite
def joint_states(draw: st.DrawFn) -> JointState:
    """Names, values and stamps that need not fit."""
    message = JointState(name=draw(st.lists(names.filter(lambda name: name != HEALTHY), max_size=4)))
    message.position, message.velocity, message.effort = draw(few), draw(few), draw(few)
    message.header.stamp = stamp(draw(stamps))
    message.header.frame_id = draw(st.sampled_from(["", "base", "x" * 50]))
    return message


@st.composite
def gains(draw: st.DrawFn) -> Float64MultiArray:
    """Tables that need not be any."""
    message = Float64MultiArray(data=draw(few))
    labels = st.sampled_from(["a", "a,b", "p,d", "p,i,d", "", ",", "a" * 200])
    message.layout.dim = [
        MultiArrayDimension(label=draw(labels), size=draw(st.integers(0, 2**32 - 1)), stride=draw(st.integers(0, 9)))
        for _ in range(draw(st.integers(0, 3)))
    ]
    return message


@st.composite
def events(draw: st.DrawFn) -> ParameterEvent:
    """Changes of gains that no controller would make."""
    value = ParameterValue(
        type=draw(st.integers(0, 255)), double_value=draw(numbers), integer_value=draw(st.integers(-(2**63), 2**63 - 1))
    )
    name = draw(st.sampled_from(["gains.a.p", "gains..p", "gains.a.b.c.i", "gains", ".", "gains.a.d", "x" * 100]))
    return ParameterEvent(
        node=draw(st.sampled_from(["/controller", "/nobody", ""])),
        changed_parameters=[ParameterMessage(name=name, value=value)],
    )


OTHER_TYPE = DiagnosticArray(status=[DiagnosticStatus(name="x", values=[KeyValue(key="k", value="v")] * 5)])


@st.composite
def garbage(draw: st.DrawFn, whole: st.SearchStrategy[object]) -> bytes:
    """Bytes that no serializer would make: cut off, changed, of another type, with huge counts, or any."""
    kind = draw(st.sampled_from(["any", "cut", "changed", "huge", "other"]))
    if kind == "any":
        return draw(st.binary(max_size=200))
    if kind == "other":
        return bytes(serialize_message(OTHER_TYPE))
    data = bytearray(serialize_message(draw(whole)))
    at = draw(st.integers(0, len(data) - 1))
    if kind == "cut":
        return bytes(data[:at])
    if kind == "changed":
        data[at] ^= draw(st.integers(1, 255))
    else:
        # A count stands at a multiple of four after the encapsulation.
        at = 4 + 4 * (at // 4)
        data[at : at + 4] = draw(st.sampled_from([b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x00\x00\x00\x10"]))
    return bytes(data)


@dataclass
class Patient:
    """The node under test, and the healthy joint's motion, some of which goes with every example."""

    one: Probe
    monitor: NodeProcess
    publishers: dict[str, Publisher]
    motion: Iterator[tuple[float, float]]
    sent: list[tuple[float, float]] = field(default_factory=list)
    messages: int = 0

    def go_on(self, count: int) -> None:
        """Some samples of the healthy joint."""
        for at, position in islice(self.motion, count):
            self.sent.append((at, position))
            self.one.publish([HEALTHY], at, position=[position])

    def send(self, topic: str, message: object) -> None:
        """One message, or the bytes of one."""
        self.publishers[topic].publish(message)
        self.messages += 1


@contextmanager
def patient() -> Iterator[Patient]:
    """A monitor that takes every sample (reliable), so that cycles can be compared."""
    override = "qos_overrides./joint_states.subscription"
    reliable = {f"{override}.reliability": "reliable", f"{override}.depth": ROOM}
    parameters = {"joints": "['']", "controller": "/controller", "state_file": "none", "learn": "false", **reliable}
    with NodeProcess("monitor", parameters) as monitor, probe() as one:
        one.wait_for_monitor()
        qos = QoSProfile(depth=ROOM)
        kinds = {"joint_states": JointState, "joint_references": JointState, "pd_gains": Float64MultiArray}
        publishers = {topic: one.node.create_publisher(kind, topic, qos) for topic, kind in kinds.items()}
        publishers["/parameter_events"] = one.node.create_publisher(ParameterEvent, "/parameter_events", qos)
        one.wait(lambda: all(p.get_subscription_count() > 0 for p in publishers.values()), "the listeners")
        one.wait_for_publishers(2)
        times, positions = staircase(60 * int(RATE), rate=RATE)
        yield Patient(one, monitor, publishers, zip((100.0 + np.array(times)).tolist(), positions, strict=True))


def check(sick: Patient) -> None:
    """The healthy joint's cycles are those that its samples alone give, its status is theirs, and the node is up."""
    sent = np.array(sick.sent)
    alone = JointMonitor(at_arrest=True)
    expected = alone.process(Batch(time=sent[:, 0], position=sent[:, 1]))
    assert len(expected) >= 8

    def heard() -> list[float]:
        return [float(cycle["breakaway [s]"]) for cycle in sick.one.cycles if cycle["joint"] == HEALTHY]

    sick.one.wait(lambda: len(heard()) >= len(expected), f"{len(expected)} cycles")
    assert heard()[: len(expected)] == pytest.approx([cycle.breakaway for cycle in expected], abs=1e-6)
    # A cycle is told in a message of its own, before the status that follows from it.
    sick.one.wait(lambda: sick.one.status(HEALTHY) == alone.finding().status.value, "the status")
    assert alone.finding().status is Status.STICK_SLIP
    assert sick.monitor.running, sick.monitor.output()
    assert "Traceback" not in sick.monitor.output()


def test_thousands_of_messages(ros_domain: int) -> None:
    """Issue 7: any content in any order on every subscriber, and bytes that are no messages; ten thousand at night."""
    kinds = {
        "joint_states": joint_states(),
        "joint_references": joint_states(),
        "pd_gains": gains(),
        "/parameter_events": events(),
    }
    message = st.sampled_from(sorted(kinds)).flatmap(
        lambda topic: st.tuples(st.just(topic), st.one_of(kinds[topic], garbage(kinds[topic])))
    )
    with patient() as sick:

        @settings(
            max_examples=EXAMPLES,
            deadline=None,
            suppress_health_check=[HealthCheck.too_slow, HealthCheck.large_base_example, HealthCheck.data_too_large],
        )
        @given(st.lists(message, min_size=AT_ONCE, max_size=AT_ONCE))
        def bombard(batch: list[tuple[str, object]]) -> None:
            for index, (topic, content) in enumerate(batch):
                sick.send(topic, content)
                if index % 5 == 0:
                    sick.go_on(4)
            sick.one.spin(0.02)
            assert sick.monitor.running, sick.monitor.output()

        bombard()
        sick.go_on(2000)
        assert sick.messages >= EXAMPLES * AT_ONCE
        check(sick)
        values = sick.one.diagnostics["stickslip_monitor"][2]
        refused = [key for key in values if key.startswith("refused")]
        assert len(refused) > 5
        assert max(map(len, refused)) < 500


def test_random_parameters(ros_domain: int) -> None:
    """Issue 7: random sets of parameters of every type, right or wrong: taken or refused, and the node is up."""
    common = ["warn_margin", "wanted_margin", "confidence", "condition", "variant", "memory", "apply_rate", "joints"]
    joints = ["inertia", "friction", "gains", "limits", "trial", "gain_scale", "control_delay", "load", "recommended"]
    keys = ["", ".p", ".d", ".i", ".stribeck", ".stribeck_velocity", ".p_max", ".d_min", ".bandwidth", ".effort"]
    name = st.one_of(
        st.sampled_from([*common, "use_sim_time", "publish_rate", "qos_overrides", "no_such", "a.b.c", "x" * 200]),
        st.tuples(st.sampled_from(joints), st.sampled_from(["a", "b", "nobody"]), st.sampled_from(keys)).map(
            lambda parts: f"{parts[0]}.{parts[1]}{parts[2]}"
        ),
    ).filter(lambda name: name != "use_sim_time")
    value = st.one_of(numbers, st.integers(-(2**62), 2**62), st.booleans(), st.text(max_size=5), st.just(["a"]), few)
    with patient() as sick:
        sick.one.publish(["a", "b"], 100.0, position=[0.0, 0.0])
        sick.one.wait(lambda: "b" in sick.one.diagnostics, "the other joints")

        @settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
        @given(st.dictionaries(name, value.filter(lambda found: found != []), min_size=1, max_size=3))
        def change(values: dict[str, object]) -> None:
            reasons = sick.one.set_parameters("/stickslip_monitor", values)
            for (key, wanted), reason in zip(values.items(), reasons, strict=True):
                if key.startswith("recommended.") or (
                    isinstance(wanted, float) and not math.isfinite(wanted) and "gain_scale" in key
                ):
                    assert reason, key
            sick.go_on(10)
            assert sick.monitor.running, sick.monitor.output()

        change()
        sick.go_on(2000)
        check(sick)
