# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The joints that the node watches, and when the samples of each are processed and its status is published.

To process the samples of a joint costs about as much for a few samples as for many, and to publish its status costs
more than either. So samples of a joint that rests, or moves smoothly, are processed only when its status is published,
as long as the joint is where it was expected to be; of very many such joints, not even each time. The results do not
depend on it.
"""

from __future__ import annotations

import math
import re
import traceback
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from operator import is_not
from time import monotonic

from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.parameter import Parameter

from stickslip_ros.errors import StickSlipError
from stickslip_ros.messages.joint_states import WholeTurns
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.assessment import Adviser, Assessment
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import FloatArray, ReferencePairing
from stickslip_ros.nodes import node_parameters
from stickslip_ros.settings.parameter_table import COMMON, PER_JOINT
from stickslip_ros.settings.parameters import JointSettings

RANGES = ("stiffness_range", "damping_range")
WORTH_CHANGING = (Status.STICK_SLIP, Status.AT_RISK)
MOST_JOINTS = 256  # number of joints, 1: their names come from the graph, and no robot has so many
_JOINT_NAME = re.compile(r"[A-Za-z0-9_/-]{1,128}")
_COMMON = frozenset(spec.name for spec in COMMON)
_ROUNDING = 1e-6  # error of a sum of periods, s
_ALL_WITHIN = 1.0  # time between two reports on any joint, s: a listener that begins has all joints within it
_URGENT_WITHIN = 0.1  # time between two reports on a joint that sticks or is at risk, s: its figures change
FEW = 8  # number of joints, 1: so few are reported each time, as an arm's are
_SOME = 4  # number of joints reported in turn each time, 1: of many, these at least
_LATER = 0.1  # time that samples of a quiet joint may wait, s: several batches are processed as one
_LATER_EACH, _LATEST = 0.002, 0.5  # extension of that time for each joint, and its limit, s: each costs time
_QUIET_RATE = 60.0  # rate of processing joints that go on as before, Hz: of more, the last report is repeated
_AS_EXPECTED = 1.5  # time that samples of a joint that goes on as before may wait, s: its report comes first
_AT_ONCE = 8  # number of quiet joints processed together, 1: these at least, while more are spread over time
_PACE_OVER = 0.2  # span over which the pace of a joint is measured, s: a count of its encoder matters little
_BEHIND = 0.1  # lag behind the expected position that is no surprise, s at the joint's pace
_LOG_EVERY = 1.0  # time between two lines on a joint's gains, s: a ramp changes them many times a second
_UNEVENTFUL = (Status.SMOOTH, Status.AT_REST)
# The first limits that have an upper end, in the controller's units, by joint and one of RANGES. They hold as long as
# the node runs: whoever can set parameters can request narrower limits or other advice, but no gains outside the
# limits that the robot's owner configured are written.
GainBounds = dict[tuple[str, str], tuple[float, float]]


def _limits(settings: JointSettings, which: str) -> tuple[float, float]:
    least, largest = getattr(settings.options.limits, which)
    return least / settings.gain_scale, largest / settings.gain_scale


@dataclass
class WatchedJoint:
    """One joint as the node watches it: its monitor, samples that wait for their reference, and settings.

    Attributes
    ----------
    heard : arrival of the last sample, a steady time [s].
    trouble : why the joint cannot be judged, "" as long as it can.
    """

    name: str
    monitor: JointMonitor
    settings: JointSettings
    configured_bounds: GainBounds
    pairing: ReferencePairing = field(default_factory=ReferencePairing)
    heard: float = -math.inf
    trouble: str = ""

    def __post_init__(self) -> None:
        self._note_bounds()

    def follow(self, settings: JointSettings) -> None:
        """Apply other settings."""
        self.settings = settings
        self.monitor.joint, self.monitor.options = settings.joint, settings.options
        self._note_bounds()

    def restart(self) -> None:
        """Discard the motion, and samples that wait for their reference."""
        self.pairing = ReferencePairing()
        self.monitor.restart()

    def bounds(self, which: str) -> tuple[float, float]:
        """Limits of gains that may be written, for one of :data:`RANGES`, in the controller's units: the present limits
        within the first ones.
        """
        now = _limits(self.settings, which)
        first = self.configured_bounds.get((self.name, which), now)
        return max(now[0], first[0]), min(now[1], first[1])

    def _note_bounds(self) -> None:
        for which in RANGES:
            limits = _limits(self.settings, which)
            if math.isfinite(limits[1]):
                self.configured_bounds.setdefault((self.name, which), limits)

    @cached_property
    def parameters(self) -> frozenset[str]:
        """Names of the parameters that are this joint's."""
        return frozenset(spec.name.format(joint=self.name) for spec in PER_JOINT)

    def advised(self, assessment: Assessment) -> Gains | None:
        """Recommended gains in the controller's units, None if there are none or the present ones are not known."""
        recommended = assessment.recommended
        if recommended is None or not recommended.found or not assessment.gains_known:
            return None
        return self.settings.from_si(recommended.gains)

    def being_advised(self, assessment: Assessment) -> bool:
        """Whether advice that would be applied is being computed."""
        status = assessment.finding.status
        return status in WORTH_CHANGING and assessment.margin is not None and assessment.advice is None

    def why_not_applied(self, assessment: Assessment, *, has_controller: bool) -> str:
        """Why the advice cannot be applied, or ""; SI units."""
        recommendation, status = assessment.recommendation, assessment.finding.status
        if status not in WORTH_CHANGING:
            return f"{self.name} needs no other gains: its status is {status.value}"
        if recommendation is None:
            return f"{self.name} has no advice: {assessment.margin_reason or 'it is being computed'}"
        if recommendation.keep:
            return (
                f"{self.name} already has the wanted reserve at {recommendation.velocity:.3g} rad/s; if it sticks "
                "there, the friction estimate is wrong"
            )
        if self.advised(assessment) is None:
            reason = assessment.recommended.reason if assessment.recommended else ""
            return f"{self.name}: " + (reason if assessment.gains_known else "its gains are not known")
        if not has_controller:
            return f"{self.name} has no controller whose parameters could be written (parameter 'controller')"
        if math.isinf(self.bounds("stiffness_range")[1]) or math.isinf(self.bounds("damping_range")[1]):
            return f"{self.name} has no limits: set limits.{self.name}.p_max and limits.{self.name}.d_max first"
        return ""


