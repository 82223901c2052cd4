# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A bag played to the node and the same bag analysed: the same cycles, statuses and parameters."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import LIMIT, nightly
from nodes.forked_nodes import NodeProcess
from support_ros import Probe, probe

from stickslip_ros.analysis.analysis import AnalysisOptions, analyze
from stickslip_ros.analysis.joint_analysis import JointAnalysis, JointAnalyzer
from stickslip_ros.bags.simulated import RecordedJoint, write_simulation
from stickslip_ros.bags.writing import BagWriter, serialized_joint_states
from stickslip_ros.messages.joint_states import TYPE as JOINT_STATE
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.monitoring.detection.status import Segment, Status
from stickslip_ros.monitoring.friction.estimate import NAMES
from stickslip_ros.settings.known_joints import load_joint
from stickslip_ros.settings.parameter_file import Parameters

_DURATION, _FACTOR = 14.0, 5.0
_ATTEMPTS = 4
_RELIABLE = {
    f"qos_overrides./{topic}.subscription.reliability": "reliable" for topic in ("joint_states", "joint_references")
}


def random_bag(folder: Path, number: int, name: str, *, with_gains: bool) -> Path:
    """A recording of a joint drawn at random, that sticks or does not."""
    generator = np.random.default_rng(100 + number)

    def about(value: float, spread: float = 0.4) -> float:
        return float(value * np.exp(spread * generator.standard_normal()))

    known = load_joint("puma560_joint1").joint.friction
    friction = Friction(
        coulomb=about(8.43), viscous=about(4.94), stribeck=about(1.6), stribeck_velocity=about(0.0058),
        lag=float(known.lag), rise_time=about(0.26),
    )  # fmt: skip
    joint = RecordedJoint(
        joint=Joint(inertia=about(6.3), friction=friction),
        gains=Gains(stiffness=about(900.0), damping=float(generator.choice([0.0, 30.0, 150.0]))),
        velocities=(about(0.012), -about(0.012)) if number % 3 == 0 else (about(0.012),),
        encoder_resolution=float(generator.choice([0.0, 2.5e-5, 1e-4])),
        position_noise=float(generator.choice([0.0, 1e-5])),
        velocity_noise=1e-4,
    )
    path = folder / f"{name}.mcap"
    rate = float(generator.choice([200.0, 333.0, 500.0]))
    write_simulation(
        path, {name: joint}, duration=_DURATION, rate=rate, seed=number, jitter=0.05 / rate,
        with_gains=with_gains, start=1000.0,
    )  # fmt: skip
    return path


def played(one: Probe, path: Path, joint: str) -> list[str]:
    """Play a bag to the monitor; the joint's status words in order."""
    words: list[str] = []

    def over() -> bool:
        word = one.status(joint)
        if word and (not words or words[-1] != word):
            words.append(word)
        return not replay.running

    with NodeProcess("replay", {"recording": path, "time_factor": _FACTOR, "linger": 0.3}) as replay:
        one.wait(over, f"the end of {path.name}")
        assert replay.wait(LIMIT) == 0, replay.output()
    return words


def words_of(path: Path, options: AnalysisOptions, joint: str) -> list[str]:
    """The joint's status words with every single sample of a bag, in order."""
    words: list[str] = []

    def watch(joints: dict[str, JointAnalyzer], *_: object) -> None:
        if joint in joints:
            word = joints[joint].monitor.finding().status.value
            if not words or words[-1] != word:
                words.append(word)

    analyze(path, replace(options, longest_piece=1e-4), watcher=watch)
    return words


def counted(one: Probe, key: str) -> int:
    """What the monitor has counted since it began."""
    return int(one.diagnostics["stickslip_monitor"][2][key])


def is_part_of(some: Iterable[str], words: Iterable[str]) -> bool:
    """Whether words occur among others in the same order."""
    rest = iter(words)
    return all(word in rest for word in some)


def status_of(segment: Segment) -> str:
    return segment.status.value


def without_arrests(segments: Sequence[Segment]) -> list[Segment]:
    """The segments without the slices of 50 ms in which the joint came to rest, just before an ``at_rest``."""
    before_rest = [after.status is Status.AT_REST for after in segments[1:]] + [False]
    return [
        one
        for one, rests in zip(segments, before_rest, strict=True)
        if not (rests and one.status is Status.NOT_JUDGED and one.end - one.start <= 0.05)
    ]


def check_cycles(one: Probe, expected: JointAnalysis) -> None:
    """Whether the node published the cycles that the analysis found, all numbers to the last digit."""
    heard = [cycle for cycle in one.cycles if cycle["joint"] == expected.name]
    assert len(heard) == len(expected.cycles)
    for live, recorded in zip(heard, expected.cycles, strict=True):
        assert float(live["breakaway [s]"]) == recorded.breakaway
        assert float(live["arrest [s]"]) == recorded.arrest
        assert float(live["slip_distance [rad]"]) == recorded.slip_distance
        assert float(live["dwell [s]"]) == recorded.dwell


