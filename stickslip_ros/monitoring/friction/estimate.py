# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The friction of a joint estimated from its slips, with errors, and what the data leave open.

The force comes from gains and reference, from the effort, or, where neither is known, from the reference's mean
speed alone: then everything is per inertia, and ω stands for the stiffness, which is all that Eq. (43) and the exact
condition need. In one direction a constant load cannot be told from Coulomb friction: their sum is what is learnt.
Neither condition contains it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from stickslip_ros.model._friction_law import PAPERS_LAW
from stickslip_ros.model.friction import JOINT_PARAMETERS, PRESLIDING_PARAMETERS, Friction, Gains, Joint, Real
from stickslip_ros.monitoring.drive import DriveGains
from stickslip_ros.monitoring.friction._window_kernel import (
    FITTED,
    INERTIA,
    LAG,
    RISE_TIME,
    STRIBECK,
    STRIBECK_VELOCITY,
    VISCOUS,
)
from stickslip_ros.monitoring.friction.asymmetry import Asymmetry
from stickslip_ros.monitoring.friction.bristles import BristleContact
from stickslip_ros.monitoring.friction.curved_viscous import Curvature
from stickslip_ros.monitoring.friction.dry_friction import DryFriction
from stickslip_ros.monitoring.friction.friction_factor import FrictionFactor
from stickslip_ros.monitoring.friction.late_controller import LEAST_VISCOUS, SPREAD_LIMIT, DelayEstimate
from stickslip_ros.monitoring.friction.slip_problem import PARAMETERS
from stickslip_ros.monitoring.friction.slip_windows import ForceSource
from stickslip_ros.monitoring.samples import FloatArray

NAMES = tuple(parameter.name for parameter in JOINT_PARAMETERS)
_OF_CONTACT = tuple(parameter.name for parameter in PRESLIDING_PARAMETERS)
IDENTIFIED = 0.05  # standard error, of the value: with less the data determine a parameter
DOES_NOT_FIT = "friction model does not fit"
CUT_SHORT = "the study of the slips was cut short: further effects and laws were not tried"
COULOMB_AND_LOAD = "coulomb_and_load"  # what one direction shows of the two

# Misfit, of a slip, and slips set aside, of all slips: an estimate with more is not usable.
_USABLE, USABLE_ASIDE = 0.02, 0.25
_KNOWN = {
    ForceSource.GAINS: "gains and reference known",
    ForceSource.EFFORT: "effort known",
    ForceSource.SPEED: "from the motion alone",
}
_SEEN = 3.0  # value, standard errors
_ROUGHLY = 0.3  # standard error, of the value: with less a parameter that is not identified is still no guess
OfALaw = TypeVar("OfALaw", "LawAlternative", "FrictionEstimate")
DRAWS = 128  # draws from the estimate, 1: half of them and their mirror images


@dataclass(frozen=True, kw_only=True)
class ParameterEstimate:
    """One parameter: value and standard error in its unit, and whether the data determine it.

    What is not identified rests on the prior: the configured value, or a wide guess.
    """

    value: float
    std: float
    identified: bool


NOT_ESTIMATED = ParameterEstimate(value=math.nan, std=math.nan, identified=False)


@dataclass(frozen=True, kw_only=True)
class LawAlternative:
    """Another friction law that the slips do not exclude, and its parameters.

    Attributes
    ----------
    law : its name. weight : its probability, given the slips.
    logarithms, covariance, contact : as of :class:`FrictionEstimate`.
    """

    law: str
    weight: float
    logarithms: FloatArray
    covariance: FloatArray
    contact: BristleContact | None = None


