# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The same joint gets the same gains, whatever the recording of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import nightly
from random_joints import RATE, RandomRecording, driven, random_recording

from stickslip_ros.monitoring.advice.recommend import recommend
from stickslip_ros.monitoring.advice.recommendation import Kind
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

pytestmark = pytest.mark.slow

_SEEN = ("inertia", "viscous", "stribeck", "stribeck_velocity", "lag", "rise_time")


def recorded(recording: RandomRecording, seconds: float, *, every: int = 1, noise: float = 0.0) -> Batch:
    """The joint for so long, half of it at each speed; every so-manieth sample, with noise [resolutions]."""
    references, motion = driven(recording.joint, recording.gains, recording.speeds, seconds)
    count = len(references)
    counts = np.concatenate([[0.0], motion.position[:-1]]) / recording.resolution
    counts += noise * np.random.default_rng(5).standard_normal(count)
    pick = slice(None, None, every)
    return Batch(
        time=(np.arange(count) / RATE)[pick], position=recording.resolution * np.round(counts[pick]),
        reference_position=references[pick],
    )  # fmt: skip


@pytest.mark.parametrize("seed", [0, *map(nightly, range(1, 20))])
def test_the_recording_does_not_change_the_gains(seed: int, pytestconfig: pytest.Config) -> None:
    """Issue 36: length, rate, noise, live or recorded: the same stiffness, and damping within 10 % where all is known.

    Where not all of the friction is identified, more damping may be advised, and not clearly less than is needed.
    """
    recording = random_recording(seed)
    speed = recording.speeds[0]
    ways = {
        "30 s": recorded(recording, 30.0),
        "250 Hz": recorded(recording, 30.0, every=4),
        "live": recorded(recording, 30.0),
    }
    if pytestconfig.getoption("--nightly"):
        ways |= {f"{t} s": recorded(recording, float(t)) for t in (20, 60)}
        ways["noise"] = recorded(recording, 30.0, noise=0.3)
    needed = recommend(recording.joint, recording.gains, speed)[Kind.LEAST_CHANGE]
    wanted = float(recording.joint.total_damping(needed.gains))
    certain = []
    for way, batch in ways.items():
        monitor = JointMonitor(gains=recording.gains, studies_at_once=way != "live")
        for begin in range(0, len(batch), 37 if way == "live" else len(batch)):
            monitor.process(batch.where(slice(begin, begin + 37) if way == "live" else slice(None)))
            if begin % 37_000 == 0:
                monitor.learn()
        monitor.finish()
        monitor.learn()
        state = monitor.assessment(speed)
        advised = state.recommended
        if state.estimate is None or advised is None or not advised.found:
            # Few samples allow little bandwidth, and what is learnt from them, or from noise, may be a guess.
            assert way in ("250 Hz", "noise"), (way, advised)
            continue
        assert advised.stiffness == needed.stiffness, way
        identified = all(state.estimate[name].identified for name in _SEEN)
        total = float(recording.joint.total_damping(replace(recording.gains, damping=advised.damping)))
        certain += [total] if identified else []
        # What is missing of the wanted margin of 20 % is not what ends stick-slip.
        assert identified or state.estimate.mismatch or total > wanted / 1.2, way
    if certain:
        assert wanted / 1.1 < min(certain) <= max(certain) < 1.1 * wanted
