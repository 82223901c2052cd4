# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Several observed slips of one joint as one problem of least squares.

The logarithms of six parameters are unknown, and for each slip where the joint rested, when it broke away
and with what Stribeck friction. Each slip is simulated on its own from these; what ties the slips together
are Eq. (6), from one slip's end to the next one's beginning, and the balance of forces at every breakaway.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model._friction_law import HESS_SOOM
from stickslip_ros.model.bounds import TINY
from stickslip_ros.monitoring.friction import _window_kernel as kernel
from stickslip_ros.monitoring.friction._window_kernel import (
    FITTED,
    INERTIA,
    LAG,
    LEVEL,
    STRIBECK_VELOCITY,
    VISCOUS,
)
from stickslip_ros.monitoring.friction.observed_slips import ObservedSlips
from stickslip_ros.monitoring.friction.slip_windows import ForceSource, SlipWindow
from stickslip_ros.monitoring.samples import FloatArray

PARAMETERS = len(FITTED)  # beyond them stands what else slips have in common: see `SlipProblem.terms`

# Steps of the simulation: parts of a radian of the spring's, of the time in which speed decays, of that in which the
# Stribeck friction changes, which is that of the speeding up to the Stribeck velocity and some of the lag.
_OF_RADIAN, _OF_DECAY, _OF_CHANGE, _OF_LAG = 0.4, 0.5, 0.25, 0.3
_SPEEDING_UP = 0.25  # time in which the joint comes up to the slip's mean speed, of the slip
_LEAST_STEPS, _MOST_STEPS = 4.0, 400.0  # steps in a slip, 1: at least, and at most
LATE = 1.5  # prior standard deviation of a controller's delay, sample intervals
_LONGEST_DELAY = 20.0  # longest delay of a controller, sample intervals
_MOST_DAMPING = 2.0  # damping ratio of a contact, 1: at most
_MOST_CURVED = 0.95  # quadratic part of viscous friction, of it, or what is missing there: at most
_FACTOR_STD = 0.5  # prior standard deviation of the Stribeck friction that the covariate scales, of it
_TREND = 0.1  # prior standard deviation of a trend from the first slip to the last, of the Stribeck friction
_DAMPING_RATIO = 0.5  # damping ratio of a contact that yields, 1: prior mean and standard deviation
CURVATURE = 0.5  # prior standard deviation of the quadratic part of viscous friction, of it
# Of the controller's spring: a contact that yields more is not one that slips begin on; slips do not show less.
MOST_COMPLIANCE, LEAST_COMPLIANCE = 0.2, 1e-4
_LEAST_INERTIA = 0.1  # inertia that a delay leaves, of the inertia: at least


@dataclass(frozen=True, kw_only=True)
class TermParameter:
    """Normal prior and bounds of a parameter beyond those of the law."""

    std: float
    mean: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf


@dataclass(frozen=True, kw_only=True)
class ContactKnowledge:
    """Compliance of a contact.

    Attributes
    ----------
    mean, std : in ``unit``. unit : compliance of the spring that the slips are pulled by [rad/(N·m)].
    """

    mean: float
    std: float
    unit: float


