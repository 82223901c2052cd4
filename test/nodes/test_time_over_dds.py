# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Time as robots, simulators and bags have it: it loops, pauses, steps, is missing; rates change, samples drop out."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator

import numpy as np
import pytest
from nodes.forked_nodes import NodeProcess
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from support_ros import STALE, Probe, play, probe, staircase

from stickslip_ros.nodes.conversion import stamp

OWN = "stickslip_monitor"
NOTHING: dict[str, object] = {"joints": "['']", "state_file": "none"}


@pytest.fixture(scope="module")
def monitor(ros_domain_of_the_file: int) -> Iterator[NodeProcess]:
    """A monitor that knows nothing of any joint; each test begins anew with it."""
    with NodeProcess("monitor", NOTHING) as process:
        yield process


@pytest.fixture
def one(monitor: NodeProcess) -> Iterator[Probe]:
    """A probe that the monitor listens to."""
    assert monitor.running, monitor.output()
    begin = len(monitor.output())
    with probe() as one:
        one.log = lambda: monitor.output()[begin:]
        one.begin_anew(use_sim_time=False)
        yield one
        assert monitor.running, one.log()
        assert "Traceback" not in one.log()


def another_publisher(one: Probe) -> Publisher:
    """Another one of joint states."""
    other = one.node.create_publisher(JointState, "joint_states", QoSProfile(depth=5000))
    one.wait(lambda: other.get_subscription_count() > 0, "the listener")
    one.wait_for_publishers(2)
    return other


def cycles(one: Probe, joint: str = "joint1") -> list[float]:
    """When the cycles heard of began [s]."""
    return [float(cycle["breakaway [s]"]) for cycle in one.cycles if cycle["joint"] == joint]


def wait_for_stairs(one: Probe, count: int, joint: str = "joint1") -> None:
    """So many cycles, and stick-slip."""
    one.wait(lambda: len(cycles(one, joint)) >= count and one.status(joint) == "stick_slip", f"{count} cycles")


def test_a_bag_that_loops(one: Probe) -> None:
    """Issue 7: stamps jump back: every loop shows the same stairs, at the same times, and none across the seam."""
    started = time.monotonic()
    for _ in range(3):
        play(one, "joint1", *staircase(2000), begin=100.0)
    # The last step of a loop ends where the samples do; the silence after the last loop makes it known.
    one.wait(lambda: one.diagnostics["joint1"][0] == STALE, "silence")
    one.spin(0.3)
    found = cycles(one)
    first = sorted({round(begin, 6) for begin in found})
    assert len(found) == 3 * len(first)
    assert len(first) >= 8
    assert one.diagnostics["joint1"][2]["samples left out"] == ""
    # Issue 34, item 14: the log has the change once in ten seconds, however often the status goes to and fro.
    assert 1 <= one.log().count("joint1: stick_slip") <= 1 + (time.monotonic() - started) / 10.0, one.log()


def test_simulated_time_that_pauses_and_loops(one: Probe) -> None:
    """Issue 7: use_sim_time: stamps are the clock's; a pause stops nothing; the clock may come after the samples."""
    one.begin_anew(use_sim_time=True)
    clock = one.node.create_publisher(Clock, "/clock", 10)
    stamps = one.stamps
    stamps.clear()
    one.wait(lambda: clock.get_subscription_count() > 0, "the listener to the clock")

    def run(begin: float) -> None:
        # In the first tenth of a second of a loop the clock is still that of the loop before.
        for index, (at, position) in enumerate(zip(*staircase(1400), strict=True)):
            one.publish(["joint1"], begin + at, position=[position])
            if index % 20 == 19:
                clock.publish(Clock(clock=stamp(begin + at)))
                one.spin(0.01)

    run(50.0)
    wait_for_stairs(one, 5)
    one.wait(lambda: bool(stamps) and abs(stamps[-1] - 57.0) < 0.2, "statuses stamped by the clock")
    # The simulation pauses: statuses go on, with the time at which it stands.
    stamps.clear()
    one.wait(lambda: one.diagnostics["joint1"][0] == STALE and len(stamps) > 5, "silence")
    assert max(stamps) - min(stamps) < 0.2
    before = len(cycles(one))
    run(50.0)
    wait_for_stairs(one, before + 5)
    one.wait(lambda: abs(stamps[-1] - 57.0) < 0.2, "statuses stamped by the clock of the second loop")
    assert "refused" not in " ".join(one.diagnostics[OWN][2])


