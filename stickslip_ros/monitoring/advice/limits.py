# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What advice must reach, what it must keep within, and what that leaves of the damping at a given stiffness."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, NamedTuple, TypeVar

import numpy as np

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model._validation import require_not_negative, require_positive
from stickslip_ros.model.bounds import TINY
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.units import unit_of
from stickslip_ros.monitoring.advice.resonance import damping_limits
from stickslip_ros.monitoring.samples import FloatArray

Value = TypeVar("Value")

_ANY = (0.0, math.inf)  # range of a gain without bounds
_SAMPLES_TO_WATCH = 8.0  # samples a natural period: with fewer, rests and slips cannot be distinguished
# Phase at the crossover frequency that a delay may take [rad]: up to there the damping -k_p τ_d, which is the first
# order of a delay, is right to 5 %; the same phase as that of 20 controller periods in each of the crossover's.
_DELAY_PHASE = 2.0 * math.pi / 20.0
# Largest root mean square of the torque that noise of position, or of velocity, makes, of the breakaway torque: with
# more, noise shakes the joint as friction does.
_NOISE_SHARE = 0.1


class Criterion(str, Enum):
    """Which condition for smooth motion advice is to satisfy."""

    PAPER = "paper"
    EXACT = "exact"


def criterion_for(joint: Joint, condition: Criterion) -> Criterion:
    """The condition that can be answered of a joint: the exact one where Eq. (43) is not of that joint."""
    return condition if joint.friction.of_the_paper and joint.transmission is None else Criterion.EXACT


@dataclass(frozen=True, kw_only=True)
class AdviceLimits:
    """What advice must reach and keep within.

    Attributes
    ----------
    wanted_margin : by how much the damping ratio shall exceed the critical one, e.g. 0.2 for 20 %.
    confidence : probability with which it shall, where the joint is known with errors only.
    condition : the critical damping ratio of Eq. (43), or the exact one; see :func:`criterion_for`.
    steady_sliding : whether a joint that does not stick shall not swing about its speed either, from whatever start;
        see :mod:`stickslip_ros.model.outcome`.
    slowest_velocity : the joint shall be smooth from this speed on [rad/s]; None: at the commanded speed.
    stiffness_range, damping_range : least and largest gain [N·m/rad], [N·m·s/rad].
    damping_ratio_range : least and largest damping ratio ρ. With less than a tenth a joint that does not stick rings
        for many periods after every disturbance, and all but stops in each.
    bandwidth : largest crossover frequency of the position loop [rad/s]; infinite: the resonance, where the
        joint has one, or the frequency at which it rings after its slips, unless the present gains have more.
    samples_per_period : the controller shall act so often in a period of the crossover frequency.
    effort : largest |effort| that position and velocity error of now may ask for [N·m].

    Raises
    ------
    InvalidParameterError
        If the margin is negative, the confidence not in [0.5, 1), a range is not 0 <= least <= largest with a finite
        least, or another limit is not > 0.
    """

    wanted_margin: float = 0.2
    confidence: float = 0.9
    condition: Criterion = Criterion.EXACT
    steady_sliding: bool = True
    slowest_velocity: float | None = field(default=None, metadata={"unit": "rad/s"})
    stiffness_range: tuple[float, float] = field(default=_ANY, metadata={"unit": "N·m/rad"})
    damping_range: tuple[float, float] = field(default=_ANY, metadata={"unit": "N·m·s/rad"})
    damping_ratio_range: tuple[float, float] = field(default=(0.1, math.inf), metadata={"unit": "1"})
    bandwidth: float = field(default=math.inf, metadata={"unit": "rad/s"})
    samples_per_period: float = 20.0
    effort: float = field(default=math.inf, metadata={"unit": "N·m"})

    def __post_init__(self) -> None:
        require_not_negative("wanted_margin", self.wanted_margin)
        if not 0.5 <= self.confidence < 1.0:
            raise InvalidParameterError("confidence", ">= 0.5 and < 1", self.confidence)
        if self.condition not in list(Criterion):
            raise InvalidParameterError("condition", "paper or exact", self.condition)
        if self.slowest_velocity is not None:
            require_positive("slowest_velocity", self.slowest_velocity)
        for name in ("stiffness_range", "damping_range", "damping_ratio_range"):
            least, largest = getattr(self, name)
            if not (0 <= least <= largest and least < math.inf):
                raise InvalidParameterError(
                    name, "least and largest, with 0 <= least <= largest and the least finite", (least, largest)
                )
        require_positive("samples_per_period", self.samples_per_period)
        for name in ("bandwidth", "effort"):
            if not getattr(self, name) > 0:
                raise InvalidParameterError(name, "> 0", getattr(self, name))

    def per_inertia(self) -> AdviceLimits:
        """The limits that still mean something where gains are known per inertia only: frequencies and ratios."""
        return replace(self, stiffness_range=_ANY, damping_range=_ANY, effort=math.inf)


