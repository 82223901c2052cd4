# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Advised gains written to a controller while its joint moves: step by step, read back, watched, taken back."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

from rclpy.impl.rcutils_logger import RcutilsLogger

from stickslip_ros.errors import StickSlipError
from stickslip_ros.messages.gain_parameters import gain_name, gain_value
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.monitoring.advice.gain_ramp import GainRamp
from stickslip_ros.monitoring.advice.recommendation import Variant
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.monitoring.vitals import Vitals, vitals_of, what_got_worse
from stickslip_ros.nodes.gains.remote_parameters import RemoteParameters
from stickslip_ros.nodes.joints.watched_joint import WatchedJoint

_STEP_PERIOD = 0.1  # [s] at least from one step to the next
_RETREAT_PERIOD = 0.05  # [s]
_WATCH = 1.0  # [s] of motion that is looked at; gains that were in force so long ago are good
_LEAST_BASELINE = 2.0  # [s]
_LONGEST_BASELINE = 20.0
_CYCLES = 2.0  # of stick slip that the baseline has to cover
_BAND = 5.0  # times the natural frequency, up to which the motion is the joint's own
_LONGEST_ADVICE = 10.0  # [s] for advice on the gains in force
_SILENCE = 1.0  # [s] without a sample, from which on there is no watching
_REST = 10.0  # [s] at rest, after which the ramp is given up
_LONGEST_JUDGEMENT = 10.0  # [s] for the status after the ramp
_NEWS = 0.2  # [s] for a change of parameters to be told
_READS = 2  # an answer can be lost
_EQUAL = 1e-9

Script = Generator[None, None, None]


class StoppedError(StickSlipError):
    """The ramp was ended before its end; the text says why, and which gains are in force."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How it ended, for the answer and the diagnostics."""

    success: bool
    message: str