@dataclass(frozen=True, kw_only=True)
class FrictionEstimate:
    """What the slips say of a joint.

    Attributes
    ----------
    source : where the force was known from.
    normalised : whether inertia and forces are per inertia, the gains being unknown; ``stiffness`` then is ω².
    logarithms : of the parameters in the order of the fit, their covariance ``covariance`` with all that is known
        of misfit in it; shapes (6,), (6, 6).
    coulomb : kinetic friction; NaN per inertia. In one direction not identified: its value is then that without a load.
    load : constant torque against the controller [N·m], NaN if the motion has but one direction.
    coulomb_and_load : their sum against the motion [N·m], where this has but one direction; else NaN.
    slips : how many were fitted; aside : how many were left out because nothing explains them.
    mean_square : of the residuals in their errors, about 1. left_over : share of a slip that the model cannot
        explain, part of these errors; 0 if it explains all.
    scatter : standard deviation of the kinetic friction from slip to slip [N·m].
    mismatch : "" or what the model does not explain; the errors are the wider for it, and no parameter is identified.
    configured : whether the prior was a configured joint.
    law : friction law of these parameters. alternatives : other laws that the slips do not exclude; what they have
        otherwise is in the covariance too.
    drive : the controller's gains as the effort shows them, None where another source is used or it does not.
    dry : what the kinetic friction depends on beside the speed; None per inertia.
    friction_factor : factor of friction that varies with position or load; all parameters are then those of the worst
        place. None else.
    late : how late the controller acts, where that shows; the viscous friction told is then what is left of it at the
        latest gains. None else.
    may_be_late : whether a delay that does not show may take away more damping than friction gives. No parameter has
        that, so that no verdict that rests on them is sure.
    curvature : of viscous friction over speed, where it shows; the viscous friction told is then that at its speed.
    asymmetry : of Stribeck friction by direction, where it shows; the value is then that of the direction with more.
    contact : that yields before it breaks away, where slips show it; there is neither lag nor rise of static friction
        then. None else.
    """

    source: ForceSource
    normalised: bool
    logarithms: FloatArray
    covariance: FloatArray
    coulomb: ParameterEstimate
    load: ParameterEstimate
    coulomb_and_load: ParameterEstimate
    slips: int
    aside: int
    mean_square: float
    left_over: float
    scatter: float
    mismatch: str
    configured: bool
    law: str = PAPERS_LAW
    alternatives: tuple[LawAlternative, ...] = ()
    drive: DriveGains | None = None
    dry: DryFriction | None = None
    friction_factor: FrictionFactor | None = field(default=None, metadata={"key": "growth"})
    late: DelayEstimate | None = None
    may_be_late: bool = False
    curvature: Curvature | None = None
    asymmetry: Asymmetry | None = None
    contact: BristleContact | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters of such a joint: on a contact that yields it has no lag and no rise time."""
        if self.contact is None:
            return NAMES
        return (*(name for name in NAMES if name not in ("lag", "rise_time")), *_OF_CONTACT)

    def __getitem__(self, name: str) -> ParameterEstimate:
        """A parameter by its name; not estimated where it is none of :attr:`names`, nor :data:`COULOMB_AND_LOAD`."""
        if name in ("coulomb", COULOMB_AND_LOAD):
            return self.coulomb if name == "coulomb" else self.coulomb_and_load
        if name not in self.names:
            return NOT_ESTIMATED
        if name == "inertia" and self.normalised:
            return ParameterEstimate(value=1.0, std=0.0, identified=False)
        if self.contact is not None and name in _OF_CONTACT:
            value, error = (float(one[_OF_CONTACT.index(name)]) for one in (self.contact.values, self.contact.stds))
        else:
            index = FITTED.index(name)
            value = math.exp(self.logarithms[index])
            error = math.sqrt(max(float(self.covariance[index, index]), 0.0))
        if name == "viscous" and self.source is ForceSource.EFFORT and self.drive is not None:
            # The sum with k_v is known better, and verdicts rest on that.
            error = math.hypot(error, self.drive.late_damping / value)
        identified = error <= IDENTIFIED and not self.mismatch
        # Upwards, the longer way: a value far too low with a logarithm that is open is no more certain for being low.
        return ParameterEstimate(value=value, std=value * math.expm1(min(error, SPREAD_LIMIT)), identified=identified)

    @property
    def usable(self) -> bool:
        """Whether to believe it rather than a configured joint."""
        return self.left_over < _USABLE and self.aside <= USABLE_ASIDE * (self.slips + self.aside)

    @property
    def natural_frequency(self) -> ParameterEstimate:
        """ω [1/s] where the gains are unknown; NaN else, since it then depends on the gains."""
        if not self.normalised:
            return NOT_ESTIMATED
        value = math.exp(0.5 * self.logarithms[INERTIA])
        error = 0.5 * math.sqrt(max(float(self.covariance[INERTIA, INERTIA]), 0.0))
        return ParameterEstimate(value=value, std=value * error, identified=error <= IDENTIFIED and not self.mismatch)

    @property
    def unidentified(self) -> tuple[str, ...]:
        """Names of the parameters that the margin depends on and the data do not determine."""
        absent = ("coulomb", "inertia") if self.normalised else ("coulomb",)
        return tuple(name for name in self.names if name not in absent and not self[name].identified)

    @property
    def gains(self) -> Gains | None:
        """Per inertia the stiffness, ω², with all damping counted as friction; else None."""
        return Gains(stiffness=math.exp(self.logarithms[INERTIA])) if self.normalised else None

    def joint(self) -> Joint:
        """The joint as estimated; of inertia one where the gains are unknown."""
        joint = _joint(self.logarithms, self.coulomb.value, self.law, normalised=self.normalised)
        return joint if self.contact is None else self.contact.applied_to(joint)

    def draws(self) -> tuple[Joint, FloatArray]:
        """Joints as likely as the errors allow, as one of arrays, and the stiffness of each where that is estimated.

        The draws are always the same standard normal ones, so that what is computed from them is smooth.
        """
        values, vectors = np.linalg.eigh(self.covariance)
        root = vectors * np.sqrt(np.clip(values, 0.0, SPREAD_LIMIT**2))
        offsets = root @ _NORMAL
        logarithms = self.logarithms[:, None] + offsets
        joint = _joint(logarithms, max(self.coulomb.value, 0.0), self.law, normalised=self.normalised)
        if self.contact is not None:
            joint = self.contact.drawn(joint, offsets)
        return joint, np.exp(logarithms[INERTIA])

    def by_law(self) -> tuple[tuple[float, FrictionEstimate], ...]:
        """The estimate under each law that is not excluded, with the law's weight; its own first."""
        own = 1.0 - sum(other.weight for other in self.alternatives)
        others = (
            (
                other.weight,
                replace(
                    self,
                    law=other.law,
                    logarithms=other.logarithms,
                    covariance=other.covariance,
                    contact=other.contact,
                    alternatives=(),
                ),
            )
            for other in self.alternatives
        )
        return ((own, replace(self, alternatives=())), *others)

    def with_stiffness(self, stiffness: float, damping: float) -> FrictionEstimate:
        """The estimate in units of torque, from the gains in force; itself if it is in them already.

        Inertia is k_p/ω²; what of the damping the controller does not give is friction.
        """
        if not self.normalised or not stiffness > 0:
            return self
        others = tuple(_with_stiffness(other, stiffness, damping) for other in self.alternatives)
        return replace(_with_stiffness(self, stiffness, damping), normalised=False, alternatives=others)

    @property
    def is_a_guess(self) -> bool:
        """Whether nothing of the friction is known, not even roughly, nor configured."""
        known = [self[name] for name in NAMES[1:] if name != "coulomb"]
        return not self.configured and not any(one.std < _ROUGHLY * one.value for one in known)

    def _not_identified(self) -> str:
        """What is known of it roughly, and what is not known."""
        errors = {name: self[name].std / self[name].value for name in self.unidentified}
        roughly = [f"{name} ±{100.0 * error:.0f} %" for name, error in errors.items() if error < _ROUGHLY]
        text = f"; uncertain: {', '.join(roughly)}" if roughly else ""
        unknown = [name for name, error in errors.items() if not error < _ROUGHLY]
        prior = "the configured values" if self.configured else "default values"
        return f"{text}; not determined, {prior} used: {', '.join(unknown)}" if unknown else text

    def summary(self) -> str:
        """One sentence on what the estimate rests on."""
        text = f"friction estimated from {self.slips} slips ({_KNOWN[self.source]})"
        if self.unidentified and not self.mismatch:
            text += self._not_identified()
        if self.law != PAPERS_LAW:
            text += f"; law: {self.law}"
        if self.alternatives:
            others = " or ".join(f"{other.law} ({100 * other.weight:.0f} %)" for other in self.alternatives)
            text += f"; the law may also be {others}"
        for effect in (self.friction_factor, self.curvature, self.asymmetry, self.contact):
            if effect is not None:
                text += f"; {effect.text}"
        if self.may_be_late:
            text += "; viscous friction is nearly zero, or a delay of the controller cancels it"
        elif self.late is not None and self.late.missing_damping > 0.0:
            missing = self.late.missing_damping
            text += f"; the controller acts late: that removes {missing:.2g} N·m·s/rad more damping than friction adds"
        elif self.late is not None and self.late.delay > _SEEN * self.late.delay_std:
            text += f"; the controller acts {1000.0 * self.late.delay:.2g} ms late"
        if self.mismatch:
            text += f"; {self.mismatch}: do not trust the parameters"
        return text


