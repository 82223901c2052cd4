# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 18: what is learnt from a joint on bristles that yield ever more, which no law that is fitted explains."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

pytestmark = pytest.mark.slow


def test_bristles_that_yield_ever_more_end_no_analysis(puma: Joint) -> None:
    """A LuGre contact, 50 times as stiff as the controller: the errors of a fit were no numbers, and a study raised."""
    gains, rate, resolution = Gains(stiffness=630.0), 1000.0, 2e-5
    stiffness = 50.0 * float(gains.stiffness)
    friction = replace(
        puma.friction,
        presliding_stiffness=stiffness,
        presliding_damping=0.6 * math.sqrt(stiffness * float(puma.inertia)),
        contact="lugre",
    )
    times = np.arange(int(60.0 * rate)) / rate
    velocities = np.where(times < 30.0, 0.005, 0.003)
    references = np.append(0.0, np.cumsum(velocities)) / rate
    motion = JointSimulation(replace(puma, friction=friction), gains).advance(1.0 / rate, references[:-1], velocities)
    monitor = JointMonitor(None, gains, studies_at_once=True, segments_kept=None, at_arrest=True)
    monitor.process(
        Batch(
            time=times,
            position=resolution * np.round(motion.position / resolution),
            effort=motion.effort,
            reference_position=references[1:],
            reference_velocity=velocities,
        )
    )
    monitor.finish()
    assert monitor.learner.estimate is None or monitor.learner.estimate.mismatch