@dataclass(frozen=True, kw_only=True)
class SlipModel:
    """What is fitted to slips: the law of the Stribeck friction, and optional terms.

    Attributes
    ----------
    law : number in ``model._friction_law``.
    known : mean and standard deviation of the logarithms of the law's parameters of which something is known, by index.
    delay_shows : whether the controller's delay is unknown too.
    contact : what is known of the compliance of a contact that yields, None if it does not. All slips have to be
        between creep, see :meth:`.SlipWindow.between_creep`.
    curved_at : speed at which the viscous friction is reported [rad/s] if it may be a curve over speed, of which a
        share goes with the square of the speed; None if it is a straight line, as where only speeds are known.
    trend : whether friction changes steadily from the first slip to the last; parameters and kinetic friction are then
        those at the last one. Where only speeds are known there is none.
    """

    law: int = HESS_SOOM
    known: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    delay_shows: bool = False
    contact: ContactKnowledge | None = None
    curved_at: float | None = None
    trend: bool = False

    @staticmethod
    def of(
        windows: list[SlipWindow], law: int = HESS_SOOM, known: Mapping[int, tuple[float, float]] | None = None
    ) -> SlipModel:
        """The law alone, with the delay where gains change: else a delay τ is as good as less damping and inertia."""
        changing = len({window.gains for window in windows}) > 1
        delay_shows = changing and windows[0].source is ForceSource.GAINS
        return SlipModel(law=law, known=known or {}, delay_shows=delay_shows)

    @property
    def terms(self) -> dict[str, TermParameter]:
        """Parameters of the terms by name, in their order: delay in sample intervals, compliance in `contact.unit`."""
        terms = {}
        if self.delay_shows:
            terms["delay"] = TermParameter(std=LATE, lower=0.0, upper=_LONGEST_DELAY)
        if self.contact is not None:
            mean, std = self.contact.mean, self.contact.std
            terms["compliance"] = TermParameter(mean=mean, std=std, lower=LEAST_COMPLIANCE, upper=MOST_COMPLIANCE)
            terms["damping_ratio"] = TermParameter(
                mean=_DAMPING_RATIO, std=_DAMPING_RATIO, lower=0.0, upper=_MOST_DAMPING
            )
        if self.curved_at is not None:
            terms["curvature"] = TermParameter(std=CURVATURE, lower=-_MOST_CURVED, upper=_MOST_CURVED)
        if self.trend:
            terms["trend"] = TermParameter(std=_TREND)
        return terms


@dataclass
class Budget:
    """Steps of simulation that are left to a study: a bound of its time that is the same on every machine."""

    steps: float = math.inf

    @property
    def spent(self) -> bool:
        """Whether nothing is left: what could still be tried is not, and iterations end where they are."""
        return self.steps <= 0.0


