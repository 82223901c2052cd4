# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Reversals: known answers, an integration by other means, random joints."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import nightly
from numpy.typing import NDArray

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.reversal import ReferenceMotion, reversal_map, reversals, sine, triangle, turning_points


def test_coulomb_friction_alone() -> None:
    """Issue 23: creeping to and fro against Coulomb friction, the spring turns from one full stretch to the other.

    A stiff, slow joint stands while the reference moves by 2 F_k/k_p, falls behind by F_k/k_p, and stops no more.
    """
    joint = Joint(inertia=1.0, friction=Friction(stribeck=0.0, stribeck_velocity=0.01, coulomb=3.0))
    gains = Gains(stiffness=1e4, damping=200.0)
    speed, amplitude = 1e-4, 2e-3  # so slow that damping matters little
    turns = reversals(joint, gains, triangle(amplitude, speed / (4 * amplitude), joint, gains))
    assert len(turns) == 2
    for turn in turns:
        assert turn.lost_motion == pytest.approx(2 * 3.0 / 1e4, rel=0.03)
        assert turn.standing == pytest.approx(2 * 3.0 / 1e4 / speed, rel=0.05)
        assert turn.peak_error == pytest.approx(3.0 / 1e4, rel=0.01)
        assert turn.running_error == pytest.approx(3.0 / 1e4, rel=0.01)
        assert turn.stops == 0
    assert {turn.direction for turn in turns} == {-1, 1}


def test_elastic_contact_gives_lost_motion_back_in_part() -> None:
    """Issue 23: an elastic contact lets the joint follow by k_p/(k_p + σ₀) while it stands, so that it stands longer.

    The contact turns from −F_k/σ₀ to F_k/σ₀, and the spring with it: 2 F_k (1/k_p + 1/σ₀) of the reference.
    """
    friction = Friction(
        stribeck=0.0, stribeck_velocity=0.01, coulomb=3.0, presliding_stiffness=2e4, presliding_damping=100.0
    )
    joint, gains = Joint(inertia=1.0, friction=friction), Gains(stiffness=1e4, damping=200.0)
    turns = reversals(joint, gains, triangle(2e-3, 0.0125, joint, gains))
    for turn in turns:
        assert turn.lost_motion == pytest.approx(2 * 3.0 * (1 / 1e4 + 1 / 2e4), rel=0.05)
        assert turn.peak_error == pytest.approx(3.0 / 1e4, rel=0.02)


def test_too_small_a_motion_never_breaks_away() -> None:
    """Issue 23: a reference that turns before the spring overcomes friction leaves the joint where it is."""
    joint = Joint(inertia=1.0, friction=Friction(stribeck=1.0, stribeck_velocity=0.01, coulomb=3.0))
    gains = Gains(stiffness=1e3)
    for turn in reversals(joint, gains, sine(0.001, 0.2, joint, gains)):
        assert turn.standing == math.inf
        assert turn.settles_after == math.inf
        assert turn.peak_error <= 0.002


def _brute_force(joint: Joint, gains: Gains, reference: ReferenceMotion) -> tuple[NDArray[np.float64], list[float]]:
    """Position at the reference's samples and arrests, breakaways in turn, by small explicit steps; no code is shared.

    Eqs (4)-(6) without lag: semi-implicit Euler, the joint stopped where its velocity changes sign.
    """
    friction = joint.friction
    inertia, spring, damper = float(joint.inertia), float(gains.stiffness), float(gains.damping)
    kinetic, excess, viscous = float(friction.coulomb), float(friction.stribeck), float(friction.viscous)
    scale, rise = float(friction.stribeck_velocity), float(friction.rise_time)
    steps = 60
    h = reference.period / steps
    x, v, level, since, stuck, found, events = float(reference.position[0]), 0.0, excess, 0.0, True, [], []
    time = 0.0
    for start, rate in zip(reference.position[:-1].tolist(), reference.velocity[:-1].tolist(), strict=True):
        for step in range(steps):
            target = start + rate * step * h
            force = spring * (target - x) + damper * (rate - v)
            if stuck:
                dwell = time - since
                now = level + (excess - level) * (dwell / (dwell + rise) if rise > 0 else 1.0)
                if abs(force) > kinetic + now:
                    stuck, level = False, now
                    events.append(time)
                    way = math.copysign(1.0, force)
            if not stuck:
                friction_now = kinetic + level / (1.0 + (v / scale) ** 2)
                v += h * (force - way * friction_now - viscous * v) / inertia
                if v * way < 0.0:
                    v, stuck, since = 0.0, True, time
                    events.append(-time)
                x += h * v
            time += h
        found.append(x)
    return np.array(found), events