class WatchedJoints(dict[str, WatchedJoint]):
    """The watched joints by name: those configured, or every one that is heard of.

    Parameters
    ----------
    node : has the parameters. names : joints to watch from the beginning; () for every joint heard of.
    own_change : context in which parameters are declared that others may not set.
    adviser : makes the adviser of a joint's monitor. refuse : called with the reason why something is refused.
    """

    def __init__(
        self,
        node: Node,
        names: tuple[str, ...],
        bounds: GainBounds,
        own_change: node_parameters.OwnChange,
        adviser: Callable[[str], Adviser],
        refuse: Callable[[str], object],
    ) -> None:
        super().__init__()
        self._node, self._adviser, self._refuse = node, adviser, refuse
        self._bounds, self._own_change = bounds, own_change
        self._contested: frozenset[str] = frozenset()
        log = node.get_logger()
        self._whole_turns, self._reference_turns = WholeTurns(log.info), WholeTurns()
        self.welcomes_others = not names
        self.fed_forward: tuple[str, ...] = ()  # joints whose friction is to be compensated
        for name in names:
            self._add(name)

    def _add(self, name: str) -> WatchedJoint:
        with self._own_change:
            node_parameters.declare_joint(self._node, name)
        settings = node_parameters.read_joint(self._node, name)
        monitor = JointMonitor(
            settings.joint, settings.gains, settings.options, self._adviser(name), segments_kept=0, at_arrest=True
        )
        joint = self[name] = WatchedJoint(name, monitor, settings, self._bounds)
        self._note_fed_forward()
        return joint

    def _note_fed_forward(self) -> None:
        # The names are read much more often than settings change.
        self.fed_forward = tuple(name for name, one in self.items() if one.settings.feedforward.share > 0)

    def hear(self, samples: Mapping[str, FloatArray], references: Mapping[str, FloatArray], now: float) -> list[str]:
        """Pass samples and references to the joints they are of; returns the joints that are heard of first.

        Parameters
        ----------
        samples : rows of time, position, velocity and effort of each joint. references : rows that begin with time,
            position and velocity. now : a steady time [s].
        """
        new = [name for name in samples if name not in self and self._welcome(name)]
        for name, rows in samples.items():
            joint = self.get(name)
            if joint is not None:
                joint.heard = now
                if name not in self._contested:
                    joint.pairing.add_samples(self._whole_turns.removed(name, rows), joint.settings.effort_scale)
        for name, rows in references.items():
            if name in self:
                self[name].pairing.add_references(self._reference_turns.removed(name, rows[:, :3]))
        return new

    def _welcome(self, name: str) -> bool:
        """Add a joint that was heard of, if there may be others; returns whether it is watched."""
        if not self.welcomes_others:
            return False
        if not _JOINT_NAME.fullmatch(name):
            self._refuse("joint_states: a joint name has characters other than letters, digits, _ - /")
            return False
        if len(self) >= MOST_JOINTS:
            self._refuse(f"joint_states: more than {MOST_JOINTS} joints")
            return False
        try:
            self._add(name)
        except StickSlipError as error:
            self._refuse(f"{name}: {error}")
            return False
        return True

    def mark_contested(self, contested: frozenset[str], contest: str) -> None:
        """Restart joints that several publishers move, with ``contest`` as their trouble; clear that of the others."""
        if not contested and not self._contested:
            return
        for name, joint in self.items():
            if name in contested and not joint.trouble:
                # The samples until now were of two motions.
                joint.restart()
            joint.trouble = contest if name in contested else ""
        self._contested = contested

    def check(self, changes: Mapping[str, Parameter]) -> None:
        """Check the joints' settings as they would be after the changes.

        Raises
        ------
        StickSlipError
            If changes would make no joint.
        """
        for joint in self._concerned(changes):
            node_parameters.read_joint(self._node, joint.name, changes)

    def apply(self, changes: Mapping[str, Parameter]) -> list[tuple[WatchedJoint, Gains | None]]:
        """Apply parameters that have changed; returns the gains, in SI units, that follow for some joints."""
        gains: list[tuple[WatchedJoint, Gains | None]] = []
        for joint in self._concerned(changes):
            before = joint.settings
            joint.follow(node_parameters.read_joint(self._node, joint.name))
            if any(name.startswith(f"gains.{joint.name}.") for name in changes):
                gains.append((joint, joint.settings.gains))
            elif joint.settings.gain_scale != before.gain_scale and joint.monitor.gains is not None:
                gains.append((joint, joint.settings.to_si(before.from_si(joint.monitor.gains))))
            if any(name.startswith(f"limits.{joint.name}.") for name in changes):
                node_parameters.describe_recommended(self._node, joint.name)
        self._note_fed_forward()
        return gains

    def _concerned(self, changes: Mapping[str, Parameter]) -> list[WatchedJoint]:
        """Joints whose settings depend on the changed parameters."""
        if not _COMMON.isdisjoint(changes):
            return list(self.values())
        return [joint for joint in self.values() if not joint.parameters.isdisjoint(changes)]


