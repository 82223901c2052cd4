# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Motor and load on a spring, as a harmonic drive or a belt is one; the friction is at the motor.

    M_m x¨ = u − k_s (x − y) − d_s (x˙ − y˙) − friction,    M_l y¨ = k_s (x − y) + d_s (x˙ − y˙)

with x of the motor and y of the load, M_m + M_l = M, all on the same side of the gear. Two frequencies that a frequency
response shows are enough: M_m = M (f_a/f_r)², and k_s = M_l (2π f_a)².
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model._validation import require_finite, require_not_negative, require_positive

SIDES = ("motor", "load")  # of the spring, on which an encoder may be; the first by default


@dataclass(frozen=True, kw_only=True)
class Transmission:
    """The spring between motor and load.

    Attributes
    ----------
    resonance : f_r [Hz], at which motor and load swing against each other, both free.
    antiresonance : f_a [Hz], at which the load swings while the motor is held.
    spring_damping : damping ratio of that swing [1]. Steel structures have 0.01 to 0.02 (A. Preumont, Vibration Control
        of Active Structures, chapter 2).
    encoder : the side of the spring that the controller measures, "motor" or "load".

    Raises
    ------
    InvalidParameterError
        If not resonance > antiresonance > 0, or the damping is not finite or negative, or there is no such side.
    """

    resonance: float = field(metadata={"unit": "Hz"})
    antiresonance: float = field(metadata={"unit": "Hz"})
    spring_damping: float = field(default=0.02, metadata={"unit": "1"})
    encoder: str = SIDES[0]

    def __post_init__(self) -> None:
        require_positive("antiresonance", self.antiresonance)
        require_finite("resonance", self.resonance)
        if not self.resonance > self.antiresonance:
            raise InvalidParameterError("resonance", f"> the antiresonance, {self.antiresonance:g} Hz", self.resonance)
        require_not_negative("spring_damping", self.spring_damping)
        if self.encoder not in SIDES:
            raise InvalidParameterError("encoder", f"one of {', '.join(SIDES)}", self.encoder)

    @classmethod
    def given(cls, values: Mapping[str, Any]) -> Transmission | None:
        """The transmission of which some values are given by name, the others None; None where nothing is.

        Raises
        ------
        InvalidParameterError
            If a frequency is missing, or as the class.
        """
        every = ((entry.name, values.get(entry.name)) for entry in fields(cls))
        known: dict[str, Any] = {name: value for name, value in every if value is not None}
        for name in ("resonance", "antiresonance"):
            if known and name not in known:
                raise InvalidParameterError(name, f"given beside {next(iter(known))}", None)
        numbers: dict[str, Any] = {name: value if name == "encoder" else float(value) for name, value in known.items()}
        return cls(**numbers) if known else None

    @property
    def on_load(self) -> bool:
        """Whether the controller measures the load."""
        return self.encoder == SIDES[1]

    @property
    def in_words(self) -> str:
        """For a person, in a list of values."""
        frequencies = f"resonance {self.resonance:.4g} Hz, antiresonance {self.antiresonance:.4g} Hz"
        return f"{frequencies}, encoder on the {self.encoder}"

    def masses(self, inertia: float) -> tuple[float, float]:
        """Inertias of motor and load [kg·m²], of both together."""
        motor = inertia * (self.antiresonance / self.resonance) ** 2
        return motor, inertia - motor

    def spring(self, inertia: float) -> tuple[float, float]:
        """Stiffness k_s [N·m/rad] and damping d_s [N·m·s/rad] of the spring, of the inertia of both together."""
        load, frequency = self.masses(inertia)[1], 2.0 * math.pi * self.antiresonance
        return load * frequency**2, 2.0 * self.spring_damping * load * frequency
