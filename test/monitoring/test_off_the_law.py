# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Friction learnt from machines that do not obey the paper's law: what is told, and what is withheld."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import nightly
from random_joints import cut_slips
from random_machines import CONDITIONS, MachineRecording, random_recording
from two_masses import in_counts, seen, two_mass_joint

from stickslip_ros.model.dimensionless import dimensionless_groups
from stickslip_ros.model.exact import exact_critical_damping_ratio
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.model.margin import stability_margin
from stickslip_ros.monitoring.advice.limits import AdviceLimits, Criterion
from stickslip_ros.monitoring.advice.recommend import recommend
from stickslip_ros.monitoring.advice.recommendation import Kind
from stickslip_ros.monitoring.advice.requirement import Requirement
from stickslip_ros.monitoring.friction.estimate import COULOMB_AND_LOAD, NAMES, FrictionEstimate, LawAlternative
from stickslip_ros.monitoring.friction.estimation import estimate_friction
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.monitoring.selected_model import select_model, uncertainty_of
from stickslip_ros.monitoring.uncertainty import stick_slip_probability

pytestmark = pytest.mark.slow

RATE = 500.0


@functools.cache
def learnt(condition: str, seed: int, share: float = 1.0) -> tuple[MachineRecording, FrictionEstimate]:
    """A random machine off the law in one way, and what the first part of its recording teaches."""
    recording = random_recording(seed, CONDITIONS[condition])
    monitor = JointMonitor(None, recording.gains, studies_at_once=True)
    monitor.process(recording.batch.where(slice(0, round(share * len(recording.batch)))))
    monitor.finish()
    assert monitor.learner.estimate is not None
    return recording, monitor.learner.estimate


def outside(recording: MachineRecording, estimate: FrictionEstimate) -> list[str]:
    """Parameters that are called identified and lie outside of three standard errors."""
    machine = recording.machine.after(float(recording.batch.time[-1]))
    return [
        name
        for name in NAMES
        if estimate[name].identified
        and abs(estimate[name].value - float(getattr(machine, name))) > 3.0 * estimate[name].std
    ]


@pytest.mark.parametrize("seed", [0, nightly(2), nightly(5)])
def test_an_exponential_curve_is_told_from_the_papers(seed: int) -> None:
    """Issue 18, found wrong 4: 6 of 16 verdicts were wrong; the law is learnt with the parameters now."""
    recording, estimate = learnt("exponential", seed)
    assert estimate.law == "exponential"
    assert "law: exponential" in estimate.summary()
    assert not outside(recording, estimate)
    assert {"inertia", "stribeck_velocity"} <= {name for name in NAMES if estimate[name].identified}
    _, papers = learnt("base", seed)
    assert papers.law == "hess_soom"
    assert not papers.alternatives


@pytest.mark.nightly
def test_a_law_is_found_far_from_the_other_laws_parameters() -> None:
    """Issue 18: a look at the exponential law gave up in a wrong valley, and Stribeck friction was 32 % off, sure."""
    recording, estimate = learnt("exponential", 107)
    assert estimate.law == "exponential"
    assert not estimate.mismatch
    assert estimate["stribeck"].value == pytest.approx(recording.machine.stribeck, rel=0.05)
    assert not outside(recording, estimate)


@pytest.mark.parametrize("seed", [0, nightly(3)])
def test_static_friction_that_scatters_bends_nothing(seed: int) -> None:
    """Issue 18: 3 % from rest to rest made Coulomb friction 14 standard errors off, under the wrong law."""
    recording, estimate = learnt("scatter", seed)
    assert estimate.law == "hess_soom"
    assert not estimate.mismatch
    assert {"inertia", "stribeck_velocity"} <= {name for name in NAMES if estimate[name].identified}
    assert not outside(recording, estimate)


@pytest.mark.parametrize("seed", [6, nightly(7)])
def test_what_the_slips_do_not_show_does_not_weigh_between_laws(seed: int) -> None:
    """Where all slips dwell as long, F_s∞ may be anything: another law must not win by a small one."""
    recording = random_recording(seed, CONDITIONS["base"])
    batch = recording.batch.where(slice(0, round(0.45 * len(recording.batch))))  # at the first speed
    estimate = estimate_friction(cut_slips(batch, recording.gains)[0][-14:])
    assert estimate is not None
    assert not estimate["stribeck"].identified
    assert "hess_soom" in [one.law for _, one in estimate.by_law()]


