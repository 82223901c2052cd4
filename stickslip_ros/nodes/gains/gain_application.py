# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Gains changed in a controller while its joint moves: step by step, read back, watched, and restored.

During each wait, and once more immediately before each write, a ramp checks the permission, the joint's motion and
gains that others set. Withdrawn permission stops everything: nothing is written after it, not even to go back. The way
back leads to gains that were in force, so that no bounds prevent it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from rclpy.impl.rcutils_logger import RcutilsLogger

from stickslip_ros.errors import StickSlipError
from stickslip_ros.messages.gain_parameters import GainPair
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.advice.gain_ramp import GainRamp
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.closed_loop_health import ClosedLoopHealth, health_of, swing_of, what_got_worse
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.nodes.gains.gain_writer import (
    GainWriter,
    Script,
    SetByOthersError,
    Step,
    StoppedError,
    WithdrawnError,
)
from stickslip_ros.nodes.gains.remote_parameters import RemoteParameters
from stickslip_ros.nodes.kept_state import RampJournal, UnfinishedRamp
from stickslip_ros.nodes.watched_joints import WatchedJoint

_LOG_EVERY = 1.0  # time between two lines on the gains of a ramp, s: a ramp of minutes fills no log
_STEP_PERIOD = 0.1  # least time between two steps, s: the motion after a step is seen before the next
_RETREAT_PERIOD = 0.05  # time between two steps back, s: going back is urgent
_LONGEST_ADVICE = 10.0  # time until there is advice on the gains in force, s: exact advice takes seconds
_REST = 10.0  # time at rest after which a ramp ends, s: a joint at rest does not reveal the effect of gains
_JUDGEMENT = 10.0  # time until the status after a ramp is known, s, beside the cycles below
_CYCLES = 3.0  # number of cycles until that status is known, 1: stick-slip is a repeated motion
_LONGEST_JUDGEMENT = 60.0  # limit of that time, s: somebody waits for the answer
_WATCH = 1.0  # span of motion that is judged, s: gains that were in force for so long without objection are good
_SILENT_FOR = 1.0  # time without a sample, s: a joint that is silent for longer cannot be watched
_LEAST_BASELINE, _LONGEST_BASELINE = 2.0, 20.0  # span of the motion before the ramp, s: enough for a mean; still recent
_BASELINE_CYCLES = 2.0  # number of stick-slip cycles in that span, 1: their largest errors are then in it
_BAND = 5.0  # bandwidth of the joint's own motion, natural frequencies: faster motion is noise
_SWINGS = 2.0  # number of natural periods, 1: an unstable joint swings to and fro within them
_LONGEST_SWINGS = 5.0  # limit of their duration, s: instability has to be noticed soon
_RANK = {Status.SMOOTH: 0, Status.AT_RISK: 1, Status.STICK_SLIP: 2}

Bounds = Callable[[], tuple[tuple[float, float], tuple[float, float]]]


