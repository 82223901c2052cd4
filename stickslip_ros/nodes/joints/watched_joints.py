# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The joints that the node watches, their parameters, and bounds of their gains that nobody on the graph can widen."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, ItemsView, Iterator, Mapping, ValuesView
from dataclasses import dataclass, field
from functools import cached_property

from rclpy.node import Node
from rclpy.parameter import Parameter

from stickslip_ros.errors import StickSlipError
from stickslip_ros.messages.whole_turns import WholeTurns
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.advice.adviser import Adviser
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.reference_pairing import ReferencePairing
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.nodes.intake.refusals import Refusals
from stickslip_ros.nodes.joints import joint_parameters
from stickslip_ros.settings.parameter_table import COMMON, PER_JOINT
from stickslip_ros.settings.parameters import JointSettings

RANGES = ("stiffness_range", "damping_range")
WORTH_CHANGING = (Status.STICK_SLIP, Status.AT_RISK)
MOST_JOINTS = 256  # number of joints, 1: their names come from the graph, and no robot has so many
_JOINT_NAME = re.compile(r"[A-Za-z0-9_/-]{1,128}")
_COMMON = frozenset(spec.name for spec in COMMON)


class GainBounds:
    """The first limits of a joint that have an upper end, in the controller's units.

    These limits hold as long as the node runs. Whoever can set parameters can request narrower limits or other advice,
    but no gains outside the limits that the robot's owner configured are written.
    """

    def __init__(self) -> None:
        self._first: dict[tuple[str, str], tuple[float, float]] = {}

    def note(self, name: str, settings: JointSettings) -> None:
        """Store a joint's limits, if they are the first."""
        for which in RANGES:
            limits = _limits(settings, which)
            if math.isfinite(limits[1]):
                self._first.setdefault((name, which), limits)

    def of(self, name: str, settings: JointSettings, which: str) -> tuple[float, float]:
        """Limits of gains that may be written, for one of :data:`RANGES`: the present limits within the first ones."""
        now = _limits(settings, which)
        first = self._first.get((name, which), now)
        return max(now[0], first[0]), min(now[1], first[1])


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
        self.configured_bounds.note(self.name, self.settings)

    def follow(self, settings: JointSettings) -> None:
        """Apply other settings."""
        self.settings = settings
        self.monitor.joint, self.monitor.options = settings.joint, settings.options
        self.configured_bounds.note(self.name, settings)

    def restart(self) -> None:
        """Discard the motion, and samples that wait for their reference."""
        self.pairing = ReferencePairing()
        self.monitor.restart()

    def bounds(self, which: str) -> tuple[float, float]:
        """Limits of gains that may be written, "stiffness_range" or "damping_range", in the controller's units."""
        return self.configured_bounds.of(self.name, self.settings, which)

    @cached_property
    def parameters(self) -> frozenset[str]:
        """Names of the parameters that are this joint's."""
        return frozenset(spec.name.format(joint=self.name) for spec in PER_JOINT)

    def add_samples(self, rows: FloatArray) -> None:
        """Add rows of time, position, velocity and effort, shape (n, 4), the effort in its publisher's units."""
        self.pairing.add_samples(self.settings.samples_to_si(rows))

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


class WatchedJoints(Mapping[str, WatchedJoint]):
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
        own_change: joint_parameters.OwnChange,
        adviser: Callable[[str], Adviser],
        refuse: Refusals,
    ) -> None:
        self._node, self._adviser, self._refuse = node, adviser, refuse
        self._bounds, self._own_change = bounds, own_change
        self._joints: dict[str, WatchedJoint] = {}
        self._contested: frozenset[str] = frozenset()
        log = node.get_logger()
        self._whole_turns, self._reference_turns = WholeTurns(log.info), WholeTurns()
        self.welcomes_others = not names
        self.fed_forward: tuple[str, ...] = ()  # joints whose friction is to be compensated
        for name in names:
            self._add(name)

    def __getitem__(self, name: str) -> WatchedJoint:
        return self._joints[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._joints)

    def __len__(self) -> int:
        return len(self._joints)

    # The methods of a Mapping would get every joint by its name, many thousand times a second.

    def __contains__(self, name: object) -> bool:
        """Whether a joint is watched."""
        return name in self._joints

    def items(self) -> ItemsView[str, WatchedJoint]:
        """Names and joints."""
        return self._joints.items()

    def values(self) -> ValuesView[WatchedJoint]:
        """The joints."""
        return self._joints.values()

    def _add(self, name: str) -> WatchedJoint:
        with self._own_change:
            joint_parameters.declare(self._node, name)
        settings = joint_parameters.read(self._node, name)
        monitor = JointMonitor(
            settings.joint, settings.gains, settings.options, self._adviser(name), segments_kept=0, at_arrest=True
        )
        joint = self._joints[name] = WatchedJoint(name, monitor, settings, self._bounds)
        self._note_fed_forward()
        return joint

    def _note_fed_forward(self) -> None:
        # The names are read much more often than settings change.
        self.fed_forward = tuple(name for name, one in self._joints.items() if one.settings.feedforward.share > 0)

    def hear(self, samples: Mapping[str, FloatArray], references: Mapping[str, FloatArray], now: float) -> list[str]:
        """Pass samples and references to the joints they are of; returns the joints that are heard of first.

        Parameters
        ----------
        samples : rows of time, position, velocity and effort of each joint. references : rows that begin with time,
            position and velocity. now : a steady time [s].
        """
        new = [name for name in samples if name not in self._joints and self._welcome(name)]
        for name, rows in samples.items():
            joint = self._joints.get(name)
            if joint is not None:
                joint.heard = now
                if name not in self._contested:
                    joint.add_samples(self._whole_turns.removed(name, rows))
        for name, rows in references.items():
            if name in self._joints:
                self._joints[name].pairing.add_references(self._reference_turns.removed(name, rows[:, :3]))
        return new

    def _welcome(self, name: str) -> bool:
        """Add a joint that was heard of, if there may be others; returns whether it is watched."""
        if not self.welcomes_others:
            return False
        if not _JOINT_NAME.fullmatch(name):
            self._refuse("joint_states: a joint name has characters other than letters, digits, _ - /")
            return False
        if len(self._joints) >= MOST_JOINTS:
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
        for name, joint in self._joints.items():
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
            joint_parameters.read(self._node, joint.name, changes)

    def apply(self, changes: Mapping[str, Parameter]) -> list[tuple[WatchedJoint, Gains | None]]:
        """Apply parameters that have changed; returns the gains, in SI units, that follow for some joints."""
        gains: list[tuple[WatchedJoint, Gains | None]] = []
        for joint in self._concerned(changes):
            before = joint.settings
            joint.follow(joint_parameters.read(self._node, joint.name))
            if any(name.startswith(f"gains.{joint.name}.") for name in changes):
                gains.append((joint, joint.settings.gains))
            elif joint.settings.gain_scale != before.gain_scale and joint.monitor.gains is not None:
                gains.append((joint, joint.settings.to_si(before.from_si(joint.monitor.gains))))
            if any(name.startswith(f"limits.{joint.name}.") for name in changes):
                joint_parameters.describe_recommended(self._node, joint.name)
        self._note_fed_forward()
        return gains

    def _concerned(self, changes: Mapping[str, Parameter]) -> list[WatchedJoint]:
        """Joints whose settings depend on the changed parameters."""
        if not _COMMON.isdisjoint(changes):
            return list(self._joints.values())
        return [joint for joint in self._joints.values() if not joint.parameters.isdisjoint(changes)]
