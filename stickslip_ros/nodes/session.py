# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""All that the monitor has between configuring and cleaning up: its parts are made here, and called in turn.

The node ticks and publishes often while messages come or work is under way, rarely else. Joints with changes are
reported at once, the others in turn; each is assessed anew before.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from time import monotonic

from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.assessment import NOT_COMPUTED, as_seen
from stickslip_ros.nodes import node_parameters
from stickslip_ros.nodes.friction_feedforward import FrictionFeedforward
from stickslip_ros.nodes.gains.gain_intake import GainIntake
from stickslip_ros.nodes.gains.ramps import Ramps
from stickslip_ros.nodes.intake.arrivals import Arrivals, reference_message_type
from stickslip_ros.nodes.intake.inputs import Inputs
from stickslip_ros.nodes.intake.refusals import Refusals
from stickslip_ros.nodes.kept_state import RampJournal, StateKeeper
from stickslip_ros.nodes.other_monitors import OtherMonitors
from stickslip_ros.nodes.publications import Publications, recommended_compensation, stability_maps
from stickslip_ros.nodes.running import CompiledParts
from stickslip_ros.nodes.self_diagnosis import SelfDiagnosis
from stickslip_ros.nodes.slow_work import AdviceWorker, ExactWorker, SlowWork, attend_study
from stickslip_ros.nodes.watched_joints import (
    FEW,
    BatchProcessing,
    GainBounds,
    RoundRobin,
    WatchedJoint,
    WatchedJoints,
    urgent,
)
from stickslip_ros.output.diagnosis import Diagnosis, Level, diagnosis
from stickslip_ros.output.published import Findings
from stickslip_ros.settings.parameter_names import MONITOR

_PUBLISH_REST = 2.5  # time between publications, mean durations of one: intake has most of the processor
_SMOOTHING = 0.1  # weight of the last duration in the mean duration, 1: one long tick delays no joint
_LONGEST_TICK, SHORTEST_TICK = 0.04, 0.02  # period of ticks, s: 25 Hz suffice, and 50 Hz while gains change
_IDLE_TICK = 0.5  # period of ticks while nothing comes, s: the first message ends it at once
_EARLY = 0.5 * SHORTEST_TICK  # a publication that is due before the middle of the next period is made now
_IDLE_AFTER = 2.0  # time without a message and without work under way, s: a shorter pause of a publisher is usual
_IDLE_PERIOD = 1.0  # time between two statuses of an idle node, s: nothing changes meanwhile, and each costs time
_STALE_AFTER = 1.0  # time without a sample, s: a joint that has been silent for longer is reported as silent
_SCAN_ALL = 0.2  # time between two scans of all joints for changes, s: a person notices no later report
_POLL_GAINS = 0.1  # time between two polls of the controllers and the inputs, s: each queries the graph
_TOO_LATE, _NOT_LEARNT_FROM = attrgetter("pairing.too_late"), attrgetter("monitor.learner.skipped")


class Pace:
    """Times of ticks and publications; times are steady [s].

    Parameters
    ----------
    rate : rate of publications while messages come [Hz].
    """

    def __init__(self, rate: float) -> None:
        self._period = 1.0 / rate
        self._publish_at = -math.inf
        self._busy_at, self._came = monotonic(), 0
        self._spent = 0.0  # mean duration of a tick that publishes [s]

    @property
    def idle(self) -> bool:
        """Whether no message has come for a while, and no work is under way."""
        return monotonic() - self._busy_at > _IDLE_AFTER

    @property
    def publish_period(self) -> float:
        """Time between two publications [s]."""
        return max(self._period, _IDLE_PERIOD) if self.idle else self._period

    def is_due(self, now: float, came: int, *, busy: bool) -> bool:
        """Whether a publication is due, with so many messages until now, and work under way or not.

        The status that ends a silence is published at once, however far the next one was away.
        """
        due = now >= self._publish_at - _EARLY
        if came != self._came or busy:
            if self.idle:
                due, self._publish_at = True, now
            self._busy_at, self._came = now, came
        return due

    def published(self, now: float) -> None:
        """Set the time of the next publication, after that of a tick that began at ``now``.

        However many joints there are, intake has most of the time. One long tick delays no later status.
        """
        self._spent += _SMOOTHING * (monotonic() - now - self._spent)
        self._publish_at = max(self._publish_at + self.publish_period, now + _PUBLISH_REST * self._spent)

    def next_tick(self, *, hurry: bool) -> float:
        """Time until the next tick [s].

        A tick costs about as much for few messages as for many, so that there is one tick for each status, and several
        where statuses are rare. There are more ticks while gains change, and few while the node is idle.
        """
        if self.idle:
            return _IDLE_TICK
        if hurry:
            return SHORTEST_TICK
        return max(self._period / math.ceil(self._period / _LONGEST_TICK - 1e-6), SHORTEST_TICK)


