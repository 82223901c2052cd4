# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Friction learnt while a joint runs: bounded in time and memory, watchful for changes.

A study fits the kept slips and takes up to seconds. A study is due after four slips, then whenever there are twice
as many slips, and may run in another process. Between two studies each new slip is compared with the estimate, in
milliseconds: slips that differ from it show that the friction has changed.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.linalg import LinAlgError

from stickslip_ros.model._friction_law import PAPERS_LAW, risen_level
from stickslip_ros.model.friction import Joint
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.drive import gains_in_slips
from stickslip_ros.monitoring.friction._window_kernel import RISE_TIME, STRIBECK
from stickslip_ros.monitoring.friction.change import FrictionChange, friction_change
from stickslip_ros.monitoring.friction.dry_friction import LEAST_OF_A_DIRECTION
from stickslip_ros.monitoring.friction.estimate import FrictionEstimate
from stickslip_ros.monitoring.friction.estimation import StudyQuestion, best_known
from stickslip_ros.monitoring.friction.fitted_law import of_law
from stickslip_ros.monitoring.friction.friction_factor import KnownFactor
from stickslip_ros.monitoring.friction.kept_slips import MOST_SLIPS, KeptSlips
from stickslip_ros.monitoring.friction.slip_data import SlipData, follows_on
from stickslip_ros.monitoring.friction.slip_fit import SlipFit, Tolerances, fit_at_fixed_parameters
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem
from stickslip_ros.monitoring.friction.slip_solution import OUTLIER
from stickslip_ros.monitoring.friction.slip_windows import SlipWindow
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.monitoring.study import OUTLIERS_IN_A_ROW, Learnt, stribeck_fraction, study

_FIRST_STUDY = 4  # slips before the first study, 1
_LAST_STUDY = 1.2  # slips, of those at the last study, at which one is due where no more come
_SHAPE_IS_KNOWN = 4  # slips studied, 1: from then on a study begins where the last one ended
# Time between slips like the last one that are learnt from, s; slips then, 1: one shows the level of the next.
_NOW_AND_THEN, _IN_A_ROW = 50.0, 5
_LIKE = 0.15  # difference of dwell, distance and duration, of each: with less two slips are similar
# Error of a slip's kinetic friction, standard deviations: with more the estimate does not explain the slip.
_FORCE_OUTLIER = 6.0
_OFF = 0.01  # misfit, of the slip distance: less is no change
_STEPS = 2.0  # misfit, steps of a controller's force: less is no change
_FORCE_OFF = 0.02  # error of the kinetic friction, of the Stribeck friction: less is no change
_WELL_STUDIED = 12  # slips of a study that is trusted, 1: at least
_LEVEL_ERROR = 0.03  # error of the logarithm of the level that a slip leaves for the next, 1: without the slips before


@dataclass(frozen=True, kw_only=True)
class LearnerMemory:
    """What a learner knows without the slips themselves: enough to go on from.

    Attributes
    ----------
    configured : joint that was the prior. learnt : by the last study.
    change : the last abrupt one, None if there was none.
    """

    configured: Joint | None
    learnt: Learnt | None
    change: FrictionChange | None


