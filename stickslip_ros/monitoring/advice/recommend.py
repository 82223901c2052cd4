# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Gains that would make the motion smooth: the least change of both, of damping alone, of stiffness alone.

A change is measured in logarithms: that of the stiffness k_p, which counts three times, and that of the damping of
controller and viscous friction together, k_v + F_v, of which what lies below a damping ratio of 0.01 counts as none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stickslip_ros.model.bisection import bisected
from stickslip_ros.model.bounds import TINY
from stickslip_ros.model.dimensionless import DimensionlessGroups, damping_reserve, dimensionless_groups
from stickslip_ros.model.exact import exact_critical_damping_ratio, exact_lowest_smooth_velocity
from stickslip_ros.model.extinction import critical_damping_ratio
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.loop_modes import loop_is_unstable
from stickslip_ros.model.margin import lowest_smooth_velocity, stability_margin
from stickslip_ros.model.outcome import Outcome, outcomes
from stickslip_ros.model.verdict import Detail, ExactVerdict, beyond_the_paper, verdict
from stickslip_ros.monitoring.advice.limits import (
    AdviceLimits,
    Criterion,
    ObservedLoop,
    criterion_for,
    crossover_frequency,
)
from stickslip_ros.monitoring.advice.recommendation import Kind, Recommendation, Variant, without_gains
from stickslip_ros.monitoring.advice.requirement import DRAWS_TOLERANCE, Requirement, SteadySliding
from stickslip_ros.monitoring.advice.resonance import damping_limits
from stickslip_ros.monitoring.advice.search import AdviceSearch, Condition, Obstruction
from stickslip_ros.monitoring.uncertainty import Uncertainty

_SEARCHES = 6  # at most, each with the factors of damping found at the ends of those before
_SAME_STIFFNESS = 0.03  # difference of logarithms: stiffnesses closer than this need the same factor of damping
# Raising the damping until the integration agrees.
_DAMPING_STEP, _DAMPING_STEPS = 1.25, 11  # factor of each step; steps: to ten times the damping
_BISECTIONS = 3  # of the last step: to 3 % of the damping
_MOST_DAMPING = 100.0  # factor on the damping that stands for no damping at all that would do at a stiffness
_STEADY_FACTORS = (0.97, 1.0, 1.1, 1.25)  # on the total damping, all to be steady: no lucky gains
_RESERVE_TOLERANCE = 1e-4  # relative, of the critical ratio in a reported reserve: below what is printed
# Difference of two changes (of logarithms: a tenth of a gain) from which on one is clearly less: then advice is
# replaced, and both gains are changed where one would do.
_CLEARLY_LESS = 0.1
_SEEN_BANDWIDTH = 2.0  # bandwidth, of the present one: resonances beyond this were hardly excited by the present gains