def test_a_pause_and_a_clock_that_steps(one: Probe) -> None:
    """Issue 7: after 30 s of silence in the stamps, and steps of the clock forth and back, it goes on as before."""
    times, positions = staircase(1600)
    begin = 100.0
    for step in (0.0, 3600.0, -0.4, -7200.0, 30.0):
        begin += 8.0 + step
        count = len(cycles(one))
        play(one, "joint1", times, positions, begin=begin)
        wait_for_stairs(one, count + 6)
        mine = [at for at in cycles(one)[count:] if begin <= at <= begin + 8.0]
        assert len(mine) >= 5
        assert all(0.3 < later - earlier < 1.7 for earlier, later in itertools.pairwise(mine)), mine
    distances = [float(cycle["slip_distance [rad]"]) for cycle in one.cycles]
    assert np.allclose(distances, 0.01, atol=2e-4), "no slip across a seam"


def test_a_clock_that_steps_under_the_references_too(one: Probe) -> None:
    """Issue 7: a small step back puts old and new references side by side; no cycle is invented by them."""
    count, rate = 1600, 200.0
    times = [index / rate for index in range(count)]
    for begin, start in ((100.0, 0.0), (107.6, 0.08), (115.2, 0.16)):
        smooth = [1e-5 * round((start + 0.01 * at) / 1e-5) for at in times]
        play(one, "joint1", times, smooth, [start + 0.01 * at for at in times], begin=begin)
    one.wait(lambda: one.status("joint1") == "smooth", "smooth motion")
    assert cycles(one) == []


def test_missing_stamps(one: Probe) -> None:
    """Issue 7: messages without stamps are taken at the time of their arrival, each at its own; it is said."""
    # Where the joint is depends on when that is said, or a moment without a processor would change the motion.
    positions = staircase(20000)[1]
    start, sent = time.monotonic(), [0]
    while (index := int(200 * (time.monotonic() - start))) < len(positions):
        one.publish(["joint1"], 0.0, position=[positions[index]])
        sent += [0] * (int(index / 200) + 1 - len(sent))
        sent[-1] += 1
        one.spin(0.005)
        if len(cycles(one)) >= 4 and one.status("joint1") == "stick_slip":
            break
    assert len(cycles(one)) >= 4
    periods = [later - earlier for earlier, later in itertools.pairwise(cycles(one))]
    assert abs(float(np.median(periods)) - 1.0) < 0.1
    assert "joint_states: stamp is zero" in " ".join(one.diagnostics[OWN][2])
    # A busy machine sends fewer than 200 a second, and in some seconds far fewer. The last one has not ended.
    assert float(one.diagnostics["joint1"][2]["sample rate [Hz]"]) > 0.5 * min(sent[:-1])


def test_silence_and_a_simulation_without_a_clock(ros_domain: int) -> None:
    """Issue 34, item 14: what is listened to and what there is instead; stamps of zero where simulated time stands."""
    parameters = NOTHING | {"use_sim_time": "true"}
    with NodeProcess("monitor", parameters, {"joint_states": "arm/states"}) as monitor, probe() as one:
        silence = (
            "nothing is heard on /arm/states (sensor_msgs/msg/JointState) yet, for 10 s: no node publishes "
            "JointState there; JointState is published on /joint_references (by /probe), /joint_states (by /probe): "
            "remap joint_states"
        )
        clock = "use_sim_time is true and nothing is heard on /clock"

        def own() -> tuple[bytes, str]:
            return one.diagnostics.get(OWN, (b"", "", {}))[:2]

        one.wait(lambda: silence in own()[1] and clock in own()[1], "both")
        assert own()[0] == b"\x01"
        one.spin(1.5)
        assert monitor.output().count(silence) == monitor.output().count(clock) == 1
        states = one.node.create_publisher(JointState, "/arm/states", QoSProfile(depth=100))
        one.wait(lambda: states.get_subscription_count() > 0, "the listener")
        positions = staircase(20000)[1]
        start = time.monotonic()
        while len(cycles(one)) < 3 and (index := int(200 * (time.monotonic() - start))) < len(positions):
            states.publish(JointState(name=["joint1"], position=[positions[index]]))
            one.spin(0.005)
        assert len(cycles(one)) >= 3
        assert one.diagnostics["joint1"][2]["samples left out"] == ""
        assert "nothing is heard on /arm" not in own()[1]
        used = "stamp is zero; the time of arrival by the system's clock (use_sim_time is true, and nothing is "
        assert f"joint_states: {used}heard on /clock) is used instead" in " ".join(one.diagnostics[OWN][2])