class FrictionLearner:
    """Learns one joint's friction.

    While a study is due or under way the slips that come after it wait for its result, so that what is learnt does
    not depend on how long studies take.

    Parameters
    ----------
    configured : prior, or None.
    memory : slips after which what fits is studied again at the latest.

    ``skipped`` counts slips that waited in vain because studies took too long; ``studied_in_vain`` those of the last
    study if it found nothing: none was usable, or no friction fits them.
    """

    def __init__(self, configured: Joint | None = None, memory: float = 100.0) -> None:
        self.configured = configured
        self.memory = memory
        self._begin()

    def _begin(self) -> None:
        """Know nothing."""
        self.estimate: FrictionEstimate | None = None
        self.change: FrictionChange | None = None
        self._kept = KeptSlips()
        self._state: Learnt | None = None
        self._outliers: list[SlipWindow] = []
        self._before_change: FrictionEstimate | None = None
        self._changed_at = math.nan
        self._seen = 0
        self._studied = 0
        self._last: Cycle | None = None
        self._wanted = self._in_a_row = 0
        self._due: StudyQuestion | None = None
        self._under_way = False
        self._waiting: deque[SlipWindow | None] = deque()  # None: no more slips came then
        self.skipped = 0
        self.studied_in_vain = 0

    def wants(self, cycle: Cycle) -> bool:
        """Whether there is something to learn from a slip: not if many like it came before, and one just now.

        Of friction that drifts every slip tells something.
        """
        last = self._last
        if (
            last is None
            or self._wanted < MOST_SLIPS
            or (self._state is not None and self._state.drifts)
            or self._kept.is_at_new_position(cycle)
            or abs(cycle.breakaway - last.breakaway) >= _NOW_AND_THEN
            or any(
                abs(float(getattr(cycle, name)) - float(getattr(last, name))) > _LIKE * abs(float(getattr(last, name)))
                for name in ("slip_distance", "slip_duration", "dwell")
            )
        ):
            self._last, self._in_a_row = cycle, _IN_A_ROW
        if self._in_a_row == 0:
            return False
        self._in_a_row -= 1
        self._wanted += 1
        return True

    def add_slip(self, window: SlipWindow) -> None:
        """Learn from a slip, in bounded time."""
        self._waiting.append(window)
        while len(self._waiting) > MOST_SLIPS:
            self.skipped += self._waiting.popleft() is not None
        self._learn_what_waits()

    def _learn_what_waits(self) -> None:
        """Take what came, in its order, until a study is due."""
        while self._waiting and self._due is None:
            window = self._waiting.popleft()
            if window is None:
                self._request_last_study()
            else:
                self._learn(window)

    def _learn(self, window: SlipWindow) -> None:
        self._seen += 1
        self._kept.add(window)
        # An estimate that does not explain the slips it is of says nothing of another.
        if self._state is not None and self._state.explains and not self._state.estimate.normalised:
            self._compare(window)
        more = self._studied
        if more >= MOST_SLIPS and self._state is not None and self._state.explains:
            # Once so many came, only slips unlike the last one are learnt from: they are counted from zero.
            more = max(more - MOST_SLIPS, _IN_A_ROW)
        self._request_study(self._studied + min(more, self.memory))

    def finish(self) -> None:
        """No more slips come for now: what came since the last study is worth another."""
        if not (self._waiting and self._waiting[-1] is None):
            self._waiting.append(None)
        self._learn_what_waits()

    def _request_last_study(self) -> None:
        """Make a study due where no more slips came, if there were enough since the last one.

        Every slip is once so many came that only slips unlike the last one are learnt from, and of friction that
        drifts: parameters are reported as they are at the last slip that was studied.
        """
        drifts = self._state is not None and self._state.drifts and self._studied > 0
        every = drifts or self._studied >= MOST_SLIPS
        self._request_study(self._studied + 1 if every else _LAST_STUDY * self._studied)

    def _request_study(self, slips: float) -> None:
        """Make a study due if so many slips were seen."""
        if self._seen < max(_FIRST_STUDY, slips):
            return
        chosen = best_known(self._kept.windows)
        if len(chosen) >= _FIRST_STUDY:
            start = self._start(chosen)
            state = None if start is None else self._state
            self._due = StudyQuestion(
                windows=chosen,
                configured=self.configured,
                start=start,
                rejected=() if state is None else state.rejected,
                yields=state is not None and state.contact is not None,
                bristles=None if state is None else state.bristles,
            )
            self._studied = self._seen

    def _start(self, windows: list[SlipWindow]) -> FloatArray | None:
        """Parameters from which a study of these slips may begin, once enough were studied to be sure of the shape."""
        state = self._state
        if state is None or self._studied < _SHAPE_IS_KNOWN or not state.estimate.usable:
            return None
        if windows[-1].source is not state.last_window.source:
            return None
        return of_law(PAPERS_LAW, state.parameters, state.estimate.law)

    @property
    def study_is_due(self) -> bool:
        """Whether there is something to study, and nobody does."""
        return self._due is not None and not self._under_way

    def wanted_study(self) -> StudyQuestion | None:
        """What to study, if a study is due; pass what :func:`study` makes of it to :meth:`adopt`."""
        if not self.study_is_due:
            return None
        self._under_way = True
        return self._due

    def adopt(self, learnt: Learnt | None) -> None:
        """Take over a study's result, or None if it found nothing or failed; then the slips that waited for it.

        What was begun before a reset comes to nothing.
        """
        if not self._under_way:
            return
        studied = len(self._due.windows) if self._due is not None else 0
        self.studied_in_vain = studied if learnt is None else 0
        self._due, self._under_way = None, False
        if len(self._outliers) >= OUTLIERS_IN_A_ROW and not (learnt is not None and learnt.explains_latest):
            # Nothing explains them beside the slips of before: neither where they were, nor a drift.
            self._begin_after_change()
            learnt = None
        self._outliers = []
        if learnt is not None and not (self.estimate is not None and self.estimate.usable > learnt.estimate.usable):
            self._state, self.estimate = learnt, learnt.estimate
            if self._before_change is not None and not learnt.estimate.mismatch:
                self.change = friction_change(self._before_change, learnt.estimate, self._changed_at)
                self._before_change = None
        self._learn_what_waits()

    def study_now(self) -> None:
        """Study here what is due."""
        while (question := self.wanted_study()) is not None:
            self.adopt(study(question))

    def memory_of(self) -> LearnerMemory:
        """What to remember beyond the end of the process."""
        return LearnerMemory(configured=self.configured, learnt=self._state, change=self.change)

    def restore(self, memory: LearnerMemory) -> bool:
        """Restore an earlier state; returns whether it is of use: not if another joint is configured by now."""
        if memory.configured != self.configured or memory.learnt is None:
            return False
        self._state, self.estimate, self.change = memory.learnt, memory.learnt.estimate, memory.change
        # The slips themselves are gone: a study of a few new ones must not take the place of what is known.
        self._seen, self._studied = 0, _WELL_STUDIED
        return True

    def reset(self) -> None:
        """Forget everything."""
        self._begin()

    def _compare(self, window: SlipWindow) -> None:
        """Simulate a slip by what is known: slips that differ may be of another friction."""
        state = self._state
        assert state is not None
        if window.source is not state.last_window.source:
            return
        if len(state.kinetic) == 1 and window.direction != state.last_window.direction:
            # Only a study of both directions tells the load from the Coulomb friction.
            if sum(one.direction == window.direction for one in self._kept.windows) >= LEAST_OF_A_DIRECTION:
                self._studied = 0
            return
        follows = follows_on(state.last_window, window)
        observed, model = window, state.model
        disturbance, friction_factor = state.position_disturbance, state.estimate.friction_factor
        # Of friction that varies from place to place each slip is made one at the worst.
        if friction_factor is not None:
            model = model.with_term(KnownFactor(factor=friction_factor.factor(window.rest_position)))
            window = friction_factor.applied(window)
        elif disturbance is not None:
            window = disturbance.applied(window)
        if state.contact is not None:
            if window.before is None or window.after is None:
                return
            window = window.between_creep()
        problem = SlipProblem(
            SlipData([window]),
            model,
            before=(state.last_window.arrest, state.stribeck_fraction) if follows else None,
            both_directions=len(state.kinetic) > 1,
        ).weighed(jitter=state.jitter, tolerance=state.tolerance)
        # A level to begin with, as Eq. (6) has it.
        left = state.stribeck_fraction if follows else 0.5
        share = float(risen_level(0.0, 1.0, problem.data.dwells[0], math.exp(state.parameters[RISE_TIME])))
        unknowns = problem.data.detected(math.exp(state.parameters[STRIBECK]) * (left + (1.0 - left) * share))
        try:
            with np.errstate(all="ignore"):
                fixed_fit = fit_at_fixed_parameters(
                    problem, Tolerances(balance=state.balance_error, level=max(_LEVEL_ERROR, state.link_error)),
                    parameters=state.parameters, kinetic=state.kinetic, unknowns=unknowns,
                )  # fmt: skip
        except LinAlgError:
            return
        if self._is_outlier(problem, fixed_fit, state):
            self._add_outlier(observed)
            return
        self._outliers = []
        estimate = state.estimate
        if estimate.drive is not None:
            # Somebody may turn the gains at the drive, which a study of slips before and after does not show.
            seen = gains_in_slips(problem, state.parameters, fixed_fit.unknowns)[-1]
            estimate = replace(estimate, drive=estimate.drive.followed_by(seen))
        self._state = replace(
            state, estimate=estimate, last_window=window, stribeck_fraction=stribeck_fraction(fixed_fit)
        )
        self.estimate = estimate

    def _is_outlier(self, problem: SlipProblem, fixed_fit: SlipFit, state: Learnt) -> bool:
        """Whether a slip differs from the estimate by more than the errors of both."""
        square = float(np.mean(fixed_fit.residuals**2))
        off = float(np.sqrt(np.mean((fixed_fit.residuals * problem.noise.errors) ** 2)))
        force = abs(float(fixed_fit.misfits[0]))
        level = math.exp(state.parameters[STRIBECK])
        # A controller that acts on samples begins each slip with some more or less of a step of its force.
        step = problem.loading_rate(state.parameters) * problem.data.sample_interval / level
        enough = max(_OFF, _STEPS * step if problem.may_be_late else 0.0) * float(problem.data.distances[0])
        return (square > OUTLIER * max(1.0, state.estimate.mean_square) and off > enough) or (
            force > _FORCE_OUTLIER * math.hypot(state.balance_error, _FORCE_OFF * level)
        )

    def _add_outlier(self, window: SlipWindow) -> None:
        """Keep a slip that the estimate does not explain; after several in a row a study decides what they are."""
        self._outliers.append(window)
        if len(self._outliers) < OUTLIERS_IN_A_ROW:
            return
        if self._studied < _WELL_STUDIED:
            # What was learnt from so few may simply be wrong.
            self._outliers = []
        elif len(self._kept) == len(self._outliers):
            self._begin_after_change()
            return
        self._studied = 0

    def _begin_after_change(self) -> None:
        """Learn from the outliers alone: the friction has changed abruptly."""
        self._changed_at = self._outliers[0].breakaway
        self.change = FrictionChange(time=self._changed_at, learning_anew=True, differences=())
        self._before_change, self.estimate, self._state = self.estimate, None, None
        self._kept = KeptSlips(self._outliers)
        self._seen, self._studied, self._outliers = len(self._kept), 0, []
        self._wanted = self._seen
