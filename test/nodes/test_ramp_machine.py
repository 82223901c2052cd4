# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 20: whatever controller, joint, people and permission do, a ramp keeps to its rules.

`python test/nodes/test_ramp_machine.py 1000000` takes so many steps by hand.
"""

from __future__ import annotations

import math
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import pytest
from conftest import nightly
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule, run_state_machine_as_test
from late_controller import LateController

from stickslip_ros.messages.gain_parameters import GainPair
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.nodes.gains.gain_application import GainApplication, Outcome
from stickslip_ros.nodes.kept_state import RampJournal, UnfinishedRamp
from stickslip_ros.settings.known_joints import load_joint

pytestmark = pytest.mark.slow

TICK = 0.02  # [s], that of the monitor
PATIENCE = 2.0  # [s] for one answer
JOINT = load_joint("puma560_joint1").joint
_QUICK = 0.05  # [s]
_SILENT = "the joint has not been heard for 1 s"
TARGET = GainPair(3820.0, 26.4)


@dataclass
class Motion:
    """What a monitor would see of the joint, in the gains' own units."""

    controller: LateController
    status: Status = Status.STICK_SLIP
    cycles: int = 5
    complaint: str = ""

    def assessment(self) -> Any:
        """Advice for the gains in force, whatever these are."""
        gains = Gains(stiffness=self.controller.gains["p"], damping=self.controller.gains["d"])
        advised = SimpleNamespace(found=True, gains=TARGET.to_si(1.0), reason="raise the stiffness")
        return SimpleNamespace(
            gains=gains, recommended=advised, joint=JOINT, last_cycle=None, tracking_error=math.nan,
            velocity_error=math.nan,
        )  # fmt: skip

    def begin(self, begin: Gains, target: Gains) -> str:
        """Every motion will do."""
        return ""

    def silence(self) -> str:
        """Of what the test says, that nothing is heard."""
        return self.complaint if self.complaint == _SILENT else ""

    def objection(self, softer: float) -> str:
        """What the test says."""
        return self.complaint


class Silent:
    """A log that nobody reads."""

    def info(self, message: str) -> None:
        """Drop it."""

    warning = error = info


