# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""How a joint is judged, everything known of it at one time, and what is predicted: its margin, advice, exact verdicts.

Advice and exact verdicts take milliseconds to seconds: a question says what they depend on, and when the answer to one
answers another.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model._validation import require_not_negative
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.dimensionless import damping_reserve, dimensionless_groups
from stickslip_ros.model.exact import exact_critical_damping_ratio
from stickslip_ros.model.friction import Gains, Joint, Real
from stickslip_ros.model.margin import StabilityMargin, stability_margin
from stickslip_ros.model.verdict import ExactVerdict, beyond_the_paper, verdict
from stickslip_ros.monitoring.advice.limits import AdviceLimits, Criterion, ObservedLoop
from stickslip_ros.monitoring.advice.recommendation import Advice, Kind, Recommendation, Variant, no_advice
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.detection.reversals import ReversalRecord
from stickslip_ros.monitoring.detection.status import Finding, Status
from stickslip_ros.monitoring.friction.change import FrictionChange
from stickslip_ros.monitoring.friction.estimate import FrictionEstimate
from stickslip_ros.monitoring.friction.presliding import PreslidingEstimate
from stickslip_ros.monitoring.ring import RingEstimate
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.monitoring.selected_model import SelectedModel, approximately_equal, select_model, uncertainty_of
from stickslip_ros.monitoring.uncertainty import Uncertainty, stick_slip_probability

_SPEEDS_APART = 0.1  # difference of the logarithms of two speeds at which a reserve is integrated, 1
_TOLERANCE = 5e-3  # error of a critical damping ratio, of it: no status changes with it
_COMPARABLE = 2.0  # ratio of speeds, up to which an answer is shown until the next is computed
# Relative differences, up to which an answer is kept.
_SAME_ADVICE_SPEED = 0.01  # changes the advised gains by less than they are printed to
_SAME_RATE = 0.05  # of the sample rate, which is estimated
_SAME_ERROR = 0.2  # of position and velocity errors, maxima that scatter from second to second, and of noise
# Slip of which nine of ten are found, counts and standard deviations of the noise (docs/detection.md).
_SEEN_COUNTS, _SEEN_NOISES = 15.0, 50.0
_STEP = 0.02  # step that a friction factor is rounded up to, 1
NOT_COMPUTED = ExactVerdict(smooth=None)
_SAME_SPEED = 0.02  # difference of two speeds, of the speed: within it an answer still holds
_SAME_GAINS = 0.01  # difference of two gains, of the gain: within it an answer still holds
_SEEN = 0.99  # probability of stick-slip that is detected, 1: of a hundred detections one may be false


@dataclass(frozen=True, kw_only=True, eq=False)
class AdviceQuestion:
    """What advice depends on: the arguments of :func:`stickslip_ros.monitoring.advice.recommend.recommend`.

    Attributes
    ----------
    velocity : commanded speed, not negative [rad/s].
    before : advice given before, which stands unless other gains are clearly better.
    """

    joint: Joint
    gains: Gains
    velocity: float
    limits: AdviceLimits
    uncertainty: Uncertainty | None
    loop: ObservedLoop
    gains_known: bool
    before: Recommendation | None = None

    def of_the_same_controller(self, other: AdviceQuestion) -> bool:
        """Whether gains and limits are the same, however friction and speed have changed."""
        return (
            self.gains_known == other.gains_known
            and (not self.gains_known or self.gains == other.gains)
            and self.limits == other.limits
            and self.loop.conditions == other.loop.conditions
        )

    def comparable(self, other: AdviceQuestion) -> bool:
        """Whether the answer to the one is of use until the other is answered: at speeds within a factor of two.

        A joint that stood still and moves now needs other gains than none.
        """
        slower, faster = sorted((abs(self.velocity), abs(other.velocity)))
        return self.of_the_same_controller(other) and faster <= _COMPARABLE * slower

    def similar(self, other: AdviceQuestion) -> bool:
        """Whether the answer to the one answers the other."""
        mine, its = self.loop, other.loop
        return (
            self.joint is other.joint
            and self.gains == other.gains
            and self.uncertainty is other.uncertainty
            and self.of_the_same_controller(other)
            and _near(self.velocity, other.velocity, _SAME_ADVICE_SPEED)
            and _near(mine.sample_rate, its.sample_rate, _SAME_RATE)
            and _near(mine.ring, its.ring, _SAME_RATE)
            and _near(mine.position_noise, its.position_noise, _SAME_ERROR)
            and _near(mine.velocity_noise, its.velocity_noise, _SAME_ERROR)
            and (
                math.isinf(self.limits.effort)
                or (
                    _near(mine.tracking_error, its.tracking_error, _SAME_ERROR)
                    and _near(mine.velocity_error, its.velocity_error, _SAME_ERROR)
                )
            )
        )


