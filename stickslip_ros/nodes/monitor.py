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
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from stickslip_ros.compiled import load_compiled_parts
from stickslip_ros.errors import StickSlipError
from stickslip_ros.model.controlled import Conditions
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.advice import AdviceLimits
from stickslip_ros.monitoring.joint_monitor import Assessment, JointMonitor, MonitorOptions
from stickslip_ros.nodes import joint_parameters
from stickslip_ros.nodes.conversion import (
    MARGIN_FIELDS,
    MessageError,
    cycle_diagnostic,
    friction_message,
    gains_from_message,
    joint_diagnostic,
    joint_rows,
    margin_row,
    seconds,
    table,
)
from stickslip_ros.nodes.drain import DrainedSubscription
from stickslip_ros.nodes.exact_worker import UNKNOWN, ExactWorker
from stickslip_ros.nodes.gain_source import ControllerGains
from stickslip_ros.nodes.reference_pairing import ReferencePairing
from stickslip_ros.nodes.references import reference_message_type, reference_rows
from stickslip_ros.nodes.running import run
from stickslip_ros.nodes.study_worker import StudyWorker

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
        self._monitors: dict[str, JointMonitor] = {}
        self._pairings: dict[str, ReferencePairing] = {}
        self._conditions: dict[str, Conditions] = {}
        self._heard: dict[str, float] = {}
        self._refused: Counter[str] = Counter()
        self._changing = False
        self._exact = ExactWorker()
        self._studies = StudyWorker()
        load_compiled_parts()
        self._declare()
        names = [name for name in self.get_parameter("joints").value if name]
        self._all_joints = not names
        for name in names:
            self._add_joint(name)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)

        incoming = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=_QUEUE, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._states = DrainedSubscription(self, JointState, "joint_states", incoming)
        reference_type = reference_message_type(self.get_parameter("reference_type").value)
        self._references = DrainedSubscription(self, reference_type, "joint_references", incoming)
        self.create_subscription(Float64MultiArray, "pd_gains", self._on_gains_message, 10)
        controller = self.get_parameter("controller").value
        self._controller = (
            ControllerGains(self, controller, self._set_gains, lambda: list(self._monitors)) if controller else None
        )
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._margins = self.create_publisher(Float64MultiArray, "~/margins", 10)
        self._cycles = self.create_publisher(DiagnosticArray, "~/cycles", 1000)
        self._friction = self.create_publisher(JointState, "~/friction", 10)
        self._recommended = self.create_publisher(Float64MultiArray, "~/recommended_gains", 10)
        self.create_service(Trigger, "~/reset", self._reset)
        # Timers on ROS time would stop with a paused or looping simulation.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_DRAIN_PERIOD, self._drain, clock=steady)
        self.create_timer(1.0 / self.get_parameter("publish_rate").value, self._publish, clock=steady)

    def _declare(self) -> None:
        def parameter(name: str, default: object, text: str, *, read_only: bool = False) -> None:
            self.declare_parameter(name, default, ParameterDescriptor(description=text, read_only=read_only))

        parameter("joints", [""], "joints to watch; [''] for every joint heard of", read_only=True)
        parameter(
            "controller", "", "node whose parameters gains.<joint>.p/.i/.d are followed; empty: none", read_only=True
        )
        parameter(
            "reference_type",
            "JointState",
            "message on joint_references: JointState, or with control_msgs JointTrajectoryControllerState or "
            "MultiDOFStateStamped",
            read_only=True,
        )
        parameter("publish_rate", 10.0, "how often diagnostics and margins are published [Hz]", read_only=True)
        parameter("warn_margin", 0.1, "damping reserve rho/rho_c - 1 below which smooth motion is at risk [1]")
        parameter("wanted_margin", 0.2, "damping reserve rho/rho_c - 1 that advice must reach [1]")
        parameter(
            "confidence", 0.9, "probability with which advice must reach it, the friction learnt being uncertain [1]"
        )
        parameter("learn", True, "whether friction is learnt from the motion")
        parameter("memory", 100.0, "slips after which what they taught has faded to a third [1]")
        parameter("least_motion", 1.0, "how long motion must last before it is called smooth [s]")

    def _add_joint(self, name: str) -> None:
        with self._own_change():
            joint_parameters.declare(self, name)
        settings = joint_parameters.read(self, name)
        self._monitors[name] = JointMonitor(settings.joint, settings.gains, self._options(settings.limits))
        self._pairings[name] = ReferencePairing()
        self._conditions[name] = settings.conditions

    @contextmanager
    def _own_change(self) -> Iterator[None]:
        """Lets the node itself set what others may not."""
        self._changing = True
        try:
            yield
        finally:
            self._changing = False

    def _options(self, limits: AdviceLimits, changes: dict[str, Parameter] | None = None) -> MonitorOptions:
        def value(name: str) -> float:
            changed = (changes or {}).get(name)
            return float(changed.value if changed is not None else self.get_parameter(name).value)

        return MonitorOptions(
            warn_margin=value("warn_margin"),
            least_motion=value("least_motion"),
            learn=bool(value("learn")),
            memory=value("memory"),
            limits=limits,
        )

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
            for joint in self._monitors:
                settings = joint_parameters.read(self, joint, changes)
                self._options(settings.limits, changes)
        except StickSlipError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, parameters: list[Parameter]) -> None:
        if self._changing:
            return
        for name, monitor in self._monitors.items():
            settings = joint_parameters.read(self, name)
            monitor.joint = settings.joint
            self._conditions[name] = settings.conditions
            monitor.options = self._options(settings.limits)
            if any(parameter.name.startswith(f"gains.{name}.") for parameter in parameters):
                self._set_gains(name, settings.gains)

    def _set_gains(self, joint: str, gains: Gains | None) -> None:
        monitor = self._monitors.get(joint)
        if monitor is not None and monitor.gains != gains:
            monitor.gains = gains
            self.get_logger().info(f"{joint}: gains are now {gains}")

    def _on_gains_message(self, message: Float64MultiArray) -> None:
        try:
            gains = gains_from_message(message)
        except MessageError as error:
            self._refuse(f"pd_gains: {error}")
            return
        for joint, value in gains.items():
            if joint in self._monitors:
                self._set_gains(joint, value)
            else:
                self._refuse(
                    f"pd_gains: unknown joint {joint[:64]!r}; known: {', '.join(self._monitors) or 'none yet'}"
                )

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
        for name, pairing in self._pairings.items():
            batch = pairing.take()
            if batch is not None:
                found += [cycle_diagnostic(name, cycle) for cycle in self._monitors[name].process(batch)]
        self._publish_cycles(found)

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
            if name in self._pairings:
                self._pairings[name].add_reference(time, position, velocity)

    def _take_state(self, message: JointState) -> None:
        try:
            rows = joint_rows(message)
        except MessageError as error:
            self._refuse(f"joint_states: {error}")
            return
        time = self._time_of("joint_states", message)
        now = monotonic()
        for name, row in rows.items():
            pairing = self._pairings.get(name) or self._welcome(name)
            if pairing is not None:
                pairing.add_sample(time, *row)
                self._heard[name] = now

    def _time_of(self, topic: str, message: Any) -> float:
        """The message's stamp, or the time now if it has none [s]."""
        stamp = seconds(message.header.stamp)
        if stamp == 0.0:
            self._refuse(f"{topic}: stamp is zero; the time of arrival is used instead")
            stamp = 1e-9 * self.get_clock().now().nanoseconds
        return stamp

    def _welcome(self, name: str) -> ReferencePairing | None:
        """Begin to watch a joint heard of for the first time, if every joint is watched."""
        if not self._all_joints:
            return None
        if not _JOINT_NAME.fullmatch(name):
            self._refuse("joint_states: a joint name has characters other than letters, digits, _ - /")
            return None
        if len(self._monitors) >= _MOST_JOINTS:
            self._refuse(f"joint_states: more than {_MOST_JOINTS} joints")
            return None
        try:
            self._add_joint(name)
        except StickSlipError as error:
            self._refuse(f"{name}: {error}")
            return None
        return self._pairings[name]

    def _publish(self) -> None:
        now = monotonic()
        if self._controller is not None:
            self._controller.poll(now)
        warn_margin = float(self.get_parameter("warn_margin").value)
        array = DiagnosticArray()
        array.header.stamp = self.get_clock().now().to_msg()
        array.status.append(self._own_status())
        rows: list[float] = []
        ended: list[DiagnosticStatus] = []
        advised: dict[str, tuple[float, float]] = {}
        assessments: dict[str, Assessment] = {}
        for name, monitor in self._monitors.items():
            self._studies.attend(name, monitor.learner)
            assessment = monitor.assessment()
            assessments[name] = assessment
            silent_for = now - self._heard[name] if name in self._heard else math.inf
            exact = self._exact_verdict(name, assessment, now)
            stale = silent_for if silent_for > _STALE_AFTER else None
            array.status.append(joint_diagnostic(name, assessment, exact, warn_margin=warn_margin, silent_for=stale))
            if silent_for > _STALE_AFTER:
                ended += [cycle_diagnostic(name, cycle) for cycle in monitor.finish()]
            rows += margin_row(assessment, exact)
            advice = assessment.recommendation
            known = advice is not None and assessment.gains is not None
            advised[name] = (advice.stiffness, advice.damping) if known and advice else (math.nan, math.nan)
        self._diagnostics.publish(array)
        self._publish_cycles(ended)
        if not self._monitors:
            return
        self._friction.publish(friction_message(array.header.stamp, assessments))
        self._margins.publish(table(list(self._monitors), MARGIN_FIELDS, rows))
        self._publish_advice(advised)

    def _exact_verdict(self, name: str, assessment: Assessment, now: float) -> ExactVerdict:
        joint, gains = assessment.joint, assessment.margin_gains
        if joint is None or gains is None or not assessment.velocity_source:
            return UNKNOWN
        return self._exact.verdict(name, joint, gains, self._conditions[name], assessment.velocity, now)

    def destroy_node(self) -> None:
        """End the workers too."""
        self._exact.close()
        self._studies.close()
        super().destroy_node()

    def _publish_advice(self, advised: dict[str, tuple[float, float]]) -> None:
        found = {name: gains for name, gains in advised.items() if math.isfinite(gains[0])}
        if found:
            values = [value for gains in found.values() for value in gains]
            self._recommended.publish(table(list(found), ("p", "d"), values))
        changed = []
        for name, gains in advised.items():
            for key, value in zip(joint_parameters.RECOMMENDED, gains, strict=True):
                parameter = f"recommended.{name}.{key}"
                old = float(self.get_parameter(parameter).value)
                if old != value and not (math.isnan(old) and math.isnan(value)):
                    changed.append(Parameter(parameter, Parameter.Type.DOUBLE, value))
        if changed:
            with self._own_change():
                self.set_parameters(changed)

    def _own_status(self) -> DiagnosticStatus:
        """The node's own health: what it refused, where the gains come from."""
        status = DiagnosticStatus(name="stickslip_monitor", hardware_id="stickslip_monitor", level=DiagnosticStatus.OK)
        controller = self._controller.state if self._controller is not None else "none configured"
        status.message = f"watching {len(self._monitors)} joints"
        waiting = self._controller is not None and not controller.startswith("following")
        if self._refused or waiting:
            status.level = DiagnosticStatus.WARN
            status.message = controller if waiting else f"refused: {next(reversed(self._refused))}"
        status.values = [
            KeyValue(key="joints [1]", value=str(len(self._monitors))),
            KeyValue(key="controller", value=controller),
            KeyValue(key="studies of friction that failed [1]", value=str(self._studies.failures)),
        ]
        status.values += [
            KeyValue(key=f"refused: {reason}", value=str(count)) for reason, count in self._refused.items()
        ]
        return status

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        for monitor in self._monitors.values():
            monitor.reset()
        response.success = True
        response.message = f"forgot what was learnt of {len(self._monitors)} joints"
        return response


def main(args: list[str] | None = None) -> int:
    """Run the node until it is interrupted."""
    return run(Monitor, args)


if __name__ == "__main__":
    raise SystemExit(main())
