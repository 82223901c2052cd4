# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Joints that obey the paper's law or none of it, integrated apart from the package's own kernels.

Small fixed steps, the midpoint rule; breakaway and arrest are found within the step by a straight line. Motor and load
on a spring alone are integrated by the package, which ``test/model/test_two_masses.py`` compares with other code.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from stickslip_ros.model.friction import FRICTION_PARAMETERS, Friction, Gains, Joint, Transmission
from stickslip_ros.model.joint_simulation import JointSimulation

PAPER, EXPONENTIAL, LUGRE = range(3)

TIME, POSITION, LEVEL, ARREST_TIME, ARREST_POSITION = range(5)  # columns of Motion.slips

_SCATTER = 18  # seed
_CREEP = 0.1  # of the largest commanded speed: a joint on bristles rests below it
_MOVES = 5.0  # times that speed, from which on it slips
# Longest step, of the shortest time in which something happens.
_OF_SWING, _OF_LAG, _OF_BRISTLE, _OF_DECAY, _OF_FALL = 0.003, 0.025, 0.02, 0.01, 0.03

_RUNS_AWAY = 2.0  # times as large as earlier, or as the speed, are the swings of a joint that is smooth at most


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A joint and what is not ideal in it; all that has a default is off by default.

    Attributes
    ----------
    inertia : M [kg·m²]. coulomb : F_k [N·m], the mean of both directions. viscous : F_v [N·m·s/rad].
    stribeck : F_s∞ [N·m]; stribeck_velocity : x˙_s [rad/s].
    lag, rise_time : τ_L, γ [s]; LUGRE has neither.
    law : PAPER has Ψ = 1/(1 + (x˙/x˙_s)²), EXPONENTIAL exp(−(x˙/x˙_s)²); LUGRE the latter on bristles.
    bristle_stiffness : σ₀ [N·m/rad] of LuGre's bristles, under another law of a contact that is elastic up to
        breakaway; then static friction is everywhere and always the same. bristle_damping : σ₁ [N·m·s/rad].
    load : constant torque against the controller [N·m].
    asymmetry : share by which Coulomb friction is higher in positive direction, and lower in the other.
    stribeck_asymmetry : share by which Stribeck friction is higher in positive direction, and lower in the other.
    ripple : amplitude of Coulomb friction over position, a share of it; ripples : periods per radian.
    stribeck_ripple : amplitude of Stribeck friction over position, a share of it, with the same periods and phase.
    gravity : of an arm that is stretched out at position 0: a further load, its cosine [N·m]; bend : turns of the arm
        by as many radians in a radian of the joint's.
    load_share : Coulomb friction grows by this share of the load's size, and Stribeck friction with it in proportion.
    drift : share by which all friction grows in a second, from the beginning on [1/s].
    static_scatter : share by which static friction varies from rest to rest, its standard deviation.
    drag : of the square of the velocity, beside viscous friction [N·m·s²/rad²].
    sampled : the controller sees the joint once in a period and holds its effort.
    control_delay : so much later the effort takes effect [s], at most a period.
    transmission : spring between motor and load; all else is ideal in such a machine, and of the paper's law.
    """

    inertia: float
    coulomb: float
    viscous: float
    stribeck: float
    stribeck_velocity: float
    lag: float = 0.0
    rise_time: float = 0.0
    law: int = PAPER
    bristle_stiffness: float = 0.0
    bristle_damping: float = 0.0
    load: float = 0.0
    asymmetry: float = 0.0
    stribeck_asymmetry: float = 0.0
    ripple: float = 0.0
    ripples: float = 0.0
    stribeck_ripple: float = 0.0
    gravity: float = 0.0
    bend: float = 1.0
    load_share: float = 0.0
    drift: float = 0.0
    static_scatter: float = 0.0
    drag: float = 0.0
    sampled: bool = False
    control_delay: float = 0.0
    transmission: Transmission | None = None

    @classmethod
    def of(cls, joint: Joint) -> Machine:
        """A joint of the paper's law, ideal otherwise."""
        values = {one.name: float(getattr(joint.friction, one.name)) for one in FRICTION_PARAMETERS}
        return cls(inertia=float(joint.inertia), **values)

    def after(self, time: float) -> Machine:
        """The machine whose friction stays as it is after a time of drift [s]."""
        factor = 1.0 + self.drift * time
        return replace(
            self,
            coulomb=factor * self.coulomb,
            viscous=factor * self.viscous,
            stribeck=factor * self.stribeck,
            drift=0.0,
        )

    @property
    def in_the_worse_direction(self) -> Machine:
        """The machine whose Stribeck friction is in both directions what it is in that with more."""
        return replace(self, stribeck=(1.0 + abs(self.stribeck_asymmetry)) * self.stribeck, stribeck_asymmetry=0.0)

    def load_at(self, position: float) -> float:
        """Torque against the controller [N·m] at a position [rad]."""
        return self.load + self.gravity * math.cos(self.bend * position)

    def at(self, position: float) -> Machine:
        """The machine whose friction and load are everywhere as they are at a position [rad]."""
        load = self.load_at(position)
        wave = math.sin(2.0 * math.pi * self.ripples * position)
        grown = 1.0 + self.load_share * abs(load) / self.coulomb
        return replace(
            self,
            coulomb=grown * self.coulomb * (1.0 + self.ripple * wave),
            stribeck=grown * self.stribeck * (1.0 + self.stribeck_ripple * wave),
            load=load, ripple=0.0, stribeck_ripple=0.0, gravity=0.0, load_share=0.0,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Samples at the start of every period, shape (n,), and the slips.

    Attributes
    ----------
    position : [rad]; velocity : [rad/s]; effort : of the controller, in force from the sample on [N·m].
    slips : that have ended, a row each: time and position of the breakaway, level F_s,b there (NaN for LUGRE), time
        and position of the arrest.
    last_rest : the last instant at rest [s].
    """

    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    slips: np.ndarray
    last_rest: float


def simulate(machine: Machine, gains: Gains, references: np.ndarray, velocities: np.ndarray, period: float) -> Motion:
    """Motion from rest at position 0 with full static friction.

    ``references[i]`` [rad] is the desired position at the start of period i, and moves on with ``velocities[i]``
    [rad/s] during it. The gains' integral is not used.
    """
    if machine.transmission is not None:
        return _on_a_spring(machine, gains, references, velocities, period)
    steps = math.ceil(period / _longest_step(machine, gains))
    plant = np.array([
        machine.inertia, machine.coulomb, machine.viscous, machine.stribeck, machine.stribeck_velocity, machine.lag,
        machine.rise_time, machine.bristle_stiffness, machine.bristle_damping, machine.load, machine.asymmetry,
        machine.ripple, 2.0 * math.pi * machine.ripples, machine.drift, machine.stribeck_ripple, machine.gravity,
        machine.load_share, machine.bend, machine.drag, machine.stribeck_asymmetry,
    ])  # fmt: skip
    control = np.array([float(gains.stiffness), float(gains.damping), machine.control_delay])
    samples = np.empty((len(references), 3))
    # A joint cannot slip more often than every few samples, but for hops that matter to nobody.
    slips = np.empty((len(references), 5))
    strengths = np.exp(machine.static_scatter * np.random.default_rng(_SCATTER).standard_normal(len(references)))
    count, last_rest = _integrate(
        machine.law, plant, control, machine.sampled, np.ascontiguousarray(references, dtype=float),
        np.ascontiguousarray(velocities, dtype=float), period, steps, _CREEP * float(np.abs(velocities).max()),
        strengths, samples, slips,
    )  # fmt: skip
    return Motion(
        position=samples[:, 0],
        velocity=samples[:, 1],
        effort=samples[:, 2],
        slips=slips[: min(count, len(slips))],
        last_rest=last_rest,
    )


def _on_a_spring(
    machine: Machine, gains: Gains, references: np.ndarray, velocities: np.ndarray, period: float
) -> Motion:
    friction = Friction(**{one.name: getattr(machine, one.name) for one in FRICTION_PARAMETERS})
    joint = Joint(inertia=machine.inertia, friction=friction, transmission=machine.transmission)
    simulation = JointSimulation(joint, gains)
    found = simulation.advance(period, references, velocities)
    begins, ends = found.events[::2], found.events[1::2]
    slips = [
        (begin.time, begin.position, begin.stribeck_level, end.time, end.position)
        for begin, end in zip(begins, ends, strict=False)
    ]
    at_first = float(gains.stiffness) * references[0] + float(gains.damping) * velocities[0]
    return Motion(
        position=np.concatenate([[0.0], found.position[:-1]]),
        velocity=np.concatenate([[0.0], found.velocity[:-1]]),
        effort=np.concatenate([[at_first], found.effort[:-1]]),
        slips=np.array(slips).reshape(-1, 5),
        last_rest=simulation.time if simulation.stuck else max((end.time for end in ends), default=0.0),
    )


def sticks(
    machine: Machine, gains: Gains, velocity: float, *, periods: float = 200.0, controller_period: float | None = None
) -> bool:
    """Whether stick-slip that begins at rest goes on at a steady speed [rad/s], or the joint runs away.

    It does if it rests in the last fifth.

    A cycle may take a hundred slips to die. So many natural periods are waited for, each with the time in which the
    spring draws the Stribeck friction twice.

    Parameters
    ----------
    controller_period : of a machine whose controller is sampled [s].
    """
    assert machine.sampled == (controller_period is not None)
    stiffness = float(gains.stiffness)
    natural_period = 2.0 * math.pi * math.sqrt(machine.inertia / stiffness)
    period = controller_period or natural_period / 200.0
    duration = periods * (natural_period + 2.0 * machine.stribeck / (stiffness * velocity))
    count = math.ceil(duration / period)
    references = drawn(machine, gains) + velocity * period * np.arange(count)
    motion = simulate(machine, gains, references, np.full(count, velocity), period)
    swings = np.abs(motion.velocity - velocity)
    earlier, later = (swings[int(share * count) : int((share + 0.2) * count)].max() for share in (0.4, 0.8))
    return motion.last_rest > 0.8 * count * period or bool(not later < _RUNS_AWAY * max(earlier, velocity))


def drawn(machine: Machine, gains: Gains) -> float:
    """A reference [rad] at which the joint at position 0 still rests, but not for long in positive direction."""
    here = machine.at(0.0)
    friction = (1.0 + machine.asymmetry) * here.coulomb + 0.3 * here.stribeck
    return (friction + here.load) / float(gains.stiffness)


def _longest_step(machine: Machine, gains: Gains) -> float:
    inertia = machine.inertia
    times = [
        _OF_SWING * math.sqrt(inertia / float(gains.stiffness)),
        _OF_FALL * inertia * machine.stribeck_velocity / machine.stribeck,
        _OF_DECAY * inertia / max(abs(float(gains.damping)) + machine.viscous, 1e-12),
    ]
    if machine.bristle_stiffness > 0.0:
        times.append(_OF_BRISTLE * math.sqrt(inertia / machine.bristle_stiffness))
    if machine.law != LUGRE and machine.lag > 0:
        times.append(_OF_LAG * machine.lag)
    return min(times)


@njit(cache=True)
def _share_left(law, ratio):
    """Ψ of a speed over the Stribeck velocity."""
    return 1.0 / (1.0 + ratio * ratio) if law == PAPER else math.exp(-ratio * ratio)


@njit(cache=True)
def _at(past, place):
    """Velocity at a place between two steps of the ring."""
    before = math.floor(place)
    share = place - before
    return (1.0 - share) * past[before % len(past)] + share * past[(before + 1) % len(past)]


@njit(cache=True)
def _place(x, coulomb, load, gravity, bend, load_share, ripple, stribeck_ripple, wave_number):
    """Load and Coulomb friction at a position [N·m], and the factor on the Stribeck friction there."""
    if gravity != 0.0:
        load += gravity * math.cos(bend * x)
    grown = 1.0 + load_share * abs(load) / coulomb
    wave = math.sin(wave_number * x) if wave_number != 0.0 else 0.0
    return load, grown * coulomb * (1.0 + ripple * wave), grown * (1.0 + stribeck_ripple * wave)


@njit(cache=True)
def _integrate(law, plant, control, sampled, references, velocities, period, steps, creep, strengths,
               samples, slips):  # fmt: skip
    inertia, coulomb, viscous, stribeck, stribeck_velocity, lag, rise_time = plant[:7]
    bristle_stiffness, bristle_damping, constant_load, asymmetry, ripple, wave_number, drift = plant[7:14]
    stribeck_ripple, gravity, load_share, bend, drag, more_forward = plant[14:]
    stiffness, damping, delay = control
    h = period / steps
    reach = lag / h
    past = np.zeros(int(reach) + 4)
    x = v = z = anchor = 0.0
    if bristle_stiffness > 0.0:
        # The contact carries what the controller begins with.
        anchor = (constant_load - stiffness * references[0] - damping * velocities[0]) / bristle_stiffness
        z = -anchor
    level, direction, resting = stribeck, 0.0, True
    breakaway, arrest, last_rest = 0.0, 0.0, 0.0
    held = before = 0.0
    begin_time = begin_position = begin_level = math.nan
    count = 0
    for i in range(len(references)):
        reference, speed = references[i], velocities[i]
        effort = stiffness * (reference - x) + damping * (speed - v)
        if sampled:
            before, held = held, effort
            effort = before if delay > 0.0 else held
        samples[i, 0], samples[i, 1], samples[i, 2] = x, v, effort
        for k in range(steps):
            number = i * steps + k
            t = number * h
            past[number % len(past)] = v
            remaining = h
            if law == LUGRE:
                x0, v0, z0 = x, v, z
                dx, dv, dz = 0.0, 0.0, 0.0
                for stage in range(2):
                    # The slope at the beginning leads to the middle, that of the middle to the end.
                    x, v, z = x0 + 0.5 * h * dx, v0 + 0.5 * h * dv, z0 + 0.5 * h * dz
                    s = (k + 0.5 * stage) * h
                    if sampled:
                        force = held if s >= delay else before
                    else:
                        force = stiffness * (reference + speed * s - x) + damping * (speed - v)
                    factor = 1.0 + drift * (t + 0.5 * h * stage)
                    side = 1.0 + asymmetry if v >= 0.0 else 1.0 - asymmetry
                    load, dry, rough = _place(x, coulomb, constant_load, gravity, bend, load_share, ripple,
                                              stribeck_ripple, wave_number)  # fmt: skip
                    steady = side * dry + rough * stribeck * _share_left(law, v / stribeck_velocity)
                    dx = v
                    dz = v - bristle_stiffness * abs(v) / steady * z
                    friction = bristle_stiffness * z + bristle_damping * dz + viscous * v
                    dv = (force - load - factor * friction) / inertia
                x, v, z = x0 + h * dx, v0 + h * dv, z0 + h * dz
                now = t + h
                if resting:
                    last_rest = now
                    if abs(v) > _MOVES * creep:
                        resting = False
                        begin_time, begin_position, begin_level = now, x, math.nan
                elif abs(v) < creep:
                    resting = True
                    if count < len(slips):
                        slips[count] = (begin_time, begin_position, begin_level, now, x)
                    count += 1
                continue
            if direction == 0.0 and bristle_stiffness > 0.0:
                # An elastic contact: it yields until what is on it is more than friction holds.
                last_rest = t
                x0, v0 = x, v
                dx, dv = 0.0, 0.0
                for stage in range(2):
                    x, v = x0 + 0.5 * h * dx, v0 + 0.5 * h * dv
                    s = (k + 0.5 * stage) * h
                    if sampled:
                        force = held if s >= delay else before
                    else:
                        force = stiffness * (reference + speed * s - x) + damping * (speed - v)
                    contact = bristle_stiffness * (x - anchor) + bristle_damping * v
                    dx, dv = v, (force - constant_load - contact) / inertia
                x, v = x0 + h * dx, v0 + h * dv
                contact = bristle_stiffness * (x - anchor)
                sign = 1.0 if contact >= 0.0 else -1.0
                dwell = max(t + h - arrest, 0.0)
                now_level = level + (stribeck - level) * (dwell / (dwell + rise_time) if rise_time > 0.0 else 1.0)
                if abs(contact) > coulomb + now_level:
                    level, direction, breakaway = now_level, sign, t + h
                    begin_time, begin_position, begin_level = breakaway, x, level
                continue
            if direction == 0.0:
                # Force and level at both ends of the step, and where they meet.
                last_rest = t
                excess = 0.0
                found = -1.0
                load, dry, rough = _place(x, coulomb, constant_load, gravity, bend, load_share, ripple,
                                          stribeck_ripple, wave_number)  # fmt: skip
                for end in range(2):
                    s, now = (k + end) * h, t + end * h
                    if sampled:
                        force = held if k * h >= delay else before
                    else:
                        force = stiffness * (reference + speed * s - x) + damping * speed
                    force -= load
                    sign = 1.0 if force >= 0.0 else -1.0
                    dwell = max(now - arrest, 0.0)
                    risen = dwell / (dwell + rise_time) if rise_time > 0.0 else 1.0
                    now_level = level + (stribeck - level) * risen
                    most = rough * (1.0 + sign * more_forward) * now_level * strengths[count]
                    held_by = (1.0 + sign * asymmetry) * dry + most
                    after = abs(force) - (1.0 + drift * now) * held_by
                    if end == 0 and after > 0.0:
                        found = 0.0
                        break
                    if end == 1 and after > 0.0:
                        found = excess / (excess - after)
                    excess = after
                if found < 0.0:
                    continue
                breakaway = t + found * h
                dwell = max(breakaway - arrest, 0.0)
                level += (stribeck - level) * (dwell / (dwell + rise_time) if rise_time > 0.0 else 1.0)
                direction = sign
                begin_time, begin_position, begin_level = breakaway, x, level * strengths[count]
                remaining = (1.0 - found) * h
            # The midpoint rule over what remains of the step.
            start = h - remaining
            x0, v0 = x, v
            dx, dv = 0.0, 0.0
            for stage in range(2):
                x, v = x0 + 0.5 * remaining * dx, v0 + 0.5 * remaining * dv
                s = start + 0.5 * remaining * stage
                now = t + s
                if sampled:
                    force = held if (k * h + s) >= delay else before
                else:
                    force = stiffness * (reference + speed * (k * h + s) - x) + damping * (speed - v)
                if lag == 0.0:
                    share = _share_left(law, v / stribeck_velocity)
                elif now - breakaway <= lag:
                    share = 1.0
                else:
                    share = _share_left(law, _at(past, number + s / h - reach) / stribeck_velocity)
                load, dry, rough = _place(x, coulomb, constant_load, gravity, bend, load_share, ripple,
                                          stribeck_ripple, wave_number)  # fmt: skip
                rough *= 1.0 + direction * more_forward
                friction = direction * ((1.0 + direction * asymmetry) * dry + rough * begin_level * share)
                friction += (viscous + drag * abs(v)) * v
                dx, dv = v, (force - load - (1.0 + drift * now) * friction) / inertia
            x, v = x0 + remaining * dx, v0 + remaining * dv
            if v * direction < 0.0:
                # It stopped on the way, at a deceleration that is constant as far as can be seen.
                part = v0 / (v0 - v) * remaining if v0 * direction > 0.0 else 0.0
                x = x0 + 0.5 * v0 * part
                v = 0.0
                if bristle_stiffness > 0.0:
                    anchor = x - friction / bristle_stiffness
                arrest = t + start + part
                if lag > 0.0 and arrest - breakaway > lag:
                    level *= _share_left(law, _at(past, number + (start + part) / h - reach) / stribeck_velocity)
                direction = 0.0
                last_rest = arrest
                if count < len(slips):
                    slips[count] = (begin_time, begin_position, begin_level, arrest, x)
                count += 1
    return count, last_rest
