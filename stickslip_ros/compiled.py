# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Loading the compiled parts ahead of time: some fifteen seconds after installation, a fraction of one later."""

from __future__ import annotations

import numpy as np

from stickslip_ros.model.controlled import Conditions
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.joint_simulation import simulate
from stickslip_ros.model.verdict import exact_verdict
from stickslip_ros.monitoring.assessment import MonitorOptions
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.monitoring.slip_problem import PARAMETERS, SlipProblem
from stickslip_ros.monitoring.slip_windows import slip_window


def load_compiled_parts() -> None:
    """Use everything compiled once, so that nothing is compiled while data come."""
    joint = Joint(inertia=1.0, friction=Friction(stribeck=1.0, stribeck_velocity=0.1, lag=0.1, rise_time=0.1))
    gains = Gains(stiffness=100.0)
    motion = simulate(joint, gains, 0.05 * np.arange(200.0), np.full(200, 5.0), period=0.01)
    monitor = JointMonitor(options=MonitorOptions(learn=False))
    batch = Batch(time=motion.time, position=motion.position)
    cycles = monitor.process(batch) + monitor.finish()
    windows = [slip_window(batch, cycle, None, resolution=0.0, noise=0.0) for cycle in cycles]
    for window in windows[:1]:
        if window is not None:
            problem = SlipProblem([window])
            problem.simulate(np.zeros(PARAMETERS + 1), problem.detected(1.0))
    exact_verdict(joint, gains, 0.05)
    exact_verdict(joint, gains, 0.05, Conditions(controller_period=0.01))
