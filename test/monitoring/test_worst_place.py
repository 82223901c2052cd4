# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 18: friction that grows with load, or varies over position: verdict and advice hold at the worst place seen."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conftest import nightly
from machines import Machine, sticks
from varying_machines import EVEN, LOAD, PLACE, VaryingRecording, learnt_monitor, random_varying, recorded

from stickslip_ros.model.friction import Gains
from stickslip_ros.model.verdict import Detail, verdict
from stickslip_ros.monitoring.advice.limits import AdviceLimits
from stickslip_ros.monitoring.advice.recommend import recommend
from stickslip_ros.monitoring.advice.recommendation import Kind
from stickslip_ros.monitoring.friction.dry_friction import PositionDisturbance, dry_friction
from stickslip_ros.monitoring.friction.estimate import FrictionEstimate
from stickslip_ros.monitoring.friction.friction_factor import FrictionFactor
from stickslip_ros.monitoring.friction.learner import LearnerMemory
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.nodes.kept_state import from_plain, to_plain
from stickslip_ros.output.as_json import growth_json

pytestmark = pytest.mark.slow

MACHINE = Machine(
    inertia=6.3, coulomb=8.43, viscous=4.94, stribeck=1.6, stribeck_velocity=0.0058, lag=0.05, rise_time=0.264
)
GAINS, SPEED = Gains(stiffness=630.0, damping=2.0), 0.008
# Of an arm that is stretched out at the beginning of its way.
ARM = replace(MACHINE, gravity=20.0, bend=8.0, load_share=0.1)
_UNEVEN = 2  # seed of a machine whose friction varies over position


@cache
def learnt(machine: Machine | None) -> tuple[VaryingRecording, JointMonitor, FrictionEstimate]:
    """What is learnt of a machine that moves to and fro; None for the one whose friction varies over position."""
    recording = random_varying(_UNEVEN, PLACE) if machine is None else recorded(machine, GAINS, SPEED, 2.5e-5)
    monitor = learnt_monitor(recording)
    estimate = monitor.assessment().estimate
    assert estimate is not None
    return recording, monitor, estimate


def places(recording: VaryingRecording) -> tuple[Machine, Machine]:
    """The machine as it is where it sticks most, and where it sticks least."""
    found = sorted((recording.machine.at(x) for x in recording.slips[:, 1]), key=lambda one: one.stribeck)
    return found[-1], found[0]


def boundary(machine: Machine, gains: Gains, speed: float) -> float:
    """Total damping at which a machine just sticks [N·m·s/rad], to 3 %."""
    scale = math.sqrt(float(gains.stiffness) * machine.inertia)
    low, high = 0.01 * scale, 4.0 * scale
    while high > 1.03 * low:
        middle = math.sqrt(low * high)
        tried = replace(gains, damping=middle - machine.viscous)
        low, high = (middle, high) if sticks(machine, tried, speed, periods=60.0) else (low, middle)
    return low


@pytest.fixture(scope="module", params=[nightly(ARM), None], ids=["load", "position"])
def found(request: pytest.FixtureRequest) -> tuple[VaryingRecording, JointMonitor, FrictionEstimate]:
    """A machine of either kind, and what is learnt of it."""
    return learnt(request.param)


def test_how_far_it_varies_is_learnt(found: tuple[VaryingRecording, JointMonitor, FrictionEstimate]) -> None:
    recording, _, estimate = found
    worst, best = places(recording)
    friction_factor = estimate.friction_factor
    assert friction_factor is not None
    assert friction_factor.share == pytest.approx(
        1.0 - best.stribeck / worst.stribeck, abs=max(3.0 * friction_factor.std, 0.04)
    )
    assert estimate["stribeck"].value == pytest.approx(worst.stribeck, rel=0.1)
    assert friction_factor.factor(friction_factor.worst_position) == 1.0
    # What is taken off is only nearly what varies: the model is still said not to fit.
    assert estimate.mismatch
    assert friction_factor.text in estimate.summary()