Adviser = Callable[[AdviceQuestion], Advice | None]


class MarginPrediction:
    """The selected model of a joint, its margin, and the advice that follows; :meth:`follow` gives what is known now.

    Parameters
    ----------
    adviser : answers questions for advice, or returns None as long as it is at work.

    Attributes
    ----------
    selected : joint and gains to compute with, None if they are not known; why_none : what is missing then.
    """

    def __init__(self, adviser: Adviser) -> None:
        self._adviser = adviser
        self._last: tuple[SelectedModel, float, StabilityMargin, tuple[float, float]] | None = None
        self._advised: tuple[AdviceQuestion, Advice] | None = None
        self._basis: tuple[FrictionEstimate | None, Joint | None, Gains | None, bool] | None = None
        self.selected: SelectedModel | None = None
        self.why_none = ""
        self._exact: ExactReserves | None = None

    def follow(
        self, estimate: FrictionEstimate | None, configured: Joint | None, gains: Gains | None, *, velocity_loop: bool
    ) -> None:
        """Keep the model until it changes by more than 1 %; parameters as of :func:`select_model`."""
        basis = (estimate, configured, gains, velocity_loop)
        if self._basis is not None and all(one is other for one, other in zip(self._basis, basis, strict=True)):
            return
        selected, self.why_none = select_model(estimate, configured, gains, velocity_loop=velocity_loop)
        if selected is None or self.selected is None or not approximately_equal(selected, self.selected):
            self.selected = selected
        self._basis = basis

    def margin(self, velocity: float) -> tuple[StabilityMargin | None, str]:
        """The margin at a velocity [rad/s], or None; and why there is none, or it does not apply."""
        if self.selected is None:
            return None, self.why_none
        if not math.isfinite(velocity):
            return None, "the commanded velocity is not known"
        margin, _ = self._at(self.selected, velocity)
        return margin, str(margin.reason or "")

    def uncertainty(self, velocity: float) -> tuple[float, float]:
        """Of the margin at a velocity [rad/s] the standard error [M x˙_s²], and how probable stick-slip is by Eq. (43).

        NaN where they are not known.
        """
        return (math.nan, math.nan) if self.selected is None else self._at(self.selected, velocity)[1]

    def _at(self, selected: SelectedModel, velocity: float) -> tuple[StabilityMargin, tuple[float, float]]:
        last = self._last
        # Many a speed is asked for again and again: that of the reference, and the mean of the last cycles.
        if last is None or last[0] is not selected or last[1] != velocity:
            margin = stability_margin(selected.joint, selected.gains, velocity)
            last = self._last = (selected, velocity, margin, uncertainty_of(margin, selected, velocity))
        return last[2:]

    def advise(
        self, selected: SelectedModel, velocity: float, limits: AdviceLimits, loop: ObservedLoop
    ) -> Advice | None:
        """Advice by the selected model, None while it is being computed."""
        if selected.no_advice:
            return no_advice(selected.no_advice, abs(velocity), limits, gains_known=selected.gains_known)
        question = AdviceQuestion(
            joint=selected.joint,
            gains=selected.gains,
            velocity=abs(velocity),
            limits=limits,
            uncertainty=selected.uncertainty,
            loop=loop,
            gains_known=selected.gains_known,
        )
        if self._advised is not None and self._advised[0].comparable(question):
            question = replace(question, before=self._advised[1].recommendation)
        advice = self._adviser(question)
        if advice is not None:
            self._advised = (question, advice)
        return advice

    def damping_reserves(
        self, velocities: FloatArray, condition: Criterion, conditions: OperatingConditions
    ) -> tuple[FloatArray, Criterion]:
        """Relative damping reserves ρ/ρ_c − 1 at velocities [rad/s], and by which condition; NaN where unknown."""
        reserves = np.full(len(velocities), np.nan)
        speeds = np.abs(velocities)
        known = np.isfinite(speeds) & (speeds > 0)
        selected = self.selected
        if selected is None or not known.any() or not selected.gains.stiffness > 0:
            return reserves, condition
        if condition is Criterion.PAPER and selected.of_the_paper:
            reserves[known] = stability_margin(
                conditions.at_constant_speed.applied_to(selected.joint), selected.gains, speeds[known]
            ).damping_reserve
            return reserves, condition
        reserves[known] = self.exact_reserves(selected, conditions).at(speeds[known])
        return reserves, Criterion.EXACT

    def exact_reserves(self, selected: SelectedModel, conditions: OperatingConditions) -> ExactReserves:
        """Damping reserves by integration; those of the last model and conditions are kept."""
        if self._exact is None or self._exact.model is not selected or self._exact.conditions != conditions:
            self._exact = ExactReserves(selected, conditions)
        return self._exact