def test_two_publishers_of_different_joints(one: Probe) -> None:
    """Issue 7: an arm's and a gripper's broadcaster on one topic: both are served, nothing is called lost."""
    other = another_publisher(one)
    for index, (at, position) in enumerate(zip(*staircase(1600), strict=True)):
        one.publish(["arm"], 100.0 + at, position=[position])
        message = JointState(name=["gripper"], position=[-position])
        message.header.stamp = stamp(500.0 + at)
        other.publish(message)
        if index % 20 == 0:
            one.spin(0.01)
    wait_for_stairs(one, 6, "arm")
    wait_for_stairs(one, 6, "gripper")
    one.spin(1.0)
    said = one.diagnostics[OWN][2]
    assert said["publishers of joint_states [1]"] == "2"
    # A busy machine loses some on the way, at ten times the rate of a joint. None that came is called lost.
    assert int(said["messages received [1]"]) + int(said["messages lost [1]"]) <= 3200


def test_two_publishers_of_one_joint(one: Probe) -> None:
    """Issue 7: what two say at once is no motion: it is said, and followed again once one of them is gone."""
    rival = Node("rival")
    other = rival.create_publisher(JointState, "joint_states", QoSProfile(depth=5000))
    one.wait_for_publishers(2)
    for index in range(900):
        at = 100.0 + index / 200.0
        one.publish(["joint1", "joint2"], at, position=[0.001 * index, 0.0])
        message = JointState(name=["joint1"], position=[5.0 - 0.002 * index])
        message.header.stamp = stamp(at + 0.002)
        other.publish(message)
        one.spin(0.005)
    # Issue 34, item 14: both are named, and the log has it too.
    contest = "joint1: published by several nodes at once (/probe, /rival); remap all but one of them"
    assert one.diagnostics["joint1"][1] in contest
    one.wait(lambda: contest in one.log(), "the log")
    assert one.diagnostics["joint1"][0] == b"\x01"
    assert "several nodes" not in one.diagnostics["joint2"][1]
    rival.destroy_node()
    count = len(cycles(one))
    for number in range(2):
        play(one, "joint1", *staircase(1600), begin=200.0 + 10.0 * number)
    wait_for_stairs(one, count + 5)
    assert "several nodes" not in one.diagnostics["joint1"][1]


def test_rates_that_change_and_samples_that_drop_out(one: Probe) -> None:
    """Issue 7: 500, 100 and 250 Hz, a tenth of the samples missing, and half a second now and then: the same stairs."""
    random = np.random.default_rng(7)
    begin = 100.0
    for rate in (500.0, 100.0, 250.0):
        times, positions = staircase(round(8 * rate), rate=rate)
        hole = [at for at in times if 0.05 < at % 4.0 < 0.55]  # while the joint stands
        kept = [index for index, at in enumerate(times) if at not in hole and random.random() > 0.1]
        shift = 0.01 * (begin - 100.0)
        play(one, "joint1", [times[n] for n in kept], [positions[n] + shift for n in kept], begin=begin)
        begin += 8.0
    wait_for_stairs(one, 20)
    gaps = [later - earlier for earlier, later in itertools.pairwise(cycles(one))]
    assert all(math.isclose(gap, 1.0, abs_tol=0.12) for gap in gaps), gaps
