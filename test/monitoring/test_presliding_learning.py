# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The stiffness of the contact, learnt from the creep of a joint at rest (issue 23)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from elastic_joints import CONTACTS, Case, random_case
from presliding import creeping

from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.assessment import MonitorOptions
from stickslip_ros.monitoring.friction.presliding import PreslidingEstimate
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

pytestmark = pytest.mark.slow

JOINTS = 8
NATURAL_PERIOD, CREEP = 0.63, 0.05  # [s]; of a slip


def learnt(samples: Batch, gains: Gains | None, pieces: int = 1) -> PreslidingEstimate | None:
    """What a monitor learns of the contact."""
    monitor = JointMonitor(gains=gains)
    for part in np.array_split(np.arange(len(samples)), pieces):
        monitor.process(samples.where(slice(int(part[0]), int(part[-1]) + 1)))
    return monitor.assessment().presliding


@pytest.fixture(scope="module")
def elastic() -> Case:
    """A joint of whose contact enough is seen to identify it, from its gains."""
    generator = np.random.default_rng(7)
    cases = (random_case(generator, "elasto_plastic", turns=True) for _ in range(20))
    return next(case for case in cases if (seen := learnt(case.samples, case.gains)) and seen.stiffness.identified)


@pytest.mark.parametrize("contact", CONTACTS)
def test_of_random_joints_to_and_fro(contact: str) -> None:
    """Intervals hold, whatever the contact; no rigid joint is said to creep, and no contact is mistaken."""
    generator = np.random.default_rng(11)
    cases = [random_case(generator, contact, turns=True) for _ in range(JOINTS)]
    found = [(case, seen) for case in cases if (seen := learnt(case.samples, case.gains)) is not None]
    assert len(found) >= JOINTS // 2
    shown = [(case, seen) for case, seen in found if seen.shown]
    assert (len(shown) >= 2) is (contact != "rigid")
    for case, seen in shown:
        assert abs(seen.stiffness.value - case.stiffness) <= 2.6 * seen.stiffness.std
        assert seen.contact in ("", contact)
        assert not seen.stiffness.identified or seen.contact
    for case, seen in found:
        assert seen.at_least <= 1.05 * case.stiffness


def test_one_way_the_contact_is_not_told() -> None:
    """While the force rises only one way, an elastic contact is like one that yields: nothing is called identified."""
    generator = np.random.default_rng(11)
    for contact in CONTACTS:
        for _ in range(3):
            case = random_case(generator, contact, turns=False)
            seen = learnt(case.samples, case.gains)
            assert seen is None or not seen.stiffness.identified
            assert seen is None or contact == "rigid" or seen.at_least <= 1.05 * case.stiffness


def test_of_a_joint_of_other_code() -> None:
    """LuGre friction of an exponential Stribeck curve, by an integration of its own, at 250 Hz."""
    joint = creeping(creep=CREEP, interval=0.004, period=NATURAL_PERIOD, duration=60.0, one_way=5.0)
    count = joint.slip / 3000
    samples = Batch(
        time=joint.time, position=count * np.round(joint.position / count), reference_position=joint.reference
    )
    stiffness = (2.0 * math.pi / NATURAL_PERIOD) ** 2  # of the spring, the inertia being 1
    seen = learnt(samples, Gains(stiffness=stiffness))
    assert seen is not None
    assert seen.contact != "elasto_plastic"
    assert abs(seen.stiffness.value - stiffness / CREEP) <= 1.96 * seen.stiffness.std
    # Of its 56 rests those before and after a turn scatter most.
    assert seen.stiffness.std < 0.3 * seen.stiffness.value


def test_the_effort_is_as_good_as_gains(elastic: Case) -> None:
    """Without gains it comes from a noisy effort."""
    samples, stiffness = elastic.samples, float(elastic.gains.stiffness)
    law = stiffness * (samples.reference_position - samples.position)
    noise = 0.01 * np.ptp(law) * np.random.default_rng(1).standard_normal(len(law))
    alone = replace(
        samples, effort=law + noise, reference_position=np.full(len(law), np.nan), reference_velocity=np.zeros(0)
    )
    seen = learnt(alone, None)
    assert seen is not None
    assert abs(seen.stiffness.value - elastic.stiffness) <= 1.96 * seen.stiffness.std
    assert seen.stiffness.std < 0.1 * seen.stiffness.value


def test_batches_make_no_difference(elastic: Case) -> None:
    """To the digit."""
    assert learnt(elastic.samples, elastic.gains) == learnt(elastic.samples, elastic.gains, 40)


def test_where_the_force_is_not_known_nothing_is_learnt(elastic: Case) -> None:
    """Neither without gains and effort, nor where the effort holds another force than the gains give."""
    samples = elastic.samples
    assert learnt(replace(samples, reference_position=np.full(len(samples), np.nan)), None) is None
    law = float(elastic.gains.stiffness) * (samples.reference_position - samples.position)
    assert learnt(replace(samples, effort=law + np.ptp(law) * np.sin(3.0 * samples.time)), elastic.gains) is None


def test_gains_that_change_in_a_rest_teach_nothing(elastic: Case) -> None:
    """No rest in which the gains were set counts, and a reset forgets the others."""
    monitor = JointMonitor(gains=elastic.gains)
    for number, part in enumerate(np.array_split(np.arange(len(elastic.samples)), 400)):
        monitor.gains = replace(elastic.gains, damping=float(elastic.gains.damping) + 0.01 * (number % 2))
        monitor.process(elastic.samples.where(slice(int(part[0]), int(part[-1]) + 1)))
    unknown = monitor.assessment().presliding
    known = learnt(elastic.samples, elastic.gains)
    assert known is not None
    assert unknown is None or unknown.rests < 0.5 * known.rests
    monitor.reset()
    assert monitor.assessment().presliding is None


def test_it_is_not_learnt_where_nothing_is_to_be(elastic: Case) -> None:
    """`learn: false` holds for the contact too."""
    monitor = JointMonitor(gains=elastic.gains, options=MonitorOptions(learn=False))
    monitor.process(elastic.samples)
    assert monitor.assessment().presliding is None