class ExactReserves:
    """Damping reserves of a model by integration, interpolated between a few speeds at which it is made.

    An integration takes a millisecond or more, and there are many batches of samples a second. ``beyond_the_paper`` :
    whether integral action, sampled control or the like make it take longer still.
    """

    def __init__(self, model: SelectedModel, conditions: OperatingConditions) -> None:
        self.model, self.conditions = model, conditions
        self._joint = conditions.at_constant_speed.applied_to(model.joint)
        self.beyond_the_paper = beyond_the_paper(model.joint, model.gains, conditions)
        self._critical: dict[int, float] = {}  # critical damping ratios by the number of their speed

    @cached_property
    def _ratio(self) -> Real:
        return dimensionless_groups(self._joint, self.model.gains, 1.0).damping_ratio

    def at(self, speeds: FloatArray) -> FloatArray:
        """Relative damping reserves ρ/ρ_c − 1 at speeds [rad/s]."""
        places = np.log(speeds) / _SPEEDS_APART
        below = np.floor(places).astype(int)
        missing = [node for node in np.unique([below, below + 1]).tolist() if node not in self._critical]
        if missing:
            at = np.exp(_SPEEDS_APART * np.array(missing, dtype=float))
            groups = dimensionless_groups(self._joint, self.model.gains, at)
            found = np.asarray(exact_critical_damping_ratio(groups, tolerance=_TOLERANCE))
            self._critical.update(zip(missing, found.tolist(), strict=True))
        low, high = (np.array([self._critical[node] for node in nodes.tolist()]) for nodes in (below, below + 1))
        return np.asarray(damping_reserve(self._ratio, low + (places - below) * (high - low)))


def _near(one: float, other: float, share: float) -> bool:
    return abs(one - other) <= share * abs(other) or (math.isnan(one) and math.isnan(other))


@dataclass(frozen=True, kw_only=True)
class MonitorOptions:
    """How a joint is judged.

    Attributes
    ----------
    warn_margin : relative damping reserve ρ/ρ_c − 1 below which smooth motion is at risk.
    least_motion : motion must last so long before it is called smooth, if no period is known [s].
    learn : whether friction is learnt from the motion.
    memory : slips after which friction is learnt anew, at the latest.
    limits : what advice must reach and keep within.
    variant : which of the three variants of advice is recommended.
    conditions : load and sampled control, where advice is to satisfy the exact condition.
    trial : gains whose margin is wanted beside that of the present ones, or None.

    Raises
    ------
    InvalidParameterError
        If the memory is less than a slip, or margin or motion are negative or not finite.
    """

    warn_margin: float = 0.1
    least_motion: float = field(default=1.0, metadata={"unit": "s"})
    learn: bool = True
    memory: float = 100.0
    limits: AdviceLimits = field(default_factory=AdviceLimits)
    variant: Kind = Kind.LEAST_CHANGE
    conditions: OperatingConditions = field(default_factory=OperatingConditions)
    trial: Gains | None = None

    def __post_init__(self) -> None:
        require_not_negative("warn_margin", self.warn_margin)
        require_not_negative("least_motion", self.least_motion)
        if not self.memory >= 1.0:
            raise InvalidParameterError("memory", ">= 1 slip", self.memory)


