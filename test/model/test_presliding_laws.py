# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Presliding: the limit that is the paper's law, independent integration, published examples, what is refused."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from brute_presliding import critical_ratio
from conftest import nightly
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.joint_simulation import EventKind, JointSimulation, Trajectory, simulate
from stickslip_ros.model.margin import stability_margin
from stickslip_ros.model.outcome import Outcome
from stickslip_ros.model.verdict import Detail, verdict

pytestmark = pytest.mark.slow

SECONDS = 30.0
# Canudas de Wit, Olsson, Åström and Lischinsky, IEEE TAC 40(3), 1995, Table I.
PUBLISHED = Friction(
    stribeck=0.5, stribeck_velocity=0.001, coulomb=1.0, viscous=0.4, law="exponential",
    presliding_stiffness=1e5, presliding_damping=math.sqrt(1e5), contact="lugre",
)  # fmt: skip


def on_contact(joint: Joint, stiffness: float, damping: float = 0.0, contact: str = "elasto_plastic") -> Joint:
    """The same joint on a contact that gives way."""
    friction = replace(joint.friction, presliding_stiffness=stiffness, presliding_damping=damping, contact=contact)
    return replace(joint, friction=friction)


def move(joint: Joint, gains: Gains, velocity: float, duration: float = SECONDS) -> Trajectory:
    """Constant velocity from rest."""
    count = round(duration / 1e-3)
    return simulate(joint, gains, velocity * 1e-3 * np.arange(count), np.full(count, velocity))


def breakaways(motion: Trajectory) -> list[tuple[float, float]]:
    """Time and Stribeck level of each."""
    return [(event.time, event.stribeck_level) for event in motion.events if event.kind is EventKind.BREAKAWAY]


