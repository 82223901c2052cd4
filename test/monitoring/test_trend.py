# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Friction that changes steadily while it is learnt."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from conftest import nightly
from random_machines import CONDITIONS, Condition, MachineRecording, random_recording, to_and_fro

from stickslip_ros.monitoring.joint_monitor import JointMonitor

pytestmark = pytest.mark.slow

DRIFT = 0.05 / 60.0  # a second
DRIFTS_UNDER_LOAD = Condition(
    name="drift under load",
    velocities=to_and_fro,
    change=lambda rng, machine, gains: replace(machine, drift=DRIFT, load=0.3 * machine.coulomb),
    both_directions=True,
)


@functools.cache
def learnt(condition: Condition, seed: int) -> tuple[MachineRecording, JointMonitor]:
    """A random machine, and what its recording teaches."""
    recording = random_recording(seed, condition)
    monitor = JointMonitor(None, recording.gains, studies_at_once=True, segments_kept=None, at_arrest=True)
    monitor.process(recording.batch)
    monitor.finish()
    return recording, monitor


@pytest.mark.parametrize("seed", [20, nightly(21), nightly(22)])
def test_friction_that_drifts_is_known_as_it_is_at_the_end(seed: int) -> None:
    """Issue 18: what was learnt was the friction of the whole recording."""
    recording, monitor = learnt(CONDITIONS["drift"], seed)
    estimate = monitor.learner.estimate
    assert estimate is not None
    assert not estimate.mismatch
    # What a trend leaves over is a tenth of what the friction changes by.
    machine = recording.machine.after(float(recording.batch.time[-1]))
    changed = (machine.coulomb + machine.stribeck) * DRIFT * float(np.ptp(recording.batch.time))
    assert estimate.scatter < 0.1 * changed
    for name in ("inertia", "stribeck", "stribeck_velocity"):
        assert abs(estimate[name].value - getattr(machine, name)) < 3.0 * estimate[name].std
    assert estimate["inertia"].identified
    together = estimate.coulomb_and_load
    assert abs(together.value - machine.coulomb) < 2.5 * together.std


def test_drift_and_load_are_told_apart() -> None:
    """Coulomb friction is that of the last slip, and the load is what it was all the time."""
    recording, monitor = learnt(DRIFTS_UNDER_LOAD, 3)
    estimate = monitor.learner.estimate
    assert estimate is not None
    machine = recording.machine.after(float(recording.batch.time[-1]))
    for one, truth in ((estimate.coulomb, machine.coulomb), (estimate.load, machine.load)):
        assert one.identified
        assert abs(one.value - truth) < 3.0 * one.std
        assert one.std < 0.03 * truth


@pytest.mark.parametrize("seed", [20, nightly(21)])
def test_friction_that_stays_has_no_trend(seed: int) -> None:
    """Nothing changes where nothing drifts."""
    _, monitor = learnt(CONDITIONS["base"], seed)
    found = monitor.learner.memory_of().learnt
    assert found is not None
    assert not found.drifts