class Reports:
    """Reports on the watched joints; ``findings`` has those on each, as assessed last."""

    def __init__(
        self,
        node: LifecycleNode,
        own_change: node_parameters.OwnChange,
        joints: WatchedJoints,
        processing: BatchProcessing,
        *,
        work: SlowWork,
        inputs: Inputs,
        ramps: Ramps,
        publications: Publications,
    ) -> None:
        self._node, self._own_change, self._joints, self._processing = node, own_change, joints, processing
        self._work, self._exact, self._inputs, self._ramps = work, ExactWorker(work), inputs, ramps
        self._publications = publications
        self._on_demand = (
            stability_maps(node, work),
            recommended_compensation(node, work, publications.robot),
        )
        self._round_robin = RoundRobin()
        self._scan_at = -math.inf
        self._change_tokens: dict[str, tuple[object, ...]] = {}
        self._advised: dict[str, Gains | None] = {}  # recommended gains of each joint, in the controller's units
        self.findings: dict[str, Findings] = {}

    def close(self) -> None:
        """Take the topics that are published while somebody listens from the graph."""
        for topic in self._on_demand:
            topic.close()

    def publish(self, own: Diagnosis, now: float, period: float, published: Callable[[], None]) -> None:
        """Publish the node's own status, those of the joints and the tables; begin the studies that are due.

        Joints with changes do not wait for many others in turn: ``published`` is called between the two.

        Parameters
        ----------
        now : a steady time [s]. period : time until the next publication [s].
        """
        processed = self._scan_for_changes(now)
        reported, in_turn = self._round_robin.due(self._change_tokens, urgent(self._joints), period)
        later = in_turn if len(self._joints) > FEW else []
        assessed = [name for name in reported if name not in later]
        self._assess(assessed, now)
        self._publications.publish_statuses(own, self.findings, assessed, assessed)
        published()
        if later:
            again = self._processing.may_wait(later, period)
            assessed_later = [name for name in later if name not in again or name not in self.findings]
            self._assess(assessed_later, now)
            self._publications.publish_statuses(None, self.findings, later, assessed_later)
            assessed = assessed + assessed_later
        for name in assessed:
            found = self.findings.get(name)
            self._advised[name] = None if found is None else self._joints[name].advised(found.assessment)
        self._publications.publish_tables(self.findings, reported, self._advised)
        for topic in self._on_demand:
            topic.attend(self.findings, now)
        with self._own_change:
            node_parameters.set_recommended(
                self._node, {name: self._advised[name] for name in assessed if name in self.findings}
            )
        ended = self._processing.pop_cycles()
        for name in dict.fromkeys([*processed, *reported]):
            attend_study(self._work, name, self._joints[name].monitor.learner)
        for name in assessed:
            if name in self.findings and self.findings[name].silent_for is not None:
                ended += [(name, cycle) for cycle in self._joints[name].monitor.finish()]
        self._publications.publish_cycles(ended)

    def _assess(self, names: Iterable[str], now: float) -> None:
        for name in names:
            self._processing.process_pending(name, now)
            try:
                self.findings[name] = self._findings_of(self._joints[name], now)
            except Exception:
                self.findings.pop(name, None)
                self._processing.restart_after_error(self._joints[name])

    def _scan_for_changes(self, now: float) -> list[str]:
        """Joints that were processed since the last scan; their change tokens are updated.

        A change token holds objects of which one is replaced when a joint is to be reported at once. Tokens of the
        other joints are updated less often, if these are many.
        """
        processed = self._processing.processed()
        names: Iterable[str] = processed
        if now >= self._scan_at:
            self._scan_at = now + (_SCAN_ALL if len(self._joints) > FEW else 0.0)
            names = self._joints
        for name in names:
            joint = self._joints[name]
            outcome = self._ramps.outcomes.get(name, "")
            self._change_tokens[name] = (
                *joint.monitor.change_token,
                joint.trouble,
                now - joint.heard > _STALE_AFTER,
                outcome,
            )
        return processed

    def _findings_of(self, joint: WatchedJoint, now: float) -> Findings:
        assessment = joint.monitor.assessment()
        silence = now - joint.heard
        trial = assessment.trial if assessment.gains_known else None
        conditions = joint.settings.options.conditions
        complete = assessment.gains is not None and assessment.velocity_source == "reference"
        exact = self._exact.verdict_on(joint.name, assessment, assessment.margin_gains, conditions, now)
        if exact is NOT_COMPUTED:
            # While gains rise in steps, each exact verdict comes too late.
            exact = replace(exact, damping_reserve=joint.monitor.damping_reserve(assessment.velocity))
        return Findings(
            assessment=assessment,
            exact=as_seen(exact, assessment.finding.status),
            trial=self._exact.verdict_on(f"trial {joint.name}", assessment, trial, conditions, now),
            silent_for=silence if silence > _STALE_AFTER else None,
            trouble=joint.trouble,
            missing="" if complete else self._inputs.missing(joint, assessment),
            applied=self._ramps.outcomes.get(joint.name, ""),
            here=self._exact.verdict_here(f"here {joint.name}", assessment, conditions, now),
            conditions=conditions,
        )