@pytest.mark.parametrize("seed", [*range(4), *map(nightly, range(4, 12))])
def test_a_stiff_contact_is_the_papers_law(seed: int) -> None:
    """Issue 23: from σ₀ = 1000 k_p on, period and breakaway level of the cycles are within 1 % of the paper's law."""
    random = np.random.default_rng(seed)
    inertia, frequency = 10 ** random.uniform(-1, 1), random.uniform(6.0, 20.0)
    stiffness, speed = inertia * frequency**2, random.uniform(0.003, 0.01)
    stribeck = random.uniform(2.0, 4.0) * stiffness * speed / frequency
    joint = Joint(
        inertia=inertia,
        friction=Friction(
            stribeck=stribeck,
            stribeck_velocity=random.uniform(0.5, 2.0) * speed,
            lag=random.uniform(0.0, 0.5) / frequency,
            rise_time=random.uniform(0.0, 0.5),
            viscous=random.uniform(0.0, 0.2) * inertia * frequency,
            coulomb=random.uniform(1.0, 5.0) * stribeck,
        ),
    )
    gains = Gains(stiffness=stiffness)
    rigid = breakaways(move(joint, gains, speed))
    soft = breakaways(move(on_contact(joint, 1000.0 * stiffness), gains, speed))
    assert len(rigid) > 6
    assert abs(len(soft) - len(rigid)) <= max(1, len(rigid) // 100)
    period = np.mean(np.diff([time for time, _ in rigid[-5:]]))
    assert np.mean(np.diff([time for time, _ in soft[-5:]])) == pytest.approx(period, rel=0.01)
    assert soft[-1][1] == pytest.approx(rigid[-1][1], rel=0.01)


# k_p and speed of joint 1, and how far ρ_c may be from that of a rigid contact: with σ₀ of 10³, 10⁴ and 10⁵ k_p.
BOUNDARIES = [(2016.0, 0.005), nightly(630.0, 0.01), nightly(630.0, 0.005), nightly(630.0, 0.003)]
NEAR = {"elasto_plastic": (0.10, 0.035, 0.02), "lugre": (0.21, 0.08, 0.025)}
CONTACTS = [("elasto_plastic", 0.5), ("lugre", 0.0), nightly("elasto_plastic", 0.0), nightly("lugre", 0.5)]


@pytest.mark.parametrize(("contact", "damped"), CONTACTS)
@pytest.mark.parametrize(("stiffness", "speed"), BOUNDARIES)
def test_the_boundary_tends_to_that_of_a_rigid_contact(
    puma: Joint, contact: str, damped: float, stiffness: float, speed: float
) -> None:
    """Issue 23: ρ_c tends to the paper's; 1 % (and the search's own) holds from 1e5 k_p on, not from 1000 k_p."""
    gains = Gains(stiffness=stiffness)
    rigid = verdict(puma, gains, speed, detail=Detail.BOUNDARY).critical_damping_ratio
    for exponent, near in enumerate(NEAR[contact], start=3):
        joint = _damped(puma, 10.0**exponent * stiffness, damped, contact)
        found = verdict(joint, gains, speed, detail=Detail.BOUNDARY).critical_damping_ratio
        assert found == pytest.approx(rigid, rel=near)


@pytest.mark.parametrize(("contact", "damped"), CONTACTS)
@pytest.mark.parametrize(("stiffness", "speed"), BOUNDARIES[:3])
def test_the_boundary_is_that_of_brute_force(
    puma: Joint, contact: str, damped: float, stiffness: float, speed: float
) -> None:
    """Issue 23: at 1000 and 10,000 k_p ρ_c is that of small steps: how far it is from the rigid one is physics."""
    for ratio in (1e3, 1e4):
        joint = _damped(puma, ratio * stiffness, damped, contact)
        found = verdict(joint, Gains(stiffness=stiffness), speed).critical_damping_ratio
        expected = critical_ratio(joint.friction, float(puma.inertia), stiffness, speed, 20.0)
        assert found == pytest.approx(expected, rel=0.02)


def test_a_joint_that_creeps_off_slides() -> None:
    """Issue 39: on a contact that creeps a joint may come to its speed without breaking away, and does not stick."""
    friction = Friction(
        coulomb=14.5, viscous=11.4, stribeck=5.9, stribeck_velocity=0.002, lag=0.037, rise_time=0.42,
        presliding_stiffness=4e5, presliding_damping=1200.0, contact="lugre",
    )  # fmt: skip
    joint, gains, speed = Joint(inertia=14.8, friction=friction), Gains(stiffness=10400.0, damping=20.4), 0.0021
    found = verdict(joint, gains, speed, detail=Detail.BOUNDARY)
    assert found.outcome is Outcome.STEADY
    assert verdict(joint, gains, speed, detail=Detail.SMOOTH).smooth
    expected = critical_ratio(friction, 14.8, float(gains.stiffness), speed, 20.0)
    assert found.critical_damping_ratio == pytest.approx(expected, rel=0.05)


def _damped(joint: Joint, stiffness: float, damped: float, contact: str) -> Joint:
    """On a contact with so much of its critical damping."""
    return on_contact(joint, stiffness, 2.0 * damped * math.sqrt(stiffness * float(joint.inertia)), contact)


@dataclass(kw_only=True)
class _Piecewise:
    """An elasto-plastic joint without lag and rise, by scipy between located events; nothing is shared with ours."""

    joint: Joint
    gains: Gains
    velocity: float
    anchor: float = 0.0
    direction: float = 0.0

    def rates(self, time: float, y: NDArray[np.float64]) -> list[float]:
        """Velocity and acceleration."""
        friction, (x, v) = self.joint.friction, y
        held = friction.viscous * v
        if self.direction == 0.0:
            held += friction.presliding_stiffness * (x - self.anchor) + friction.presliding_damping * v
        else:
            shape = 1.0 / (1.0 + (v / friction.stribeck_velocity) ** 2)
            held += self.direction * (friction.coulomb + friction.stribeck * shape)
        force = self.gains.stiffness * (self.velocity * time - x) + self.gains.damping * (self.velocity - v)
        return [float(v), float((force - held) / self.joint.inertia)]

    def until(self, _: float, y: NDArray[np.float64]) -> float:
        """What crosses zero where the joint breaks away or stops."""
        friction = self.joint.friction
        if self.direction != 0.0:
            return float(self.direction * y[1])
        return float(friction.presliding_stiffness * abs(y[0] - self.anchor) - friction.coulomb - friction.stribeck)

    def positions(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Position at times."""
        friction, begin, state, found = self.joint.friction, 0.0, np.zeros(2), np.empty(0)
        most = float(friction.coulomb + friction.stribeck) / float(friction.presliding_stiffness)
        # At the start the contact carries what the controller begins with.
        self.anchor = -float(self.gains.damping) * self.velocity / float(friction.presliding_stiffness)
        while begin < times[-1]:
            event = lambda time, y: self.until(time, y)  # noqa: E731
            event.terminal, event.direction = True, 1.0 if self.direction == 0.0 else -1.0  # type: ignore[attr-defined]
            piece = solve_ivp(
                self.rates, (begin, times[-1] + 1e-9), state, method="DOP853", rtol=1e-10, atol=1e-14,
                events=event, dense_output=True,
            )  # fmt: skip
            found = np.append(found, piece.sol(times[(times > begin) & (times <= piece.t[-1])])[0])
            begin, state = float(piece.t[-1]), piece.y[:, -1]
            if self.direction == 0.0:
                self.direction = math.copysign(1.0, state[0] - self.anchor)
                state[1] += self.direction * 1e-12
            else:
                self.anchor = state[0] - self.direction * most
                state[1] = -self.direction * 1e-12
                self.direction = 0.0
        return found


@pytest.mark.parametrize(("contact", "damping"), [(4e3, 0.0), (4e3, 30.0), (4e4, 200.0)])
def test_an_elastic_contact_by_other_means(contact: float, damping: float) -> None:
    """Issue 23: without lag and rise, positions agree with scipy's integration between located events."""
    friction = Friction(stribeck=2.0, stribeck_velocity=0.01, viscous=2.0, coulomb=6.0)
    joint = on_contact(Joint(inertia=5.0, friction=friction), contact, damping)
    gains = Gains(stiffness=500.0, damping=5.0)
    found = move(joint, gains, 0.01, 12.0)
    expected = _Piecewise(joint=joint, gains=gains, velocity=0.01).positions(found.time[9::10])
    assert len(found.events) > 8
    np.testing.assert_allclose(found.position[9::10], expected, rtol=0, atol=2e-6)


def _lugre(
    friction: Friction, gains: Gains, target: float, speed: float, times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Position of a unit mass by scipy's Radau."""
    s0, s1 = float(friction.presliding_stiffness), float(friction.presliding_damping)

    def right(time: float, y: NDArray[np.float64]) -> list[float]:
        x, v, z, *integral = y
        yields = friction.coulomb + friction.stribeck * math.exp(-((v / float(friction.stribeck_velocity)) ** 2))
        deflecting = v - s0 * abs(v) * z / float(yields)
        error = target + speed * time - x
        force = (
            gains.stiffness * error + gains.damping * (speed - v) + gains.integral * (integral[0] if integral else 0.0)
        )
        rates = [v, float(force - s0 * z - s1 * deflecting - friction.viscous * v), deflecting, error]
        return rates[: len(y)]

    start = np.zeros(4 if gains.integral else 3)
    found = solve_ivp(right, (0.0, times[-1]), start, method="Radau", rtol=1e-8, atol=1e-11, t_eval=times)
    return np.asarray(found.y[0])


def test_the_published_stick_slip() -> None:
    """Issue 23: a unit mass on a spring of 2 N/m pulled at 0.1 m/s sticks and slips as published, and as Radau has it.

    A spring of 2 N/m has to stretch by F_S/k = 0.75 m before the mass moves; a slip without damping would be
    2 (F_S − F_C)/k = 0.5 m long, and more as the end of the spring moves on.
    """
    joint, gains = Joint(inertia=1.0, friction=PUBLISHED), Gains(stiffness=2.0)
    count, period, speed = 2500, 0.01, 0.1
    motion = simulate(joint, gains, speed * period * np.arange(count), np.full(count, speed), period=period)
    np.testing.assert_allclose(motion.position, _lugre(PUBLISHED, gains, 0.0, speed, motion.time), atol=1e-5)
    times = [time for time, _ in breakaways(motion)]
    assert times[0] == pytest.approx(7.2, abs=0.3)
    assert np.diff(times) == pytest.approx(6.36, abs=0.05)


def test_the_published_hunting() -> None:
    """Issue 23: under the PID control of the same paper the mass hunts about its target without end."""
    joint, gains = Joint(inertia=1.0, friction=PUBLISHED), Gains(stiffness=3.0, damping=6.0, integral=4.0)
    count, period = 10000, 0.01
    motion = JointSimulation(joint, gains).advance(period, np.ones(count), np.zeros(count))
    np.testing.assert_allclose(motion.position, _lugre(PUBLISHED, gains, 1.0, 0.0, motion.time), atol=1e-3)
    late = motion.position[6000:]
    assert 0.05 < late.max() - 1.0 < 0.08
    assert 0.05 < 1.0 - late.min() < 0.08
    assert breakaways(motion)[-1][0] > 90.0


@pytest.mark.parametrize("contact", ["elasto_plastic", "lugre"])
def test_in_pieces_or_at_once_on_a_contact(puma: Joint, contact: str) -> None:
    """Issue 23: how the periods are grouped into calls makes no difference."""
    joint, gains = on_contact(puma, 2e4, 50.0, contact), Gains(stiffness=630.0)
    references, velocities = 0.0058e-3 * np.arange(6000), np.full(6000, 0.0058)
    whole = simulate(joint, gains, references, velocities)
    simulation = JointSimulation(joint, gains)
    pieces = [simulation.advance(1e-3, references[i : i + 7], velocities[i : i + 7]) for i in range(0, 6000, 7)]
    np.testing.assert_allclose(np.concatenate([piece.position for piece in pieces]), whole.position, atol=1e-9)


def test_a_small_push_is_given_back(puma: Joint) -> None:
    """Issue 23: below breakaway an elastic contact moves by force over k_p + σ₀, and comes back."""
    joint, gains = on_contact(puma, 2e4, 500.0), Gains(stiffness=630.0)
    there = np.linspace(0.0, 0.006, 2000)
    references = np.concatenate([there, np.full(2000, 0.006), there[::-1], np.zeros(4000)])
    motion = simulate(joint, gains, references, np.gradient(references, 1e-3))
    assert not motion.events
    assert motion.position[3900] == pytest.approx(630.0 * 0.006 / (630.0 + 2e4), rel=1e-4)
    assert abs(motion.position[-1]) < 1e-8


def test_what_a_contact_may_be(puma: Joint) -> None:
    """Issue 23: a presliding stiffness is positive, or infinite, which is none; a contact has a name."""
    with pytest.raises(InvalidParameterError, match="presliding_stiffness"):
        on_contact(puma, 0.0)
    with pytest.raises(InvalidParameterError, match="presliding_damping"):
        on_contact(puma, 1e4, -1.0)
    with pytest.raises(InvalidParameterError, match="elasto_plastic, lugre"):
        on_contact(puma, 1e4, 0.0, "dahl")
    assert puma.friction.of_the_paper
    assert not on_contact(puma, 1e4).friction.of_the_paper


def test_eq_43_is_of_a_rigid_contact(puma: Joint) -> None:
    """Issue 23: Eq. (43) is not applicable to a contact that is less than 1000 times as stiff as k_p."""
    gains = Gains(stiffness=2016.0)
    margin = stability_margin(on_contact(puma, 1e4), gains, 0.005)
    assert not margin.applicable
    assert "presliding stiffness is below 1000 times k_p" in str(margin.reason)
    assert stability_margin(on_contact(puma, 2.1e6), gains, 0.005).applicable