class RoundRobin:
    """Round-robin scheduler of reports: changed joints at once, urgent ones often, the others in turn."""

    def __init__(self) -> None:
        # Change tokens that were reported, the oldest report first; and the times, on a clock that sums the periods.
        self._reported: dict[str, tuple[object, ...]] = {}
        self._reported_at: dict[str, float] = {}
        self._clock = 0.0  # [s]

    def due(
        self, change_tokens: Mapping[str, tuple[object, ...]], urgent: Iterable[str], period: float
    ) -> tuple[list[str], list[str]]:
        """The joints to report now, and those among them that are reported in turn only.

        Parameters
        ----------
        change_tokens : objects of each joint, of which one is replaced when the joint is to be reported at once.
        urgent : joints that are reported ten times a second.
        period : time until the next call [s].
        """
        self._clock += period
        # A report at the next call would be too late.
        reported_before = self._clock + 0.5 * period - _URGENT_WITHIN - _ROUNDING
        wanted = {name for name in urgent if self._reported_at.get(name, -math.inf) < reported_before}
        # Most tokens are the very tuples that were reported, and need no comparison of their objects.
        reported = self._reported
        wanted.update(
            name for name, new in change_tokens.items() if reported.get(name) is not new and self._is_new(name, new)
        )
        others = [name for name in self._reported if name in change_tokens and name not in wanted]
        count = len(change_tokens)
        share = count if count <= FEW else max(_SOME, math.ceil(count * period / _ALL_WITHIN))
        turns = set(others[:share])
        wanted.update(turns)
        chosen = [name for name in change_tokens if name in wanted]
        for name in chosen:
            self._reported.pop(name, None)
            self._reported[name] = change_tokens[name]
            self._reported_at[name] = self._clock
        return chosen, [name for name in chosen if name in turns]

    def _is_new(self, name: str, new: tuple[object, ...]) -> bool:
        reported = self._reported.get(name)
        if reported is None or any(map(is_not, reported, new)):
            return True
        self._reported[name] = new
        return False