def test_verdict_is_that_of_the_worst_place(
    found: tuple[VaryingRecording, JointMonitor, FrictionEstimate],
) -> None:
    """By the machine's own simulation there, a fifth off its boundary."""
    recording, monitor, estimate = found
    worst, _ = places(recording)
    gains, speed = recording.gains, recording.speed
    sticking = boundary(worst, gains, speed)
    for factor in (0.8, 1.25):
        tried = replace(gains, damping=factor * sticking - worst.viscous)
        assert sticks(worst, tried, speed) == (factor < 1.0)
        assert verdict(estimate.joint(), tried, speed, detail=Detail.SMOOTH).smooth is (factor > 1.0)
    state = monitor.assessment()
    assert state.joint is not None
    assert state.joint.friction.stribeck == pytest.approx(estimate["stribeck"].value)
    assert state.here is not None
    here = recording.machine.at(state.position).stribeck / worst.stribeck
    assert state.here.friction.stribeck / state.joint.friction.stribeck == pytest.approx(here, abs=0.06)


@pytest.mark.nightly
def test_smooth_folded_and_sticking_stretched_out() -> None:
    """Between the boundaries of both the verdict is stick-slip, as it is of the machine stretched out."""
    recording, _, estimate = learnt(ARM)
    worst, best = places(recording)
    sticking, smooth = boundary(worst, GAINS, SPEED), boundary(best, GAINS, SPEED)
    assert smooth < 0.95 * sticking
    between = replace(GAINS, damping=math.sqrt(smooth * sticking) - worst.viscous)
    assert sticks(worst, between, SPEED)
    assert not sticks(best, between, SPEED)
    assert verdict(estimate.joint(), between, SPEED, detail=Detail.SMOOTH).smooth is False


def test_advice_holds_at_the_worst_place(
    found: tuple[VaryingRecording, JointMonitor, FrictionEstimate],
) -> None:
    """Every variant of it."""
    recording, monitor, _ = found
    advice = monitor.assessment(recording.speed).recommendation
    assert advice is not None
    worst, best = places(recording)
    for variant in advice.variants:
        if variant.found:
            tried = Gains(stiffness=variant.stiffness, damping=variant.damping)
            assert not sticks(worst, tried, recording.speed)
            assert not sticks(best, tried, recording.speed)


@pytest.mark.nightly
def test_slope_over_the_load() -> None:
    """Both slopes are known with their errors: a tenth of the load, and that share of the Stribeck friction."""
    recording, _, estimate = learnt(ARM)
    friction_factor = estimate.friction_factor
    assert friction_factor is not None
    assert friction_factor.position_disturbance.with_load
    said = growth_json(estimate, float(recording.batch.position[-1]))
    assert said is not None
    assert said["with"] == "load"
    assert said["stribeck_over_load"] == pytest.approx(
        0.1 * 1.6 / 8.43, abs=max(3.0 * said["stribeck_over_load_std"], 0.006)
    )
    assert said["largest_load"] == pytest.approx(20.0, rel=0.05)
    assert said["stribeck_here"] == pytest.approx(recording.machine.at(recording.batch.position[-1]).stribeck, rel=0.1)


