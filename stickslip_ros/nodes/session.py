# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""All that the monitor has between configuring and cleaning up: joints, topics, services, workers."""

from __future__ import annotations

import math
import traceback
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from time import monotonic

from rclpy.lifecycle import LifecycleNode
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from stickslip_ros.messages.whole_turns import WholeTurns
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.exact_question import NOT_COMPUTED, as_seen
from stickslip_ros.nodes import monitor_parameters
from stickslip_ros.nodes.compiled_parts import CompiledParts
from stickslip_ros.nodes.friction_feedforward import FrictionFeedforward
from stickslip_ros.nodes.gains.gain_intake import GainIntake
from stickslip_ros.nodes.gains.ramps import Ramps, RefusedError
from stickslip_ros.nodes.intake.drain import FirstMessage
from stickslip_ros.nodes.intake.inputs import Inputs
from stickslip_ros.nodes.intake.joint_state_topic import JointStateTopic
from stickslip_ros.nodes.intake.reference_topic import ControllerStateTopic, reference_message_type, reference_topic
from stickslip_ros.nodes.intake.refusals import Refusals
from stickslip_ros.nodes.joints import joint_parameters
from stickslip_ros.nodes.joints.joint_parameters import OwnChange
from stickslip_ros.nodes.joints.scheduling import FEW, BatchProcessing, RoundRobin, urgent
from stickslip_ros.nodes.joints.watched_joints import GainBounds, WatchedJoint, WatchedJoints
from stickslip_ros.nodes.on_demand import recommended_compensation, stability_maps
from stickslip_ros.nodes.publications import Findings, Publications
from stickslip_ros.nodes.self_diagnosis import SelfDiagnosis
from stickslip_ros.nodes.state.state_keeper import StateKeeper
from stickslip_ros.nodes.worker.process import SlowWork
from stickslip_ros.nodes.worker.questions import AdviceWorker, ExactWorker, attend_study
from stickslip_ros.output.diagnosis import Diagnosis, Level, value_text

_STALE_AFTER = 1.0  # time without a sample, s: a joint that has been silent for longer is reported as silent
_QUEUE = 5000  # depth of a queue, messages: five seconds at 1 kHz without a drain lose none
_POLL_GAINS = 0.1  # time between two polls of the controllers and the inputs, s: each queries the graph
_SCAN_ALL = 0.2  # time between two scans of all joints for changes, s: a person notices no later report
_PUBLISH_REST = 2.5  # time between publications, mean durations of one: intake has most of the processor
_SMOOTHING = 0.1  # weight of the last duration in the mean duration, 1: one long tick delays no joint
_LONGEST_TICK, SHORTEST_TICK = 0.04, 0.02  # period of ticks, s: 25 Hz suffice, and 50 Hz while gains change
_IDLE_TICK = 0.5  # period of ticks while nothing comes, s: the first message ends it at once
_EARLY = 0.5 * SHORTEST_TICK  # a publication that is due before the middle of the next period is made now
_PENDING_PER_TICK = 5.0  # span of waiting messages that one tick processes, s: a tick stays short
_IDLE_AFTER = 2.0  # time without a message and without work under way, s: a shorter pause of a publisher is usual
_IDLE_PERIOD = 1.0  # time between two statuses of an idle node, s: nothing changes meanwhile, and each costs time
_TOO_LATE, _NOT_LEARNT_FROM = attrgetter("pairing.too_late"), attrgetter("monitor.learner.skipped")