def urgent(joints: Mapping[str, WatchedJoint]) -> list[str]:
    """The joints that stick or are at risk."""
    return [name for name, joint in joints.items() if joint.monitor.latest_status in WORTH_CHANGING]


@dataclass(kw_only=True)
class _Course:
    """Expected course of a joint that goes on as before.

    Attributes
    ----------
    since, began : time [s] and position [rad] from which the pace is measured.
    time, position : time [s] and position [rad] of the last processed sample. pace : velocity [rad/s].
    band : largest displacement that is no motion [rad].
    processed_at : when the joint was processed last, a steady time [s].
    """

    since: float
    began: float
    time: float
    position: float
    pace: float = math.nan
    band: float = 0.0
    processed_at: float = -math.inf

    def go_on(self, time: float, position: float, band: float, now: float) -> None:
        """Update the course with the last processed sample."""
        self.time, self.position, self.band, self.processed_at = time, position, band, now
        if not 0.0 <= time - self.since < _PACE_OVER:
            self.pace = (position - self.began) / (time - self.since) if time > self.since else math.nan
            self.since, self.began = time, position

    def surprised(self, time: float, position: float) -> bool:
        """Whether a sample is off the expected course, or the course is not known."""
        aside = abs(position - self.position - self.pace * (time - self.time))
        return not (aside <= self.band + _BEHIND * abs(self.pace) and time >= self.time)