class SlipProblem(ObservedSlips):
    """Observed slips, and what a simulation of them needs.

    Where gains or force are unknown the inertia is taken as one, and its place among the parameters holds the
    stiffness, which then is ω²; damping and forces are per inertia likewise.

    Parameters
    ----------
    windows : in order of time, all with the force from one source; at least one.
    model : law and terms; by default as :meth:`SlipModel.of` has it.
    before : arrest before the first slip [s] and the share of F_s∞ that was left then, if known.
    both_directions : whether the load is told from the Coulomb friction even if these slips are all of one direction,
        because slips of both are known; where the reference's speeds are all that is known it means nothing.
    subtracted_force : known disturbance that was subtracted from each slip's force, shape (slips,) [N·m].
    covariate : regressor in [-1, 0] that scales friction (position or load), shape (slips,). Parameters and kinetic
        friction are reported at covariate = 0. With a trend it is the time.
    known_factor : factor of the Stribeck friction of each slip, where that is known, shape (slips,).
    budget : of the simulations of this problem and of all that are made of it; None for no bound.

    ``terms`` are the parameters beyond those of the law: the reference's speeds, where only they are known, relative;
    those of the model's terms; last the share by which Stribeck friction grows with the covariate, and with a trend
    viscous friction too. ``column`` is their index, ``term_means`` and ``term_stds`` are their priors. Growth of the
    kinetic friction is the last column of ``balance``.
    """

    def __init__(
        self,
        windows: list[SlipWindow],
        model: SlipModel | None = None,
        *,
        before: tuple[float, float] | None = None,
        both_directions: bool = False,
        subtracted_force: FloatArray | None = None,
        covariate: FloatArray | None = None,
        known_factor: FloatArray | None = None,
        budget: Budget | None = None,
    ) -> None:
        super().__init__(windows)
        self.model = model = model or SlipModel.of(windows)
        self.budget = budget or Budget()
        # Factor on the levels of Eq. (6).
        self._known_factor = known_factor
        self.subtracted_force = np.zeros(self.count) if subtracted_force is None else subtracted_force
        self.before = (before[0] - self.origin, before[1]) if before else None
        self._usual_duration = float(np.median(self.durations))
        self._least_rate = _LEAST_STEPS / self._usual_duration
        self._most_rate = _MOST_STEPS / float(self.durations.max())
        self.references = np.concatenate([window.references for window in windows])
        self.forces = np.concatenate([window.forces for window in windows])
        self._slip_of_node = np.repeat(np.arange(self.count), np.diff(self.edges))
        self._gains = np.array(
            [
                (float(window.gains.stiffness), float(window.gains.damping)) if window.gains else (0.0, 0.0)
                for window in windows
            ]
        )
        self._largest_gains = self._gains.max(axis=0)[None]
        self._rates = np.concatenate([np.gradient(window.references, window.times) for window in windows])
        stiffness, damping = self._gains[self._slip_of_node].T
        # Force at the nodes that would be on a joint at zero, without its velocity's part [N·m].
        self._drives = stiffness * self.references + damping * self._rates + self.forces
        self._none = np.zeros((1, self.count))
        self._rigid = np.zeros((1, self.count, 2))
        self._standing = self._none
        if model.contact is not None:
            self._last_observed = self.observed[self.observation_edges[1:] - 1]
            # Where it was not seen to stand there is nothing to correct.
            rested = [window.before.drive if window.before else math.nan for window in windows]
            stopped = [window.after.drive if window.after else math.nan for window in windows]
            begins, ends = self._drives[self.edges[:-1]], self._drives[self._last_observed]
            self._standing = np.where(np.isfinite(rested), rested, begins)[None]
            self._stopped = np.where(np.isfinite(stopped), stopped, ends)
        # Of the time of the slips, from -1 to 0.
        self.since = (self.breakaways - self.breakaways[-1]) / max(float(np.ptp(self.breakaways)), TINY)
        self.covariate = self.since if model.trend else covariate
        self.terms = {f"speed {k}": TermParameter(std=float(error)) for k, error in enumerate(self.speed_errors)}
        self.terms |= model.terms
        if self.covariate is not None and not model.trend:
            self.terms["factor"] = TermParameter(std=_FACTOR_STD)
        self.term_means = np.array([term.mean for term in self.terms.values()])
        self.term_stds = np.array([term.std for term in self.terms.values()])
        self.column = {name: PARAMETERS + k for k, name in enumerate(self.terms)}
        # Columns: what the kinetic friction is made of. With both directions the load shows, in one it is part of it.
        if self.normalised:
            self.balance = np.eye(len(self.speeds))[self.groups]
        elif both_directions or self.directions.min() < self.directions.max():
            self.balance = np.stack([np.ones(self.count), self.directions], axis=1)
        else:
            self.balance = np.ones((self.count, 1))
        if self.covariate is not None:
            self.balance = np.column_stack([self.balance, self.covariate])

    def stiffness(self, parameters: FloatArray) -> FloatArray:
        """Of the spring in each slip [N·m/rad], shape (slips,); per inertia ω²."""
        return np.full(self.count, math.exp(parameters[INERTIA])) if self.normalised else self._gains[:, 0].copy()

    def natural_frequency(self, parameters: FloatArray) -> float:
        """ω [1/s] with the largest gain; that of the slips' duration where there is no stiffness."""
        stiffness = float(self.stiffness(parameters).max())
        if stiffness <= 0:
            return 2.0 * math.pi / self._usual_duration
        return math.sqrt(stiffness / (1.0 if self.normalised else math.exp(parameters[INERTIA])))

    def loading_rate(self, parameters: FloatArray) -> float:
        """How fast the force on the resting joint rises, median of the slips [N·m/s]."""
        return float(np.median(self.loading_rates(parameters)))

    def loading_rates(self, parameters: FloatArray) -> FloatArray:
        """How fast the force on the resting joint rises before each slip [N·m/s], shape (slips,)."""
        if self.normalised:
            rates = np.abs(self.speeds * np.exp(parameters[PARAMETERS:]))[self.groups]
        else:
            ends = self.edges[1:] - 1
            rates = np.abs(self.references[ends] - self.references[self.edges[:-1]])
            rates /= self.last_times - self.first_times
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
        plants = np.exp(parameters[:, :PARAMETERS])
        gains, drives, drags = self._gains[None], self._drives[None], self._none
        if self.model.curved_at is not None:
            # What goes with the square of the speed is no part of the damping.
            squared = parameters[:, self.column["curvature"]] * plants[:, VISCOUS]
            drags = np.repeat(squared[:, None] / self.model.curved_at, self.count, axis=1)
            plants[:, VISCOUS] -= squared
        if self.normalised:
            stiffness = plants[:, INERTIA].copy()
            plants[:, INERTIA] = 1.0
            gains = np.zeros((len(plants), self.count, 2))
            gains[:, :, 0] = stiffness[:, None]
            speeds = stiffness[:, None] * self.speeds * np.exp(parameters[:, PARAMETERS:])
            drives = speeds[:, self.groups[self._slip_of_node]] * (self.times - self.times[0])
        starts = unknowns.copy()
        starts[:, :, LEVEL] = levels = np.exp(unknowns[:, :, LEVEL])
        lighter = None
        more = None
        if self.covariate is not None:
            # Levels are those that Eq. (6) would have without it.
            more = parameters[:, -1:] * self.covariate
        elif self._known_factor is not None:
            more = (self._known_factor - 1.0)[None]
        if more is not None:
            starts[:, :, LEVEL] *= 1.0 + more
            if self.model.trend:
                gains = np.repeat(gains, len(plants), axis=0)
                gains[:, :, 1] += more * plants[:, VISCOUS, None]
                drags = drags * (1.0 + more)
        if self.model.delay_shows:
            # The force of a time ago is that of now less its rate: k_p τ less damping, k_v τ less inertia. By the
            # inertia left, all that is per inertia grows.
            delay = parameters[:, self.column["delay"], None] * self.sample_interval
            stiffness, damping = self._gains.T
            lighter = np.maximum(1.0 - delay * damping / plants[:, INERTIA, None], _LEAST_INERTIA)
            viscous = plants[:, VISCOUS, None]
            damping = gains[:, :, 1]
            gains = np.stack(
                np.broadcast_arrays(stiffness / lighter, (damping - delay * stiffness + viscous) / lighter - viscous),
                axis=2,
            )
            late = (delay * stiffness)[:, self._slip_of_node] * self._rates
            drives = (self._drives - late) / lighter[:, self._slip_of_node]
            starts[:, :, LEVEL] /= lighter
            drags = drags / lighter
        contacts, standing = self._rigid, self._standing
        if self.model.contact is not None:
            inertia = plants[:, INERTIA]
            compliances = np.maximum(parameters[:, self.column["compliance"]], LEAST_COMPLIANCE)
            compliances *= self.model.contact.unit
            dampings = 2.0 * parameters[:, self.column["damping_ratio"]] * np.sqrt(inertia / compliances)
            contacts = np.repeat(np.stack([compliances, dampings], axis=1)[:, None], self.count, axis=1)
            stopped = self._stopped - self._drives[self._last_observed]
            if lighter is not None:
                contacts *= np.stack([lighter, 1.0 / lighter], axis=2)
                stopped, standing = stopped / lighter, (standing - late[:, self.edges[:-1]]) / lighter
        positions, velocities = np.empty((2, len(plants), len(self.times)))
        found = np.empty((len(plants), self.count, kernel.FOUND_COLUMNS))
        # What was chosen by slip lies the other way round in memory, and would have the kernel compiled once more.
        drives, standing = np.ascontiguousarray(drives), np.ascontiguousarray(standing)
        drags = np.ascontiguousarray(drags)
        self.budget.steps -= kernel.simulate_windows(
            plants, self.model.law, self.directions, starts, surpluses, gains, drags, contacts, standing, self.edges,
            self.times, drives, self._steps(plants, gains), positions, velocities, found,
        )  # fmt: skip
        if self.model.contact is not None:
            # Where the joint stands after a slip is a mean over a time in which it creeps on.
            softness = contacts[:, :, kernel.COMPLIANCE]
            softness = softness / (1.0 + softness * gains[:, :, 0])
            positions[:, self._last_observed] += softness * stopped
        if lighter is not None:
            found[:, :, kernel.HOLDING_FORCE] *= lighter
        if more is not None:
            found[:, :, kernel.HOLDING_FORCE] -= more * levels
        return positions, velocities, found

    def _steps(self, plants: FloatArray, gains: FloatArray) -> FloatArray:
        """Steps of the simulation [s], smooth in the parameters: columns of the kernel, shape (variants, 3)."""
        # As few calls as can be: they take longer than what they do.
        inertia = plants[:, INERTIA]
        largest = self._largest_gains if gains.base is self._gains else gains.max(axis=1)
        stiffness, damping = largest[:, 0], largest[:, 1]
        frequency = np.where(stiffness > 0, np.sqrt(stiffness / inertia), 2.0 * math.pi / self._usual_duration)
        coarse = np.maximum(frequency / _OF_RADIAN, (plants[:, VISCOUS] + damping) / inertia / _OF_DECAY)
        coarse = 1.0 / np.minimum(np.maximum(coarse, self._least_rate), self._most_rate)
        growth = _OF_CHANGE * plants[:, STRIBECK_VELOCITY] * _SPEEDING_UP * self._usual_duration / self.usual_speed
        fine = np.maximum(growth + _OF_CHANGE * _OF_LAG * plants[:, LAG], 1.0 / self._most_rate)
        if not self.normalised:
            # A sampled force has a bend at every sample. Steps of one length keep the error by them smooth.
            coarse, growth = np.minimum(coarse, fine), np.zeros(len(plants))
        return np.stack([coarse, fine, growth], axis=1)

    def thinned(self, most: int) -> SlipProblem:
        """The problem with at most so many observations of each slip."""
        return self.changed([window.thinned(most) for window in self.windows])

    def spread(self, slips: int = 12, observations: int = 60) -> SlipProblem:
        """The problem of at most so many usable slips from everywhere, with at most so many observations of each."""
        usable = np.flatnonzero(self.noise.usable)
        chosen = np.unique(np.round(np.linspace(0, len(usable) - 1, min(slips, len(usable)))).astype(int))
        return self.only(usable[chosen].tolist()).thinned(observations)

    def plain(self, law: int) -> SlipProblem:
        """The problem of the same slips under a law, without what a fit has added."""
        return SlipProblem(self.windows, SlipModel.of(self.windows, law, self.model.known), budget=self.budget)

    def compliance(self, parameters: FloatArray) -> float:
        """Of the contact [rad/(N·m)]; 0 of a rigid one."""
        contact = self.model.contact
        return 0.0 if contact is None else float(parameters[self.column["compliance"]]) * contact.unit

    @property
    def may_be_late(self) -> bool:
        """Whether the force is that of a controller's gains, which may act late."""
        return self.windows[0].source is ForceSource.GAINS

    @property
    def latest_gains(self) -> tuple[float, float]:
        """Stiffness [N·m/rad] and damping [N·m·s/rad] at the last slip."""
        return float(self._gains[-1, 0]), float(self._gains[-1, 1])

    def changed(
        self,
        windows: list[SlipWindow] | None = None,
        *,
        model: SlipModel | None = None,
        subtracted_force: FloatArray | None = None,
        covariate: FloatArray | None = None,
    ) -> SlipProblem:
        """The problem with other windows, model or covariate, within the same budget.

        Subtracted force and covariate are kept as long as the windows are the same.
        """
        if windows is None:
            windows, subtracted_force = self.windows, self.subtracted_force
            covariate = self.covariate if covariate is None and not self.model.trend else covariate
        return SlipProblem(
            windows, model or self.model, subtracted_force=subtracted_force, covariate=covariate, budget=self.budget
        )

    @property
    def without_drift(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Indices of the parameters, and of the kinetic friction, without those of drift or covariate."""
        parameters, kinetic = PARAMETERS + len(self.terms), self.balance.shape[1]
        return np.arange(parameters - (self.covariate is not None)), np.arange(kinetic - (self.covariate is not None))

    def only(self, which: list[int]) -> SlipProblem:
        """The problem of some of the slips."""
        return self.changed([self.windows[number] for number in which])
