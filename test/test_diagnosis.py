# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What is said of a joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stickslip_ros.diagnosis import Level, joint_diagnostic
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import simulate
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.assessment import MonitorOptions
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

UNKNOWN = ExactVerdict(smooth=None)


def test_a_joint_that_sticks_in_spite_of_its_margin(puma: Joint) -> None:
    """Issue 5, item 2: advice to keep the gains of a joint that sticks would mislead; what is wrong is said instead."""
    references = 5.8e-6 * np.arange(12_000.0)
    motion = simulate(puma, Gains(stiffness=630.0), references, np.full(12_000, 0.0058))
    batch = Batch(time=motion.time, position=2.5e-5 * np.round(motion.position / 2.5e-5), reference_position=references)
    oiled = replace(puma, friction=replace(puma.friction, stribeck=0.01))
    monitor = JointMonitor(oiled, Gains(stiffness=630.0), MonitorOptions(learn=False))
    monitor.process(batch)
    state = monitor.assessment()
    assert state.recommendation is not None
    assert state.recommendation.keep
    status = joint_diagnostic("a", state, UNKNOWN, UNKNOWN, warn_margin=0.1, silent_for=None)
    assert status.level is Level.ERROR
    assert status.message == "stick_slip, though its margin is there: the friction is not what is believed"
