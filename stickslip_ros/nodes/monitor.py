# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The node `stickslip_monitor`: joint states and gains in; diagnostics, margins, cycles and advice out."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from stickslip_ros.compiled import load_compiled_parts
from stickslip_ros.diagnosis import cycle_diagnostic, joint_diagnostic
from stickslip_ros.errors import StickSlipError
from stickslip_ros.joint_settings import RECOMMENDED
from stickslip_ros.margin_table import MARGIN_FIELDS, margin_row
from stickslip_ros.message_content import MessageError, joint_rows, reference_rows, seconds
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.nodes import joint_parameters, monitor_parameters
from stickslip_ros.nodes.advice_worker import AdviceWorker
from stickslip_ros.nodes.apply_service import ApplyService, NotYetError, RefusedError
from stickslip_ros.nodes.conversion import diagnostic_status, friction_message, table
from stickslip_ros.nodes.drain import DrainedSubscription
from stickslip_ros.nodes.exact_worker import UNKNOWN, ExactWorker
from stickslip_ros.nodes.gain_application import GainApplication
from stickslip_ros.nodes.gain_intake import GainIntake
from stickslip_ros.nodes.references import reference_message_type
from stickslip_ros.nodes.running import run
from stickslip_ros.nodes.study_worker import StudyWorker
from stickslip_ros.nodes.watched_joint import WatchedJoint

_DRAIN_PERIOD = 0.02
_STALE_AFTER = 1.0
_QUEUE = 5000
_MOST_JOINTS = 256  # names come from the graph; their number is bounded
_MOST_REASONS = 64
_JOINT_NAME = re.compile(r"[A-Za-z0-9_/-]{1,128}")