class GainApplication:
    """One joint's ramp. :meth:`tick` carries it on; it never waits.

    Parameters
    ----------
    watched : the joint, whose limits and permission count as they are at each step.
    controller : parameters of its controller. rate : relative change a second [1/s].
    allowed : whether gains still may be written.
    """

    def __init__(
        self,
        watched: WatchedJoint,
        controller: RemoteParameters,
        *,
        rate: float,
        allowed: Callable[[], bool],
        log: RcutilsLogger,
    ) -> None:
        self.joint = watched.name
        self._watched, self._monitor, self._controller = watched, watched.monitor, controller
        self._scale = watched.settings.gain_scale
        self._rate, self._allowed, self._log = rate, allowed, log
        self._now = 0.0
        self._target, self._reason = Gains(stiffness=math.nan), ""
        self._good: list[tuple[float, Gains]] = []  # verified gains, and when they came into force
        self._tried: list[Gains] = []
        self._heard_before: list[Gains] = []
        self._before: Vitals | None = None
        self._band = math.nan
        self.state = f"{self.joint}: beginning"
        self.outcome: Outcome | None = None
        self._script = self._run()

    def tick(self, now: float) -> Outcome | None:
        """Carry on; ``now`` is a steady time [s]. Returns the outcome once there is one."""
        self._now = now
        self._controller.poll(now)
        if self.outcome is None:
            try:
                next(self._script)
            except StopIteration:
                pass
            except StoppedError as stopped:
                self._finish(success=False, message=str(stopped))
        return self.outcome

    def stop(self, why: str) -> Outcome:
        """End the ramp where it is."""
        self._script.close()
        self._finish(success=False, message=f"{why}; {self._in_force()}")
        assert self.outcome is not None
        return self.outcome

    def _finish(self, *, success: bool, message: str) -> None:
        self.state = f"{self.joint}: {message}"
        self.outcome = Outcome(success=success, message=self.state)
        # Two lines of code: rclpy wants one severity from each.
        if success:
            self._log.info(f"apply_recommendation: {self.state}")
        else:
            self._log.error(f"apply_recommendation: {self.state}")

    def _run(self) -> Script:
        begin = yield from self._read()
        assessment, advised, joint = yield from self._advice_for(begin)
        self._target, self._reason = advised.gains, advised.reason
        for gains in (begin, self._target):
            self._check_bounds(gains)
        self._good.append((self._now, begin))
        self._heard_before = list(self._watched.gains_heard)
        self._begin_watch(assessment, joint, begin)
        ramp = GainRamp.between(joint, begin, self._target)
        was, share, steps = assessment.finding.status.value, 0.0, 0
        last = self._now
        while share < 1.0:
            yield from self._pause(last + _STEP_PERIOD - self._now)
            yield from self._wait_for_motion()
            state = self._monitor.assessment()
            share = ramp.next_share(
                share,
                rate=self._rate,
                elapsed=self._now - last,
                tracking_error=state.tracking_error,
                velocity_error=state.velocity_error,
            )
            steps, last = steps + 1, self._now
            yield from self._write(ramp.at(share), f"step {steps}, {100 * share:.0f} % of the way: {self._reason}")
            self.state = f"{self.joint}: {100 * share:.0f} % of the way to {self._text(self._target)}"
        yield from self._wait_for_a_verdict()
        status = self._monitor.finding().status.value
        way = f"from {self._text(begin)} to {self._text(self._target)} in {steps} steps"
        self._finish(success=True, message=f"{way}; it was {was}, it is {status}")

    def _wait_for_a_verdict(self) -> Script:
        """Watch on until the motion with the new gains can be judged."""
        until, settled = self._now + _LONGEST_JUDGEMENT, self._now + 2.0 * _WATCH
        cycles = self._monitor.cycle_count
        while self._now < until:
            yield from self._pause(_STEP_PERIOD)
            status = self._monitor.finding().status
            sticks = status is Status.STICK_SLIP and self._monitor.cycle_count >= cycles + _CYCLES
            if self._now >= settled and (sticks or status in (Status.SMOOTH, Status.AT_RISK)):
                return

    def _advice_for(self, begin: Gains) -> Generator[None, None, tuple[Assessment, Variant, Joint]]:
        """The advice for the gains in force, once the monitor has heard of these; and the joint that it is for."""
        until = self._now + _LONGEST_ADVICE
        while True:
            assessment = self._monitor.assessment()
            advised = assessment.recommended
            if assessment.gains is not None and _same(assessment.gains, begin) and advised is not None:
                break
            if self._now > until:
                raise StoppedError(f"there is no advice for the gains in force, {self._text(begin)}")
            yield
        if assessment.joint is None or not advised.found:
            raise StoppedError(advised.reason)
        return assessment, advised, assessment.joint

    def _check_bounds(self, gains: Gains) -> None:
        for name, value, (least, largest) in (
            ("p", float(gains.stiffness) / self._scale, self._watched.bounds("stiffness_range")),
            ("d", float(gains.damping) / self._scale, self._watched.bounds("damping_range")),
        ):
            slack = _EQUAL * max(abs(least), abs(value))
            if not least - slack <= value <= largest + slack:
                raise StoppedError(f"the gain {name} of {value:.4g} is outside {least:.4g} to {largest:.4g}")

    def _begin_watch(self, assessment: Assessment, joint: Joint, begin: Gains) -> None:
        stiffest = max(float(begin.stiffness), float(self._target.stiffness))
        self._band = _BAND * math.sqrt(stiffest / float(joint.inertia)) / (2.0 * math.pi)
        cycle = assessment.last_cycle
        longest = _CYCLES * cycle.period if cycle is not None else 0.0
        baseline = self._monitor.recent(min(max(_LEAST_BASELINE, longest), _LONGEST_BASELINE))
        self._before = vitals_of(baseline, self._band) if baseline is not None else None
        if self._before is None:
            raise StoppedError("there are no samples of the joint to watch it by")

    def _pause(self, duration: float) -> Script:
        """Watch for a while, at least once.

        Raises
        ------
        StoppedError
            If something speaks against going on; gains that were good are in force again then.
        """
        until = self._now + duration
        while True:
            yield
            if not self._allowed():
                raise StoppedError(f"allow_apply was set to false; {self._in_force()}")
            self._look_for_others()
            why = self._objection()
            if why:
                yield from self._retreat(why)
            if self._now >= until:
                return

    def _look_for_others(self) -> None:
        """End the ramp if the controller has told of gains that are not the ramp's, though they may be gone again."""
        ours = [gains for _, gains in self._good] + self._tried
        for heard in self._watched.gains_heard:
            if heard not in self._heard_before and not any(_same(heard, gains) for gains in ours):
                raise StoppedError(f"somebody else set {self._text(heard)} meanwhile; {self._in_force()}")

    def _objection(self) -> str:
        """Why the ramp should not go on, or ""."""
        if self._now - self._watched.heard > _SILENCE:
            return f"the joint has not been heard for {_SILENCE:g} s"
        recent = self._monitor.recent(_WATCH)
        if recent is None or self._before is None or not self._good:
            return ""
        softer = float(self._good[0][1].stiffness) / float(self._good[-1][1].stiffness)
        return what_got_worse(
            self._before,
            vitals_of(recent, self._band),
            softer=softer,
            resolution=self._monitor.resolution,
            effort_limit=self._watched.settings.options.limits.effort,
        )

    def _wait_for_motion(self) -> Script:
        """A joint at rest shows nothing: wait until it moves again."""
        until = self._now + _REST
        while self._monitor.finding().status is Status.AT_REST:
            if self._now > until:
                raise StoppedError(f"the joint has been at rest for {_REST:g} s; {self._in_force()}")
            yield from self._pause(_STEP_PERIOD)

    def _read(self) -> Generator[None, None, Gains]:
        """The gains in force."""
        names = [gain_name(self.joint, kind) for kind in ("p", "d")]
        values = None
        for _ in range(_READS):
            values = yield from self._ask(lambda then: self._controller.get(names, self._now, then))
            if values is not None:
                break
        if values is None:
            raise StoppedError(f"{self._controller.remote} does not answer; {self._in_force()}")
        stiffness, damping = (gain_value(value) for value in [*values, *values][:2])
        if not math.isfinite(stiffness):
            raise StoppedError(f"{self._controller.remote} has no gain {names[0]}; {self._in_force()}")
        return Gains(
            stiffness=self._scale * stiffness, damping=self._scale * (damping if math.isfinite(damping) else 0.0)
        )

    def _ask(self, ask: Callable[[Callable[[Any], None]], None]) -> Generator[None, None, Any]:
        answers: list[Any] = []
        ask(answers.append)
        while not answers:
            yield
        return answers[0]

    def _write(self, gains: Gains, why: str) -> Script:
        """Write gains, and read them back.

        Raises
        ------
        StoppedError
            If the controller does not take them as they are; the last ones that it took are in force then.
        """
        self._check_bounds(gains)
        old = self._good[-1][1]
        values = self._values(gains, old)
        if not values:
            return
        found = yield from self._read()
        if not _same(found, old):
            raise StoppedError(self._somebody_else(found, old))
        self._log.info(f"{self._controller.remote}: {self.joint} {self._text(old)} -> {self._text(gains)}: {why}")
        self._tried.append(gains)
        result = yield from self._ask(lambda then: self._controller.set(values, self._now, then))
        if result is not None and not result.successful:
            raise StoppedError(
                f"{self._controller.remote} refused {self._text(gains)}: {result.reason or 'no reason given'}; "
                f"{self._in_force()}"
            )
        found = yield from self._read()
        if _same(found, gains):
            self._good.append((self._now, gains))
            return
        if _same(found, old):
            silent = " did not answer and" if result is None else ""
            raise StoppedError(
                f"{self._controller.remote}{silent} took no notice of {self._text(gains)}; {self._in_force()}"
            )
        yield from self._put_back(gains, found)

    def _put_back(self, gains: Gains, found: Gains) -> Script:
        """The controller made something else of the gains: go back to those that it took."""
        old = self._good[-1][1]
        until = self._now + _NEWS
        while self._now < until:
            yield
        if any(_same(heard, gains) for heard in self._watched.gains_heard):
            # The controller had taken them, and told so, before it took others.
            raise StoppedError(self._somebody_else(found, gains))
        what = f"{self._controller.remote} made {self._text(found)} of {self._text(gains)}"
        self._log.warning(f"{what}; going back to {self._text(old)}")
        yield from self._ask(lambda then: self._controller.set(self._values(old, found), self._now, then))
        after = yield from self._read()
        if _same(after, old):
            raise StoppedError(f"{what}; {self._in_force()}")
        raise StoppedError(f"{what}, and {self._text(after)} of {self._text(old)}, which are in force now")

    def _somebody_else(self, found: Gains, ours: Gains) -> str:
        return f"somebody else set {self._text(found)} while the ramp was at {self._text(ours)}; they are left alone"

    def _retreat(self, why: str) -> Script:
        """Back to the last gains under which all was well for long enough, by the steps that led away from them."""
        settled = [index for index, (since, _) in enumerate(self._good) if self._now - since >= _WATCH]
        back_to = settled[-1] if settled else 0
        self._log.warning(f"{self.joint}: {why}; going back to {self._text(self._good[back_to][1])}")
        steps = [gains for _, gains in self._good[back_to:-1]]
        for gains in reversed(steps):
            yield from self._write(gains, f"taken back: {why}")
            until = self._now + _RETREAT_PERIOD
            while self._now < until:
                yield
        raise StoppedError(f"{why}; {self._in_force()}")

    def _values(self, gains: Gains, old: Gains) -> dict[str, float]:
        """The parameters that have to change, in the controller's units."""
        pairs = (("p", gains.stiffness, old.stiffness), ("d", gains.damping, old.damping))
        return {
            gain_name(self.joint, kind): float(new) / self._scale
            for kind, new, before in pairs
            if not math.isclose(float(new), float(before), rel_tol=_EQUAL, abs_tol=0.0)
        }

    def _in_force(self) -> str:
        if not self._good:
            return "no gains were changed"
        return f"the gains in force are {self._text(self._good[-1][1])}"

    def _text(self, gains: Gains) -> str:
        return f"p {float(gains.stiffness) / self._scale:.6g}, d {float(gains.damping) / self._scale:.6g}"


def _same(one: Gains, other: Gains) -> bool:
    return math.isclose(float(one.stiffness), float(other.stiffness), rel_tol=_EQUAL) and math.isclose(
        float(one.damping), float(other.damping), rel_tol=_EQUAL, abs_tol=1e-12
    )