def test_laws_that_the_slips_do_not_exclude_are_averaged() -> None:
    """Issue 18: the verdict is averaged over the laws by their weights, and advice must hold under each."""
    recording, estimate = learnt("base", 0)
    _, other = learnt("exponential", 0)
    damped = replace(recording.gains, damping=0.5 * float(recording.machine.viscous))
    undecided = replace(
        estimate,
        alternatives=(
            LawAlternative(law=other.law, weight=0.3, logarithms=other.logarithms, covariance=other.covariance),
        ),
    )
    assert "the law may also be exponential (30 %)" in undecided.summary()
    assert [weight for weight, _ in undecided.by_law()] == pytest.approx([0.7, 0.3])
    selected, _ = select_model(undecided, None, recording.gains)
    assert selected is not None
    assert selected.uncertainty is not None
    for speed in (0.5 * recording.speeds[0], recording.speeds[0], 2.0 * recording.speeds[0]):
        together = stick_slip_probability(selected.uncertainty, damped, speed)
        apart = [
            stick_slip_probability(replace(one, weight=1.0, others=()), damped, speed)
            for one in (selected.uncertainty, *selected.uncertainty.others)
        ]
        assert together == pytest.approx(0.7 * apart[0] + 0.3 * apart[1])
    speed = recording.speeds[0]
    limits = AdviceLimits()
    advised = recommend(selected.joint, recording.gains, speed, limits, selected.uncertainty)[Kind.DAMPING_ONLY]
    assert advised.found
    exactly = replace(limits, condition=Criterion.EXACT)
    for law in selected.uncertainty.others:
        needed = Requirement(selected.joint, speed, exactly, law).damping(np.array([advised.stiffness]))
        assert advised.damping >= float(needed[0]) * (1.0 - 1e-6)


@pytest.mark.parametrize("seed", [nightly(17)])
def test_more_slips_do_not_lose_a_contact(seed: int) -> None:
    """Of all slips no start leads anywhere; what fitted the first of them does."""
    _, estimate = learnt("lugre", seed)
    assert estimate.contact is not None
    assert estimate["inertia"].identified


@pytest.mark.nightly
def test_a_fit_on_bristles_reaches_its_minimum() -> None:
    """It crept along the valley of viscous and Stribeck friction: viscous friction twice as large, the curve unsure."""
    recording = random_recording(15, CONDITIONS["lugre"])
    estimate = estimate_friction(cut_slips(recording.batch, recording.gains)[0])
    assert estimate is not None
    assert estimate.contact is not None
    assert not estimate.alternatives
    for name in ("inertia", "viscous", "stribeck", "stribeck_velocity"):
        assert abs(estimate[name].value - float(getattr(recording.machine, name))) < 1.5 * estimate[name].std


@pytest.mark.parametrize(("condition", "seed"), [nightly("ripple_20", 0), nightly("ripple_200", 1), ("two_masses", 0)])
def test_what_the_model_does_not_explain_is_not_believed(condition: str, seed: int) -> None:
    """Issue 18, found wrong 3 and 4: misfit was said and believed all the same."""
    recording, estimate = learnt(condition, seed)
    assert estimate.mismatch
    assert not any(estimate[name].identified for name in (*NAMES, COULOMB_AND_LOAD))
    selected, _ = select_model(estimate, None, recording.gains)
    assert selected is not None
    assert selected.uncertainty is not None
    speed = recording.speeds[0]
    for factor in (0.5, 2.0):
        gains = replace(recording.gains, stiffness=factor * float(recording.gains.stiffness))
        assert 0.05 < stick_slip_probability(selected.uncertainty, gains, speed) < 0.95
    # By Eq. (43) no more than by the exact condition: it was 0.98 of slips that begin slowly, and 1 with a ripple.
    for factor in (0.1, 0.5, 1.0, 2.0, 30.0):
        margin = stability_margin(selected.joint, selected.gains, factor * speed)
        assert 0.05 < uncertainty_of(margin, selected, factor * speed)[1] < 0.95


