# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 18: viscous friction that is no straight line over speed. Its slips left nothing over, and were believed.

The machines are the tests' own, integrated apart from the package.
"""

from __future__ import annotations

import math
import pkgutil
from dataclasses import replace

import numpy as np
import pytest
from conftest import nightly
from machines import Machine
from random_joints import cut_slips, later
from random_joints import random_recording as random_joint_recording
from random_machines import CONDITIONS, random_recording
from two_masses import in_counts, seen, two_mass_joint
from two_speeds import SECONDS, monitor_of, recording

from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.monitoring.friction.estimate import FrictionEstimate
from stickslip_ros.monitoring.friction.estimation import estimate_friction
from stickslip_ros.monitoring.friction.learner import FrictionLearner, LearnerMemory
from stickslip_ros.monitoring.selected_model import select_model
from stickslip_ros.nodes.kept_state import from_plain, to_plain

GAINS = Gains(stiffness=630.0)
RESOLUTION = 5e-6  # [rad], some thousandth of a slip


def learnt_from(condition: str, seed: int) -> tuple[Machine, FrictionEstimate]:
    """A random machine, and what is learnt from its recording."""
    random = random_recording(seed, CONDITIONS[condition])
    estimate = monitor_of(random.batch, random.gains).learner.estimate
    assert estimate is not None
    return random.machine, estimate


def off(estimate: FrictionEstimate, name: str, truth: float) -> float:
    """In standard errors."""
    return abs(estimate[name].value - truth) / estimate[name].std


@pytest.mark.slow
@pytest.mark.parametrize("curvature", [nightly(0.5), -0.4])
def test_curved_friction_is_told(puma: Joint, curvature: float) -> None:
    """Stribeck friction and lag were several per cent and many errors off, and identified."""
    straight = Machine.of(puma)
    speed = 0.05
    machine = replace(straight, viscous=straight.viscous * (1.0 - curvature), drag=straight.viscous * curvature / speed)
    batch = recording(machine, GAINS, RESOLUTION)
    monitor = monitor_of(batch, GAINS)
    estimate = monitor.learner.estimate
    assert estimate is not None
    assert not estimate.mismatch
    # Nothing of a slip is left over: it is that of the other integration, which has the same curve.
    assert estimate.left_over == 0.0
    assert estimate.curvature is not None
    at = estimate.curvature.speed
    viscous = machine.viscous + machine.drag * at
    true = machine.drag * at / viscous
    assert estimate.curvature.value == pytest.approx(true, abs=3.0 * estimate.curvature.std)
    assert ("more" if curvature > 0 else "less") + " than in proportion to the speed" in estimate.summary()
    assert off(estimate, "viscous", viscous) < 3.0
    for name in ("inertia", "stribeck", "stribeck_velocity", "lag", "rise_time"):
        assert off(estimate, name, float(getattr(machine, name))) < 3.0, name
    for name in ("inertia", "stribeck"):
        assert estimate[name].identified, name
    # A verdict is about slower motion, where curved friction gives less damping, or more.
    selected, _ = select_model(estimate, None, GAINS)
    assert selected is not None
    assert selected.uncertainty is not None
    drawn = float(np.median(selected.uncertainty.joint.friction.viscous)) / estimate["viscous"].value
    assert drawn == pytest.approx(1.0 - 0.5 * estimate.curvature.value, abs=0.1)
    # A monitor that is started anew goes on from there, slip by slip.
    learner = FrictionLearner()
    assert learner.restore(from_plain(LearnerMemory, to_plain(monitor.learner.memory_of())))
    for window in cut_slips(batch, GAINS)[0][-6:]:
        learner.add_slip(later(window, SECONDS))
    updated = learner.estimate
    assert updated is not None
    assert updated is not estimate
    assert updated.curvature is not None
    assert updated.curvature.speed == at
    for name in ("inertia", "stribeck", "stribeck_velocity", "lag", "rise_time"):
        assert off(updated, name, float(getattr(machine, name))) < 3.0, name
    assert off(updated, "viscous", viscous) < 3.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, nightly(3)])
def test_errors_have_what_curved_friction_may_make(seed: int) -> None:
    """Two random joints: Stribeck friction 7.1 and 3.9 % off, 8.7 and 3.5 standard errors."""
    machine, estimate = learnt_from("drag", seed)
    assert estimate["stribeck"].identified
    for name in ("inertia", "stribeck", "stribeck_velocity"):
        assert off(estimate, name, float(getattr(machine, name))) < 2.5, name


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, nightly(1), nightly(2)])
def test_straight_friction_stays_straight(seed: int) -> None:
    """Where the paper's law holds, no curve is seen."""
    _, estimate = learnt_from("base", seed)
    assert estimate.curvature is None