class Monitor(Node):
    """Watches every joint it is told of, or hears of; see config/monitor.yaml for the parameters."""

    def __init__(self) -> None:
        super().__init__("stickslip_monitor")
        self._joints: dict[str, WatchedJoint] = {}
        self._refused: Counter[str] = Counter()
        self._changing = False
        self._exact = ExactWorker()
        self._advice = AdviceWorker()
        self._studies = StudyWorker()
        load_compiled_parts()
        monitor_parameters.declare(self)
        names = [name for name in self.get_parameter("joints").value if name]
        self._all_joints = not names
        self._gains = GainIntake(
            self, lambda: list(self._joints), lambda: self._all_joints, self._on_gains, self._refuse
        )
        self._gains.follow(monitor_parameters.controllers(self))
        for name in names:
            self._add_joint(name)
        monitor_parameters.check(self)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)

        incoming = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=_QUEUE, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._states = DrainedSubscription(self, JointState, "joint_states", incoming)
        reference_type = reference_message_type(self.get_parameter("reference_type").value)
        self._references = DrainedSubscription(self, reference_type, "joint_references", incoming)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._margins = self.create_publisher(Float64MultiArray, "~/margins", 10)
        self._cycles = self.create_publisher(DiagnosticArray, "~/cycles", 1000)
        self._friction = self.create_publisher(JointState, "~/friction", 10)
        self._recommended = self.create_publisher(Float64MultiArray, "~/recommended_gains", 10)
        self.create_service(Trigger, "~/reset", self._reset)
        self._apply = ApplyService(self, self._begin_applying)
        # Timers on ROS time would stop with a paused or looping simulation.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_DRAIN_PERIOD, self._drain, clock=steady)
        self.create_timer(1.0 / self.get_parameter("publish_rate").value, self._publish, clock=steady)

    def _add_joint(self, name: str) -> None:
        with self._own_change():
            joint_parameters.declare(self, name)
        settings = joint_parameters.read(self, name)
        monitor = JointMonitor(settings.joint, settings.gains, settings.options, self._advice.adviser(name))
        self._joints[name] = WatchedJoint(name, monitor, settings)

    @contextmanager
    def _own_change(self) -> Iterator[None]:
        """Lets the node itself set what others may not."""
        self._changing = True
        try:
            yield
        finally:
            self._changing = False

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Refuse what would make no joint, with the reason; nothing is changed here."""
        changes = {parameter.name: parameter for parameter in parameters}
        for name in changes:
            if name.startswith("recommended.") and not self._changing:
                return SetParametersResult(
                    successful=False,
                    reason=f"{name} is the monitor's advice and cannot be set; set the controller's gains instead",
                )
        try:
            monitor_parameters.check(self, changes)
            for joint in self._joints:
                joint_parameters.read(self, joint, changes)
        except StickSlipError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, parameters: list[Parameter]) -> None:
        if self._changing:
            return
        names = {parameter.name for parameter in parameters}
        for joint in self._joints.values():
            before = joint.settings
            joint.settings = joint_parameters.read(self, joint.name)
            joint.monitor.joint = joint.settings.joint
            joint.monitor.options = joint.settings.options
            if any(name.startswith(f"gains.{joint.name}.") for name in names):
                self._set_gains(joint, joint.settings.gains)
            elif joint.settings.gain_scale != before.gain_scale and joint.monitor.gains is not None:
                self._set_gains(joint, joint.settings.to_si(before.from_si(joint.monitor.gains)))
            if any(name.startswith(f"limits.{joint.name}.") for name in names):
                joint_parameters.describe_recommended(self, joint.name)
        if "controller" in names:
            self._gains.follow(monitor_parameters.controllers(self))

    def _on_gains(self, name: str, gains: Gains) -> None:
        joint = self._joints.get(name)
        if joint is not None:
            self._set_gains(joint, joint.settings.to_si(gains))

    def _set_gains(self, joint: WatchedJoint, gains: Gains | None) -> None:
        """Let a joint's monitor know its gains, in SI units."""
        if joint.monitor.gains != gains:
            joint.monitor.gains = gains
            if gains is not None:
                joint.gains_heard.append(gains)
            self.get_logger().info(f"{joint.name}: gains are now {gains}")

    def _refuse(self, reason: str) -> None:
        """Count a refusal for the diagnostics and say it once in the log."""
        if reason not in self._refused:
            if len(self._refused) >= _MOST_REASONS:
                reason = "more reasons than are kept"
            self.get_logger().warning(f"refused: {reason}")
        self._refused[reason] += 1

    def _drain(self) -> None:
        """Take what has arrived and let every joint's monitor follow it."""
        # References last, so that they are no older than the samples that wait for them.
        for message in self._states.take_all():
            self._take_state(message)
        for message in self._references.take_all():
            self._take_reference(message)
        found: list[DiagnosticStatus] = []
        for name, joint in self._joints.items():
            batch = joint.pairing.take()
            if batch is not None:
                found += [diagnostic_status(cycle_diagnostic(name, cycle)) for cycle in joint.monitor.process(batch)]
        self._publish_cycles(found)
        self._apply.tick(monotonic())

    def _publish_cycles(self, found: list[DiagnosticStatus]) -> None:
        if found:
            array = DiagnosticArray(status=found)
            array.header.stamp = self.get_clock().now().to_msg()
            self._cycles.publish(array)

    def _take_reference(self, message: Any) -> None:
        try:
            rows = reference_rows(message)
        except MessageError as error:
            self._refuse(f"joint_references: {error}")
            return
        time = self._time_of("joint_references", message)
        for name, (position, velocity) in rows.items():
            if name in self._joints:
                self._joints[name].pairing.add_reference(time, position, velocity)

    def _take_state(self, message: JointState) -> None:
        try:
            rows = joint_rows(message)
        except MessageError as error:
            self._refuse(f"joint_states: {error}")
            return
        time = self._time_of("joint_states", message)
        now = monotonic()
        for name, row in rows.items():
            joint = self._joints.get(name) or self._welcome(name)
            if joint is not None:
                joint.add_sample(time, *row)
                joint.heard = now

    def _time_of(self, topic: str, message: Any) -> float:
        """The message's stamp, or the time now if it has none [s]."""
        stamp = seconds(message.header.stamp)
        if stamp == 0.0:
            self._refuse(f"{topic}: stamp is zero; the time of arrival is used instead")
            stamp = 1e-9 * self.get_clock().now().nanoseconds
        return stamp

    def _welcome(self, name: str) -> WatchedJoint | None:
        """Begin to watch a joint heard of for the first time, if every joint is watched."""
        if not self._all_joints:
            return None
        if not _JOINT_NAME.fullmatch(name):
            self._refuse("joint_states: a joint name has characters other than letters, digits, _ - /")
            return None
        if len(self._joints) >= _MOST_JOINTS:
            self._refuse(f"joint_states: more than {_MOST_JOINTS} joints")
            return None
        try:
            self._add_joint(name)
        except StickSlipError as error:
            self._refuse(f"{name}: {error}")
            return None
        gains = self._gains.heard_of(name)
        if gains is not None:
            self._on_gains(name, gains)
        return self._joints[name]

    def _publish(self) -> None:
        now = monotonic()
        self._gains.poll(now)
        warn_margin = float(self.get_parameter("warn_margin").value)
        array = DiagnosticArray()
        array.header.stamp = self.get_clock().now().to_msg()
        array.status.append(self._own_status())
        rows: list[float] = []
        ended: list[DiagnosticStatus] = []
        advised: dict[str, Gains | None] = {}
        assessments: dict[str, Assessment] = {}
        for name, joint in self._joints.items():
            self._studies.attend(name, joint.monitor.learner)
            assessment = assessments[name] = joint.monitor.assessment()
            stale = now - joint.heard if now - joint.heard > _STALE_AFTER else None
            exact, trial = self._exact_verdicts(joint, assessment, now)
            diagnosis = joint_diagnostic(
                name,
                assessment,
                exact,
                trial,
                warn_margin=warn_margin,
                silent_for=stale,
                applied=self._apply.outcomes.get(name, ""),
            )
            array.status.append(diagnostic_status(diagnosis))
            if stale is not None:
                ended += [diagnostic_status(cycle_diagnostic(name, cycle)) for cycle in joint.monitor.finish()]
            rows += margin_row(assessment, exact, trial)
            advised[name] = joint.advised(assessment)
        self._diagnostics.publish(array)
        self._publish_cycles(ended)
        if not self._joints:
            return
        self._friction.publish(friction_message(array.header.stamp, assessments))
        self._margins.publish(table(list(self._joints), MARGIN_FIELDS, rows))
        self._publish_advice(advised)

    def _exact_verdicts(
        self, joint: WatchedJoint, assessment: Assessment, now: float
    ) -> tuple[ExactVerdict, ExactVerdict]:
        """On the gains of now, and on those on trial."""

        def verdict(name: str, believed: Joint | None, gains: Gains | None) -> ExactVerdict:
            if believed is None or gains is None or not assessment.velocity_source:
                return UNKNOWN
            return self._exact.verdict(
                name, believed, gains, joint.settings.options.conditions, assessment.velocity, now
            )

        trial = None if assessment.per_inertia else assessment.trial
        return (
            verdict(joint.name, assessment.joint, assessment.margin_gains),
            verdict(f"trial {joint.name}", assessment.joint, trial),
        )

    def destroy_node(self) -> None:
        """End the workers too."""
        self._exact.close()
        self._advice.close()
        self._studies.close()
        super().destroy_node()

    def _publish_advice(self, advised: dict[str, Gains | None]) -> None:
        found = {name: gains for name, gains in advised.items() if gains is not None}
        if found:
            values = [float(value) for gains in found.values() for value in (gains.stiffness, gains.damping)]
            self._recommended.publish(table(list(found), ("p", "d"), values))
        changed = []
        for name, gains in advised.items():
            numbers = (math.nan, math.nan) if gains is None else (float(gains.stiffness), float(gains.damping))
            for key, value in zip(RECOMMENDED, numbers, strict=True):
                parameter = joint_parameters.recommended_name(name, key)
                old = float(self.get_parameter(parameter).value)
                if old != value and not (math.isnan(old) and math.isnan(value)):
                    changed.append(Parameter(parameter, Parameter.Type.DOUBLE, value))
        if changed:
            with self._own_change():
                self.set_parameters(changed)

    def _begin_applying(self) -> list[GainApplication]:
        """The ramps that lead to the advice, for every joint that needs it."""
        if not self.get_parameter("allow_apply").value:
            raise RefusedError("allow_apply is false; set it to true where gains may be written")
        ramps, reasons = [], []
        for joint in self._joints.values():
            assessment = joint.monitor.assessment()
            if joint.being_advised(assessment):
                raise NotYetError(f"the advice for {joint.name} is being worked out")
            controller = self._gains.controller_of(joint.name)
            reason = joint.why_not_applied(assessment, has_controller=controller is not None)
            if reason or controller is None:
                reasons.append(reason)
                continue
            ramps.append(
                GainApplication(
                    joint,
                    controller,
                    rate=float(self.get_parameter("apply_rate").value),
                    allowed=lambda: bool(self.get_parameter("allow_apply").value),
                    log=self.get_logger(),
                )
            )
        if not ramps:
            raise RefusedError("; ".join(reasons) or "no joint is watched yet")
        return ramps

    def _own_status(self) -> DiagnosticStatus:
        """The node's own health: what it refused, where the gains come from."""
        status = DiagnosticStatus(name="stickslip_monitor", hardware_id="stickslip_monitor", level=DiagnosticStatus.OK)
        if self._apply.failed:
            status.level, status.message = DiagnosticStatus.WARN, f"apply_recommendation: {self._apply.state}"
        elif self._gains.waiting:
            status.level, status.message = DiagnosticStatus.WARN, self._gains.state
        elif self._refused:
            status.level, status.message = DiagnosticStatus.WARN, f"refused: {next(reversed(self._refused))}"
        status.values = [
            KeyValue(key="joints [1]", value=str(len(self._joints))),
            KeyValue(key="controller", value=self._gains.state),
            KeyValue(key="gains of joints not heard of", value=", ".join(self._gains.early)),
            KeyValue(key="apply_recommendation", value=self._apply.state),
            KeyValue(key="studies of friction that failed [1]", value=str(self._studies.failures)),
            KeyValue(
                key="slips not learnt from, a study being late [1]",
                value=str(sum(joint.monitor.learner.skipped for joint in self._joints.values())),
            ),
        ]
        status.values += [
            KeyValue(key=f"refused: {reason}", value=str(count)) for reason, count in self._refused.items()
        ]
        return status

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        for joint in self._joints.values():
            joint.monitor.reset()
        response.success = True
        response.message = f"forgot what was learnt of {len(self._joints)} joints"
        return response


def main(args: list[str] | None = None) -> int:
    """Run the node until it is interrupted."""
    return run(Monitor, args)


if __name__ == "__main__":
    raise SystemExit(main())
