# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What is said of a joint."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import simulate
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.assessment import MonitorOptions
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.output.diagnosis import Level, joint_diagnostic
from stickslip_ros.output.published import Findings
from stickslip_ros.settings.known_joints import load_joint

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
    status = joint_diagnostic("a", Findings(assessment=state, exact=UNKNOWN), 0.1)
    assert status.level is Level.ERROR
    assert status.message == (
        "stick_slip; its gains have the wanted reserve by the friction estimate, which is therefore wrong"
    )


@pytest.mark.parametrize("silent_for", [None, 0.0, 12.3, math.inf])
@pytest.mark.parametrize("configured", [False, True])
def test_no_sentence_has_an_infinite_duration(silent_for: float | None, configured: bool) -> None:
    """Issue 15: what never was is said so; "for inf s" is no time."""
    known = load_joint("puma560_joint1")
    monitor = JointMonitor(known.joint, known.gains) if configured else JointMonitor()
    state = monitor.assessment()
    status = joint_diagnostic("a", Findings(assessment=state, exact=UNKNOWN, silent_for=silent_for), 0.1)
    assert not re.search(r"\b(inf|nan)\b", status.message), status.message
    if silent_for == math.inf:
        assert status.message == "no data yet"


def test_a_silent_monitor_in_words() -> None:
    """Issue 15: so too in `stickslip watch`."""
    pytest.importorskip("rclpy")
    from stickslip_ros.cli.monitor_client import WatchListener, _Heard

    for at, text in ((-math.inf, "no status yet"), (-1e6, "no status for 1")):
        message = WatchListener._view("a", _Heard(at=at, values={"status": "smooth"})).message
        assert message.startswith(text)
        assert "inf" not in message


def test_what_is_missing_is_in_the_line_of_the_joint() -> None:
    """Issue 15: the reason stands behind whatever else is said, and the joint is not called well."""
    state = JointMonitor().assessment()
    found = Findings(assessment=state, exact=UNKNOWN, missing="gains not known: waiting for /b")
    status = joint_diagnostic("a", found, 0.1)
    assert status.message.endswith("; gains not known: waiting for /b")
    assert dict(status.values)["missing"] == "gains not known: waiting for /b"
    assert status.level >= 1