class Session:
    """State of a configured node, see the module; the node calls :meth:`tick` while it is active.

    Parameters
    ----------
    bounds : limits of the gains that may be written, which outlast the session.

    Raises
    ------
    StickSlipError
        If parameters make no joint or topic.
    """

    def __init__(self, node: LifecycleNode, bounds: GainBounds, own_change: OwnChange, state_path: Path | None) -> None:
        self._own_change = own_change
        self._node, self._log = node, node.get_logger()
        self._refuse = Refusals(self._log.warning)
        self._work = SlowWork(self._log.warning)
        self._exact, advice = ExactWorker(self._work), AdviceWorker(self._work)
        self._keeper = StateKeeper(state_path, self._log)
        self._states: JointStateTopic | None = None
        self._references: JointStateTopic | ControllerStateTopic | None = None
        self._self: SelfDiagnosis | None = None
        self._first: FirstMessage | None = None
        self._publish_at = self._poll_at = self._scan_at = -math.inf
        self._period = 1.0 / float(node.get_parameter("publish_rate").value)
        self._round_robin = RoundRobin()
        self._busy_at, self._came = monotonic(), 0
        self._spent = 0.0  # mean duration of a tick that publishes [s]
        self._change_tokens: dict[str, tuple[object, ...]] = {}
        self._wholes, self._reference_wholes = WholeTurns(self._log.info), WholeTurns()
        self._findings: dict[str, Findings] = {}
        self._compiled = CompiledParts(self._log)
        self._gains_waiting: deque[tuple[float, str, Gains | None]] = deque()
        self._closing: list[Callable[[], object]] = [self._work.close, self._compiled.close]
        self._reference_type = str(node.get_parameter("reference_type").value)
        try:
            names = monitor_parameters.joint_names(node)
            self.joints = WatchedJoints(
                node, names, bounds, own_change, advice.adviser, self._refuse, self._on_new, self._before_new_gains
            )
            self._processing = BatchProcessing(self.joints, lambda: self._ramps.busy, self._restart_after_error)
            self._gains = GainIntake(
                node,
                lambda: list(self.joints),
                lambda: self.joints.welcomes_others,
                self._hear_gains,
                self._refuse,
            )
            self._closing.append(self._gains.close)
            self._publications = Publications(node)
            self._closing.append(self._publications.close)
            self._feedforward = FrictionFeedforward(node)
            self._closing.append(self._feedforward.close)
            self._on_demand = (
                stability_maps(node, self._work),
                recommended_compensation(node, self._work, self._publications.robot),
            )
            self._closing += [topic.close for topic in self._on_demand]
            self._ramps = Ramps(node, self.joints, self._gains, self._why_not_yet, state_path)
            self._closing.append(self._ramps.close)
            reset = node.create_service(Trigger, "~/reset", self._reset)
            self._closing.append(lambda: node.destroy_service(reset))
            # A type that is not installed is refused now, rather than when the node is activated.
            reference_message_type(self._reference_type)
            self._inputs = Inputs(node, self.joints, self._gains, self._reference_type)
            self.follow_controllers()
        except BaseException:
            self.close()
            raise
        for joint in self.joints.values():
            self._keeper.restore(joint)

    def follow_controllers(self) -> None:
        """Follow the gains of the controllers that the parameters name."""
        self._gains.follow(monitor_parameters.controllers(self._node))

    def withdraw_permission(self) -> None:
        """Stop writing gains of requests made until now."""
        self._ramps.withdraw()

    def activate(self, heard: Callable[[], None]) -> None:
        """Begin to listen; ``heard`` is called when the first message comes that ends an idle time."""
        self._references = reference_topic(
            self._node, self._reference_type, "joint_references", self._qos(), self._refuse
        )
        self._states = JointStateTopic(self._node, "joint_states", self._qos(), self._refuse)
        self._self = SelfDiagnosis(self._states, self._work, self.joints)
        topics = (self._states.subscription, self._references.subscription, self._gains.topic)
        self._first = FirstMessage(self._node, topics, heard)

    def deactivate(self) -> None:
        """Close the subscriptions and stop writing gains; what was learnt is kept and saved."""
        if self._states is None or self._references is None:
            return
        self._ramps.stop("the monitor was deactivated")
        self._feedforward.silence()
        if self._compiled.ready:
            for name in self.joints:
                self._processing.process_pending(name)
            last = [(name, cycle) for name, joint in self.joints.items() for cycle in joint.monitor.finish()]
            self._publications.publish_cycles([*self._processing.pop_cycles(), *last])
        if self._first is not None:
            self._first.close()
        self._states.close()
        self._references.close()
        self._states = self._references = self._self = self._first = None
        self._keeper.save(self.joints)

    def close(self) -> None:
        """Give everything back."""
        while self._closing:
            self._closing.pop()()

    def tick(self) -> None:
        """Process the messages that have arrived, and publish what is due."""
        now = monotonic()
        self._compiled.poll(now)
        self._gains.hear()
        due = now >= self._publish_at - _EARLY
        self._intake(now)
        came = self._came_so_far()
        if came != self._came or self._ramps.busy or self._work.waiting or not self._compiled.ready:
            # The status that ends a silence is published at once, however far the next one was away.
            if self._idle:
                due, self._publish_at = True, now
            self._busy_at, self._came = now, came
        if now >= self._poll_at:
            self._poll_at = now + _POLL_GAINS
            self._gains.poll(now)
            self._inputs.poll(now, self._states)
        self._ramps.tick(now)
        self._feedforward.tick(self.joints, now)
        self._keeper.tick(self.joints, now)
        if due:
            self._publish(now)
            # However many joints there are, intake has most of the time. One long tick delays no later status.
            self._spent += _SMOOTHING * (monotonic() - now - self._spent)
            self._publish_at = max(self._publish_at + self._publish_period, now + _PUBLISH_REST * self._spent)

    def pace(self) -> float:
        """Time until the next tick [s].

        A tick costs about as much for few messages as for many, so that there is one tick for each status, and several
        where statuses are rare. There are more ticks while gains change, and few while no message comes and no work is
        under way. The first message ends an idle time at once.
        """
        if self._first is not None:
            self._first.armed = self._idle
        if self._idle:
            return _IDLE_TICK
        if self._ramps.busy:
            return SHORTEST_TICK
        return max(self._period / math.ceil(self._period / _LONGEST_TICK - 1e-6), SHORTEST_TICK)

    @property
    def _idle(self) -> bool:
        return monotonic() - self._busy_at > _IDLE_AFTER

    @property
    def _publish_period(self) -> float:
        return max(self._period, _IDLE_PERIOD) if self._idle else self._period

    def _came_so_far(self) -> int:
        """How many messages came."""
        topics = (self._states, self._references)
        return sum(topic.messages for topic in topics if topic is not None)

    @staticmethod
    def _qos() -> QoSProfile:
        return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=_QUEUE, reliability=ReliabilityPolicy.BEST_EFFORT)

    def _on_new(self, joint: WatchedJoint) -> None:
        self._keeper.restore(joint)
        gains = self._gains.heard_of(joint.name)
        if gains is not None:
            self.joints.hear_gains(joint.name, gains)

    def _hear_gains(self, name: str, gains: Gains | None) -> None:
        """Apply gains to the samples from now on; where these wait, the gains wait too."""
        if self._gains_waiting or self._behind(monotonic()):
            self._gains_waiting.append((monotonic(), name, gains))
        else:
            self._apply_gains(name, gains)

    def _before_new_gains(self, joint: WatchedJoint) -> None:
        """Process the samples that came before a change of gains."""
        self._processing.process_pending(joint.name)

    def _apply_gains(self, name: str, gains: Gains | None) -> None:
        self.joints.hear_gains(name, gains)
        if name in self.joints:
            self._ramps.hear_gains(self.joints[name])

    def _oldest(self) -> float:
        """Arrival of the oldest waiting message, a steady time [s]; infinite if none waits."""
        if self._states is None or self._references is None:
            return math.inf
        return min(self._states.backlog.oldest, self._references.backlog.oldest)

    def _behind(self, now: float) -> bool:
        """Whether messages that arrived a while ago still wait."""
        return not self._compiled.ready or now - self._oldest() > _PENDING_PER_TICK

    def _intake(self, now: float) -> None:
        """Drain the topics; messages wait while the node compiles, and are processed later in their order."""
        if self._states is None or self._references is None:
            return
        if not self._compiled.ready:
            self._states.keep()
            self._references.keep()
            return
        until = self._oldest() + _PENDING_PER_TICK if self._behind(now) else math.inf
        if self._gains_waiting:
            until = min(until, self._gains_waiting[0][0])
        self._process_arrived(until, now)
        while self._gains_waiting and self._gains_waiting[0][0] <= until:
            _, name, gains = self._gains_waiting.popleft()
            self._apply_gains(name, gains)

    def _process_arrived(self, until: float, now: float) -> None:
        assert self._states is not None
        assert self._references is not None
        # References last, so that they are no older than the samples that wait for them.
        samples, references = self._states.samples_until(until), self._references.samples_until(until)
        contested = self._states.contested
        self.joints.mark_contested(contested, self._states.contest)
        for name, rows in samples.items():
            heard = self.joints.welcome(name)
            if heard is not None:
                heard.heard = now
                if name not in contested:
                    heard.add_samples(self._wholes.removed(name, rows))
        for name, rows in references.items():
            if name in self.joints:
                self.joints[name].pairing.add_references(self._reference_wholes.removed(name, rows[:, :3]))
                self._feedforward.hear(name, rows, now)
        self._processing.expect(samples, references, now)
        self._processing.poll(now)
        self._publications.publish_cycles(self._processing.pop_cycles())

    def _restart_after_error(self, joint: WatchedJoint) -> None:
        """Log an error in the processing of one joint, and restart the joint."""
        self._refuse(f"{joint.name}: an error of the monitor itself; the joint is followed anew")
        self._log.error(f"{joint.name}: {traceback.format_exc()}", throttle_duration_sec=10.0)
        joint.restart()

    def _publish(self, now: float) -> None:
        if not self._compiled.ready:
            self._publications.publish_waiting(self._own_status(), self.joints, self._compiled.state)
            return
        processed = self._scan_for_changes(now)
        reported, in_turn = self._round_robin.due(self._change_tokens, urgent(self.joints), self._publish_period)
        # Joints with changes do not wait for the many joints whose turn it is.
        later = in_turn if len(self.joints) > FEW else []
        assessed = [name for name in reported if name not in later]
        self._assess(assessed, now)
        self._publish_statuses(self._own_status(), assessed, assessed)
        if self._self is not None and self._states is not None:
            if self._behind(now):
                self._states.reset_figures()
            else:
                self._self.note()
        if later:
            again = self._processing.may_wait(later, self._publish_period)
            assessed_later = [name for name in later if name not in again or name not in self._findings]
            self._assess(assessed_later, now)
            self._publish_statuses(None, later, assessed_later)
            assessed += assessed_later
        self._publications.publish_tables(self._findings, reported)
        for topic in self._on_demand:
            topic.attend(self._findings, now)
        advised = {name: self._findings[name].advised for name in assessed if name in self._findings}
        with self._own_change:
            joint_parameters.set_recommended(self._node, advised)
        ended = self._processing.pop_cycles()
        for name in dict.fromkeys([*processed, *reported]):
            attend_study(self._work, name, self.joints[name].monitor.learner)
        for name in assessed:
            if name in self._findings and self._findings[name].silent_for is not None:
                ended += [(name, cycle) for cycle in self.joints[name].monitor.finish()]
        self._publications.publish_cycles(ended)

    def _assess(self, names: Iterable[str], now: float) -> None:
        for name in names:
            self._processing.process_pending(name, now)
            try:
                self._findings[name] = self._findings_of(self.joints[name], now)
            except Exception:
                self._findings.pop(name, None)
                self._restart_after_error(self.joints[name])

    def _publish_statuses(self, own: Diagnosis | None, reported: Iterable[str], assessed: Iterable[str]) -> None:
        warn_margin = float(self._node.get_parameter("warn_margin").value)
        self._publications.publish_statuses(own, self._findings, reported, assessed, warn_margin=warn_margin)

    def _scan_for_changes(self, now: float) -> list[str]:
        """Joints that were processed since the last scan; their change tokens are updated.

        A change token holds objects of which one is replaced when a joint is to be reported at once. Tokens of the
        other joints are updated less often, if these are many.
        """
        processed = self._processing.processed()
        names: Iterable[str] = processed
        if now >= self._scan_at:
            self._scan_at = now + (_SCAN_ALL if len(self.joints) > FEW else 0.0)
            names = self.joints
        for name in names:
            joint = self.joints[name]
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
        self._feedforward.update(joint, assessment)
        silence = now - joint.heard
        trial = assessment.trial if assessment.gains_known else None
        conditions = joint.settings.options.conditions
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
            missing=self._inputs.missing(joint, assessment),
            applied=self._ramps.outcomes.get(joint.name, ""),
            advised=joint.advised(assessment),
            here=self._exact.verdict_here(f"here {joint.name}", assessment, conditions, now),
            conditions=conditions,
        )

    def _why_not_yet(self) -> str:
        if self._states is None:
            raise RefusedError("the monitor is not active")
        if self._behind(monotonic()):
            return self._compiled.state or "what came while the node compiled is being looked at"
        return ""

    def _own_status(self) -> Diagnosis:
        """Status of the node itself: what it refused, where its gains come from, and how it keeps up."""
        troubles = [
            self._compiled.state,
            self._ramps.trouble,
            self._gains.state if self._gains.waiting else "",
            *self._inputs.troubles,
            self._self.trouble if self._self is not None else "",
            self._keeper.trouble,
            f"refused: {self._refuse.latest}" if self._refuse.latest else "",
        ]
        message = "; ".join(trouble for trouble in troubles if trouble)
        values: list[tuple[str, object]] = [
            ("compiling", self._compiled.state),
            ("joints [1]", len(self.joints)),
            ("controller", self._gains.state),
            ("gains of joints not heard of", ", ".join(self._gains.early)),
            *self._inputs.values(),
            ("references too late [1]", sum(map(_TOO_LATE, self.joints.values()))),
            ("apply_recommendation", self._ramps.state),
            ("slips not learnt from, a study being late [1]", sum(map(_NOT_LEARNT_FROM, self.joints.values()))),
            *(self._self.values() if self._self is not None else ()),
            *((f"refused: {reason}", count) for reason, count in self._refuse.counts.items()),
        ]
        return Diagnosis(
            level=Level.WARN if message else Level.OK,
            name="stickslip_monitor",
            hardware_id="stickslip_monitor",
            message=message,
            values=tuple((key, value_text(value)) for key, value in values),
        )

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        for name, joint in self.joints.items():
            self._processing.process_pending(name)
            joint.monitor.reset()
            self._keeper.forget(name)
        response.success = True
        response.message = f"forgot what was learnt of {len(self.joints)} joints"
        return response