@pytest.mark.slow
def test_a_curve_that_stands_for_a_flexible_load_is_not_sure() -> None:
    """Issue 38: the swing of a load passed for curved friction, with viscous friction 4.8 times too large, at 3 errors.

    The Stribeck velocity was identified 3.4 errors off.
    """
    friction = Friction(coulomb=8.0, viscous=2.0, stribeck=1.6, stribeck_velocity=0.006, lag=0.02, rise_time=0.3)
    gains, inertia = Gains(stiffness=630.0, damping=10.0), 6.3
    joint = two_mass_joint(friction, (0.3 * inertia, 0.7 * inertia), 40.0)
    batch = in_counts(seen(joint, gains, np.full(12_000, 0.004), 200.0), 2e-5)
    estimate = monitor_of(batch, gains).learner.estimate
    assert estimate is not None
    assert off(estimate, "inertia", inertia) < 2.5
    for name in ("viscous", "stribeck", "stribeck_velocity", "lag", "rise_time"):
        assert off(estimate, name, float(getattr(friction, name))) < 2.5, name


_MORE_SLIPS = pytest.mark.xfail(reason="rests of 20 ms, stamps 2.5 ms off: their noise passes for a curve (issue 38)")


_BENT_VALLEY = pytest.mark.xfail(reason="a curve of 0.04 ± 0.4, since fits end in the deepest valley (issue 38)")


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed",
    [
        pytest.param(15, marks=[_MORE_SLIPS, pytest.mark.nightly]),
        24,
        pytest.param(39, marks=[_BENT_VALLEY, pytest.mark.nightly]),
    ],
)
def test_noise_is_no_curve(seed: int) -> None:
    """With stray stamps and lost samples each of these had a curve, and up to three of six verdicts were wrong."""
    drawn = random_joint_recording(seed)
    windows, _ = cut_slips(drawn.noisy(1), drawn.gains)
    estimate = estimate_friction(windows)
    assert estimate is not None
    assert estimate.curvature is None
    frequency = math.sqrt(drawn.joint.inertia / estimate["inertia"].value)
    assert frequency == pytest.approx(1.0, abs=0.03)


@pytest.mark.slow
def test_more_than_all_static_friction_held_no_slip() -> None:
    """A slip after a long rest began at twice what F_s∞ was taken for, half of the true one, with an error of 1 %."""
    machine, estimate = learnt_from("drag", 8)
    assert not estimate["stribeck"].identified or off(estimate, "stribeck", machine.stribeck) < 2.5


@pytest.mark.slow
@pytest.mark.parametrize(("delay", "curvature"), [(1e-3, 0.5), (4e-3, 0.0)])
def test_the_order_of_optional_terms_does_not_matter(
    puma: Joint, delay: float, curvature: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Issue 38: the same terms and estimates, whichever stands first in the table of the terms that are tried."""
    straight, gains = Machine.of(puma), replace(GAINS, damping=10.0)
    drag = straight.viscous * curvature / 0.05
    machine = replace(
        straight, sampled=True, control_delay=delay, viscous=straight.viscous * (1.0 - curvature), drag=drag
    )
    windows, _ = cut_slips(recording(machine, gains, RESOLUTION), gains)
    room, table = "stickslip_ros.monitoring.friction.model_selection", "SCORED_TERMS"
    terms = pkgutil.resolve_name(f"{room}:{table}")
    assert len(terms) > 1
    found = []
    for order in (terms, tuple(reversed(terms))):
        monkeypatch.setattr(f"{room}.{table}", order)
        estimate = estimate_friction(windows)
        assert estimate is not None
        found.append(estimate)
    assert found[0].summary() == found[1].summary()
    assert (found[0].curvature is not None) == (curvature != 0.0)
    np.testing.assert_allclose(found[0].logarithms, found[1].logarithms, rtol=1e-9)
    np.testing.assert_allclose(found[0].covariance, found[1].covariance, rtol=1e-6, atol=1e-12)