class LimitOption(NamedTuple):
    """A limit that users set, by an option of commands or a parameter of the node.

    ``name`` is the option's, with underscores; ``parameter`` the last word of the node's parameter; ``field`` that of
    :class:`AdviceLimits`, of which it is one end, 0 or 1, where the field is a range.
    """

    name: str
    parameter: str
    help: str
    field: str
    end: int | None = None

    @property
    def unit(self) -> str:
        """Unit of the limit."""
        return unit_of(AdviceLimits, self.field)

    @property
    def default(self) -> float:
        """Value where users give none."""
        value = getattr(AdviceLimits(), self.field)
        return float(value if self.end is None else value[self.end])


LIMIT_OPTIONS = (
    LimitOption("least_stiffness", "p_min", "least stiffness k_p to advise", "stiffness_range", 0),
    LimitOption("largest_stiffness", "p_max", "largest stiffness k_p to advise", "stiffness_range", 1),
    LimitOption("least_damping", "d_min", "least damping k_v to advise", "damping_range", 0),
    LimitOption("largest_damping", "d_max", "largest damping k_v to advise", "damping_range", 1),
    LimitOption("least_damping_ratio", "damping_ratio_min", "least damping ratio to advise", "damping_ratio_range", 0),
    LimitOption(
        "largest_damping_ratio", "damping_ratio_max", "largest damping ratio to advise", "damping_ratio_range", 1
    ),
    LimitOption(
        "bandwidth",
        "bandwidth",
        "largest crossover frequency of the position loop (default: the resonance, if the joint has one or rings)",
        "bandwidth",
    ),
    LimitOption("effort", "effort", "largest effort allowed at the present tracking error", "effort"),
)


def by_field(value_of: Callable[[LimitOption], Value]) -> dict[str, tuple[Value, ...]]:
    """What each field of :class:`AdviceLimits` that users limit is made of: one value, or the ends of a range."""
    found: dict[str, tuple[Value, ...]] = {}
    for one in LIMIT_OPTIONS:
        found[one.field] = (*found.get(one.field, ()), value_of(one))
    return found


def limits_from(value_of: Callable[[LimitOption], float]) -> dict[str, Any]:
    """Arguments of :class:`AdviceLimits` for what users limit."""
    return {name: values if len(values) > 1 else values[0] for name, values in by_field(value_of).items()}


@dataclass(frozen=True, kw_only=True)
class ObservedLoop:
    """What else decides which gains can be used.

    Attributes
    ----------
    conditions : load and sampled control; the controller's period is 0 if it is not known.
    sample_rate : of the joint states [Hz], NaN if unknown; without a controller's period it stands for its rate.
    crossover : crossover frequency of the loop with the present gains [rad/s]: one that is too fast for a controller
        of the sample rate shows that it has another. 0 where the sample rate is given as the controller's.
    tracking_error, velocity_error : largest |x_d − x| [rad] and |x˙_d − x˙| [rad/s] of now, NaN if unknown.
    position_noise, velocity_noise : standard deviations [rad], [rad/s] of the noise of the measured position, with its
        quantisation, and velocity; 0 if unknown.
    ring : at which the joint rings after its slips [Hz], NaN if it is not seen to.
    """

    conditions: OperatingConditions = field(default_factory=OperatingConditions)
    sample_rate: float = field(default=math.nan, metadata={"unit": "Hz"})
    crossover: float = field(default=0.0, metadata={"unit": "rad/s"})
    tracking_error: float = field(default=math.nan, metadata={"unit": "rad"})
    velocity_error: float = field(default=math.nan, metadata={"unit": "rad/s"})
    position_noise: float = field(default=0.0, metadata={"unit": "rad"})
    velocity_noise: float = field(default=0.0, metadata={"unit": "rad/s"})
    ring: float = field(default=math.nan, metadata={"unit": "Hz"})


@dataclass(frozen=True, kw_only=True)
class Bound:
    """One limit: at each stiffness, the least and the largest damping k_v [N·m·s/rad] that it allows.

    Where it allows none, the least is infinite.
    """

    text: str
    least: FloatArray
    largest: FloatArray


def largest_bandwidth(limits: AdviceLimits, loop: ObservedLoop) -> float:
    """Largest crossover frequency [rad/s] that limits, controller and samples allow."""
    period, rate = loop.conditions.controller_period, loop.sample_rate
    bandwidth = limits.bandwidth
    if period > 0:
        bandwidth = min(bandwidth, 2.0 * math.pi / (limits.samples_per_period * period))
    its_own = period > 0 or loop.crossover > 2.0 * math.pi * rate / limits.samples_per_period
    needed = _SAMPLES_TO_WATCH if its_own else limits.samples_per_period
    return min(bandwidth, 2.0 * math.pi * rate / needed) if rate > 0 else bandwidth


def crossover_frequency(joint: Joint, gains: Gains) -> float:
    """Crossover frequency ω [rad/s] of the position loop: |k_p + i k_v ω| = |−M ω² + i F_v ω|; scalars."""
    inertia, stiffness = float(joint.inertia), float(gains.stiffness)
    more = float(gains.damping) ** 2 - float(joint.friction.viscous) ** 2
    return math.sqrt((more + math.hypot(more, 2.0 * inertia * stiffness)) / 2.0) / inertia