@pytest.mark.nightly
def test_the_swing_of_a_load_is_no_jitter() -> None:
    """What rings on a spring was taken for stamps off by a third of a sample, which were even: a law then fitted."""
    friction = Friction(
        coulomb=0.318, viscous=0.137, stribeck=0.0749, stribeck_velocity=0.0063, lag=0.0258, rise_time=0.487
    )
    joint, gains = two_mass_joint(friction, (0.509, 0.908), 8.56), Gains(stiffness=227.6, damping=3.4)
    batch = in_counts(seen(joint, gains, np.repeat([0.00265, 0.0053], 6000), RATE), 5e-5)
    estimate = estimate_friction(cut_slips(batch, gains)[0])
    assert estimate is not None
    assert estimate.mismatch
    assert not any(estimate[name].identified for name in (*NAMES, COULOMB_AND_LOAD))


@pytest.mark.nightly
def test_a_law_fits_or_does_not() -> None:
    """A load on a spring left 0.08 % of a slip over, which passed, and a rise time of a tenth at ten errors with it."""
    friction = Friction(coulomb=4.04, viscous=8.24, stribeck=1.3, stribeck_velocity=0.00736, lag=0.0178, rise_time=0.22)
    joint, gains = two_mass_joint(friction, (5.46, 9.76), 11.8), Gains(stiffness=753.0, damping=21.2)
    batch = in_counts(seen(joint, gains, np.full(20_000, 0.00516), 1000.0), 7.94e-5)
    estimate = estimate_friction(cut_slips(batch, gains)[0])
    assert estimate is not None
    assert estimate.mismatch


def test_a_value_far_too_low_is_no_more_certain_for_being_low() -> None:
    """The standard error of an open logarithm was in proportion to the value: true ones were a hundred errors off."""
    _, estimate = learnt("base", 0)
    error, truth = 2.0, estimate["rise_time"].value
    logarithms, covariance = estimate.logarithms.copy(), estimate.covariance.copy()
    rise = int(np.argmin(np.abs(logarithms - math.log(truth))))
    logarithms[rise] -= 1.5 * error
    covariance[rise, rise] = error**2
    found = replace(estimate, logarithms=logarithms, covariance=covariance)["rise_time"]
    assert not found.identified
    assert abs(found.value - truth) < 4.0 * found.std


@pytest.mark.parametrize(
    ("condition", "seed"), [("drift", 0), nightly("triangle", 2), nightly("load_both_ways", 3), ("base", 3)]
)
def test_intervals_hold_off_the_law(condition: str, seed: int) -> None:
    """Issue 18: an interval that is printed holds, whatever the machine."""
    recording, estimate = learnt(condition, seed)
    assert not outside(recording, estimate)


def test_what_repeats_beneath_the_noise_widens_the_errors() -> None:
    """A wave of a hundredth in every slip, no more than the noise of a sample, does not average out."""
    recording = random_recording(7, CONDITIONS["base"])
    windows = cut_slips(recording.batch, recording.gains)[0][:14]

    def error(wave: float) -> float:
        generator = np.random.default_rng(1)
        slips = []
        for one in windows:
            way = np.clip((one.values - one.rest_position) / one.slip_distance, 0.0, 1.0)
            added = wave * np.sin(5.0 * np.pi * way) + 0.01 * generator.standard_normal(len(way))
            noise = 0.01 * abs(one.slip_distance)
            slips.append(replace(one, noise=noise, values=one.values + one.slip_distance * added))
        estimate = estimate_friction(slips)
        assert estimate is not None
        return estimate["inertia"].std / estimate["inertia"].value

    assert error(0.01) > 6.0 * error(0.0)


@pytest.mark.parametrize(("condition", "seed"), [("base", 0), nightly("trapezoid", 4), nightly("load_one_way", 2)])
def test_more_data_make_no_answer_worse(condition: str, seed: int) -> None:
    """Issue 18: after the whole no error is more than 1.2 times that after a prefix, plus its own standard error."""
    recording, whole = learnt(condition, seed)
    for share in (0.4, 0.7):
        _, before = learnt(condition, seed, share)
        for name in NAMES:
            if not (whole[name].identified and before[name].identified):
                continue
            truth = float(getattr(recording.machine, name))
            error = abs(whole[name].value - truth)
            assert error <= 1.2 * abs(before[name].value - truth) + whole[name].std, (name, share)