class MotionWatch:
    """Motion of a watched joint.

    Parameters
    ----------
    watched : the joint. clock : a steady time [s].
    """

    def __init__(self, watched: WatchedJoint, clock: Callable[[], float]) -> None:
        self._watched, self._monitor, self._clock = watched, watched.monitor, clock
        self._before: ClosedLoopHealth | None = None
        self._seen: tuple[float, float, float] | None = None  # inputs of the last objection
        self._objection = ""
        self._band = self._swings = math.nan

    def assessment(self) -> Assessment:
        """Present assessment of the joint."""
        return self._monitor.assessment()

    @property
    def status(self) -> Status:
        """Present status."""
        return self._monitor.finding().status

    @property
    def cycles(self) -> int:
        """Number of cycles so far."""
        return self._monitor.cycle_count

    def begin(self, begin: Gains, target: Gains) -> str:
        """Measure the present motion, as the reference of later motion; returns why it cannot be measured, or ""."""
        assessment = self._monitor.assessment()
        stiffnesses = [float(gains.stiffness) for gains in (begin, target)]
        inertia = float(assessment.joint.inertia) if assessment.joint is not None else math.nan
        slowest, fastest = (math.sqrt(k / inertia) / (2.0 * math.pi) for k in (min(stiffnesses), max(stiffnesses)))
        self._band = _BAND * fastest
        self._swings = min(max(_WATCH, _SWINGS / slowest), _LONGEST_SWINGS) if slowest > 0.0 else _WATCH
        cycle = assessment.last_cycle
        longest = _BASELINE_CYCLES * cycle.period if cycle is not None else 0.0
        self._seen = None
        self._before = self._health(min(max(_LEAST_BASELINE, self._swings, longest), _LONGEST_BASELINE))
        return "" if self._before is not None else "there are no samples of the joint to watch it by"

    def silence(self) -> str:
        """Sentence that no samples come any more, "" if they do."""
        if self._clock() - self._watched.heard > _SILENT_FOR:
            return f"the joint has not been heard for {_SILENT_FOR:g} s"
        return ""

    def objection(self, softer: float) -> str:
        """Why the gains should not be changed further, silence included, or "".

        Parameters
        ----------
        softer : stiffness before the ramp over the present one.
        """
        if silent := self.silence():
            return silent
        # This is called once more right before each write, seldom with a new sample.
        seen = (self._monitor.last_time, softer, self._watched.settings.options.limits.effort)
        if seen != self._seen:
            self._seen, self._objection = seen, self._what_got_worse(softer, effort_limit=seen[2])
        return self._objection

    def _what_got_worse(self, softer: float, effort_limit: float) -> str:
        recent = self._health(_WATCH)
        if self._before is None or recent is None:
            return ""
        resolution = self._monitor.resolution
        return what_got_worse(self._before, recent, softer=softer, resolution=resolution, effort_limit=effort_limit)

    def _health(self, duration: float) -> ClosedLoopHealth | None:
        recent = self._monitor.recent(duration)
        swinging = self._monitor.recent(max(duration, self._swings))
        if recent is None or swinging is None:
            return None
        return replace(health_of(recent, self._band), swing=swing_of(swinging, self._monitor.resolution))


class _WorseError(StoppedError):
    """The motion became worse with the gains in force."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Outcome of a ramp, for the answer and the diagnostics.

    Attributes
    ----------
    success : whether the joint is better, or has its former gains where these were requested.
    """

    success: bool
    message: str


@dataclass(frozen=True, kw_only=True)
class Target:
    """Target of a ramp: the gains, the way to them, and the reason."""

    gains: GainPair
    ramp: GainRamp
    reason: str