class RampMachine(RuleBasedStateMachine):
    """A ramp, its controller, its joint, other people and the permission; every rule is one of their moves."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = TemporaryDirectory()
        self.journal = RampJournal(Path(self.folder.name) / "ramps.json")
        self.controller = LateController({"p": 630.0, "d": 0.0})
        self.controller.on_set = self._check_what_is_sent
        self.motion = Motion(self.controller)
        self.allowed = True
        self.bounds = ((0.0, 10000.0), (0.0, 300.0))
        self.ramp: GainApplication | None = None
        self.outcome: Outcome | None = None
        self.withdrawn_at = math.inf
        self.first_request = self.first_effect = 0
        self.complained_at = math.inf
        self.awake = 0.0  # [s] that the monitor has had a processor since something should have ended the ramp
        self.in_between: float | None = None
        self.restoring = False  # goes back to gains that were in force
        self.upset = False  # what the controller did makes some promises void

    def teardown(self) -> None:
        """Whatever was under way ends in bounded time."""
        if self.ramp is not None and self.outcome is None:
            self.motion.complaint = _SILENT
            self._pass(60.0)
            assert self.outcome is not None, self.ramp.state
        self.folder.cleanup()

    def _begin(self, back_to: UnfinishedRamp | None = None) -> None:
        self.outcome, self.restoring = None, back_to is not None
        self.withdrawn_at = self.complained_at = math.inf
        self.awake = 0.0
        self.first_request, self.first_effect = len(self.controller.requests), len(self.controller.effects)
        self.upset = self.controller.mode != "takes" or max(self.controller.busy, self.controller.delay[1]) > _QUICK
        self.ramp = GainApplication(
            "joint1", self.controller, self.motion, self.journal, scale=1.0, bounds=lambda: self.bounds, rate=0.3,
            allowed=self._may, clock=lambda: self.controller.now, log=Silent(), back_to=back_to,
        )  # fmt: skip

    def _check_what_is_sent(self, values: dict[str, float]) -> None:
        """It is within the limits, or between gains that were in force: the way back needs no limits."""
        for kind, value in values.items():
            largest = self.bounds[("p", "d").index(kind)][1]
            was = {e.before[kind] for e in self.controller.effects} | {
                e.values[kind] for e in self.controller.effects if kind in e.values
            }
            assert 0.0 <= value <= largest or min(was) <= value <= max(was)
        if self.in_between is not None and self.controller.mode != "dead":
            self.controller.others_set({"p": self.in_between})
            self.in_between = None

    def _may(self) -> bool:
        return self.allowed

    def _pass(self, duration: float) -> None:
        until = self.controller.now + duration
        while self.controller.now < until:
            self.controller.run(min(self.controller.now + TICK, until))
            if not self.controller.stalled and min(self.withdrawn_at, self.complained_at) < self.controller.now:
                self.awake += TICK
            if self.ramp is not None and self.outcome is None and not self.controller.stalled:
                self.outcome = self.ramp.tick()
                if self.outcome is not None:
                    self._check_the_end(self.outcome)

    @rule(duration=st.sampled_from([0.0005, 0.02, 0.1, 0.5]))
    def time_passes(self, duration: float) -> None:
        """The monitor ticks."""
        self._pass(duration)

    @rule(duration=st.sampled_from([0.5, 2.0, 5.0]))
    def more_time_passes(self, duration: float) -> None:
        """It goes on ticking."""
        self._pass(duration)

    @rule(duration=st.sampled_from([0.1, 1.0, 5.0]))
    def the_monitor_has_no_processor(self, duration: float) -> None:
        """What comes meanwhile comes at once afterwards."""
        self.upset = self.upset or duration > PATIENCE
        self.controller.stalled = True
        self._pass(duration)
        self.controller.stalled = False
        self._pass(TICK)

    @precondition(lambda self: self.ramp is None or self.outcome is not None)
    @rule(all_is_well=st.sampled_from([True, True, False]), lead=st.sampled_from([0.0, 1.0, 3.0]))
    def somebody_asks(self, all_is_well: bool, lead: float) -> None:
        """A new ramp to the advice."""
        if all_is_well:
            self.allowed, self.motion.complaint, self.motion.status = True, "", Status.STICK_SLIP
            self.controller.mode, self.controller.delay = "takes", (0.001, 0.001)
            self.bounds = ((0.0, 10000.0), (0.0, 300.0))
            self.controller.others_set({"p": 630.0, "d": 0.0})
            self._pass(5.0)
        if self.allowed:
            self._begin()
            self._pass(lead)

    @precondition(lambda self: self.ramp is not None and self.outcome is None)
    @rule(status=st.sampled_from([Status.SMOOTH, Status.SMOOTH, Status.AT_RISK, Status.STICK_SLIP]))
    def all_goes_on_as_it_is(self, status: Status) -> None:
        """To the end, whatever that is."""
        self._pass(12.0)
        self.motion.status = status
        self.motion.cycles += 3
        self._pass(5.0)

    @precondition(lambda self: self.ramp is not None and self.outcome is None)
    @rule()
    def permission_blinks(self) -> None:
        """Withdrawn and given again between two ticks."""
        self.permission_is_withdrawn()
        self.permission_is_given()

    @precondition(lambda self: self.ramp is not None and self.outcome is None)
    @rule(p=st.sampled_from([630.0, 1000.0, 5000.0]))
    def somebody_else_sets_in_between(self, p: float) -> None:
        """After the ramp's question was answered, before its next write arrives."""
        self.in_between = p
        self._pass(0.5)
        self.in_between = None

    @precondition(lambda self: self.ramp is not None and self.outcome is None)
    @rule(then=st.booleans())
    def the_monitor_is_killed(self, then: bool) -> None:
        """The next one reads the journal; the way back is offered, not begun."""
        assert self.ramp is not None
        written = len(self.controller.requests) > self.first_request
        self.controller.forget_the_one_who_asks()
        self.ramp = None
        self.journal = RampJournal(Path(self.folder.name) / "ramps.json")
        assert self.journal.trouble == ""
        assert not written or "joint1" in self.journal
        requests = len(self.controller.requests)
        self._pass(1.0)
        assert len(self.controller.requests) == requests
        if then and self.allowed and "joint1" in self.journal:
            self._begin(self.journal["joint1"])

    @rule(delays=st.tuples(*[st.sampled_from([0.001, 0.001, 0.05, 0.6, 1.2, 4.0])] * 2), news=st.floats(0.001, 0.05))
    def the_controller_is_as_late_as(self, delays: tuple[float, float], news: float) -> None:
        """From now on."""
        self.controller.delay, self.controller.news = delays, news
        self.upset = self.upset or max(delays) > _QUICK

    @rule(mode=st.sampled_from(["takes", "takes", "takes", "refuses", "clamps", "ignores", "dead"]))
    def the_controller(self, mode: str) -> None:
        """Takes what it is told, or not."""
        self.controller.mode = mode
        self.upset = self.upset or mode != "takes"

    @rule(p=st.sampled_from([None, 630.0, 1000.0, 5000.0]), d=st.sampled_from([None, 0.0, 3.0, 40.0]))
    def somebody_else_sets(self, p: float | None, d: float | None) -> None:
        """Gains of their own, perhaps those of before."""
        values = {kind: value for kind, value in (("p", p), ("d", d)) if value is not None}
        if values and self.controller.mode != "dead":
            self.controller.others_set(values)

    @rule()
    def permission_is_withdrawn(self) -> None:
        """As a parameter is set: between two ticks."""
        if self.allowed and self.ramp is not None and self.outcome is None:
            self.withdrawn_at = min(self.withdrawn_at, self.controller.now)
            self.ramp.withdraw()
        self.allowed = False

    @rule()
    def permission_is_given(self) -> None:
        """Which does not bring back what was withdrawn."""
        self.allowed = True

    @rule(largest=st.sampled_from([700.0, 1500.0, 10000.0, 10000.0]))
    def the_limits_change(self, largest: float) -> None:
        """Of p."""
        self.bounds = ((0.0, largest), (0.0, 300.0))

    @rule(complaint=st.sampled_from(["", "an oscillation began", _SILENT]))
    def the_joint_gets_worse(self, complaint: str) -> None:
        """Or well again."""
        self.motion.complaint = complaint
        if not complaint:
            # What was over before anybody looked ends nothing.
            self.complained_at = math.inf
        elif self.ramp is not None and self.outcome is None and (not self.restoring or complaint == _SILENT):
            self.complained_at = min(self.complained_at, self.controller.now)

    @rule(status=st.sampled_from([Status.STICK_SLIP, Status.AT_RISK, Status.SMOOTH, Status.NOT_JUDGED, Status.AT_REST]))
    def the_joint_is(self, status: Status) -> None:
        """As the monitor says."""
        self.motion.status = status
        self.motion.cycles += 3

    @invariant()
    def nothing_is_sent_after_a_withdrawal(self) -> None:
        """Whatever the controller's delay, and not even if the permission is given again."""
        assert all(time <= self.withdrawn_at for time, _ in self.controller.requests[self.first_request :])

    @invariant()
    def the_steps_are_small(self) -> None:
        """But for what puts back what others set, and what was under way already when they did."""
        others = {v for e in self.controller.effects if e.by == "other" for v in e.values.values()}
        for effect in self.controller.effects[self.first_effect :]:
            if (
                effect.by == "ramp"
                and "p" in effect.values
                and others.isdisjoint((effect.values["p"], effect.before["p"]))
            ):
                assert abs(math.log(effect.values["p"] / effect.before["p"])) < 0.0801

    def _check_the_end(self, outcome: Outcome) -> None:
        now, message = self.controller.now, outcome.message
        effects = self.controller.effects[self.first_effect :]
        sent = len(self.controller.requests) > self.first_request
        # It ends soon after what ends it.
        assert self.upset or self.awake < 12.0, message
        # It says what is in force.
        if not outcome.success:
            told = "before p" in message and "asked p" in message
            assert told if sent else "no gains were changed" in message, message
        age = float((re.findall(r"as read ([\d.]+) s ago", message) or ["0"])[0])
        if ", as read" in message:
            said = message.rpartition("the gains in force are ")[2].partition(", as read")[0]
            states = [str(GainPair(**self.controller.gains))]
            states += [str(GainPair(**e.before)) for e in self.controller.effects if e.time >= now - age - PATIENCE]
            assert said in states, message
        elif not self.upset:
            raise AssertionError(f"it does not say what is in force: {message}")
        # Success is what it says.
        judged = re.search(r"; (\w+) before, (\w+) now", message)
        if outcome.success and judged is not None:
            order = [status.value for status in (Status.SMOOTH, Status.AT_RISK, Status.STICK_SLIP)]
            assert order.index(judged[2]) < order.index(judged[1])
        # What others set stays, as far as the controller tells of it and may be written to.
        heard = [e for e in effects if e.by == "other"]
        if (
            heard
            and heard[-1].time < now - 0.1
            and self.allowed
            and not math.isfinite(self.withdrawn_at)
            and not self.upset
        ):
            wanted: dict[str, float] = {}
            for effect in heard:
                wanted |= effect.values
            assert {kind: self.controller.gains[kind] for kind in wanted} == wanted, message
        # A ramp that ended half-way can be found again.
        begin = GainPair(**effects[0].before) if effects else GainPair(**self.controller.gains)
        in_force = GainPair(**self.controller.gains)
        if sent and not heard and in_force.between(begin, TARGET) and not in_force.same(begin) and not outcome.success:
            assert "joint1" in self.journal, message
        if outcome.success:
            assert "joint1" not in self.journal