@pytest.mark.slow
@pytest.mark.parametrize("count", [40, nightly(100)])
def test_random_joints_agree_with_brute_force(count: int) -> None:
    """Issue 23: through reversals of random joints, standing and peak error within 5 % of brute force."""
    random = np.random.default_rng(23)
    compared = 0
    for _ in range(count):
        inertia, frequency = 10 ** random.uniform(-1, 1), random.uniform(8.0, 40.0)
        stiffness = inertia * frequency**2
        stretch = 10 ** random.uniform(-3.5, -2.5)
        friction = Friction(
            stribeck=random.uniform(0.05, 0.4) * stretch * stiffness,
            stribeck_velocity=10 ** random.uniform(-3, -1.5),
            rise_time=random.uniform(0.0, 0.5),
            viscous=random.uniform(0.0, 0.2) * inertia * frequency,
            coulomb=stretch * stiffness,
        )
        joint = Joint(inertia=inertia, friction=friction)
        gains = Gains(stiffness=stiffness, damping=random.uniform(0.5, 1.5) * inertia * frequency)
        make = sine if random.uniform() < 0.5 else triangle
        reference = make(stretch * random.uniform(3.0, 30.0), random.uniform(0.05, 0.5), joint, gains)
        position, events = _brute_force(joint, gains, reference)
        times = reference.period * np.arange(len(reference.position))
        for turn in reversals(joint, gains, reference):
            index = round(turn.time / reference.period)
            later = [at for at, _ in turning_points(reference.position, 1e-9) if at > index]
            until = later[0] if later else len(times) - 1
            errors = turn.direction * (reference.position[index + 1 : until + 1] - position[index:until])
            assert turn.peak_error == pytest.approx(errors.max(), rel=0.05)
            if not math.isfinite(turn.standing) or turn.standing < 0.02:
                continue
            arrests = [-event for event in events if event < 0]
            ends = turn.time + turn.settles_after
            if turn.stops == 0:
                begin = max(time for time in [0.0, *arrests] if time < ends - 1e-3)
                breakaway = min(event for event in events if event > begin)
                assert turn.standing == pytest.approx(breakaway - begin, rel=0.05, abs=5e-3)
                compared += 1
    assert compared > 0.8 * count


@pytest.mark.parametrize("contact", ["elasto_plastic", "lugre"])
def test_a_map_is_its_points(puma: Joint, contact: str) -> None:
    """Issue 23: many references by several threads give what each gives by itself."""
    soft = replace(puma.friction, presliding_stiffness=2e4, presliding_damping=300.0, contact=contact)
    joint, gains = replace(puma, friction=soft), Gains(stiffness=6300.0, damping=200.0)
    references = [sine(amplitude, 0.2, joint, gains) for amplitude in (0.01, 0.05, 0.2)]
    assert reversal_map(joint, gains, references, workers=2) == [reversals(joint, gains, one) for one in references]


def test_where_a_reference_turns() -> None:
    """Issue 23: at the last sample of an extreme, whether it rests there or not; noise below the least is none."""
    reference = np.array([0.0, 1.0, 2.0, 2.0, 2.0, 1.0, 1.01, 0.0, 0.5, 2.0])
    assert turning_points(reference, 0.1) == [(4, -1), (7, 1)]
    assert turning_points(np.arange(5.0), 0.1) == []
    assert turning_points(np.zeros(5), 0.0) == []
    # Also about where it began, from which it goes by less than that.
    assert turning_points(np.array([0.0, 0.6, -0.6, 0.6, -0.6]), 1.0) == [(2, 1), (3, -1)]


@pytest.mark.parametrize(
    ("amplitude", "frequency"), [(0.0, 1.0), (1.0, 0.0), (math.nan, 1.0), (1.0, math.inf), (1.0, 1e-9)]
)
def test_bad_references_are_refused(puma: Joint, amplitude: float, frequency: float) -> None:
    """Issue 23: with the name of the value."""
    with pytest.raises(InvalidParameterError, match=r"amplitude|frequency"):
        sine(amplitude, frequency, puma, Gains(stiffness=2016.0))
