# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the place of a slip makes of its forces: a load that varies with position, and friction that varies with either.

Both act on a slip like springs beside the controller's. They are taken off along the way that was observed, whatever
the slip's length; what is left are slips that are alike, but for their Stribeck friction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.monitoring.friction.dry_friction import DryFriction
from stickslip_ros.monitoring.friction.slip_windows import SlipWindow
from stickslip_ros.monitoring.samples import FloatArray


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """By what a joint's forces vary from place to place.

    Attributes
    ----------
    dry : has the load over position, the Coulomb friction's slope over it, and the ripple. without : what else is said
        of slips from which this is not taken off: what does not fit.
    """

    dry: DryFriction
    without: str

    def coulomb(self, position: FloatArray) -> FloatArray:
        """Coulomb friction at positions [rad] that is not everywhere, shape (n,) [N·m]."""
        dry = self.dry
        slope = dry.load_dependence.value if dry.load_dependence is not None else 0.0
        varying = slope * np.abs(dry.load_at(position))
        return np.asarray(varying + dry.ripple.at(position) if dry.ripple is not None else varying)

    def kinetic(self, position: FloatArray, direction: int) -> FloatArray:
        """What moves in a direction meets at positions [rad] more than everywhere: load and friction [N·m]."""
        mean = self.dry.load.value if self.dry.load is not None else 0.0
        return np.asarray(direction * (self.dry.load_at(position) - mean) + self.coulomb(position))

    def taken_off(self, window: SlipWindow) -> float:
        """What is taken off the force that held the joint before a slip [N·m]."""
        return float(self.kinetic(np.array([window.rest_position]), window.direction)[0])

    def applied(self, window: SlipWindow) -> SlipWindow:
        """The slip's forces without these: as they would have been where nothing varies."""
        way = np.interp(window.times, window.times[window.observed], window.values, left=window.rest_position)
        return replace(window, forces=window.forces - window.direction * self.kinetic(way, window.direction))

    @property
    def with_load(self) -> bool:
        """Whether what friction may grow with is the load alone."""
        return self.dry.ripple is None and bool(self.dry.load_curve)

    def growth(self, position: FloatArray, *, falls: bool = False) -> FloatArray:
        """What friction may grow with, from -1 where it would be least to 0 where it would be largest, shape (n,).

        The Coulomb friction that varies, or the size of the load where that varies alone; zeros where nothing does.
        ``falls`` : friction is the largest where that is least.
        """
        places = np.append(position, self.dry.position)
        grows = self.coulomb(places)
        if self.dry.ripple is None and self.dry.load_dependence is None:
            grows = np.abs(self.dry.load_at(places))
        if falls:
            grows = -grows
        own = grows[len(position) :]
        extent = float(np.ptp(own))
        # What was not seen is not guessed: no friction is less or more than at the slips.
        return np.clip((grows[: len(position)] - own.max()) / extent, -1.0, 0.0) if extent > 0 else 0.0 * position


@dataclass(frozen=True, kw_only=True)
class Growth:
    """Stribeck friction that varies with place or load, as far as slips show it.

    Attributes
    ----------
    surroundings : what it goes with. falls : whether it falls with that.
    share : by which Stribeck friction is less at the best place than at the worst, and its standard error ``std``.
    coulomb : by how much Coulomb friction is [N·m], and its standard error ``coulomb_std``.
    """

    surroundings: Surroundings
    falls: bool
    share: float
    std: float
    coulomb: float
    coulomb_std: float

    def factor(self, position: float) -> float:
        """Stribeck friction at a position [rad] over that at the worst place seen."""
        return 1.0 + self.share * float(self.surroundings.growth(np.array([position]), falls=self.falls)[0])

    def applied(self, window: SlipWindow) -> SlipWindow:
        """A slip's forces as they would have been where nothing but the Stribeck friction varies, and Coulomb friction
        is that of the worst place.
        """
        here = self.surroundings.growth(np.array([window.rest_position]), falls=self.falls)
        less = window.direction * self.coulomb * float(here[0])
        window = self.surroundings.applied(window)
        return replace(window, forces=window.forces - less)

    def load_at(self, position: float) -> float:
        """Load at a position [N·m]."""
        return float(self.surroundings.dry.load_at(np.array([position]))[0])

    @property
    def loads(self) -> tuple[float, float]:
        """The least and the largest size of the load at the slips [N·m]."""
        sizes = np.abs(self.surroundings.dry.load_at(self.surroundings.dry.position))
        return float(sizes.min()), float(sizes.max())

    def over_load(self, stribeck: float) -> tuple[float, float]:
        """Slope of the Stribeck friction over the load [1] and its standard error; NaN where it varies with position.

        Parameters
        ----------
        stribeck : at the worst place [N·m].
        """
        least, largest = self.loads
        if not self.surroundings.with_load or not largest > least:
            return math.nan, math.nan
        slope = (-1.0 if self.falls else 1.0) * stribeck / (largest - least)
        return slope * self.share, abs(slope) * self.std

    @property
    def text(self) -> str:
        """In words what varies, and which place is meant."""
        size = f"Stribeck friction varies by {100.0 * self.share:.2g} ± {100.0 * self.std:.1g} %"
        if self.surroundings.with_load:
            way = "least" if self.falls else "largest"
            return f"{size} with the load; as at the {way} load seen, {self.loads[not self.falls]:.3g} N·m"
        return f"{size} with position; as at the worst place seen, {self.worst_position:.3g} rad"

    @property
    def worst_position(self) -> float:
        """Where among the slips it is largest [rad]."""
        positions = self.surroundings.dry.position
        return float(positions[np.argmax(self.surroundings.growth(positions, falls=self.falls))])