def take_steps(count: int, **more: Any) -> None:
    """Let the machine take so many steps, a hundred a ramp and what comes after."""
    examples = {"max_examples": count // 100, "stateful_step_count": 100}
    patient = settings(**examples, deadline=None, suppress_health_check=list(HealthCheck), **more)
    run_state_machine_as_test(RampMachine, settings=patient)


@pytest.mark.parametrize("steps", [3000, nightly(10_000)])
def test_a_ramp_keeps_to_its_rules(steps: int) -> None:
    """Issue 20."""
    take_steps(steps, derandomize=True)


def test_going_back_to_gains_that_stick_is_not_stopped_by_sticking() -> None:
    """Issue 20: ~/restore_gains is asked for gains under which the joint stuck; silence alone stops it.

    Found beside a real joint_trajectory_controller: it ended a step short, as "an oscillation began".
    """
    for complaint, there in (("an oscillation began", True), (_SILENT, False)):
        machine = RampMachine()
        before = GainPair(630.0, 0.0)
        machine.controller.others_set({"p": 1000.0, "d": 10.0})
        machine._pass(5.0)
        ramp = UnfinishedRamp(
            joint="joint1", controller=machine.controller.remote, before=before, target=TARGET, offset=5.0
        )
        machine.journal.begin(ramp)
        machine._begin(back_to=ramp)
        machine._pass(1.0)
        machine.motion.complaint = complaint
        machine._pass(60.0)
        assert machine.outcome is not None
        assert machine.outcome.success is there, machine.outcome.message
        assert (GainPair(**machine.controller.gains).same(before)) is there
        machine.folder.cleanup()


@pytest.mark.parametrize("largest", [600.0, 2000.0], ids=["those in force", "those advised"])
def test_gains_outside_the_limits_begin_no_ramp(largest: float) -> None:
    """Limits that were narrowed since the advice: the ramp would end part of the way."""
    machine = RampMachine()
    machine.bounds = ((0.0, largest), (0.0, 300.0))
    machine._begin()
    machine._pass(60.0)
    assert machine.outcome is not None
    assert "is outside its limits" in machine.outcome.message
    assert "no gains were changed" in machine.outcome.message
    assert machine.controller.gains == {"p": 630.0, "d": 0.0}
    machine.folder.cleanup()


@pytest.mark.parametrize(("later", "answer"), [(Status.SMOOTH, "smooth"), (Status.AT_RISK, "at_risk")])
def test_dips_of_the_ramp_itself_are_not_its_outcome(later: Status, answer: str) -> None:
    """The demo said "at_risk now" of a joint that was smooth two seconds later."""
    machine = RampMachine()
    machine._begin()
    machine._pass(1.0)
    while machine.controller.gains != TARGET.values():
        machine._pass(0.1)
    machine.motion.status = Status.AT_RISK
    machine._pass(5.0)
    assert machine.outcome is None
    machine.motion.status = later
    machine._pass(10.0)
    assert machine.outcome is not None
    assert machine.outcome.success
    assert f"stick_slip before, {answer} now" in machine.outcome.message
    machine.folder.cleanup()


if __name__ == "__main__":
    take_steps(int(sys.argv[1]), report_multiple_bugs=False, phases=(Phase.generate,), database=None)