def recommend(
    joint: Joint,
    gains: Gains,
    velocity: float,
    limits: AdviceLimits | None = None,
    uncertainty: Uncertainty | None = None,
    loop: ObservedLoop | None = None,
    *,
    gains_known: bool = True,
    before: Recommendation | None = None,
) -> Recommendation:
    """Gains that reach the wanted margin within the limits, with the least change.

    With ``Criterion.PAPER`` the margin is that of Eq. (43), and if the integration of (4)-(6) refutes it, the exact
    condition is to hold besides; a joint of another friction law than the paper's is advised exactly. Integral action
    and sampled control count with ``Criterion.EXACT`` only; then gains are tried on a grid, which takes seconds.

    Parameters
    ----------
    joint, gains : scalars. velocity : commanded speed [rad/s].
    limits : defaults to AdviceLimits().
    uncertainty : the margin is to hold in the share ``limits.confidence`` of its draws, by the exact condition under
        laws other than the paper's; None for a joint known exactly.
    loop : defaults to none that matter.
    gains_known : False if the gains are per inertia: the advice then is in factors, and limits in units of gains or
        effort do not bind it.
    before : advice given before on the same controller. Its gains stand while they reach the wanted margin and no
        others change the present ones by clearly less: estimates move a little with every slip.
    """
    limits, loop = limits or AdviceLimits(), loop or ObservedLoop()
    if not gains_known:
        limits = limits.per_inertia()
    limits = replace(limits, condition=criterion_for(joint, limits.condition))
    exact = limits.condition is Criterion.EXACT
    slowest = abs(velocity) if limits.slowest_velocity is None else limits.slowest_velocity
    joint, uncertainty = loop.conditions.applied_to(joint), uncertainty and uncertainty.under(loop.conditions)
    # Too little damping is no obstacle to advice, however little it is.
    bounded = replace(gains, damping=max(float(gains.damping), -float(joint.own_damping(gains.stiffness))))
    if exact:
        present = verdict(joint, bounded, slowest, loop.conditions, detail=Detail.SMOOTH)
        obstacle = "" if present.smooth is not None or present.unstable else f"the model gives {present.reason}"
        if not obstacle and slowest == 0:
            obstacle = "the commanded velocity is zero, and no slowest velocity is given"
    else:
        margin = stability_margin(joint, bounded, slowest)
        obstacle = f"Eq. (43) is {margin.reason}" if not margin.applicable else ""
    if obstacle:
        return without_gains(f"no advice: {obstacle}", slowest, limits.condition, gains_known=gains_known)
    case = _Case(joint, gains, slowest, limits, loop, uncertainty, gains_known=gains_known)
    answer = case.recommendation(() if before is None else before.variants)
    if answer.keep or not joint.friction.of_the_paper or beyond_the_paper(joint, gains, loop.conditions):
        return answer
    other = replace(limits, condition=Criterion.EXACT)
    if exact:
        other = replace(limits, condition=Criterion.PAPER, steady_sliding=False)
    beside = _Case(joint, gains, slowest, other, loop, uncertainty, gains_known=gains_known).least_change()
    return replace(answer, beside=beside)