def _with_stiffness(known: OfALaw, stiffness: float, damping: float) -> OfALaw:
    """The same with logarithms and covariance in units of torque, of those per inertia, with ω² for the inertia."""
    slopes, logarithms = np.eye(PARAMETERS), known.logarithms.copy()
    logarithms[INERTIA] = math.log(stiffness) - logarithms[INERTIA]
    slopes[INERTIA, INERTIA] = -1.0
    inertia = math.exp(logarithms[INERTIA])
    for index in (STRIBECK, VISCOUS):
        logarithms[index] += logarithms[INERTIA]
        slopes[index, INERTIA] = -1.0
    total = math.exp(logarithms[VISCOUS])
    viscous = total - damping
    error = math.sqrt(max(float(slopes[VISCOUS] @ known.covariance @ slopes[VISCOUS]), 1e-12)) * total
    viscous = max(viscous, LEAST_VISCOUS * error, 1e-6 * inertia)
    logarithms[VISCOUS] = math.log(viscous)
    slopes[VISCOUS] *= min(total / viscous, 1e3)
    return replace(known, logarithms=logarithms, covariance=slopes @ known.covariance @ slopes.T)


def _normal_draws() -> FloatArray:
    """Standard normal draws with exactly zero mean and unit covariance, shape (6, draws)."""
    draws = np.random.default_rng(43).standard_normal((PARAMETERS, DRAWS // 2))
    draws = np.concatenate([draws, -draws], axis=1)
    return np.asarray(np.linalg.solve(np.linalg.cholesky(draws @ draws.T / draws.shape[1]), draws))


_NORMAL = _normal_draws()


def _joint(logarithms: FloatArray, coulomb: float, law: str, *, normalised: bool) -> Joint:
    values: list[Real] = list(np.exp(logarithms)) if logarithms.ndim > 1 else np.exp(logarithms).tolist()
    return Joint(
        inertia=1.0 if normalised else values[INERTIA],
        friction=Friction(
            coulomb=max(coulomb, 0.0) if math.isfinite(coulomb) else 0.0,
            viscous=values[VISCOUS],
            stribeck=values[STRIBECK],
            stribeck_velocity=values[STRIBECK_VELOCITY],
            lag=values[LAG],
            rise_time=values[RISE_TIME],
            law=law,
        ),
    )
