# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Friction estimated from slips: errors, coverage, what is identified, and what does not fit."""

from __future__ import annotations

import functools
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import nightly, recording
from other_laws import EXPONENTIAL, LOAD_DEPENDENT, LUGRE, OtherJoint, sticks
from random_joints import RandomRecording, cut_slips, later, random_recording
from support import record

from stickslip_ros.model.dimensionless import dimensionless_groups
from stickslip_ros.model.exact import exact_critical_damping_ratio
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.model.simulation import simulate_cycles
from stickslip_ros.monitoring.friction.estimate import (
    COULOMB_AND_LOAD,
    CUT_SHORT,
    DOES_NOT_FIT,
    NAMES,
    FrictionEstimate,
)
from stickslip_ros.monitoring.friction.estimation import StudyQuestion, estimate_friction
from stickslip_ros.monitoring.friction.slip_windows import ForceSource
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.monitoring.study import study

pytestmark = pytest.mark.slow

GAINS = Gains(stiffness=630.0)


def truth(joint: Joint) -> dict[str, float]:
    """The parameters by their names."""
    return {"inertia": float(joint.inertia)} | {name: float(getattr(joint.friction, name)) for name in NAMES[1:]}


def estimated(batch: Batch, gains: Gains | None) -> FrictionEstimate:
    """What the slips of a recording say."""
    estimate = estimate_friction(cut_slips(batch, gains)[0])
    assert estimate is not None
    return estimate