def test_slope_over_the_load_in_the_coulomb_friction() -> None:
    rng = np.random.default_rng(0)
    direction = np.where(np.arange(48) * 6 // 48 % 2 == 0, 1.0, -1.0)
    position = np.cumsum(direction * 0.02 * (1.0 + 0.15 * rng.standard_normal(48)))
    load = 15.0 * np.cos(5.0 * position)
    kinetic = 8.0 + direction * load + 0.1 * np.abs(load) + 0.02 * rng.standard_normal(48)
    dry = dry_friction(kinetic, direction, position, np.arange(48) * 1.0)
    assert dry is not None
    assert dry.load_dependence is not None
    assert dry.load_dependence.value == pytest.approx(0.1, abs=max(4.0 * dry.load_dependence.std, 0.01))
    np.testing.assert_allclose(dry.load_at(position), load, atol=0.1)
    # Beyond what was seen nothing is guessed.
    assert dry.load_at(np.array([1e3]))[0] == dry.load_at(np.array([position.max()]))[0]


@pytest.mark.parametrize("machine", [nightly(MACHINE), replace(MACHINE, load=3.0)], ids=["even", "constant load"])
def test_what_does_not_vary_is_not_claimed(machine: Machine) -> None:
    """And costs no stiffness or damping: the advice is that for the true joint."""
    _, monitor, estimate = learnt(machine)
    assert estimate.friction_factor is None
    state = monitor.assessment()
    assert state.here is None
    advised = recommend(estimate.joint(), GAINS, SPEED, AdviceLimits())[Kind.DAMPING_ONLY]
    true = replace(
        estimate.joint(),
        inertia=6.3,
        friction=estimate.joint().friction.changed(
            {"stribeck": 1.6, "stribeck_velocity": 0.0058, "lag": 0.05, "rise_time": 0.264, "viscous": 4.94}
        ),
    )
    needed = recommend(true, GAINS, SPEED, AdviceLimits())[Kind.DAMPING_ONLY]
    assert advised.damping == pytest.approx(needed.damping, rel=0.05)
    assert growth_json(estimate, 0.0) is None


@pytest.mark.nightly
def test_a_load_alone_is_no_growth() -> None:
    """An arm's weight varies, its friction does not."""
    _, _, estimate = learnt(replace(ARM, load_share=0.0))
    assert estimate.friction_factor is None or estimate.friction_factor.share < 0.03
    assert estimate["stribeck"].value == pytest.approx(1.6, rel=0.12)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), [nightly(LOAD, 1), (EVEN, 2)])
def test_random_machines(kind: str, seed: int) -> None:
    """The advice for a random machine, whatever is claimed of it, ends its stick-slip at the worst place.

    More of them: `python -m benchmarks.worst_place`.
    """
    recording = random_varying(seed, kind)
    worst, best = places(recording)
    estimate = learnt_monitor(recording, as_it_goes=kind == LOAD).assessment().estimate
    assert estimate is not None
    assert estimate.usable
    if kind == EVEN:
        assert estimate.friction_factor is None or estimate.friction_factor.share < 0.03
    advised = recommend(estimate.joint(), recording.gains, recording.speed, AdviceLimits())[Kind.DAMPING_ONLY]
    tried = replace(recording.gains, damping=advised.damping)
    assert not sticks(worst, tried, recording.speed)
    assert not sticks(best, tried, recording.speed)


def test_what_was_not_seen_is_not_guessed() -> None:
    """Friction at other positions is no less than at the best place and no more than at the worst."""
    rng = np.random.default_rng(1)
    direction = np.tile([1.0, -1.0], 12)
    position = np.sort(rng.uniform(0.0, 1.0, 24))
    kinetic = 8.0 + direction * (5.0 + 10.0 * position) + 0.01 * rng.standard_normal(24)
    dry = dry_friction(kinetic, direction, position, np.arange(24) * 1.0)
    assert dry is not None
    assert dry.load_curve
    friction_factor = FrictionFactor(
        position_disturbance=PositionDisturbance(dry=dry, without=""),
        decreasing=False,
        share=0.2,
        std=0.01,
        coulomb=1.0,
        coulomb_std=0.1,
    )
    assert friction_factor.factor(-5.0) == pytest.approx(0.8)
    assert friction_factor.factor(9.0) == pytest.approx(1.0)
    assert friction_factor.worst_position == position[-1]


def test_what_varies_is_remembered(found: tuple[VaryingRecording, JointMonitor, FrictionEstimate]) -> None:
    """A state file holds it, and a slip that comes later is judged by it: no change of friction is claimed."""
    recording, monitor, _ = found
    memory = from_plain(LearnerMemory, json.loads(json.dumps(to_plain(monitor.learner.memory_of()))))
    assert memory.learnt is not None
    friction_factor = memory.learnt.estimate.friction_factor
    assert friction_factor is not None
    again = JointMonitor(None, recording.gains, studies_at_once=True, at_arrest=True)
    assert again.learner.restore(memory)
    again.process(recording.batch.where(slice(len(recording.batch) * 3 // 4, None)))
    assert again.learner.change is None
    assert again.learner.estimate is not None
    assert again.learner.estimate["stribeck"].value == pytest.approx(memory.learnt.estimate["stribeck"].value, rel=0.15)