@dataclass(frozen=True, kw_only=True)
class Assessment:
    """Everything known of a joint at one time.

    Attributes
    ----------
    finding : what the motion shows.
    time : of the last sample [s], NaN before any.
    velocity : commanded velocity, or the mean one where no reference is known [rad/s].
    velocity_source : "reference", "mean motion", "given" or "".
    gains : the controller's gains, None if unknown.
    margin : what Eq. (43) predicts, None if joint or gains are unknown.
    margin_reason : why there is no margin, or it does not apply; "" if it does.
    margin_std : standard error of the energy margin from those of the friction [M x˙_s²]; NaN if that is
        configured, not learnt.
    stick_slip_probability : that Eq. (43) predicts stick-slip, given these errors; NaN likewise.
    rests_on : where the friction comes from that the margin uses.
    uncertainty : of inertia and friction; None if these are configured.
    joint : inertia and friction that the margin uses; margin_gains : its gains, as the motion or the effort shows
        them where the controller's are unknown; per_inertia : whether both are, the effort being unknown too.
    position : of the last sample [rad]; mean_velocity : over the last tenths of a second [rad/s].
    estimate : what was learnt, None if nothing yet; change : its last abrupt one, None likewise.
    advice : None if joint or gains are unknown, or as long as it is being worked out; variant : of it, which is
        recommended.
    trial : gains on trial, None if there are none; trial_margin : what Eq. (43) predicts with them.
    tracking_error, velocity_error : largest of the last second [rad], [rad/s]; NaN without a reference.
    cycles : how many were counted; last_cycle : the latest one.
    resolution, noise : of the position [rad].
    sample_rate : [Hz].
    dropped : reasons for which samples were left out, and how many; blanked : the same of single values of samples.
    constant_effort : the one effort that there was while the joint moved, which counts as none [N·m]; else NaN.
    reference_follows : whether what is published as the reference only repeats what is measured, and does not count.
    restarts : how often stamps went back by so much, or for so long, that the motion was followed anew from there.
    reversals : what was seen of those in which the joint stood; None if there were none.
    presliding : how it gives way at rest, None of too few rests.
    ring : how it rings after its slips, None if it does not, or of too few rests.
    """

    finding: Finding
    time: float
    velocity: float
    velocity_source: str
    gains: Gains | None
    margin: StabilityMargin | None
    margin_reason: str
    margin_std: float
    stick_slip_probability: float
    rests_on: str
    uncertainty: Uncertainty | None
    joint: Joint | None
    margin_gains: Gains | None
    per_inertia: bool
    position: float
    mean_velocity: float
    estimate: FrictionEstimate | None
    change: FrictionChange | None
    advice: Advice | None
    variant: Kind
    trial: Gains | None
    trial_margin: StabilityMargin | None
    tracking_error: float
    velocity_error: float
    cycles: int
    last_cycle: Cycle | None
    resolution: float
    noise: float
    sample_rate: float
    dropped: dict[str, int]
    blanked: dict[str, int] = field(default_factory=dict)
    constant_effort: float = math.nan
    reference_follows: bool = False
    restarts: int = 0
    reversals: ReversalRecord | None = None
    presliding: PreslidingEstimate | None = None
    ring: RingEstimate | None = None

    @property
    def here(self) -> Joint | None:
        """The joint with the Stribeck friction of the present position and load; None where it is not known to vary.

        ``joint`` is as it is at the worst place. In steps of 2 %, so that what is computed from it is seldom anew.
        """
        friction_factor = self.estimate.friction_factor if self.estimate is not None else None
        if friction_factor is None or self.joint is None or self.uncertainty is None or math.isnan(self.position):
            return None
        factor = math.ceil(friction_factor.factor(self.position) / _STEP) * _STEP
        friction = replace(self.joint.friction, stribeck=factor * np.asarray(self.joint.friction.stribeck).item())
        return replace(self.joint, friction=friction)

    @property
    def least_slip_seen(self) -> float:
        """Slip from which on nine of ten are found [rad] (docs/detection.md); NaN where no resolution is known."""
        return max(_SEEN_COUNTS * self.resolution, _SEEN_NOISES * self.noise)

    @property
    def gains_known(self) -> bool:
        """Whether margin and advice are in gains of the controller's own; if not, advice is a factor."""
        return self.gains is not None and not self.per_inertia

    @property
    def recommendation(self) -> Recommendation | None:
        """The advice's gains, if there is advice."""
        return self.advice.recommendation if self.advice is not None else None

    @property
    def recommended(self) -> Variant | None:
        """The recommended variant, whether it holds gains or the reason why there are none."""
        variants = self.advice.recommendation.variants if self.advice is not None else ()
        return next((one for one in variants if one.kind is self.variant), None)

    @property
    def misfit_text(self) -> str:
        """Why gains and speeds that are advised are no more than a try: friction that was learnt, and does not fit; or
        "".
        """
        return self.estimate.mismatch if self.estimate is not None and self.uncertainty is not None else ""

    @property
    def advice_text(self) -> str:
        """The recommendation as a person reads it; "" without any."""
        if self.recommended is None:
            return ""
        if not self.misfit_text or not self.recommended.found:
            return self.recommended.reason
        return f"perhaps {self.recommended.reason}; {self.misfit_text}"

    @property
    def lowest_smooth_velocity(self) -> float:
        """With the present gains, by Eq. (43) [rad/s]; NaN if unknown."""
        return self.advice.lowest_smooth_velocity if self.advice is not None else math.nan