def two_speeds(joint: Joint, gains: Gains, *, load: float = 0.0, reverse: bool = False) -> tuple[Batch, np.ndarray]:
    """A recording at two speeds, with the effort beside it; the second one backwards if asked."""
    rate, count = 1000.0, 40_000
    way_back = -1.0 if reverse else 1.0
    velocities = np.where(np.arange(count) < count // 2, 0.0058, 0.011 * way_back)
    references = np.concatenate([[0.0], np.cumsum(velocities)[:-1]]) / rate
    motion = JointSimulation(joint, gains, load=load).advance(1.0 / rate, references, velocities)
    batch = Batch(
        time=motion.time,
        position=2.5e-5 * np.round(motion.position / 2.5e-5),
        reference_position=references + velocities / rate,
    )
    return batch, motion.effort


@functools.cache
def drawn(seed: int) -> tuple[RandomRecording, FrictionEstimate]:
    """A random joint, and its estimate with all that is known."""
    one = random_recording(seed)
    return one, estimated(one.batch, one.gains)


def errors_of(recordings: list[tuple[RandomRecording, FrictionEstimate]]) -> tuple[dict[str, list[float]], list[bool]]:
    """Relative errors of what was identified, and whether the 95 % interval holds the truth."""
    errors: dict[str, list[float]] = {name: [] for name in NAMES}
    covered = []
    for drawn, estimate in recordings:
        for name, value in truth(drawn.joint).items():
            # These joints move in one direction, and carry no load.
            found = estimate[name if name != "coulomb" else COULOMB_AND_LOAD]
            if found.identified:
                errors[name].append(abs(found.value / value - 1.0))
                covered.append(abs(found.value - value) < 1.96 * found.std)
    return errors, covered


def test_random_joints_are_identified() -> None:
    """Issue 4, show 1: median error within 2 % (viscous 10 %), 95th percentile 10 %, intervals hold."""
    errors, covered = errors_of([drawn(seed) for seed in range(1000, 1006)])
    for name, found in errors.items():
        # Viscous friction is known less well, as it may be no straight line over speed.
        assert len(found) >= (3 if name == "viscous" else 4), name
        assert np.median(found) <= (0.1 if name == "viscous" else 0.02), name
        assert np.quantile(found, 0.95) <= 0.1, name
    assert np.mean(covered) >= 0.9


@pytest.mark.parametrize("seed", [2028, nightly(2014), nightly(2012)])
def test_uneven_stamps_are_no_misfit(seed: int) -> None:
    """Stamps are off by up to half a period. Jitter counted for too little, so that the friction "did not fit"; or what
    it makes of the force at a breakaway was kinetic friction that "varies by 12 %".
    """
    one = random_recording(seed)
    estimate = estimated(one.noisy(seed % 7), one.gains)
    assert not estimate.mismatch
    covered = errors_of([(one, estimate)])[1]
    assert covered
    assert all(covered)


@pytest.mark.nightly
def test_noise_loss_and_jitter_widen_the_errors() -> None:
    """Issue 4, show 2: at 200 Hz with noise, losses and stray stamps the median error stays within 8 %."""
    recordings = [drawn(seed)[0] for seed in range(1000, 1006)]
    errors, covered = errors_of([(one, estimated(one.noisy(1), one.gains)) for one in recordings])
    found = [error for name in NAMES for error in errors[name]]
    assert len(found) >= 15
    assert np.median(found) <= 0.08
    assert np.mean(covered) >= 0.85


def test_motion_alone_shows_the_groups() -> None:
    """Issue 4, show 5 and item 7: gains, effort and reference withheld, omega within 2 % and the verdict the same."""
    agreed = []
    for seed in range(1000, 1003):
        one, known = drawn(seed)
        withheld = estimated(one.without_forces(), None)
        assert withheld.source is ForceSource.SPEED
        assert withheld.gains is not None
        frequency = math.sqrt(float(one.gains.stiffness) / float(one.joint.inertia))
        assert withheld.natural_frequency.value == pytest.approx(frequency, rel=0.02)
        speed = one.speeds[0]
        for factor in (0.5, 0.75, 1.3, 2.0):
            shift = factor * critical(one.joint, one.gains, speed) - ratio(one.joint, one.gains, speed)
            verdicts = [
                ratio(joint, gains, speed) + shift > critical(joint, gains, speed)
                for joint, gains in ((known.joint(), one.gains), (withheld.joint(), withheld.gains))
            ]
            agreed.append(verdicts[0] == verdicts[1])
    assert np.mean(agreed) >= 0.95


def ratio(joint: Joint, gains: Gains, speed: float) -> float:
    """Damping ratio."""
    return float(dimensionless_groups(joint, gains, speed).damping_ratio)


def critical(joint: Joint, gains: Gains, speed: float) -> float:
    """Exact critical damping ratio."""
    return float(exact_critical_damping_ratio(dimensionless_groups(joint, gains, speed)))


def test_a_settled_cycle_does_not_separate_rise_time(puma: Joint) -> None:
    """Issue 4, item 2: at one speed stribeck and rise_time are not identified; after a change of speed they are."""
    # The recording begins long after the start, so that every dwell is the same.
    settled = record(puma, GAINS, 0.0058, duration=70.0).batch
    settled = settled.where(settled.time > 40.0)
    one = estimated(settled, GAINS)
    assert one["inertia"].identified
    assert not one["rise_time"].identified
    assert {"stribeck", "rise_time"} & set(one.unidentified)
    assert one.summary().count("not determined, default values used: ") == 1
    two = estimated(two_speeds(puma, GAINS)[0], GAINS)
    assert two["rise_time"].identified
    assert two["stribeck"].identified
    assert two["rise_time"].value == pytest.approx(0.264, rel=0.05)


def test_what_is_open_rests_on_the_configured_joint(puma: Joint) -> None:
    """Issue 4, item 2: what is not identified falls back to the configured prior, and the estimate says so."""
    settled = record(puma, GAINS, 0.0058, duration=70.0).batch
    windows, _ = cut_slips(settled.where(settled.time > 40.0), GAINS)
    estimate = estimate_friction(windows, puma)
    assert estimate is not None
    assert estimate["rise_time"].value == pytest.approx(0.264, rel=0.25)
    assert "the configured values used: rise_time" in estimate.summary()


def test_what_is_known_roughly_is_no_guess(puma: Joint) -> None:
    """Viscous friction known to 7 % was called a guess."""
    found = estimated(two_speeds(puma, GAINS)[0], GAINS)
    covariance = found.covariance.copy()
    viscous = int(np.argmin(np.abs(np.exp(found.logarithms) - found["viscous"].value)))
    covariance[viscous, viscous] = 0.07**2
    assert "; uncertain: viscous ±7 %" in replace(found, covariance=covariance).summary()


def test_effort_alone_is_enough(puma: Joint) -> None:
    """Issue 4, item 1: forces come from the effort where gains or reference are missing."""
    batch, effort = two_speeds(puma, GAINS)
    by_effort = Batch(time=batch.time, position=batch.position, effort=effort)
    estimate = estimated(by_effort, None)
    assert estimate.source is ForceSource.EFFORT
    for name in ("inertia", "coulomb", "stribeck", "stribeck_velocity", "lag"):
        assert estimate[name].value == pytest.approx(truth(puma)[name], rel=0.05), name


@pytest.mark.parametrize("seed", [1003, nightly(1000), nightly(1005), nightly(1009)])
def test_noisy_effort_leads_to_one_friction(seed: int) -> None:
    """Issue 38: with effort alone and its noise, fits ended where rounding led them: another zero of the encoder moved
    what was "identified" by up to 25 standard errors.
    """
    noisy = random_recording(seed).noisy(seed)
    one, other = (estimated(replace(noisy, position=noisy.position + zero), None) for zero in (0.0, 0.3))
    moved = [abs(one[name].value - other[name].value) / one[name].std for name in (*NAMES, COULOMB_AND_LOAD)]
    assert max(moved) < 4.0
    assert np.median(moved) < 1.0


@pytest.mark.parametrize("late", [0, nightly(1)])
def test_an_effort_that_comes_late_leaves_viscous_friction_open(puma: Joint, late: int) -> None:
    """By a sample of 4 ms, k_p τ was added to viscous friction, which was "identified" 17 standard errors off."""
    batch, effort = two_speeds(puma, GAINS)
    delayed = np.concatenate([effort[:1].repeat(4 * late), effort[: len(effort) - 4 * late]])
    by_effort = Batch(time=batch.time, position=batch.position, effort=delayed).where(np.arange(0, len(batch), 4))
    learnt = study(StudyQuestion(windows=cut_slips(by_effort, None)[0]))
    assert learnt is not None
    viscous = learnt.estimate["viscous"]
    assert abs(viscous.value - float(puma.friction.viscous)) < 2.0 * viscous.std
    assert not viscous.identified
    held = learnt.estimate[COULOMB_AND_LOAD]
    assert abs(held.value - float(puma.friction.coulomb)) < 3.0 * held.std


def test_feed_forward_is_seen_in_the_effort(puma: Joint) -> None:
    """Issue 4, item 1: with gains, reference and effort, torque beside the gains' is taken from the effort."""
    batch, effort = two_speeds(puma, GAINS, load=3.0)
    # A controller that compensates the load: its gains alone would pull 3 N·m less.
    shifted = replace(batch, reference_position=batch.reference_position - 3.0 / 630.0, effort=effort)
    estimate = estimated(shifted, GAINS)
    assert estimate.coulomb_and_load.value - 3.0 == pytest.approx(8.43, rel=0.02)


@pytest.mark.parametrize(
    ("factor", "why"), [(math.pi / 180.0, "per degree and per radian?"), nightly(1.3, "other units")]
)
def test_an_effort_that_contradicts_the_gains_is_said(puma: Joint, factor: float, why: str) -> None:
    """Issues 36 and 38: k_p per degree, or 30 % above the true one, beside the true effort: friction was "identified"
    at 1.3 times its size, or "varied" by 38 %. Nothing is certain then, and the gains' friction is not bent by it.
    """
    batch, effort = two_speeds(puma, GAINS)
    wrong = Gains(stiffness=factor * GAINS.stiffness, damping=factor * GAINS.damping)
    found, alone = estimated(replace(batch, effort=effort), wrong), estimated(batch, wrong)
    assert f"the effort rises by 630 N·m/rad with the reference, and the gains say {factor * 630:.4g}" in found.mismatch
    assert why in found.mismatch
    assert not any(found[name].identified for name in truth(puma))
    assert alone.mismatch == ""
    assert (found.logarithms == alone.logarithms).all()


def test_an_effort_that_differs_little_from_the_gains_widens_the_errors(puma: Joint) -> None:
    """Issue 38: k_p 8 % above the true one, beside the true effort: M and F_s were identified 8 % off at 7 to 57
    standard errors. Lag and Stribeck velocity do not depend on the unit of force, and are as certain as before.
    """
    batch, effort = two_speeds(puma, GAINS)
    found = estimated(replace(batch, effort=effort), Gains(stiffness=1.08 * GAINS.stiffness))
    assert found.mismatch == ""
    true = truth(puma)
    for name in ("inertia", "stribeck", "viscous"):
        assert not found[name].identified, name
        assert abs(found[name].value - true[name]) < 2.0 * found[name].std, name
    assert abs(found.coulomb_and_load.value - true["coulomb"]) < 2.0 * found.coulomb_and_load.std
    for name in ("stribeck_velocity", "lag"):
        assert found[name].identified, name


@pytest.mark.parametrize("slope", [nightly(0.0), -630.0])
def test_an_effort_that_is_no_controllers_is_left_out(puma: Joint, slope: float) -> None:
    """Issue 38: a torque sensor behind the friction stays at its load while the controller pulls ever more."""
    batch, _ = two_speeds(puma, GAINS)
    noise = np.random.default_rng(36).normal(0.0, 0.02, len(batch))
    sensor = 5.0 + slope * (batch.reference_position - batch.position) + noise
    found, alone = estimated(replace(batch, effort=sensor), GAINS), estimated(batch, GAINS)
    assert found.mismatch == ""
    assert (found.logarithms == alone.logarithms).all()


def test_load_is_told_from_coulomb_in_both_directions(puma: Joint) -> None:
    """Issue 4, item 1: both directions show the load; in one it is part of the Coulomb friction."""
    both = estimated(two_speeds(puma, GAINS, load=2.0, reverse=True)[0], GAINS)
    assert both.load.value == pytest.approx(2.0, rel=0.03)
    assert both.coulomb.value == pytest.approx(8.43, rel=0.02)
    one = estimated(two_speeds(puma, GAINS, load=2.0)[0], GAINS)
    assert math.isnan(one.load.value)
    assert one.coulomb_and_load.value == pytest.approx(10.43, rel=0.02)
    assert one.coulomb_and_load.identified
    assert not one.coulomb.identified
    assert abs(one.coulomb.value - 8.43) < one.coulomb.std


LAWS = {
    "LuGre": OtherJoint(LUGRE, 1.0, 2.0, 1.0, 0.01, 0.5, 5e4),
    "exponential": OtherJoint(EXPONENTIAL, 1.0, 2.0, 1.0, 0.01, 0.5, 1.0),
    "load": OtherJoint(LOAD_DEPENDENT, 1.0, 2.0, 1.0, 0.01, 0.5, 0.1),
}


@pytest.mark.parametrize("law", [nightly("LuGre"), nightly("exponential"), "load"])
def test_other_laws_get_the_right_verdict(law: str) -> None:
    """Issue 4, show 3: the exact verdict by estimated parameters agrees with joints of other laws."""
    joint, stiffness, rate, count = LAWS[law], 100.0, 1000.0, 30_000
    velocities = np.where(np.arange(count) < count // 2, 0.01, 0.02)
    references = 0.028 + np.concatenate([[0.0], np.cumsum(velocities)[:-1]]) / rate
    positions, _ = joint.simulate(stiffness, 0.0, references, velocities, 1.0 / rate)
    batch = Batch(
        time=np.arange(count) / rate,
        position=1e-4 * np.round(positions / 1e-4),
        reference_position=references,
    )
    gains = Gains(stiffness=stiffness)
    learnt = estimated(batch, gains).joint()
    agreed = []
    for speed in (0.008, 0.015, 0.03, 0.06):
        for damping in (0.0, 4.0, 12.0, 40.0):
            total = damping + joint.viscous
            around = {sticks(joint, stiffness, share * total - joint.viscous, speed) for share in (0.8, 1.2)}
            if len(around) == 1:  # not within a fifth of the boundary
                tried = replace(gains, damping=damping)
                agreed.append((critical(learnt, tried, speed) > ratio(learnt, tried, speed)) in around)
    assert len(agreed) >= 11
    assert np.mean(agreed) >= 0.95


def test_what_the_model_cannot_explain_is_said() -> None:
    """Issue 4, item 5: a joint whose friction wanders from slip to slip does not fit, and errors are the wider."""
    one, plain = drawn(1003)
    rng = np.random.default_rng(1)
    # A place-dependent deviation of a tenth of a slip, as from a bent rack.
    wave = 0.1 * np.median(np.diff(one.batch.position[::3000]))
    bent = replace(
        one.batch,
        position=one.batch.position + wave * np.sin(one.batch.position / wave / 3.0 + rng.uniform(0, 6)),
    )
    estimate = estimate_friction(cut_slips(bent, one.gains)[0][:12])
    assert estimate is not None
    assert estimate.mismatch.startswith(DOES_NOT_FIT)
    assert estimate["inertia"].std > 3.0 * plain["inertia"].std


def test_stamps_of_this_century_make_no_difference() -> None:
    """Issue 4, item 1: stamps of 1.7e9 s, which leave no digits beyond tenths of a microsecond, give the same."""
    one, plain = drawn(1001)
    late = estimated(replace(one.batch, time=one.batch.time + 1.7e9), one.gains)
    for name in NAMES:
        assert abs(late[name].value - plain[name].value) < 0.5 * plain[name].std, name


def test_whatever_is_configured_there_is_an_answer() -> None:
    """Issue 4, item 3: whatever a fit begins with, slips are simulated in bounded time, creeping joints included."""
    one, _ = drawn(1001)
    windows = cut_slips(one.batch, one.gains)[0][:6]
    rng = np.random.default_rng(4)
    for _ in range(4):
        inertia, *numbers = np.exp(rng.uniform(-5.0, 5.0, len(NAMES)) + np.log(list(truth(one.joint).values())))
        joint = Joint(
            inertia=float(inertia), friction=Friction(**dict(zip(NAMES[1:], map(float, numbers), strict=True)))
        )
        estimate = estimate_friction(windows, joint)
        assert estimate is None or np.isfinite(estimate.logarithms).all()


def test_too_few_slips_give_no_estimate(puma: Joint) -> None:
    """Issue 4, item 2: two slips are no evidence."""
    batch = record(puma, GAINS, 0.0058, duration=4.0).batch
    windows, _ = cut_slips(batch, GAINS)
    assert estimate_friction(windows[:2]) is None
    assert estimate_friction([]) is None


def test_where_no_slip_is_usable_there_is_no_estimate(puma: Joint) -> None:
    """Issue 17, item 7: slips of which each begins another speed say nothing, where only speeds are known.

    None is told apart from one that holds a change of speed. It ended with an IndexError.
    """
    windows = [one.without_force() for one in cut_slips(record(puma, GAINS, 0.0058, duration=16.0).batch, GAINS)[0]]
    windows = [replace(one, reference_speed=0.001 * 2.0**number) for number, one in enumerate(windows)]
    assert len(windows) >= 6
    assert estimate_friction(windows) is None
    assert study(StudyQuestion(windows=windows, start=np.zeros(6))) is None


def test_slips_that_teach_nothing_are_told(puma: Joint) -> None:
    """Issue 17, item 7: where the slips studied gave no estimate, this is said."""
    windows = [one.without_force() for one in cut_slips(record(puma, GAINS, 0.0058, duration=16.0).batch, GAINS)[0]]
    monitor = JointMonitor(studies_at_once=True)
    for number, one in enumerate(windows):
        monitor.learner.add_slip(replace(one, reference_speed=0.001 * 2.0**number))
        monitor.learner.study_now()
    assert monitor.learner.estimate is None
    assert re.search(
        r"neither configured nor estimated: \d+ slips were studied in vain$", monitor.assessment().margin_reason
    )
    monitor.learner.reset()
    assert monitor.assessment().margin_reason.endswith("neither configured nor estimated")


@pytest.mark.nightly
def test_slider_on_a_spring() -> None:
    """Issue 4, show 6: friction from 42 and 1100 µm/s predicts the cycles there; at 4300 µm/s nothing is sure.

    The slider does not obey the law: the estimate says so and calls nothing identified; its mass is right to a third.
    """
    parts = []
    for speed in (42, 1100):
        batch = recording(f"enslyon_slider_k168_v{speed}")
        parts += [later(window, 1e4 * speed) for window in cut_slips(batch, Gains(stiffness=168.0))[0]]
    estimate = estimate_friction(parts)
    assert estimate is not None
    assert estimate.mismatch.startswith(DOES_NOT_FIT)
    inertia = estimate["inertia"]
    assert inertia.value == pytest.approx(0.0307, rel=0.33)
    assert not inertia.identified
    joint, gains = estimate.joint(), Gains(stiffness=168.0)
    for speed, way in ((42e-6, 69e-6), (1100e-6, 139e-6)):  # and the median slip observed [m]
        assert ratio(joint, gains, speed) < critical(joint, gains, speed)
        cycles = simulate_cycles(dimensionless_groups(joint, gains, speed), 40)
        # In units of the Stribeck velocity over omega.
        frequency = math.sqrt(168.0 / float(joint.inertia))
        unit = float(joint.friction.stribeck_velocity) / frequency
        assert float(np.median(cycles.slip_distance[20:])) * unit == pytest.approx(way, rel=0.4)


def test_a_study_that_would_take_long_is_cut_short_and_says_so() -> None:
    """Issue 36, item 6: slips that no law explains took a study 20 s. These scatter, and no noise hides it."""
    rng = np.random.default_rng(1)
    time, begin = np.arange(0.0, 38.0, 0.01), 0.5
    position = np.zeros(len(time))
    for distance, duration, dwell in np.array([0.016, 0.3, 0.8]) * np.exp(0.05 * rng.standard_normal((46, 3))):
        position += 0.5 * distance * (1.0 - np.cos(np.pi * np.clip((time - begin) / duration, 0.0, 1.0)))
        begin += dwell
    windows = cut_slips(Batch(time=time, position=position), None)[0]
    found = study(StudyQuestion(windows=windows, most_steps=5e5))
    assert found is not None
    assert found.estimate.mismatch.startswith(DOES_NOT_FIT)
    assert found.estimate.mismatch.endswith(CUT_SHORT)
    assert not any(found.estimate[name].identified for name in NAMES[1:])