def bounds_at(
    stiffness: FloatArray, joint: Joint, present: Gains, limits: AdviceLimits, loop: ObservedLoop
) -> dict[str, Bound]:
    """Every limit that binds anything, by name, at stiffnesses k_p [N·m/rad] of shape (n,); joint, gains of scalars."""
    inertia, own = float(joint.inertia), joint.own_damping(stiffness)
    critical = 2.0 * np.sqrt(stiffness * inertia)
    bounds: dict[str, Bound] = {}

    def add(
        name: str, text: str, *, least: FloatArray | float = -math.inf, largest: FloatArray | float = math.inf
    ) -> None:
        bounds[name] = Bound(
            text=text,
            least=np.broadcast_to(np.asarray(least, dtype=float), stiffness.shape),
            largest=np.broadcast_to(np.asarray(largest, dtype=float), stiffness.shape),
        )

    low, high = limits.stiffness_range
    if low > 0:
        add("least stiffness", f"{low:.4g} N·m/rad", least=np.where(stiffness < low, math.inf, -math.inf))
    if high < math.inf:
        add("largest stiffness", f"{high:.4g} N·m/rad", least=np.where(stiffness > high, math.inf, -math.inf))
    low, high = limits.damping_range
    add("least damping", f"{low:.4g} N·m·s/rad", least=low)
    if high < math.inf:
        add("largest damping", f"{high:.4g} N·m·s/rad", largest=high)
    low, high = limits.damping_ratio_range
    if low > 0:
        add("least damping ratio", f"{low:.4g}", least=low * critical - own)
    if high < math.inf:
        add("largest damping ratio", f"{high:.4g}", largest=high * critical - own)
    bandwidth, delay = largest_bandwidth(limits, loop), float(joint.actuation_delay)
    # What the present gains take of the phase, or make of the noise, is borne.
    borne = crossover_frequency(joint, present)
    within_delay = max(_DELAY_PHASE / delay, borne) if delay > 0 else math.inf
    # Beyond it the motor leaves the load behind.
    swings, seen = (loop.ring, "ring") if joint.transmission is None else (joint.transmission.resonance, "resonance")
    below = max(2.0 * math.pi * swings, borne) if swings > 0.0 and math.isinf(limits.bandwidth) else math.inf
    if min(bandwidth, within_delay, below) < math.inf:
        source = ", of the controller's period and the samples"
        if within_delay < min(bandwidth, below):
            bandwidth, source = within_delay, f", of a delay of {1e3 * delay:.3g} ms"
        elif below < bandwidth:
            bandwidth, source = below, f", of the {seen} at {swings:.4g} Hz"
        elif bandwidth == limits.bandwidth:
            source = ""
        elif not loop.conditions.period > 0:
            source = f", of samples at {loop.sample_rate:.4g} Hz, for the controller's period is not given"
        # |k_p + i k_v ω| <= |−M ω² + i F_v ω| at the largest crossover frequency ω; a delay changes the phase alone.
        squared = (inertia * bandwidth) ** 2 + float(joint.friction.viscous) ** 2 - (stiffness / bandwidth) ** 2
        add(
            "bandwidth",
            f"{bandwidth:.4g} rad/s{source}",
            least=np.where(squared < 0, math.inf, -math.inf),
            largest=np.sqrt(np.maximum(squared, 0.0)),
        )
    resonant = damping_limits(joint, loop.conditions)
    if resonant is not None:
        least, largest = resonant.at(stiffness)
        add("resonance", resonant.in_words(present), least=least, largest=largest)
    if limits.effort < math.inf and loop.tracking_error > 0:
        left = limits.effort - stiffness * loop.tracking_error
        error = loop.velocity_error if loop.velocity_error > TINY else TINY
        add(
            "effort",
            f"{limits.effort:.4g} N·m at an error of {loop.tracking_error:.3g} rad",
            least=np.where(left < 0, math.inf, -math.inf),
            largest=np.maximum(left, 0.0) / error,
        )
    if float(joint.friction.coulomb) > 0 and (loop.position_noise > 0 or loop.velocity_noise > 0):
        torque = _NOISE_SHARE * float(joint.friction.coulomb + joint.friction.stribeck)
        noises = np.array([loop.position_noise, loop.velocity_noise])
        with np.errstate(divide="ignore"):
            most_stiffness, most_damping = np.maximum(
                torque / noises, [float(present.stiffness), float(present.damping)]
            )
        add(
            "noise",
            f"of {loop.position_noise:.2g} rad and {loop.velocity_noise:.2g} rad/s, of which the gains would make "
            f"{100 * _NOISE_SHARE:.0f} % of the breakaway torque",
            least=np.where(stiffness > most_stiffness, math.inf, -math.inf),
            largest=most_damping,
        )
    return bounds
