# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Several observed slips of one joint as one problem of least squares.

The logarithms of six parameters are unknown, and for each slip where the joint rested, when it broke away
and with what Stribeck friction. Each slip is simulated on its own from these; what ties the slips together
are Eq. (6), from one slip's end to the next one's beginning, and the balance of forces at every breakaway. What an
optional term does to a simulated slip stands with the term, which is a :class:`SlipTerm` in a file of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model._friction_law import HESS_SOOM
from stickslip_ros.monitoring.friction import _window_kernel as kernel
from stickslip_ros.monitoring.friction._window_kernel import (
    FITTED,
    INERTIA,
    LEVEL,
)
from stickslip_ros.monitoring.friction.slip_data import NoiseModel, SlipData
from stickslip_ros.monitoring.friction.slip_windows import ForceSource, SlipWindow
from stickslip_ros.monitoring.samples import FloatArray

PARAMETERS = len(FITTED)  # beyond them stands what else slips have in common: see `SlipProblem.terms`

_SPREAD_SLIPS, _SPREAD_OBSERVATIONS = 12, 60  # slips from everywhere, and observations of each, 1: at most

Term = TypeVar("Term", bound="SlipTerm")


@dataclass(frozen=True, kw_only=True)
class TermParameter:
    """Normal prior and bounds of a parameter beyond those of the law."""

    std: float
    mean: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf


@dataclass
class Variants:
    """The same slips with several parameters, each a row of what the windows' kernel simulates; terms change them.

    Where all variants share a value it has one row.

    Attributes
    ----------
    parameters : logarithms and the parameters of terms, shape (variants, p). plants : values of the law's parameters,
        shape (variants, 6).
    levels : Stribeck friction of each slip at breakaway by Eq. (6), shape (variants, slips) [N·m].
    starts : columns of the kernel, shape (variants, slips, 3). gains : stiffness and damping, shape (…, slips, 2).
    drives : force at the nodes that would be on a joint at zero, without its velocity's part, shape (…, nodes) [N·m].
    drags : of the square of the velocity, shape (…, slips) [N·m·s²/rad²].
    contacts : compliance and damping of the contact at rest, shape (…, slips, 2).
    standing : mean force where the joint was seen to rest, shape (…, slips) [N·m]. stopped : the same after the slip,
        less the drive at the last observation.
    """

    parameters: FloatArray
    plants: FloatArray
    levels: FloatArray
    starts: FloatArray
    gains: FloatArray
    drives: FloatArray
    drags: FloatArray
    contacts: FloatArray
    standing: FloatArray
    stopped: FloatArray


@dataclass(frozen=True, kw_only=True)
class SlipTerm:
    """Optional effect on slips: its parameters with their priors, and what it changes of a simulation.

    Terms stand in the order of ``place``, and so do their parameters. They are applied from the last to the first, each
    to what those after it have made of the variants.
    """

    place: ClassVar[int] = 0

    @property
    def parameters(self) -> dict[str, TermParameter]:
        """Parameters by name, in their order."""
        return {}

    def covariate(self, problem: SlipProblem) -> FloatArray | None:
        """Regressor in [-1, 0] by which friction grows, shape (slips,); None where friction does not grow.

        Parameters and kinetic friction are reported at covariate = 0. Of one model's terms at most one has a covariate.
        """
        return None

    def apply(self, variants: Variants, problem: SlipProblem) -> None:
        """Change what is simulated."""

    def correct(self, variants: Variants, problem: SlipProblem, positions: FloatArray, found: FloatArray) -> None:
        """Change what was simulated: positions at the nodes, and what is found of each slip."""


@dataclass(frozen=True, kw_only=True)
class SlipModel:
    """What is fitted to slips: the law of the Stribeck friction, and optional terms.

    Attributes
    ----------
    law : number in ``model._friction_law``.
    known : mean and standard deviation of the logarithms of the law's parameters of which something is known, by index.
    terms : in the order of their places, one of each kind.
    """

    law: int = HESS_SOOM
    known: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    terms: tuple[SlipTerm, ...] = ()

    def term(self, kind: type[Term]) -> Term | None:
        """The term of a kind; None where the model has none."""
        return next((term for term in self.terms if isinstance(term, kind)), None)

    def with_term(self, term: SlipTerm) -> SlipModel:
        """The model with one more term."""
        return replace(self, terms=tuple(sorted((*self.terms, term), key=lambda one: one.place)))

    def without(self, kind: type[SlipTerm]) -> SlipModel:
        """The model without the terms of a kind."""
        return replace(self, terms=tuple(term for term in self.terms if not isinstance(term, kind)))


@dataclass
class Budget:
    """Steps of simulation that are left to a study: a bound of its time that is the same on every machine."""

    steps: float = math.inf

    @property
    def spent(self) -> bool:
        """Whether nothing is left: what could still be tried is not, and iterations end where they are."""
        return self.steps <= 0.0