@pytest.mark.nightly
def test_a_late_controller_with_gains_to_and_fro(puma: Joint) -> None:
    """Issue 18, found wrong 7: trajectories that end and are held, gains set to and fro, a controller a period late."""
    joint = replace(puma, friction=replace(puma.friction, lag=0.0, rise_time=0.0))
    gains = Gains(stiffness=630.0)
    simulation = JointSimulation(joint, gains, sampled=True, control_delay=True)
    monitor = JointMonitor(gains=gains, studies_at_once=True)
    reference = 0.0
    steps = [
        (1.0, 0.0, gains), (30.0, 0.0058, gains), (3.0, 0.0, gains), (14.0, 0.0058, replace(gains, stiffness=800.0)),
        (4.0, 0.0, replace(gains, damping=20.0)), (14.0, 0.011, replace(gains, stiffness=500.0, damping=20.0)),
        (20.0, 0.0058, gains),
    ]  # fmt: skip
    for seconds, speed, now in steps:
        simulation.gains = now
        count, start, position = round(seconds * RATE), simulation.time, simulation.position
        velocities = np.full(count, speed)
        references = reference + speed / RATE * np.arange(count)
        motion = simulation.advance(1.0 / RATE, references, velocities)
        samples = Batch(
            time=start + np.arange(count) / RATE,
            position=np.concatenate([[position], motion.position[:-1]]),
            reference_position=references,
            reference_velocity=velocities,
        )
        monitor.process(samples.where(slice(0, 3)))
        monitor.gains = now  # the monitor hears of it later
        monitor.process(samples.where(slice(3, None)))
        reference = float(references[-1]) + speed / RATE
    monitor.finish()
    estimate = monitor.learner.estimate
    assert estimate is not None
    assert not estimate.mismatch
    for name, truth in (("inertia", 6.3), (COULOMB_AND_LOAD, 8.43), ("stribeck", 1.6), ("stribeck_velocity", 0.0058)):
        assert estimate[name].value == pytest.approx(truth, rel=0.01), name
        assert abs(estimate[name].value - truth) < 4.0 * estimate[name].std, name
    # One period and half of another: so much of the friction's damping the delay takes off.
    left = float(joint.friction.viscous) - 630.0 * 1.5 / RATE
    assert estimate["viscous"].value == pytest.approx(left, rel=0.1)
    assert estimate.late is not None
    assert estimate.late.delay == pytest.approx(1.5 / RATE, rel=0.1)
    surer = replace(estimate, late=replace(estimate.late, spread=0.01, std=0.01))
    assert "; the controller acts 3" in surer.summary()


def test_the_verdict_at_other_gains_is_right_and_sure(puma: Joint) -> None:
    """The probability of stick-slip is next to 0 or 1 well away from the boundary, and between them next to it."""
    recording, estimate = learnt("base", 0)
    selected, _ = select_model(estimate, None, recording.gains)
    assert selected is not None
    assert selected.uncertainty is not None
    speed, joint = recording.speeds[0], estimate.joint()
    groups = dimensionless_groups(joint, recording.gains, speed)
    critical = float(exact_critical_damping_ratio(groups))
    momentum = 2.0 * math.sqrt(float(recording.gains.stiffness) * float(joint.inertia))
    found = []
    for factor in (0.6, 1.0, 1.6):
        damping = factor * critical * momentum - float(joint.friction.viscous)
        found.append(stick_slip_probability(selected.uncertainty, replace(recording.gains, damping=damping), speed))
    assert found[0] > 0.95
    assert 0.05 < found[1] < 0.95
    assert found[2] < 0.05


@pytest.mark.parametrize("seed", [10, nightly(12)])
def test_friction_that_has_risen_after_rests_alike_says_nothing_of_a_long_one(seed: int) -> None:
    """Issue 18: after rests alike no rise time explains as much as a long one; half of F_s∞ was called sure."""
    recording, estimate = learnt("base", seed)
    assert estimate["stribeck"].value < 0.9 * recording.machine.stribeck
    assert not estimate["stribeck"].identified
    assert not estimate["rise_time"].identified
    assert not outside(recording, estimate)
