# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Position-dependent disturbance: a load that varies with position, and friction that varies with position or load.

Both act on a slip like springs beside the controller's. They are subtracted along the observed path, whatever the
slip's length; the slips without them differ only in their Stribeck friction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from stickslip_ros.monitoring.friction.dry_friction import DryFriction
from stickslip_ros.monitoring.friction.slip_windows import SlipWindow
from stickslip_ros.monitoring.samples import FloatArray


@dataclass(frozen=True, kw_only=True)
class PositionDisturbance:
    """Position-dependent disturbance of a joint.

    Attributes
    ----------
    dry : load over position, slope of the Coulomb friction over the load, and ripple. without : what does not fit where
        the disturbance is not subtracted, for a person.
    """

    dry: DryFriction
    without: str

    def coulomb(self, position: FloatArray) -> FloatArray:
        """Position-dependent part of the Coulomb friction at positions [rad], shape (n,) [N·m]."""
        dry = self.dry
        slope = dry.load_dependence.value if dry.load_dependence is not None else 0.0
        varying = slope * np.abs(dry.load_at(position))
        return np.asarray(varying + dry.ripple.at(position) if dry.ripple is not None else varying)

    def kinetic(self, position: FloatArray, direction: int) -> FloatArray:
        """Position-dependent part of load and friction against motion in a direction, at positions [rad] [N·m]."""
        mean = self.dry.load.value if self.dry.load is not None else 0.0
        return np.asarray(direction * (self.dry.load_at(position) - mean) + self.coulomb(position))

    def subtracted_force(self, window: SlipWindow) -> float:
        """Force subtracted from the one that held the joint before a slip [N·m]."""
        return float(self.kinetic(np.array([window.rest_position]), window.direction)[0])

    def applied(self, window: SlipWindow) -> SlipWindow:
        """The slip with forces from which the disturbance is subtracted."""
        way = np.interp(window.times, window.times[window.observed], window.values, left=window.rest_position)
        return replace(window, forces=window.forces - window.direction * self.kinetic(way, window.direction))

    @property
    def with_load(self) -> bool:
        """Whether the covariate is the load alone."""
        return self.dry.ripple is None and bool(self.dry.load_curve)

    def covariate(self, position: FloatArray, *, decreasing: bool = False) -> FloatArray:
        """Regressor that scales friction, from -1 where friction is least to 0 where it is largest, shape (n,).

        The Coulomb friction that varies, or the size of the load where that varies alone; zeros where nothing does, and
        where motion in one direction does not show how large the load is.
        ``decreasing`` : friction is the largest where that is least.
        """
        places = np.append(position, self.dry.position)
        grows = self.coulomb(places)
        if self.dry.ripple is None and self.dry.load_dependence is None and self.dry.load is not None:
            grows = np.abs(self.dry.load_at(places))
        if decreasing:
            grows = -grows
        own = grows[len(position) :]
        extent = float(np.ptp(own))
        # What was not seen is not guessed: no friction is less or more than at the slips.
        return np.clip((grows[: len(position)] - own.max()) / extent, -1.0, 0.0) if extent > 0 else 0.0 * position


@dataclass(frozen=True, kw_only=True)
class FrictionFactor:
    """Position- or load-dependent factor of the Stribeck friction.

    Attributes
    ----------
    position_disturbance : disturbance that has the covariate. decreasing : whether friction falls where that grows.
    share, std : relative difference of the Stribeck friction between best and worst place, and its standard error.
    coulomb, coulomb_std : difference of the Coulomb friction between them, and its standard error [N·m].
    """

    position_disturbance: PositionDisturbance = field(metadata={"key": "surroundings"})
    decreasing: bool = field(metadata={"key": "falls"})
    share: float
    std: float
    coulomb: float
    coulomb_std: float

    def factor(self, position: float) -> float:
        """Stribeck friction at a position [rad] over that at the worst place seen."""
        return 1.0 + self.share * float(
            self.position_disturbance.covariate(np.array([position]), decreasing=self.decreasing)[0]
        )

    def applied(self, window: SlipWindow) -> SlipWindow:
        """The slip without the disturbance, and with the Coulomb friction of the worst place."""
        here = self.position_disturbance.covariate(np.array([window.rest_position]), decreasing=self.decreasing)
        less = window.direction * self.coulomb * float(here[0])
        window = self.position_disturbance.applied(window)
        return replace(window, forces=window.forces - less)

    def load_at(self, position: float) -> float:
        """Load at a position [N·m]."""
        return float(self.position_disturbance.dry.load_at(np.array([position]))[0])

    @property
    def loads(self) -> tuple[float, float]:
        """The least and the largest size of the load at the slips [N·m]."""
        sizes = np.abs(self.position_disturbance.dry.load_at(self.position_disturbance.dry.position))
        return float(sizes.min()), float(sizes.max())

    def over_load(self, stribeck: float) -> tuple[float, float]:
        """Slope of the Stribeck friction over the load [1] and its standard error; NaN where it varies with position.

        Parameters
        ----------
        stribeck : at the worst place [N·m].
        """
        least, largest = self.loads
        if not self.position_disturbance.with_load or not largest > least:
            return math.nan, math.nan
        slope = (-1.0 if self.decreasing else 1.0) * stribeck / (largest - least)
        return slope * self.share, abs(slope) * self.std

    @property
    def text(self) -> str:
        """In words what varies, and which place is meant."""
        size = f"Stribeck friction varies by {100.0 * self.share:.2g} ± {100.0 * self.std:.1g} %"
        if self.position_disturbance.with_load:
            way = "least" if self.decreasing else "largest"
            return f"{size} with the load; as at the {way} load seen, {self.loads[not self.decreasing]:.3g} N·m"
        return f"{size} with position; as at the worst place seen, {self.worst_position:.3g} rad"

    @property
    def worst_position(self) -> float:
        """Where among the slips it is largest [rad]."""
        positions = self.position_disturbance.dry.position
        return float(positions[np.argmax(self.position_disturbance.covariate(positions, decreasing=self.decreasing))])