class GainApplication:
    """One joint's ramp to the advised gains, or back to former ones. :meth:`tick` continues it and never waits.

    Parameters
    ----------
    joint : its name. controller : parameters of its controller. watch : its motion. journal : of unfinished ramps.
    scale : one of the controller's units in SI units.
    bounds : of p and of d, in the controller's units, as they are now.
    rate : relative change a second [1/s].
    allowed : whether gains may be written.
    clock : a steady time [s].
    back_to : a ramp that was cut off, whose first gains are to be restored; None for a ramp to the advice.
    """

    def __init__(
        self,
        joint: str,
        controller: RemoteParameters,
        watch: MotionWatch,
        journal: RampJournal,
        *,
        scale: float,
        bounds: Bounds,
        rate: float,
        allowed: Callable[[], bool],
        clock: Callable[[], float],
        log: RcutilsLogger,
        back_to: UnfinishedRamp | None = None,
    ) -> None:
        self.joint = joint
        self._controller, self._watch, self._journal = controller, watch, journal
        self._scale, self._bounds, self._rate = scale, bounds, rate
        self._allowed, self._clock, self._log, self._back_to = allowed, clock, log, back_to
        self._was = watch.status
        self._withdrawn = self._running = False
        self._logged_at = -math.inf  # last line on the gains, on the clock
        self._writer = GainWriter(joint, controller, clock=clock, answered=self._go_on)
        self._target_gains: GainPair | None = None
        self._good: list[tuple[float, GainPair]] = []  # gains as read back, and when they came into force
        self._sent: GainPair | None = None
        self._bounded: GainPair | None = None  # gains being written, which have to be within the present limits
        self._watching = False  # the motion can be compared with that before
        self._returning = False  # the motion is no longer watched
        self.state = f"{joint}: beginning"
        self.outcome: Outcome | None = None
        self._script = self._run()
        self._at = Step.WAIT_BLINDLY

    def tick(self) -> Outcome | None:
        """Continue the ramp. Returns the outcome once there is one."""
        self._controller.poll(self._clock())
        self._go_on()
        return self.outcome

    def withdraw(self) -> None:
        """Withdraw the permission for good, even if it is given again at once."""
        self._withdrawn = True

    def stop(self, why: str) -> Outcome:
        """End the ramp where it is."""
        if self.outcome is None:
            self._script.close()
            if not self._writer.written and self._back_to is None:
                self._journal.end(self.joint)
            self._finish(success=False, message=f"{why}; {self._gains_text()}")
        assert self.outcome is not None
        return self.outcome

    def _go_on(self) -> None:
        if self.outcome is not None or self._running:
            return
        self._running = True
        try:
            self._advance()
        except StopIteration:
            pass
        except Exception as error:
            # The script has ended, and the outcome must be reported.
            self._finish(
                success=False,
                message=f"an error of the monitor itself: {type(error).__name__}: {error}; {self._gains_text()}",
            )
            raise
        finally:
            self._running = False

    def _advance(self) -> None:
        """Run the script to its next wait; what objects is raised where the script stands."""
        while True:
            try:
                if self._at is not Step.WAIT_BLINDLY:
                    self._check(permission_alone=self._at is Step.CHECK_PERMISSION)
            except StickSlipError as objection:
                self._at = self._script.throw(objection)
            else:
                self._at = next(self._script)
            if self._at in (Step.WAIT, Step.WAIT_BLINDLY):
                return

    def _finish(self, *, success: bool, message: str) -> None:
        self._writer.close()
        self.state = f"{self.joint}: {message}"
        self.outcome = Outcome(success=success, message=self.state)
        # Two lines of code: rclpy wants one severity from each.
        if success:
            self._log.info(f"apply_recommendation: {self.state}")
        else:
            self._log.error(f"apply_recommendation: {self.state}")

    def _run(self) -> Script[None]:
        success, text = False, ""
        stopped: StoppedError | None = None
        try:
            success, text = yield from self._lead()
        except StoppedError as error:
            stopped = error
        except StickSlipError as error:
            stopped = StoppedError(str(error))
        while stopped is not None:
            try:
                text = yield from self._after(stopped, text)
                stopped = None
            except StoppedError as error:
                stopped = error
        self._returning = True
        if not self._writer.silent:
            try:
                yield from self._writer.settled()
            except StoppedError as error:
                text += f"; {error}" if str(error) not in text else ""
        if not self._leaves_something_undone(success):
            self._journal.end(self.joint)
        self._finish(success=success, message=f"{text}; {self._writer.in_force() if success else self._gains_text()}")

    def _leaves_something_undone(self, success: bool) -> bool:
        """Whether the joint has gains of this ramp that are neither its former gains nor the target."""
        last, begin = self._writer.last, self._good[0][1] if self._good else None
        if success:
            return False
        if not self._writer.written or last is None or begin is None or self._target_gains is None:
            return self._back_to is not None
        if not self._writer.certain:
            return True
        goal = begin if self._back_to is None else self._target_gains
        return last.between(begin, self._target_gains) and not last.same(goal)

    def _gains_text(self) -> str:
        """Sentence on the gains before, those asked for, and those in force."""
        report = []
        if self._writer.written and self._good and self._target_gains is not None:
            report.append(f"before {self._good[0][1]}, asked {self._target_gains}")
        elif not self._writer.written:
            report.append("no gains were changed")
        report.append(self._writer.in_force())
        return "; ".join(report)

    def _lead(self) -> Script[tuple[bool, str]]:
        """Run the ramp; returns whether the joint is better, and the report."""
        begin = yield from self._writer.read()
        target = self._former(begin) if self._back_to is not None else (yield from self._advised(begin))
        self._target_gains = target.gains
        self._good.append((self._clock(), begin))
        if self._back_to is None:
            for gains in (begin, target.gains):
                self._check_bounds(gains)
        why_not = self._watch.begin(self._si(begin), self._si(target.gains))
        if why_not:
            raise StoppedError(why_not)
        self._watching = True
        before = self._watch.status if self._watch.status in _RANK else self._was
        if self._back_to is None:
            self._journal.begin(
                UnfinishedRamp(
                    joint=self.joint,
                    controller=self._controller.remote,
                    before=begin,
                    target=target.gains,
                    offset=target.ramp.offset / self._scale,
                )
            )
        self._logged_at = self._clock()
        self._log.info(
            f"{self.joint}: the gains of {self._controller.remote} go from {begin} to {target.gains}: {target.reason}"
        )
        steps = yield from self._climb(target)
        way = f"from {begin} to {target.gains} in {steps} steps"
        if self._back_to is not None:
            return True, f"back {way}"
        after = yield from self._judged()
        if after is None:
            return False, f"{way}; {before.value} before, and it cannot be judged yet whether that is better"
        return _RANK[after] < _RANK.get(before, 0), f"{way}; {before.value} before, {after.value} now"

    def _climb(self, target: Target) -> Script[int]:
        """Write all steps; returns their number."""
        share, steps, last = 0.0, 0, self._clock()
        while share < 1.0:
            yield from self._pause(last + _STEP_PERIOD - self._clock())
            if self._back_to is None:
                yield from self._wait_for_motion()
            state = self._watch.assessment()
            share = target.ramp.next_share(
                share,
                rate=self._rate,
                elapsed=self._clock() - last,
                tracking_error=state.tracking_error,
                velocity_error=state.velocity_error,
            )
            gains = target.gains if share >= 1.0 else GainPair.from_si(target.ramp.at(share), self._scale)
            self._bounded = gains if self._back_to is None else None
            steps, last = steps + 1, self._clock()
            yield from self._step(gains, f"{100 * share:.0f} % of the way")
            self.state = f"{self.joint}: {100 * share:.0f} % of the way to {target.gains}"
        return steps

    def _judged(self) -> Script[Status | None]:
        """The status with the new gains, None if it is not known in time.

        What dipped while the gains rose leaves a joint at risk for some cycles: that is the answer only if it remains.
        """
        begun, cycles = self._clock(), self._watch.cycles
        cycle = self._watch.assessment().last_cycle
        patience = min(_JUDGEMENT + (_CYCLES * cycle.period if cycle is not None else 0.0), _LONGEST_JUDGEMENT)
        while self._clock() - begun < patience:
            yield from self._pause(_STEP_PERIOD)
            status = self._watch.status
            # Two more cycles are stick-slip with the new gains, and not with those before.
            sticks = status is Status.STICK_SLIP and self._watch.cycles >= cycles + 2
            if self._clock() - begun >= 2.0 * _WATCH and (sticks or status is Status.SMOOTH):
                return status
        return Status.AT_RISK if self._watch.status is Status.AT_RISK else None

    def _advised(self, begin: GainPair) -> Script[Target]:
        """The advice for the gains in force, once the monitor has these."""
        until = self._clock() + _LONGEST_ADVICE
        while True:
            assessment = self._watch.assessment()
            advised, gains = assessment.recommended, assessment.gains
            if gains is not None and advised is not None and GainPair.from_si(gains, self._scale).same(begin):
                break
            if self._clock() > until:
                raise StoppedError(f"there is no advice for the gains in force, {begin}")
            yield Step.WAIT
        if assessment.joint is None or not advised.found:
            raise StoppedError(advised.reason)
        ramp = GainRamp.between(assessment.joint, self._si(begin), advised.gains)
        return Target(gains=GainPair.from_si(advised.gains, self._scale), ramp=ramp, reason=advised.reason)

    def _former(self, begin: GainPair) -> Target:
        """The target of a ramp back: the gains before the ramp that was cut off."""
        assert self._back_to is not None
        former = self._back_to.before
        ramp = GainRamp(begin=self._si(begin), end=self._si(former), offset=self._back_to.offset * self._scale)
        return Target(gains=former, ramp=ramp, reason="back to the gains before the ramp that was cut off")

    def _check_bounds(self, gains: GainPair) -> None:
        outside = self._outside(gains)
        if outside:
            raise StoppedError(outside)

    def _outside(self, gains: GainPair) -> str:
        """How gains are outside the present limits, "" if they are within."""
        for (kind, value), (least, largest) in zip(gains.values().items(), self._bounds(), strict=True):
            if not (least <= value <= largest or math.isclose(value, least) or math.isclose(value, largest)):
                return (
                    f"the gain {kind} of {value:.4g} is outside its limits {least:.4g} to {largest:.4g} "
                    f"(limits.{self.joint}.{kind}_min, {kind}_max)"
                )
        return ""

    def _step(self, gains: GainPair, why: str) -> Script[None]:
        """Replace the gains in force."""
        old = self._good[-1][1]
        if gains.same(old) and self._sent is None:
            return
        now = self._clock()
        if now - self._logged_at >= _LOG_EVERY:
            self._logged_at = now
            self._log.info(f"{self.joint}: {gains}: {why}")
        expected = [old] if self._sent is None else [old, self._sent]
        self._sent = gains
        yield from self._writer.write(gains, expected)
        self._sent = None
        self._good.append((self._clock(), gains))

    def _check(self, *, permission_alone: bool) -> None:
        """Check everything that may end the ramp, or the permission alone.

        Raises
        ------
        StoppedError
            If the ramp has to end.
        """
        if self._withdrawn or not self._allowed():
            raise WithdrawnError
        if permission_alone:
            return
        self._writer.check_for_others()
        if self._bounded is not None and not self._returning:
            self._check_bounds(self._bounded)
        if self._watching and not self._returning:
            # A ramp back may lead to gains with which the joint stuck.
            why = (
                self._watch.objection(softer=self._good[0][1].p / self._good[-1][1].p)
                if self._back_to is None
                else self._watch.silence()
            )
            if why:
                raise _WorseError(why)

    def _after(self, stopped: StoppedError, report: str) -> Script[str]:
        """Restore good gains after the ramp was stopped; returns the report."""
        returning, self._returning = self._returning, True
        report = f"{report}; " if report else ""
        if isinstance(stopped, SetByOthersError):
            return report + (yield from self._writer.restore(stopped.values))
        if isinstance(stopped, WithdrawnError) or returning or len(self._good) == 0:
            return f"{report}{stopped}"
        if isinstance(stopped, _WorseError):
            return report + (yield from self._go_back(str(stopped), self._settled_before()))
        outside = self._back_to is None and self._outside(self._good[-1][1])
        if outside and not self._writer.silent:
            within = [number for number, (_, gains) in enumerate(self._good) if not self._outside(gains)]
            return report + (yield from self._go_back(str(stopped), within[-1] if within else 0))
        return f"{report}{stopped}"

    def _settled_before(self) -> int:
        """Number of the last gains with which the joint moved well for long enough."""
        settled = [number for number, (since, _) in enumerate(self._good) if self._clock() - since >= _WATCH]
        return settled[-1] if settled else 0

    def _go_back(self, why: str, number: int) -> Script[str]:
        """Go back to the gains of a number, by the steps that led away from them; returns the report."""
        if len(self._good) - 1 > number or self._sent is not None:
            self._log.warning(f"{self.joint}: {why}; going back to {self._good[number][1]}")
        steps = [gains for _, gains in self._good[number : None if self._sent is not None else -1]]
        for gains in reversed(steps):
            try:
                yield from self._step(gains, "on the way back")
                yield from self._pause(_RETREAT_PERIOD)
            except StoppedError as stopped:
                if isinstance(stopped, SetByOthersError):
                    raise
                return f"{why}; on the way back {stopped}"
        return why

    def _pause(self, duration: float) -> Script[None]:
        """Check for a while, at least once."""
        until = self._clock() + duration
        while True:
            yield Step.WAIT
            if self._clock() >= until:
                return

    def _wait_for_motion(self) -> Script[None]:
        """Wait until the joint moves: a joint at rest does not reveal the effect of gains."""
        until = self._clock() + _REST
        while self._watch.status is Status.AT_REST:
            if self._clock() > until:
                raise StoppedError(f"the joint has been at rest for {_REST:g} s")
            yield from self._pause(_STEP_PERIOD)

    def _si(self, gains: GainPair) -> Gains:
        return gains.to_si(self._scale)
