# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""When the node looks at the samples of a joint: what happens is seen soon, what goes on as it did costs little."""

from __future__ import annotations

import numpy as np
import pytest
from rclpy.logging import get_logger

from stickslip_ros.monitoring.assessment import MonitorOptions
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import ReferencePairing
from stickslip_ros.nodes.watched_joints import BatchProcessing, GainBounds, WatchedJoint
from stickslip_ros.settings.parameters import JointSettings

RATE, TICK, COUNT = 200.0, 0.04, 1e-5  # [Hz], [s], [rad]
SPEED = 0.02  # [rad/s]
JOINTS = [f"joint{number + 1}" for number in range(100)]


def test_efforts_in_other_units() -> None:
    """Efforts in amperes become torques; time, position and velocity stay as they are, and so do the given rows."""
    pairing, rows = ReferencePairing(), np.array([[1.0, 2.0, 3.0, 4.0]])
    pairing.add_samples(rows, effort_scale=50.0)
    batch = pairing.next_batch(all_of_them=True)
    assert batch is not None
    assert [batch.time[0], batch.position[0], batch.velocity[0], batch.effort[0]] == [1.0, 2.0, 3.0, 200.0]
    assert rows.tolist() == [[1.0, 2.0, 3.0, 4.0]]


class Stage:
    """Joints that are fed and followed tick by tick; ``looks`` counts how often each was looked at."""

    def __init__(self) -> None:
        settings = JointSettings(joint=None, gains=None, options=MonitorOptions(), gain_scale=1.0, effort_scale=1.0)
        bounds = GainBounds()
        self.joints = {name: WatchedJoint(name, JointMonitor(), settings, bounds) for name in JOINTS}
        self.processing = BatchProcessing(self.joints, self._fail, get_logger("stage"))
        self.time = 0.0
        self.looks = dict.fromkeys(JOINTS, 0)
        self.waited = dict.fromkeys(JOINTS, 0.0)  # [s] since a joint was looked at last
        self.position = dict.fromkeys(JOINTS, 0.0)

    def _fail(self, reason: str) -> None:
        raise AssertionError(reason)

    def go_on(self, seconds: float, speeds: dict[str, float]) -> None:
        """All joints move at the speeds given, 0 by default."""
        count = round(TICK * RATE)
        for _ in range(round(seconds / TICK)):
            times = self.time + np.arange(1, count + 1) / RATE
            samples = {}
            for name in JOINTS:
                speed = speeds.get(name, 0.0)
                position = self.position[name] + speed * (times - self.time)
                samples[name] = np.column_stack(
                    [times, COUNT * np.round(position / COUNT), np.full(count, speed), np.zeros(count)]
                )
                self.position[name] = float(position[-1])
                self.joints[name].pairing.add_samples(samples[name])
            self.time = float(times[-1])
            self.processing.expect(samples, (), self.time)
            self.processing.poll(self.time, hurry=False)
            processed = self.processing.processed()
            for name in JOINTS:
                self.waited[name] = 0.0 if name in processed else self.waited[name] + TICK
                self.looks[name] += name in processed

    def status(self, name: str) -> str:
        """As the last look had it."""
        return self.joints[name].monitor.latest_status.value


@pytest.fixture(scope="module")
def moved() -> Stage:
    """Every other joint moves, every other one rests, and nothing has happened for a while."""
    stage = Stage()
    stage.go_on(8.0, dict.fromkeys(JOINTS[::2], SPEED))
    return stage


def test_what_goes_on_is_looked_at_rarely(moved: Stage) -> None:
    """Issue 21: joints that rest or move on as they did cost next to nothing, and none of them is forgotten."""
    assert {moved.status(name) for name in JOINTS[::2]} == {"smooth"}
    assert {moved.status(name) for name in JOINTS[1::2]} == {"at_rest"}
    moved.looks = dict.fromkeys(JOINTS, 0)
    moved.go_on(8.0, dict.fromkeys(JOINTS[::2], SPEED))
    assert max(moved.looks.values()) <= 4
    assert min(moved.looks.values()) >= 1


@pytest.mark.parametrize(("which", "speed", "until"), [("joint41", 0.0, "at_rest"), ("joint42", SPEED, "smooth")])
def test_what_happens_is_seen_soon(moved: Stage, which: str, speed: float, until: str) -> None:
    """Issue 21: a joint that stops, and one that leaves, among a hundred; the others are not looked at for it."""
    before = moved.status(which)
    speeds = {**dict.fromkeys(JOINTS[::2], SPEED), which: speed}
    moved.looks = dict.fromkeys(JOINTS, 0)
    moved.go_on(1.0, speeds)
    # A tenth of a second until it is clearly elsewhere, three tenths that a hundred joints may wait, and two ticks.
    assert moved.looks[which] >= 2
    assert moved.status(which) != before
    assert sum(moved.looks.values()) < 100
    moved.go_on(2.0, speeds)
    assert moved.status(which) == until


def test_which_may_be_told_of_again(moved: Stage) -> None:
    """Issue 21: of many joints in turn some are looked at anew, those longest ago; an arm's always."""
    speeds = dict.fromkeys(JOINTS[::2], SPEED)
    moved.go_on(6.0, speeds)
    turn = JOINTS[10:30]
    waits = moved.processing.may_wait(turn, TICK)
    assert len(waits) == len(turn) - 3
    looked_at = sorted(turn, key=lambda name: -moved.waited[name])[: len(turn) - len(waits)]
    assert min(moved.waited[name] for name in set(turn) - waits) >= moved.waited[looked_at[-1]] - TICK
    few = BatchProcessing({name: moved.joints[name] for name in JOINTS[:7]}, moved._fail, get_logger("stage"))
    assert few.may_wait(JOINTS[:7], TICK) == set()