class SlipProblem:
    """Observed slips, and what a simulation of them needs.

    Where gains or force are unknown the inertia is taken as one, and its place among the parameters holds the
    stiffness, which then is ω²; damping and forces are per inertia likewise.

    Parameters
    ----------
    data : the slips. model : law and terms; the paper's law alone by default.
    before : arrest before the first slip [s] and the share of F_s∞ that was left then, if known.
    both_directions : whether the load is told from the Coulomb friction even if these slips are all of one direction,
        because slips of both are known; where the reference's speeds are all that is known it means nothing.
    subtracted_force : known disturbance that was subtracted from each slip's force, shape (slips,) [N·m].
    budget : of the simulations of this problem and of all that are made of it; None for no bound.

    ``noise`` is at first that of speeds as measured and exact stamps. ``term_parameters`` are the parameters beyond
    those of the law: the reference's speeds, where only they are known, relative; then those of the model's terms.
    ``column`` is their index, ``term_means`` and ``term_stds`` are their priors. Growth of the kinetic friction with a
    term's covariate is the last column of ``balance``.
    """

    def __init__(
        self,
        data: SlipData,
        model: SlipModel | None = None,
        *,
        before: tuple[float, float] | None = None,
        both_directions: bool = False,
        subtracted_force: FloatArray | None = None,
        budget: Budget | None = None,
    ) -> None:
        self.data = data
        self.noise = data.noise_model(data.measured_speeds, tolerance=0.0, jitter=0.0, usable=data.single)
        self.model = model = model or SlipModel()
        self.budget = budget or Budget()
        self.subtracted_force = np.zeros(data.count) if subtracted_force is None else subtracted_force
        self.before = (before[0] - data.origin, before[1]) if before else None
        self._none, self._rigid = np.zeros((1, data.count)), np.zeros((1, data.count, 2))
        self.term_parameters = {
            f"speed {k}": TermParameter(std=float(error)) for k, error in enumerate(data.speed_errors)
        }
        self.covariate: FloatArray | None = None
        growing: set[str] = set()
        for term in model.terms:
            self.term_parameters |= term.parameters
            if (covariate := term.covariate(self)) is not None:
                self.covariate, growing = covariate, set(term.parameters)
        self.term_means = np.array([one.mean for one in self.term_parameters.values()])
        self.term_stds = np.array([one.std for one in self.term_parameters.values()])
        self.column = {name: PARAMETERS + k for k, name in enumerate(self.term_parameters)}
        # Columns: what the kinetic friction is made of. With both directions the load shows, in one it is part of it.
        if data.normalised:
            self.balance = np.eye(len(data.speeds))[data.groups]
        elif both_directions or data.directions.min() < data.directions.max():
            self.balance = np.stack([np.ones(data.count), data.directions], axis=1)
        else:
            self.balance = np.ones((data.count, 1))
        # Indices of the parameters, and of the kinetic friction, without those of drift or covariate.
        parameters, kinetic = np.arange(PARAMETERS + len(self.column)), np.arange(self.balance.shape[1])
        self.without_drift = np.delete(parameters, [self.column[name] for name in growing]), kinetic
        if self.covariate is not None:
            self.balance = np.column_stack([self.balance, self.covariate])

    def weighed(
        self,
        speeds: FloatArray | None = None,
        *,
        tolerance: float = 0.0,
        jitter: float | None = None,
        usable: NDArray[np.bool_] | None = None,
    ) -> SlipProblem:
        """The same with what the observations say at other speeds.

        Parameters
        ----------
        speeds : at the nodes; as measured if None. tolerance, jitter, usable : as of :class:`NoiseModel`; the latter
            two are kept if None. A tolerance makes the cost smoother while the parameters are far off.
        """
        return self._with_noise(
            self.data.noise_model(
                self.data.measured_speeds if speeds is None else speeds,
                tolerance=tolerance,
                jitter=self.noise.jitter if jitter is None else jitter,
                usable=self.noise.usable if usable is None else usable,
            )
        )

    def without(self, outliers: NDArray[np.bool_]) -> SlipProblem:
        """The same with fewer slips that count; what follows the others begins anew."""
        return self._with_noise(replace(self.noise, **self.data.counted(self.noise.usable & ~outliers)))

    def _with_noise(self, noise: NoiseModel) -> SlipProblem:
        other = copy(self)
        other.noise = noise
        return other

    def stiffness(self, parameters: FloatArray) -> FloatArray:
        """Of the spring in each slip [N·m/rad], shape (slips,); per inertia ω²."""
        data = self.data
        return np.full(data.count, math.exp(parameters[INERTIA])) if data.normalised else data.gains[:, 0].copy()

    def natural_frequency(self, parameters: FloatArray) -> float:
        """ω [1/s] with the largest gain; that of the slips' duration where there is no stiffness."""
        stiffness = float(self.stiffness(parameters).max())
        if stiffness <= 0:
            return 2.0 * math.pi / self.data.usual_duration
        return math.sqrt(stiffness / (1.0 if self.data.normalised else math.exp(parameters[INERTIA])))

    def loading_rate(self, parameters: FloatArray) -> float:
        """How fast the force on the resting joint rises, median of the slips [N·m/s]."""
        return float(np.median(self.loading_rates(parameters)))

    def loading_rates(self, parameters: FloatArray) -> FloatArray:
        """How fast the force on the resting joint rises before each slip [N·m/s], shape (slips,)."""
        data = self.data
        if data.windows[0].source is ForceSource.EFFORT:
            return np.array([window.loading_rate for window in data.windows])
        if data.normalised:
            rates = np.abs(data.speeds * np.exp(parameters[PARAMETERS:]))[data.groups]
        else:
            rates = np.abs(data.references[data.edges[1:] - 1] - data.references[data.edges[:-1]])
            rates /= data.last_times - data.first_times
        return np.asarray(self.stiffness(parameters) * rates)

    def simulate(
        self, parameters: FloatArray, unknowns: FloatArray, surpluses: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions and velocities at the nodes, and what is found of each slip (columns of the kernel).

        ``unknowns`` of shape (slips, 3): rest position [rad], breakaway [s], logarithm of the level [N·m].
        ``surpluses`` of shape (slips,): by what the force exceeds what holds the joint when it breaks away [N·m].
        """
        positions, velocities, found = self.simulate_variants(parameters[None], unknowns[None], surpluses)
        return positions[0], velocities[0], found[0]

    def simulate_variants(
        self, parameters: FloatArray, unknowns: FloatArray, surpluses: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What :meth:`simulate` gives for several parameters and unknowns at once, each with its row."""
        surpluses = self._none[0] if surpluses is None else surpluses
        variants = self._variants(parameters, unknowns)
        for term in reversed(self.model.terms):
            term.apply(variants, self)
        data = self.data
        positions, velocities = np.empty((2, len(parameters), len(data.times)))
        found = np.empty((len(parameters), data.count, kernel.FOUND_COLUMNS))
        plants, gains = variants.plants, variants.gains
        # What was chosen by slip lies the other way round in memory, and would have the kernel compiled once more.
        drags, standing, drives = map(np.ascontiguousarray, (variants.drags, variants.standing, variants.drives))
        self.budget.steps -= kernel.simulate_windows(
            plants, self.model.law, data.directions, variants.starts, surpluses, gains, drags, variants.contacts,
            standing, data.edges, data.times, drives, data.usual, not data.normalised, positions, velocities, found,
        )  # fmt: skip
        for term in self.model.terms:
            term.correct(variants, self, positions, found)
        return positions, velocities, found

    def _variants(self, parameters: FloatArray, unknowns: FloatArray) -> Variants:
        """What is simulated without terms."""
        data = self.data
        plants = np.exp(parameters[:, :PARAMETERS])
        gains, drives = data.gains[None], data.drives[None]
        if data.normalised:
            stiffness = plants[:, INERTIA].copy()
            plants[:, INERTIA] = 1.0
            gains = np.zeros((len(plants), data.count, 2))
            gains[:, :, 0] = stiffness[:, None]
            speeds = stiffness[:, None] * data.speeds * np.exp(parameters[:, PARAMETERS:])
            drives = speeds[:, data.groups[data.slip_of_node]] * (data.times - data.times[0])
        levels, starts = np.exp(unknowns[:, :, LEVEL]), unknowns.copy()
        starts[:, :, LEVEL] = levels
        return Variants(
            parameters, plants, levels, starts, gains, drives,
            drags=self._none, contacts=self._rigid, standing=self._none, stopped=self._none,
        )  # fmt: skip

    def thinned(self, most: int) -> SlipProblem:
        """The problem with at most so many observations of each slip."""
        return self.changed([window.thinned(most) for window in self.data.windows])

    def spread(self) -> SlipProblem:
        """The problem of a dozen usable slips from everywhere at most, with some observations of each."""
        usable = np.flatnonzero(self.noise.usable)
        chosen = np.unique(np.round(np.linspace(0, len(usable) - 1, min(_SPREAD_SLIPS, len(usable)))).astype(int))
        return self.only(usable[chosen].tolist()).thinned(_SPREAD_OBSERVATIONS)

    @property
    def may_be_late(self) -> bool:
        """Whether the force is that of a controller's gains, which may act late."""
        return self.data.windows[0].source is ForceSource.GAINS

    @property
    def latest_gains(self) -> tuple[float, float]:
        """Stiffness [N·m/rad] and damping [N·m·s/rad] at the last slip."""
        return float(self.data.gains[-1, 0]), float(self.data.gains[-1, 1])

    def changed(
        self,
        windows: list[SlipWindow] | None = None,
        *,
        model: SlipModel | None = None,
        subtracted_force: FloatArray | None = None,
    ) -> SlipProblem:
        """The problem with other windows or another model, within the same budget.

        The subtracted force is kept as long as the windows are the same.
        """
        if windows is None:
            data, subtracted_force = self.data, self.subtracted_force
        else:
            data = SlipData(windows)
        return SlipProblem(data, model or self.model, subtracted_force=subtracted_force, budget=self.budget)

    def only(self, which: list[int]) -> SlipProblem:
        """The problem of some of the slips."""
        return self.changed([self.data.windows[number] for number in which])