def as_seen(verdict: ExactVerdict, status: Status) -> ExactVerdict:
    """The verdict on the present gains at the present speed, beside the status of the motion: what is seen is probable.

    The probability that follows from the errors of friction is 0.3 beside many a joint that sticks all the time.
    """
    if status is not Status.STICK_SLIP or not verdict.stick_slip_probability < _SEEN:
        return verdict
    return replace(verdict, stick_slip_probability=_SEEN)


@dataclass(frozen=True, kw_only=True)
class ExactQuestion:
    """Whether a joint sticks and slips at a speed [rad/s], which is not negative, and how sure that is.

    ``uncertainty`` is that of the joint, None if it is given; it changes with the joint alone.
    """

    joint: Joint
    gains: Gains
    conditions: OperatingConditions
    speed: float
    uncertainty: Uncertainty | None = field(default=None, compare=False)

    @classmethod
    def on(cls, state: Assessment, gains: Gains | None, conditions: OperatingConditions) -> ExactQuestion | None:
        """The question on an assessed joint, with gains that need not be its own; None if it cannot be asked."""
        if state.joint is None or gains is None or not math.isfinite(state.velocity):
            return None
        return cls(
            joint=state.joint,
            gains=gains,
            conditions=conditions,
            speed=abs(state.velocity),
            uncertainty=state.uncertainty,
        )

    def verdict(self) -> ExactVerdict:
        """The answer, worked out."""
        answer = verdict(self.joint, self.gains, self.speed, self.conditions)
        if self.uncertainty is None or answer.smooth is None:
            return answer
        # Draws are integrated as rigid joints under continuous control.
        if self.conditions.controller_period > 0 or self.joint.transmission is not None:
            return answer
        probability = stick_slip_probability(self.uncertainty, self.gains, self.speed)
        return replace(answer, stick_slip_probability=probability)

    def of_the_same_controller(self, other: ExactQuestion) -> bool:
        """Whether conditions and gains are the same, the latter but for what learning makes of them per inertia."""
        pairs = [(getattr(self.gains, name), getattr(other.gains, name)) for name in vars(self.gains)]
        near = all(abs(float(one) - float(two)) <= _SAME_GAINS * abs(float(two)) for one, two in pairs)
        return near and self.conditions == other.conditions

    def at_the_same_speed(self, other: ExactQuestion) -> bool:
        """Whether the speeds are as good as the same."""
        return abs(self.speed - other.speed) <= _SAME_SPEED * other.speed

    def answers(self, other: ExactQuestion) -> bool:
        """Whether the answer to this one is as good as the other's own: they are about the same joint too."""
        return self.joint == other.joint and self.of_the_same_controller(other) and self.at_the_same_speed(other)