class _Case:
    """Advice on one joint: what its three variants share."""

    def __init__(
        self,
        joint: Joint,
        gains: Gains,
        slowest: float,
        limits: AdviceLimits,
        loop: ObservedLoop,
        uncertainty: Uncertainty | None,
        *,
        gains_known: bool,
    ) -> None:
        self._joint, self._gains, self._slowest, self._limits = joint, gains, slowest, limits
        self._loop, self._gains_known, self._learnt = loop, gains_known, uncertainty is not None
        self._exact = limits.condition is Criterion.EXACT
        self._critical_ratios: dict[float, float] = {}  # by stiffness [N·m/rad], beyond the paper's case
        self._beyond_paper = self._exact and beyond_the_paper(joint, gains, loop.conditions)
        # Exact draws take too long for a search: the search is for the joint itself, and the draws are evaluated at its
        # end, by every law that the data do not exclude. Eq. (43) is of the paper's law alone.
        self._requirement = Requirement(joint, slowest, limits, None if self._exact else uncertainty)
        laws = [] if uncertainty is None else [uncertainty, *uncertainty.others]
        exactly = replace(limits, condition=Criterion.EXACT)
        nominal = float(joint.total_damping(gains))
        self._damping_error = 0.0 if uncertainty is None else uncertainty.damping_error(gains, nominal)
        self._draws = [Requirement(joint, slowest, exactly, law) for law in (laws if self._exact else laws[1:])]
        self._steady = (
            SteadySliding(joint, self._requirement.speeds, laws, limits.confidence) if limits.steady_sliding else None
        )

    def _search(self) -> AdviceSearch:
        conditions: list[Condition] = [self._requirement, *([self._steady] if self._steady is not None else [])]
        return AdviceSearch(self._joint, self._gains, self._limits, self._loop, conditions, learnt=self._learnt)

    def least_change(self) -> Variant | None:
        """The first variant alone, by Eq. (43) whatever the integration says of it; None if there are no such gains."""
        search = self._search()
        gains = self._verified_gains(Kind.LEAST_CHANGE, search) if self._exact else search.least_change()
        return None if gains is None else self._variant(Kind.LEAST_CHANGE, gains, "")

    def recommendation(self, before: Sequence[Variant]) -> Recommendation:
        """All variants, or what is in the way; advice given before stands unless other gains are clearly better."""
        search = self._search()
        present = self._variant(Kind.LEAST_CHANGE, self._gains, "the present gains")
        answer = Recommendation(
            variants=(),
            velocity=self._slowest,
            condition=self._limits.condition,
            gains_known=self._gains_known,
            present=present,
            resonance=self._resonance(self._gains),
        )
        if search.reaches_margin(self._gains) and self._verified(self._gains):
            kept = [replace(present, kind=kind, reason="keep the gains: they have the wanted reserve") for kind in Kind]
            lowest = self._slowest_smooth(self._gains)
            return replace(answer, variants=tuple(kept), keep=True, slowest_smooth_velocity=lowest)
        variants = []
        for kind, gains in self._gains_of_kinds(search).items():
            previous = next((self._previous_gains(one) for one in before if one.kind is kind and one.found), None)
            if gains is not None and previous is not None and self._still_valid(previous, gains, search):
                gains = previous
            if gains is None:
                text = self._reason_without_gains(kind, search)
                variants.append(Variant(kind=kind, stiffness=math.nan, damping=math.nan, reason=text))
            else:
                variants.append(self._variant(kind, gains, ""))
        if variants[0].found:
            advised = variants[0].gains
            return replace(
                answer,
                variants=tuple(variants),
                slowest_smooth_velocity=self._slowest_smooth(advised),
                resonance=self._resonance(advised),
            )
        if self._beyond_paper and (self._joint.transmission is None or search.least_change() is not None):
            simulated = f"the {answer.resonance}" if answer.resonance else "this integral action and sampled control"
            text = f"no gains tried within the limits give smooth motion with {simulated}"
            variants[0] = replace(variants[0], reason=text)
            return replace(answer, variants=tuple(variants))
        obstruction = search.obstruction()
        lowest = self._slowest_smooth(obstruction.best) if obstruction.best is not None else math.nan
        variants[0] = replace(variants[0], reason=self._obstruction_text(obstruction, lowest))
        return replace(answer, variants=tuple(variants), obstruction=obstruction, slowest_smooth_velocity=lowest)

    def _gains_of_kinds(self, search: AdviceSearch) -> dict[Kind, Gains | None]:
        """Gains of each kind; one gain alone stands as the least change unless both change clearly less."""
        found = {kind: self._verified_gains(kind, search) for kind in Kind}
        both = found[Kind.LEAST_CHANGE]
        alone = [gains for kind, gains in found.items() if kind is not Kind.LEAST_CHANGE and gains is not None]
        least = min(alone, key=self._change, default=None)
        if least is not None and (both is None or self._change(least) - self._change(both) < _CLEARLY_LESS):
            found[Kind.LEAST_CHANGE] = least
        return found

    def _change(self, gains: Gains) -> float:
        return AdviceSearch.change(self._joint, self._gains, gains)

    def _verified_gains(self, kind: Kind, search: AdviceSearch) -> Gains | None:
        """Gains at the end of a search, once draws and integration agree with them; None without any."""
        search_of_kind = {
            Kind.LEAST_CHANGE: AdviceSearch.least_change,
            Kind.DAMPING_ONLY: AdviceSearch.damping_only,
            Kind.STIFFNESS_ONLY: AdviceSearch.stiffness_only,
        }[kind]
        factors: dict[float, float] = {}
        best: Gains | None = None
        for number in range(_SEARCHES):
            gains = search_of_kind(search.with_factors(factors))
            if gains is None:
                break
            place = search.place(gains)
            if self._verified(gains):
                best = gains
                if not factors or min(abs(place - known) for known in factors) < _SAME_STIFFNESS:
                    break
            elif number == 0 and not self._exact and self._steady is None:
                exact = replace(self._limits, condition=Criterion.EXACT, wanted_margin=0.0)
                search = search.with_requirement(Requirement(self._joint, self._slowest, exact))
                continue
            # Draws and integration are evaluated at the end of a search; the next search uses the factor found there.
            required = search.total_damping(float(gains.stiffness))
            least = self._least_total_damping(float(gains.stiffness), required)
            factors[place] = min(least / max(required, TINY), _MOST_DAMPING)
        return best

    def _previous_gains(self, variant: Variant) -> Gains:
        """Gains of advice given before; by what is independent of the inertia where the gains are not known."""
        if self._gains_known:
            return variant.gains
        stiffness = variant.stiffness_factor * float(self._gains.stiffness)
        total = variant.damping_time * stiffness
        return Gains(stiffness=stiffness, damping=total - float(self._joint.own_damping(stiffness)))

    def _still_valid(self, previous: Gains, found: Gains, search: AdviceSearch) -> bool:
        """Whether advice given before still holds, and is hardly a larger change than the gains found now."""
        return (
            self._change(previous) - self._change(found) < _CLEARLY_LESS
            and search.within_bounds(previous)
            and search.reaches_margin(previous)
            and self._verified(previous)
        )

    def _verified(self, gains: Gains) -> bool:
        """Whether draws and integration agree with gains."""
        return all(self._reaches(requirement, gains) for requirement in self._draws) and self._integration_agrees(gains)

    def _least_total_damping(self, stiffness: float, required: float) -> float:
        """Least total damping at a stiffness with which draws and integration agree [N·m·s/rad].

        It is at least ``required``, and infinite if not even ten times that will do.
        """
        own = float(self._joint.own_damping(stiffness))
        here = np.array([stiffness])
        needed = [float(one.damping(here, DRAWS_TOLERANCE)[0]) for one in self._draws]
        least = max([required, *(damping + own for damping in needed)])

        def enough(total: float) -> bool:
            return self._verified(Gains(stiffness=stiffness, damping=total - own))

        if not math.isfinite(least) or enough(least):
            return least
        inside = next(
            (least * _DAMPING_STEP**step for step in range(1, _DAMPING_STEPS) if enough(least * _DAMPING_STEP**step)),
            math.inf,
        )
        if math.isinf(inside):
            return inside
        inside, _ = bisected(enough, inside, inside / _DAMPING_STEP, _BISECTIONS)
        return inside

    def _reason_without_gains(self, kind: Kind, search: AdviceSearch) -> str:
        """Reason why damping or stiffness alone does not do."""
        if kind is Kind.LEAST_CHANGE or self._beyond_paper:
            return f"no {kind.value.split('_')[0]} alone was found"
        word = kind.value.split("_")[0]
        names = search.bounds_blocking_damping() if kind is Kind.DAMPING_ONLY else search.bounds_blocking_stiffness()
        text = f"no {word} alone gives the wanted reserve"
        return f"{text} within these limits: {', '.join(names)}" if names else text

    def _integration_agrees(self, gains: Gains) -> bool:
        """Whether the integration agrees: the joint is smooth, or steady, at every speed, with the margin if exact."""
        if self._beyond_paper:
            return self._integration_agrees_beyond_paper(gains)
        gains = replace(gains, integral=0.0)
        if self._exact and not self._reaches(self._requirement, gains):
            return False
        if self._steady is not None:
            # Steady with a little less damping, and with more: beside gains at which it happens to be.
            own = float(self._joint.own_damping(gains.stiffness))
            around = (float(gains.damping) + own) * np.array(_STEADY_FACTORS)[:, None] - own
            groups = dimensionless_groups(self._joint, replace(gains, damping=around), self._requirement.speeds)
            return bool(np.all(outcomes(groups).steady))
        groups = dimensionless_groups(self._joint, gains, self._requirement.speeds)
        # Where there is no answer there is nothing that would refute the margin.
        return not np.any(outcomes(groups).sticks)

    def _integration_agrees_beyond_paper(self, gains: Gains) -> bool:
        """Whether the integration agrees with integral action or sampled control, at the slowest speed."""
        if self._steady is not None and not self._reaches(self._steady, gains):
            return False
        own = float(self._joint.own_damping(gains.stiffness))
        # With the wanted margin less damping it is smooth and steady too, and with more it stays so.
        for factor in (1.0, 1.0 / (1.0 + self._limits.wanted_margin), _STEADY_FACTORS[-1]):
            damping = (float(gains.damping) + own) * factor - own
            trial = replace(gains, damping=damping, integral=self._gains.integral)
            # Friction may hold it at this speed; a larger error would run away.
            if loop_is_unstable(self._joint, trial, self._loop.conditions):
                return False
            outcome = self._verdict(trial, Detail.OUTCOME).outcome if self._steady is not None else None
            if outcome not in (Outcome.STEADY, None):
                return False
            # What ends in steady motion is smooth, and need not be integrated again.
            if outcome is None and not self._may_be_smooth(trial):
                return False
        return True

    def _may_be_smooth(self, gains: Gains) -> bool:
        answer = verdict(self._joint, gains, self._slowest, self._loop.conditions, detail=Detail.SMOOTH)
        return answer.smooth is not False and not answer.unstable

    @staticmethod
    def _reaches(condition: Condition, gains: Gains) -> bool:
        return bool(condition.reached(np.array([float(gains.stiffness)]), np.array([float(gains.damping)]))[0])

    def _verdict(self, gains: Gains, detail: Detail) -> ExactVerdict:
        """Verdict on these gains, and on the integral action of now if that counts."""
        gains = replace(gains, integral=self._gains.integral if self._beyond_paper else 0.0)
        conditions = self._loop.conditions if self._beyond_paper else None
        return verdict(self._joint, gains, self._slowest, conditions, detail=detail)

    def _variant(self, kind: Kind, gains: Gains, reason: str) -> Variant:
        joint, present = self._joint, self._gains
        margin = stability_margin(joint, replace(gains, integral=0.0), self._slowest)
        total, before = (float(joint.total_damping(one)) for one in (gains, present))
        noise, noise_before = (abs(float(one.damping)) for one in (gains, present))
        return Variant(
            kind=kind,
            stiffness=float(gains.stiffness),
            damping=float(gains.damping),
            reason=reason or self._change_text(gains),
            energy_margin=float(margin.energy_margin),
            reserve=self._reserve(gains),
            outcome=self._verdict(gains, Detail.OUTCOME).outcome,
            stiffness_factor=float(gains.stiffness) / float(present.stiffness),
            damping_factor=self._damping_factor(total, before),
            damping_time=total / float(gains.stiffness),
            change=self._change(gains),
            bandwidth=crossover_frequency(joint, gains),
            tracking_error_factor=float(present.stiffness) / float(gains.stiffness),
            noise_factor=noise / noise_before if noise_before > 0 else (1.0 if noise == 0 else math.inf),
        )

    def _damping_factor(self, total: float, before: float) -> float:
        """Total damping over that of before; NaN where two of its errors are more than the wanted reserve."""
        if total == before:
            return 1.0
        if 2.0 * self._damping_error > math.log1p(self._limits.wanted_margin):
            return math.nan
        return total / before if before > 0 else math.inf

    def _reserve(self, gains: Gains) -> float:
        groups = dimensionless_groups(self._joint, gains, self._slowest)
        return float(damping_reserve(float(groups.damping_ratio), self._critical_ratio(gains, groups)))

    def _critical_ratio(self, gains: Gains, groups: DimensionlessGroups) -> float:
        """ρ_c at the stiffness of these gains; beyond the paper's case it takes up to seconds."""
        if not self._exact:
            return float(critical_damping_ratio(groups))
        if not self._beyond_paper:
            return float(exact_critical_damping_ratio(groups, tolerance=_RESERVE_TOLERANCE))
        stiffness = float(gains.stiffness)
        found = self._critical_ratios.get(stiffness, math.nan)
        if math.isnan(found):
            found = self._critical_ratios[stiffness] = self._verdict(gains, Detail.BOUNDARY).critical_damping_ratio
        return found

    def _change_text(self, gains: Gains) -> str:
        total, before = (float(self._joint.total_damping(one)) for one in (gains, self._gains))
        parts = []
        for name, old, new, unit in (
            ("stiffness", float(self._gains.stiffness), float(gains.stiffness), "N·m/rad"),
            ("damping", float(self._gains.damping), float(gains.damping), "N·m·s/rad"),
        ):
            if abs(new - old) <= 1e-9 * max(abs(new), abs(old)):
                continue
            if self._gains_known:
                parts.append((("raise" if new > old else "lower"), f"the {name} from {old:.4g} to {new:.4g} {unit}"))
            elif name == "stiffness":
                parts.append(("", f"stiffness × {new / old:.3g}"))
            else:
                factor = self._damping_factor(total, before)
                known = 0.0 < factor < math.inf
                text = f"× {factor:.3g}" if known else f"of {total / float(gains.stiffness):.3g} s times the stiffness"
                parts.append(("", f"damping {text} (controller's and joint's together)"))
        if len(parts) == 2 and parts[0][0] == parts[1][0]:
            parts[1] = ("", parts[1][1])
        return " and ".join(f"{verb} {text}".strip() for verb, text in parts)

    def _resonance(self, gains: Gains) -> str:
        limits = damping_limits(self._joint, self._loop.conditions)
        if limits is not None:
            return f"resonance {limits.in_words(gains)}"
        present, advised = (crossover_frequency(self._joint, one) for one in (self._gains, gains))
        # What rings is known.
        if advised <= _SEEN_BANDWIDTH * present or self._limits.bandwidth < math.inf or self._loop.ring > 0.0:
            return ""
        return (
            f"unknown resonance, which these gains may excite: they raise the bandwidth from {present:.3g} to "
            f"{advised:.3g} rad/s; with the encoder on the load they may excite one far above that"
        )

    def _slowest_smooth(self, gains: Gains) -> float:
        gains = replace(gains, integral=0.0)
        if self._beyond_paper:
            return math.nan
        return float((exact_lowest_smooth_velocity if self._exact else lowest_smooth_velocity)(self._joint, gains))

    def _obstruction_text(self, obstruction: Obstruction, lowest: float) -> str:
        wanted = "steady motion with the wanted reserve" if self._steady is not None else "the wanted reserve"
        text = f"no gains within the limits give {wanted} at {self._slowest:.3g} rad/s: {obstruction.text}"
        if obstruction.best is None:
            return text
        best = obstruction.best
        if self._gains_known:
            text += f"; the best within the limits is stiffness {float(best.stiffness):.4g} N·m/rad with damping "
            text += f"{float(best.damping):.4g} N·m·s/rad"
        else:
            text += f"; the best within the limits is {self._change_text(best) or 'the present gains'}"
        text += f", {_percent(obstruction.reserve)}"
        if 0 < lowest < math.inf:
            text += f"; with it there is no stick-slip at {lowest:.3g} rad/s and faster"
        return text


def _percent(reserve: float) -> str:
    if reserve >= 0:
        return f"with a damping reserve of {100 * reserve:.0f} %"
    return f"where {-100 * reserve:.0f} % of the damping needed is missing"
