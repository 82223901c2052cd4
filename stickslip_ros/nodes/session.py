# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""All that the monitor has between configuring and cleaning up: its parts are made here, and called in turn."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from operator import attrgetter
from pathlib import Path
from time import monotonic

from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from stickslip_ros.model.friction import Gains
from stickslip_ros.nodes import monitor_parameters
from stickslip_ros.nodes.compiled_parts import CompiledParts
from stickslip_ros.nodes.friction_feedforward import FrictionFeedforward
from stickslip_ros.nodes.gains.gain_intake import GainIntake
from stickslip_ros.nodes.gains.ramp_journal import RampJournal
from stickslip_ros.nodes.gains.ramps import Ramps
from stickslip_ros.nodes.intake.arrivals import Arrivals, reference_message_type
from stickslip_ros.nodes.intake.inputs import Inputs
from stickslip_ros.nodes.intake.refusals import Refusals
from stickslip_ros.nodes.joints.joint_parameters import OwnChange
from stickslip_ros.nodes.joints.scheduling import BatchProcessing
from stickslip_ros.nodes.joints.watched_joints import GainBounds, WatchedJoints
from stickslip_ros.nodes.other_monitors import OtherMonitors
from stickslip_ros.nodes.pace import Pace
from stickslip_ros.nodes.publications import Publications
from stickslip_ros.nodes.reports import Reports
from stickslip_ros.nodes.self_diagnosis import SelfDiagnosis
from stickslip_ros.nodes.state.state_keeper import StateKeeper
from stickslip_ros.nodes.worker.process import SlowWork
from stickslip_ros.nodes.worker.questions import AdviceWorker
from stickslip_ros.output.diagnosis import Diagnosis, Level, value_text

_POLL_GAINS = 0.1  # time between two polls of the controllers and the inputs, s: each queries the graph
_TOO_LATE, _NOT_LEARNT_FROM = attrgetter("pairing.too_late"), attrgetter("monitor.learner.skipped")


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
        own_change: OwnChange,
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
            names, adviser = monitor_parameters.joint_names(node), AdviceWorker(self._work).adviser
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
        self._gains.follow(monitor_parameters.controllers(self._node))

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
        until = arrivals.due_until(now)
        for came, name, gains in self._gains.heard_until(until):
            self._process_motion(arrivals, came, now)
            self._set_gains(name, gains)
        self._process_motion(arrivals, until, now)

    def _process_motion(self, arrivals: Arrivals, until: float, now: float) -> None:
        samples, references = arrivals.motion_until(until)
        self.joints.mark_contested(arrivals.states.contested, arrivals.states.contest)
        for name in self.joints.hear(samples, references, now):
            self._keeper.restore(self.joints[name])
            early = self._gains.heard_before(name)
            if early is not None:
                self._set_gains(name, early)
        for name, rows in references.items():
            if name in self.joints:
                self._feedforward.hear(name, rows, now)
        self._processing.expect(samples, references, now)
        self._processing.poll(now, hurry=self._ramps.busy)
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
