# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The way from one pair of gains to another."""

from __future__ import annotations

import math

from hypothesis import example, given
from hypothesis import strategies as st

from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.monitoring.advice.gain_ramp import GainRamp

positive = st.floats(1e-3, 1e5)
damping = st.one_of(st.just(0.0), st.floats(1e-3, 1e4))


@given(positive, positive, damping, damping, st.floats(0.0, 10.0), st.floats(1e-3, 1e3), st.floats(0.01, 3.0))
def test_steps_are_small_and_arrive(
    begin: float, end: float, before: float, after: float, viscous: float, inertia: float, rate: float
) -> None:
    """Issue 5, item 4: no step beyond the rate; every gain between the ends; it arrives, exactly."""
    joint = Joint(inertia=inertia, friction=Friction(stribeck=1.0, stribeck_velocity=0.01, viscous=viscous))
    first, last = Gains(stiffness=begin, damping=before, integral=3.0), Gains(stiffness=end, damping=after)
    ramp = GainRamp.between(joint, first, last)
    assert ramp.at(0.0) == first
    assert ramp.at(1.0) == last
    share, old, steps = 0.0, first, 0
    while share < 1.0:
        share = ramp.next_share(share, rate=rate, elapsed=0.1)
        gains = ramp.at(share)
        assert abs(math.log(float(gains.stiffness) / float(old.stiffness))) <= min(0.1 * rate, 0.04) + 1e-9
        change = math.log((float(gains.damping) + ramp.offset) / (float(old.damping) + ramp.offset))
        assert abs(change) <= min(0.1 * rate, 0.04) + 1e-9
        assert min(begin, end) * (1 - 1e-9) <= gains.stiffness <= max(begin, end) * (1 + 1e-9)
        assert min(before, after) <= gains.damping <= max(before, after)
        old, steps = gains, steps + 1
        assert steps <= ramp.length / min(0.1 * rate, 0.04) + 2


@given(st.floats(1e-4, 1.0), st.floats(0.0, 10.0), damping, damping)
# Steps of the damping that the rate alone would let be a quarter of the effort.
@example(error=1e-3, velocity_error=1.0, before=0.0, after=10.0)
@example(error=1e-2, velocity_error=10.0, before=0.0, after=1000.0)
def test_the_step_in_effort_is_small(error: float, velocity_error: float, before: float, after: float) -> None:
    """Issue 5, item 4: k_p times an error is a torque: a step changes the effort by a twentieth at most."""
    joint = Joint(inertia=1.0, friction=Friction(stribeck=1.0, stribeck_velocity=0.01, viscous=1.0))
    ramp = GainRamp.between(joint, Gains(stiffness=100.0, damping=before), Gains(stiffness=1000.0, damping=after))
    share = 0.0
    for _ in range(30):
        old = ramp.at(share)
        share = ramp.next_share(share, rate=1.0, elapsed=0.1, tracking_error=error, velocity_error=velocity_error)
        new = ramp.at(share)
        effort = old.stiffness * error + old.damping * velocity_error
        jump = abs(new.stiffness - old.stiffness) * error + abs(new.damping - old.damping) * velocity_error
        assert jump <= 0.0501 * effort
