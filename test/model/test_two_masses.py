# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 39: motor and load on a spring, against independent integration and known limits."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from brute_two_masses import BREAKAWAY, motion, outcome, random_joint
from conftest import nightly

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint, Transmission
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.model.loop_modes import least_modal_damping, loop_is_unstable
from stickslip_ros.model.outcome import Outcome
from stickslip_ros.model.verdict import Detail, verdict

pytestmark = pytest.mark.slow

SPRING = Transmission(resonance=12.0, antiresonance=8.0)
CONTINUOUS = OperatingConditions()


@pytest.mark.parametrize("encoder", ["motor", "load"])
@pytest.mark.parametrize("seed", [*range(2), *map(nightly, range(2, 25))])
def test_slips_and_rests_are_those_of_dop853(seed: int, encoder: str) -> None:
    """Every breakaway and arrest, its place and its level, to 1e-5 of a period, a slip, the friction."""
    one = random_joint(np.random.default_rng(seed), encoder)
    duration, friction = 12.0 * one.natural_period, one.joint.friction
    expected, _ = motion(one, duration)
    count = math.ceil(duration / 1e-3)
    references = one.start + 1e-3 * one.velocity * np.arange(count)
    found = JointSimulation(one.joint, one.gains).advance(1e-3, references, np.full(count, one.velocity)).event_rows
    found = found[found[:, 0] <= duration]
    assert len(found) == len(expected) > 0
    np.testing.assert_array_equal(found[:, 1] > 0, expected[:, 1] == BREAKAWAY)
    differences = np.abs(found[:, [0, 3, 4]] - expected[:, [0, 2, 3]])
    # The way of an unstable joint grows.
    way = np.maximum(np.abs(expected[:, 2]), one.velocity * one.natural_period)
    assert differences[:, 0].max() < 1e-5 * one.natural_period
    assert (differences[:, 1] < 1e-5 * way).all()
    assert differences[:, 2].max() < 1e-5 * float(friction.stribeck)


@pytest.mark.parametrize("encoder", ["motor", "load"])
@pytest.mark.parametrize("seed", [0, *map(nightly, range(1, 25))])
def test_the_verdict_is_what_dop853_shows(seed: int, encoder: str) -> None:
    """From little damping to much: sticks, swings or moves steadily, or its loop is unstable."""
    one = random_joint(np.random.default_rng(100 + seed), encoder, damping=(0.0, 1.0))
    found = verdict(one.joint, one.gains, one.velocity, detail=Detail.OUTCOME)
    if found.unstable:
        assert least_modal_damping(one.joint, one.gains, CONTINUOUS) < 0
        return
    shown = outcome(one)
    assert shown in (found.outcome, None)


def test_coulomb_friction_counts() -> None:
    """A loop that is unstable runs away from the joint's own friction, and only sticks with several times as much."""
    one = random_joint(np.random.default_rng(125), "load", damping=(0.0, 1.0))
    assert verdict(one.joint, one.gains, one.velocity, detail=Detail.OUTCOME).unstable
    duration = 10.0 * one.natural_period
    _, steps = motion(one, duration, 1e-7)
    speeds = [np.abs(steps[steps[:, 0] < share * duration, 2]).max() for share in (0.25, 0.5, 1.0)]
    assert speeds[2] > 2.0 * speeds[1] > 4.0 * speeds[0]
    friction = replace(one.joint.friction, coulomb=10.0 * float(one.joint.friction.stribeck))
    held = verdict(replace(one.joint, friction=friction), one.gains, one.velocity, detail=Detail.OUTCOME)
    assert held.outcome is Outcome.STICKS


def test_a_stiff_spring_is_a_rigid_joint(puma: Joint) -> None:
    """With a resonance of 2 kHz slips are those of the joint without one, to a thousandth."""
    stiff = replace(puma, transmission=Transmission(resonance=2000.0, antiresonance=1500.0, spring_damping=0.3))
    count, gains = 8000, Gains(stiffness=630.0)
    references = 8.5 / 630.0 + 5.8e-6 * np.arange(count)
    rigid, found = (
        JointSimulation(joint, gains).advance(1e-3, references, np.full(count, 0.0058)) for joint in (puma, stiff)
    )
    assert len(found.event_rows) == len(rigid.event_rows) > 6
    np.testing.assert_allclose(found.event_rows[:, [0, 3]], rigid.event_rows[:, [0, 3]], rtol=1e-3)


def test_pieces_and_directions_make_no_difference(puma: Joint) -> None:
    """One call or many, forwards or backwards; with an elastic contact as with a rigid one."""
    elastic = replace(puma.friction, presliding_stiffness=2e5, presliding_damping=100.0)
    for friction in (puma.friction, elastic):
        joint, gains, count = replace(puma, friction=friction, transmission=SPRING), Gains(stiffness=630.0), 6000
        references, speeds = 8.5 / 630.0 + 5.8e-6 * np.arange(count), np.full(count, 0.0058)
        whole = JointSimulation(joint, gains).advance(1e-3, references, speeds)
        backwards = JointSimulation(joint, gains).advance(1e-3, -references, -speeds)
        pieces = JointSimulation(joint, gains)
        parts = [pieces.advance(1e-3, references[n : n + 7], speeds[n : n + 7]).position for n in range(0, count, 7)]
        assert len(whole.event_rows) > 6
        np.testing.assert_allclose(np.concatenate(parts), whole.position, atol=1e-11)
        np.testing.assert_allclose(-backwards.position, whole.position, atol=1e-11)


