# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Everything that one recording says of a joint's friction: from its slips, and from its sliding."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model._friction_law import PAPERS_LAW
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.friction.estimate import NAMES, FrictionEstimate, ParameterEstimate
from stickslip_ros.monitoring.friction.estimation import estimate_friction
from stickslip_ros.monitoring.friction.presliding import PreslidingEstimate
from stickslip_ros.monitoring.friction.sliding import SlidingFriction, sliding_friction
from stickslip_ros.monitoring.friction.slip_windows import slip_window
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

_FROM_SLIDING = ("coulomb", "viscous", "stribeck", "stribeck_velocity")


@dataclass(frozen=True, kw_only=True)
class Identification:
    """What a recording says.

    Attributes
    ----------
    slips : estimate from slips, None if there were too few. sliding : the curve of friction, None if the effort
        is unknown or the joint hardly slid.
    cycles : stick-slip cycles that were found. speed : usual speed of the motion, its median over time [rad/s].
    resolution : of the position [rad]. gains : in force, None if unknown.
    state : of the joint at the end, which has what is wrong with the samples.
    """

    slips: FrictionEstimate | None
    sliding: SlidingFriction | None
    cycles: tuple[Cycle, ...]
    speed: float
    resolution: float
    gains: Gains | None
    state: Assessment

    @property
    def presliding(self) -> PreslidingEstimate | None:
        """How it gives way at rest, None of too few rests."""
        return self.state.presliding

    @property
    def per_inertia(self) -> bool:
        """Whether inertia and forces are not known, only their ratios."""
        return self.slips is not None and self.slips.normalised and self.gains is None

    def parameters(self) -> dict[str, tuple[ParameterEstimate, str]]:
        """Each parameter that is known, and from what: "slips" or "sliding"; what is identified first."""
        found: dict[str, tuple[ParameterEstimate, str]] = {}
        slips = self.slips
        if slips is not None and slips.normalised and self.gains is not None:
            slips = slips.with_stiffness(float(self.gains.stiffness), float(self.gains.damping))
        if slips is not None:
            found = {name: (slips[name], "slips") for name in slips.names if math.isfinite(slips[name].value)}
        if self.per_inertia:
            del found["inertia"]
        elif self.sliding is not None:
            for name in _FROM_SLIDING:
                known = found.get(name)
                value = self.sliding.estimate(name)
                if known is None or (value.identified and not known[0].identified):
                    found[name] = (value, "sliding")
        return found

    def joint(self, prior: Joint | None = None) -> Joint:
        """A joint of all that is known, the rest from a prior.

        Raises
        ------
        InvalidParameterError
            If inertia, Stribeck friction or velocity are known from neither; the message says what would show them.
        """
        known = self.parameters()
        values = {
            name: estimate.value
            for name, (estimate, _) in known.items()
            if not (self.per_inertia and name in ("stribeck", "viscous"))
        }
        if prior is not None:
            from_prior = {"inertia": prior.inertia} | {name: getattr(prior.friction, name) for name in NAMES[1:]}
            values = {name: float(value) for name, value in from_prior.items()} | values
        for name in ("inertia", "stribeck", "stribeck_velocity"):
            if name not in values:
                raise InvalidParameterError(
                    name, "shown by the motion (slips with known gains or effort show it), or given by --model", None
                )
        inertia = values.pop("inertia")
        numbers = {name: max(value, 0.0) for name, value in values.items()}
        # A Stribeck velocity is of the law it was fitted with: what sliding shows, and a prior, are of the paper's.
        of_slips = known.get("stribeck_velocity", (None, ""))[1] == "slips"
        friction = Friction(
            stribeck=numbers["stribeck"],
            stribeck_velocity=numbers["stribeck_velocity"],
            law=self.slips.law if of_slips and self.slips is not None else PAPERS_LAW,
        )
        transmission = None if prior is None else prior.transmission
        joint = Joint(inertia=inertia, friction=friction.changed(numbers), transmission=transmission)
        contact = None if self.slips is None else self.slips.contact
        return joint if contact is None else contact.applied_to(joint)


def identify(batch: Batch, gains: Gains | None, prior: Joint | None = None) -> Identification:
    """Identify a joint from a recording; takes seconds.

    Parameters
    ----------
    batch : samples in order of time. gains : of the controller, None if unknown. prior : of the paper's law, which
        is what is fitted.

    Raises
    ------
    InvalidParameterError
        If the prior is of another law.
    """
    if prior is not None and not prior.friction.of_the_paper:
        needed = f"a joint of the law that is fitted, {PAPERS_LAW}"
        raise InvalidParameterError("prior", needed, prior.friction.law_in_words)
    monitor = JointMonitor(prior, gains)
    cycles = monitor.process(batch) + monitor.finish()
    batch = batch.usable()
    state = monitor.assessment()
    windows = [
        slip_window(batch, cycle, gains, resolution=state.resolution, noise=state.noise)
        for cycle in cycles
        if not cycle.hunting
    ]
    speeds = sorted((abs(one.velocity), one.end - one.start) for one in monitor.segments if one.velocity)
    return Identification(
        slips=estimate_friction([window for window in windows if window is not None], prior),
        sliding=sliding_friction(batch, resolution=state.resolution, inertia=None),
        cycles=tuple(cycles),
        speed=_median_over_time(speeds),
        resolution=state.resolution,
        gains=gains,
        state=state,
    )


def _median_over_time(speeds: list[tuple[float, float]]) -> float:
    """Median of speeds, in their order, each with how long it lasted [s]; NaN of none."""
    if not speeds:
        return math.nan
    values, lengths = np.array(speeds).T
    return float(values[np.searchsorted(np.cumsum(lengths), 0.5 * lengths.sum())])