class Session:
    """State of a configured node, see the module; the node calls :meth:`tick` while it is active.

    Parameters
    ----------
    bounds, journal : limits of the gains that may be written, and ramps that were cut off; both outlast the session.

    Raises
    ------
    StickSlipError
        If parameters make no joint or topic.
    """

    def __init__(
        self,
        node: LifecycleNode,
        bounds: GainBounds,
        own_change: node_parameters.OwnChange,
        state_path: Path | None,
        journal: RampJournal,
    ) -> None:
        log = node.get_logger()
        self._node = node
        self._refuse = Refusals(log.warning)
        self._work = SlowWork(log.warning)
        self._keeper = StateKeeper(state_path, log)
        self._pace = Pace(float(node.get_parameter("publish_rate").value))
        self._poll_at = -math.inf
        self._reference_type = str(node.get_parameter("reference_type").value)
        self._arrivals: Arrivals | None = None
        self._self: SelfDiagnosis | None = None
        self._compiled = CompiledParts(log)
        self._closing = ExitStack()
        self._closing.callback(self._work.close)
        self._closing.callback(self._compiled.close)
        try:
            # A type that is not installed is refused now, rather than when the node is activated.
            reference_message_type(self._reference_type)
            names, adviser = node_parameters.joint_names(node), AdviceWorker(self._work).adviser
            self.joints = WatchedJoints(node, names, bounds, own_change, adviser, self._refuse)
            self._processing = BatchProcessing(self.joints, self._refuse, log)
            self._gains = GainIntake(node, self.joints, self._refuse)
            self._closing.callback(self._gains.close)
            self._publications = Publications(node)
            self._closing.callback(self._publications.close)
            self._feedforward = FrictionFeedforward(node)
            self._closing.callback(self._feedforward.close)
            self._others = OtherMonitors(node, self.joints)
            self._closing.callback(self._others.close)
            self._ramps = Ramps(node, self.joints, self._gains, self._others, journal)
            self._closing.callback(self._ramps.close)
            self._inputs = Inputs(node, self.joints, self._gains, self._reference_type)
            self._reports = Reports(
                node, own_change, self.joints, self._processing,
                work=self._work, inputs=self._inputs, ramps=self._ramps, publications=self._publications,
            )  # fmt: skip
            self._closing.callback(self._reports.close)
            reset = node.create_service(Trigger, "~/reset", self._reset)
            self._closing.callback(node.destroy_service, reset)
            self._follow_controllers()
        except BaseException:
            self.close()
            raise
        for joint in self.joints.values():
            self._keeper.restore(joint)

    def apply(self, changes: Mapping[str, Parameter]) -> None:
        """Apply parameters of the node that have changed."""
        for joint, gains in self.joints.apply(changes):
            self._processing.set_gains(joint, gains)
        if "allow_apply" in changes and not changes["allow_apply"].value:
            # Gains of requests made until now are no longer written.
            self._ramps.withdraw()
        if "controller" in changes:
            self._follow_controllers()

    def _follow_controllers(self) -> None:
        self._gains.follow(node_parameters.controllers(self._node))

    def activate(self, heard: Callable[[], None]) -> None:
        """Begin to listen; ``heard`` is called when the first message comes that ends an idle time."""
        self._arrivals = Arrivals(self._node, self._reference_type, self._gains.topic, self._refuse, heard)
        self._self = SelfDiagnosis(self._arrivals.states, self._work, self.joints)

    def deactivate(self) -> None:
        """Close the subscriptions and stop writing gains; what was learnt is kept and saved."""
        if self._arrivals is None:
            return
        self._ramps.stop("the monitor was deactivated")
        self._feedforward.silence()
        if self._compiled.ready:
            for name in self.joints:
                self._processing.process_pending(name)
            last = [(name, cycle) for name, joint in self.joints.items() for cycle in joint.monitor.finish()]
            self._publications.publish_cycles([*self._processing.pop_cycles(), *last])
        self._arrivals.close()
        self._others.close()
        self._arrivals = self._self = None
        self._keeper.save(self.joints)

    def close(self) -> None:
        """Give everything back."""
        self._closing.close()

    def tick(self) -> float:
        """Process the messages that have arrived, and publish what is due; returns the time until the next tick [s]."""
        arrivals, own = self._arrivals, self._self
        assert arrivals is not None
        assert own is not None
        now = monotonic()
        self._compiled.poll(now)
        self._process_arrivals(arrivals, now)
        busy = self._ramps.busy or self._work.waiting > 0 or not self._compiled.ready
        due = self._pace.is_due(now, arrivals.messages, busy=busy)
        if now >= self._poll_at:
            self._poll_at = now + _POLL_GAINS
            self._gains.poll(now)
            self._inputs.poll(now, arrivals.states)
            self._others.poll(now)
        behind = not self._compiled.ready or arrivals.behind(now)
        waits = self._compiled.state or "what came while the node compiled is being looked at"
        self._ramps.tick(now, not_yet=waits if behind else "")
        self._feedforward.tick(self.joints, self._reports.findings, now)
        self._keeper.tick(self.joints, now)
        if due:
            self._publish(own, now, behind=behind)
            self._pace.published(now)
        arrivals.set_idle(idle=self._pace.idle)
        return self._pace.next_tick(hurry=self._ramps.busy)

    def _process_arrivals(self, arrivals: Arrivals, now: float) -> None:
        """Process what has arrived, gains and motion in their order; all waits while the node compiles."""
        # Gains first: the samples that arrive now are of these.
        self._gains.keep()
        if not self._compiled.ready:
            arrivals.keep()
            return
        until, hurry = arrivals.due_until(now), self._ramps.busy
        for came, name, gains in self._gains.heard_until(until):
            self._process_motion(arrivals, came, now, hurry=hurry)
            self._set_gains(name, gains)
        self._process_motion(arrivals, until, now, hurry=hurry)

    def _process_motion(self, arrivals: Arrivals, until: float, now: float, *, hurry: bool) -> None:
        samples, references = arrivals.motion_until(until)
        self.joints.mark_contested(arrivals.states.contested, arrivals.states.contest)
        for name in self.joints.hear(samples, references, now):
            self._keeper.restore(self.joints[name])
            early = self._gains.heard_before(name)
            if early is not None:
                self._set_gains(name, early)
        for name in self.joints.fed_forward:
            if name in references:
                self._feedforward.hear(name, references[name], now)
        self._processing.expect(samples, references, now)
        self._processing.poll(now, hurry=hurry)
        self._publications.publish_cycles(self._processing.pop_cycles())

    def _set_gains(self, name: str, gains: Gains | None) -> None:
        """Set gains in the controller's units; None, where they are known no more, stands for the configured ones."""
        joint = self.joints.get(name)
        if joint is not None:
            self._processing.set_gains(joint, joint.settings.gains if gains is None else joint.settings.to_si(gains))
            self._ramps.hear_gains(joint)

    def _publish(self, own: SelfDiagnosis, now: float, *, behind: bool) -> None:
        if not self._compiled.ready:
            self._publications.publish_waiting(self._own_status(own), self.joints, self._compiled.state)
            return
        period = self._pace.publish_period
        self._reports.publish(self._own_status(own), now, period, lambda: own.note(behind=behind))

    def _own_status(self, own: SelfDiagnosis) -> Diagnosis:
        """Status of the node itself: what it refused, where its gains come from, and how it keeps up."""
        troubles = [
            self._compiled.state,
            self._ramps.trouble,
            self._others.trouble,
            self._gains.state if self._gains.waiting else "",
            *self._inputs.troubles,
            own.trouble,
            self._keeper.trouble,
            f"refused: {self._refuse.latest}" if self._refuse.latest else "",
        ]
        message = "; ".join(trouble for trouble in troubles if trouble)
        values: list[tuple[str, object]] = [
            ("compiling", self._compiled.state),
            *self._others.values(),
            ("joints [1]", len(self.joints)),
            ("controller", self._gains.state),
            ("gains of joints not heard of", ", ".join(self._gains.early)),
            *self._inputs.values(),
            ("references too late [1]", sum(map(_TOO_LATE, self.joints.values()))),
            ("apply_recommendation", self._ramps.state),
            ("slips not learnt from, a study being late [1]", sum(map(_NOT_LEARNT_FROM, self.joints.values()))),
            *own.values(),
            *((f"refused: {reason}", count) for reason, count in self._refuse.counts.items()),
        ]
        return diagnosis(Level.WARN if message else Level.OK, message, values, MONITOR, MONITOR)

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        for name, joint in self.joints.items():
            self._processing.process_pending(name)
            joint.monitor.reset()
            self._keeper.forget(name)
        response.success = True
        response.message = f"forgot what was learnt of {len(self.joints)} joints"
        return response