def played_in_time(
    one: Probe, record: Callable[[str], Path], options: AnalysisOptions
) -> tuple[Path, JointAnalysis, list[str]]:
    """A recording that was played, as analysed, and the words live; record() makes one of the joint named.

    A busy machine loses messages, and a reliable publisher sends them again up to three seconds later. The monitor
    counts the references that come too late by that, and takes a second without messages for the end of the motion,
    after which it studies the slips seen so far. A monitor that gets no processor for two seconds finds the first
    messages pushed out of its queue by later ones. Such a recording is played again, by another name.
    """
    for attempt in range(_ATTEMPTS):
        path = record(f"axis{attempt}")
        (expected,) = analyze(path, options).joints.values()
        late, received = counted(one, "references too late [1]"), counted(one, "messages received [1]")
        words = played(one, path, expected.name)
        one.wait(lambda name=expected.name: one.is_silent(name), f"the end of {expected.name}")
        one.wait(lambda: "stickslip_monitor" in one.diagnostics, "the monitor's own status")
        received = counted(one, "messages received [1]") - received
        in_time = counted(one, "references too late [1]") == late and one.silences[expected.name] == 1
        if in_time and received == expected.samples:
            return path, expected, words
    pytest.fail(f"what was played did not come in time {_ATTEMPTS} times")


@pytest.mark.parametrize("count", [3, nightly(10)])
def test_random_recordings_live_and_from_the_file(ros_domain: int, tmp_path: Path, count: int) -> None:
    """Issue 6, item 2: random recordings through DDS and from the file: identical cycles and statuses."""
    options = AnalysisOptions(parameters=Parameters({"learn": False}))
    sticking = 0
    with NodeProcess("monitor", {"learn": "false", **_RELIABLE}), probe() as one:
        one.wait_for_monitor()
        for number in range(count):

            def record(name: str, number: int = number) -> Path:
                return random_bag(tmp_path, number, f"{name}_{number}", with_gains=number % 2 == 0)

            path, expected, words = played_in_time(one, record, options)
            one.wait(
                lambda expected=expected: (
                    sum(cycle["joint"] == expected.name for cycle in one.cycles) >= len(expected.cycles)
                ),
                f"the cycles of {expected.name}",
            )
            check_cycles(one, expected)
            sticking += len(expected.cycles) > 0
            assert one.status(expected.name) == expected.assessment.finding.status.value
            # Segments are of 50 ms or more, and live a status is said now and then: both miss short ones, and tell no
            # others. The slice in which a joint came to rest is neither motion nor rest to a segment, and no word live.
            every = words_of(path, options, expected.name)
            recorded = [key for key, _ in itertools.groupby(map(status_of, without_arrests(expected.segments)))]
            assert is_part_of(recorded, every), (recorded, every)
            assert is_part_of((word for word in words[:-1] if word != "unknown"), every), (words, every)
            live = one.margins[expected.name]
            gains = expected.assessment.gains
            assert (gains is None) == np.isnan(live["stiffness"])
            assert gains is None or live["stiffness"] == float(gains.stiffness)
    assert 0.4 * count <= sticking <= 0.9 * count


def test_parameters_learnt_live_and_from_the_file(ros_domain: int, tmp_path: Path) -> None:
    """Issue 6, item 2: what is learnt does not depend on whether studies are made at once or in another process."""
    known = load_joint("puma560_joint1")
    joint = RecordedJoint(joint=known.joint, gains=known.gains, velocities=(0.009,), encoder_resolution=2.5e-5)

    def record(name: str) -> Path:
        path = tmp_path / f"{name}.mcap"
        write_simulation(path, {name: joint}, duration=22.0, rate=500.0, start=1000.0)
        return path

    with NodeProcess("monitor", _RELIABLE), probe() as one:
        one.wait_for_monitor()
        _, expected, _ = played_in_time(one, record, AnalysisOptions())
        estimate = expected.assessment.estimate
        assert estimate is not None
        one.wait(
            lambda: one.diagnostics[expected.name][2].get("slips learnt from [1]") == str(estimate.slips),
            f"what {estimate.slips} slips teach",
        )
        check_cycles(one, expected)
        values = one.diagnostics[expected.name][2]
    units = {key.partition(" [")[0]: key for key in values}
    for name in NAMES:
        assert float(values[units[name]]) == pytest.approx(estimate[name].value, rel=1e-9), name
        assert float(values[units[f"{name} std"]]) == pytest.approx(estimate[name].std, rel=1e-6), name


def test_a_bag_of_several_robots_is_played_one_at_a_time(ros_domain: int, tmp_path: Path) -> None:
    """Issue 17, item 10: replay plays one robot; of several it lists the topics, and names the parameter."""
    path = tmp_path / "arms.mcap"
    topics = ("/left/joint_states", "/right/joint_states")
    times = 1.0 + 0.01 * np.arange(100)
    with BagWriter(path, dict.fromkeys(topics, JOINT_STATE)) as writer:
        values = np.stack([0.1 * times, *[np.full(100, np.nan)] * 2], axis=1)[:, :, None]
        writer.write(*(serialized_joint_states(topic, ("joint1",), times, values) for topic in topics))
    with NodeProcess("replay", {"recording": path}) as replay:
        assert replay.wait(LIMIT) == 2
        listed = "/left/joint_states (100 messages), /right/joint_states (100 messages)"
        assert f"{listed}: choose one with the parameter states" in replay.output()
    with NodeProcess("replay", {"recording": path, "states": "/middle"}) as replay:
        assert replay.wait(LIMIT) == 2
        assert "the parameter states /middle: no such topic" in replay.output()