def test_a_stiff_contact_is_a_rigid_one(puma: Joint) -> None:
    """On an elastic contact of 1000 k_p the motor slips as on a rigid one, to a hundredth of a slip."""
    elastic = replace(puma.friction, presliding_stiffness=6.3e5)
    count, gains = 8000, Gains(stiffness=630.0)
    references = 8.5 / 630.0 + 5.8e-6 * np.arange(count)
    rigid, found = (
        JointSimulation(replace(puma, friction=friction, transmission=SPRING), gains)
        .advance(1e-3, references, np.full(count, 0.0058))
        .event_rows
        for friction in (puma.friction, elastic)
    )
    assert len(rigid) == len(found) > 6
    slips, expected = (np.diff(events[:, 3])[::2] for events in (found, rigid))
    assert np.abs(slips - expected).max() < 0.01 * expected.max()


def test_the_load_rings_while_the_motor_sticks(puma: Joint) -> None:
    """At the antiresonance, less and less by the spring's damping, as the controller sees it on the load."""
    joint = replace(puma, transmission=replace(SPRING, encoder="load"))
    gains, count = Gains(stiffness=630.0), 20_000
    simulation = JointSimulation(joint, gains)
    simulation.advance(1e-3, 8.5 / 630.0 + 5.8e-6 * np.arange(count), np.full(count, 0.0058))
    # The reference stops; a joint that slips comes to rest then, and its load rings on.
    stop = 8.5 / 630.0 + 5.8e-6 * count
    simulation.advance(1e-3, np.full(500, stop), np.zeros(500))
    assert simulation.stuck
    rings = simulation.advance(1e-4, np.full(5000, stop), np.zeros(5000)).position
    rings = rings - rings[-1250:].mean()
    crossings = np.flatnonzero(np.diff(np.sign(rings)))
    assert 0.5 / (np.diff(crossings).mean() * 1e-4) == pytest.approx(8.0, rel=0.02)


@pytest.mark.parametrize("encoder", ["motor", "load"])
@pytest.mark.parametrize(("period", "late"), [(0.0, False), (0.002, False), (0.01, True)])
def test_linear_modes_are_those_of_the_simulation(puma: Joint, period: float, encoder: str, late: bool) -> None:
    """Without friction a disturbance decays, or grows, as the least damped mode does."""
    friction = replace(puma.friction, coulomb=0.0, stribeck=0.0)
    joint = replace(puma, friction=friction, transmission=replace(SPRING, encoder=encoder))
    conditions = OperatingConditions(controller_period=period, control_delay=late)
    signs = set()
    for damping in (5.0, 50.0, 100.0, 300.0, 900.0):
        gains = Gains(stiffness=2500.0, damping=damping)
        count = 8000
        simulation = JointSimulation.under(joint, gains, conditions, position=1.0)
        position = np.abs(simulation.advance(period or 0.002, np.zeros(count), np.zeros(count)).position)
        grows = bool(position[-200:].max() > position[200:400].max()) or not np.isfinite(position[-1])
        assert loop_is_unstable(joint, gains, conditions) is grows
        assert bool(least_modal_damping(joint, gains, conditions) < 0) is grows
        signs.add(grows)
    assert True in signs or encoder == "motor"


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"resonance": 8.0, "antiresonance": 8.0}, "'resonance' must be > the antiresonance, 8 Hz: 8"),
        ({"resonance": math.inf, "antiresonance": 8.0}, "'resonance' must be finite"),
        ({"resonance": 9.0, "antiresonance": 0.0}, "'antiresonance' must be finite and > 0: 0"),
        ({"resonance": 9.0, "antiresonance": 8.0, "spring_damping": -1.0}, "'spring_damping' must be finite and >= 0"),
        ({"resonance": 9.0, "antiresonance": 8.0, "encoder": "arm"}, "'encoder' must be one of motor, load: arm"),
        ({"resonance": 9.0}, "'antiresonance' must be given beside resonance"),
        ({"encoder": "load"}, "'resonance' must be given beside encoder"),
    ],
)
def test_what_cannot_be_is_refused(values: dict[str, object], text: str) -> None:
    """The error names the value and what would be right."""
    with pytest.raises(InvalidParameterError, match=text):
        Transmission.given(values)


def test_a_contact_that_creeps_is_refused(puma: Joint) -> None:
    """Two masses are integrated on rigid and on elastic contacts."""
    creeping = replace(puma.friction, presliding_stiffness=1e5, contact="lugre")
    with pytest.raises(InvalidParameterError, match="'contact' must be elasto_plastic where there is a resonance"):
        replace(puma, friction=creeping, transmission=SPRING)