class BatchProcessing:
    """Batch processing of the joints' samples by their monitors.

    Parameters
    ----------
    refuse : called with the reason why a joint's motion is discarded.
    """

    def __init__(self, joints: Mapping[str, WatchedJoint], refuse: Callable[[str], object], log: RcutilsLogger) -> None:
        self._joints, self._refuse, self._log = joints, refuse, log
        self._since: dict[str, float] = {}  # arrival of the oldest waiting sample, a steady time [s]
        self._courses: dict[str, _Course] = {}
        self._surprised: set[str] = set()
        self._polled_at = -math.inf
        self._processed: dict[str, None] = {}
        self._cycles: list[tuple[str, Cycle]] = []
        self._logged_at: dict[str, float] = {}  # last line on a joint's gains, a steady time [s]

    def expect(self, samples: Mapping[str, FloatArray], references: Iterable[str], now: float) -> None:
        """Note samples (rows of time and position first) or references of these joints, come at a steady time [s]."""
        joints, surprised, courses, since = self._joints, self._surprised, self._courses, self._since
        for name, rows in samples.items():
            if name not in joints:
                continue
            since.setdefault(name, now)
            if name not in surprised:
                course = courses.get(name)
                if course is None or course.surprised(rows.item(-1, 0), rows.item(-1, 1)):
                    surprised.add(name)
        for name in references:
            if name in self._joints:
                self._since.setdefault(name, now)

    def poll(self, now: float, *, hurry: bool) -> None:
        """Process joints that stick or may have stopped, and joints whose samples have waited long enough.

        Parameters
        ----------
        hurry : whether all samples are processed at once.
        """
        later = min(_LATER + _LATER_EACH * len(self._joints), _LATEST)
        as_expected = _AS_EXPECTED + len(self._joints) / _QUIET_RATE
        quiet = max(_AT_ONCE, math.ceil(len(self._joints) * min((now - self._polled_at) / later, 1.0)))
        self._polled_at = now
        for name, since in list(self._since.items()):
            if hurry or self._joints[name].monitor.latest_status not in _UNEVENTFUL:
                self.process_pending(name, now)
            elif quiet and now - since >= (later if name in self._surprised else as_expected):
                quiet -= 1
                self.process_pending(name, now)

    def process_pending(self, name: str, now: float | None = None) -> None:
        """Process the waiting samples of one joint; an error concerns no other joint."""
        if self._since.pop(name, None) is None:
            return
        joint = self._joints[name]
        self._processed[name] = None
        now = monotonic() if now is None else now
        try:
            batch = joint.pairing.next_batch(now)
            if batch is not None:
                self._cycles += [(name, cycle) for cycle in joint.monitor.process(batch)]
                self._surprised.discard(name)
                time, position = float(batch.time[-1]), float(batch.position[-1])
                course = self._courses.setdefault(
                    name, _Course(since=time, began=position, time=time, position=position)
                )
                course.go_on(time, position, joint.monitor.band, now)
        except Exception:
            self.restart_after_error(joint)

    def restart_after_error(self, joint: WatchedJoint) -> None:
        """Log the error that is being handled, and restart the joint whose processing raised it."""
        self._refuse(f"{joint.name}: an error of the monitor itself; the joint is followed anew")
        self._log.error(f"{joint.name}: {traceback.format_exc()}", throttle_duration_sec=10.0)
        joint.restart()

    def set_gains(self, joint: WatchedJoint, gains: Gains | None) -> None:
        """Set the gains of a joint's monitor, in SI units, from the samples on that still wait to arrive."""
        if joint.monitor.gains == gains:
            return
        self.process_pending(joint.name)
        joint.monitor.gains = gains
        # A ramp changes the gains again and again, and logs them itself.
        if monotonic() - self._logged_at.get(joint.name, -math.inf) >= _LOG_EVERY:
            self._logged_at[joint.name] = monotonic()
            text = "not known" if gains is None else _in_words(joint.settings.from_si(gains))
            self._log.info(f"{joint.name}: gains are now {text}")

    def may_wait(self, in_turn: Iterable[str], period: float) -> set[str]:
        """Joints among those in turn whose last report may be repeated without processing.

        These joints go on as before; the joints that were processed longest ago are not among them.

        Parameters
        ----------
        period : time until the next call [s].
        """
        if len(self._joints) <= FEW:
            return set()
        quiet = [name for name in in_turn if name not in self._surprised and name in self._courses]
        quiet = [name for name in quiet if self._joints[name].monitor.latest_status in _UNEVENTFUL]
        quiet.sort(key=lambda name: self._courses[name].processed_at)
        return set(quiet[math.ceil(_QUIET_RATE * period) :])

    def processed(self) -> list[str]:
        """The joints that were processed since the last call."""
        processed, self._processed = list(self._processed), {}
        return processed

    def pop_cycles(self) -> list[tuple[str, Cycle]]:
        """The cycles detected since the last call, each with the name of its joint."""
        cycles, self._cycles = self._cycles, []
        return cycles


def _in_words(gains: Gains) -> str:
    """Gains in the controller's units, as words."""
    integral = f", i {float(gains.integral):.6g}" if gains.integral else ""
    return f"p {float(gains.stiffness):.6g}{integral}, d {float(gains.damping):.6g}"
