# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""One joint as the node watches it: its monitor, its samples on their way there, its settings."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.reference_pairing import ReferencePairing
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.nodes.joints.gain_bounds import GainBounds
from stickslip_ros.settings.parameter_table import PER_JOINT
from stickslip_ros.settings.parameters import JointSettings

WORTH_CHANGING = (Status.STICK_SLIP, Status.AT_RISK)


@dataclass
class WatchedJoint:
    """See the module.

    Attributes
    ----------
    heard : when a sample came last, as a steady time [s].
    trouble : why nothing can be said of it, "" as long as something can.
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
        """Go on with other settings."""
        self.settings = settings
        self.monitor.joint, self.monitor.options = settings.joint, settings.options
        self.configured_bounds.note(self.name, settings)

    def restart(self) -> None:
        """Forget the motion, and what waits for its reference."""
        self.pairing = ReferencePairing()
        self.monitor.restart()

    def bounds(self, which: str) -> tuple[float, float]:
        """What may be written, of "stiffness_range" or "damping_range", in the controller's units."""
        return self.configured_bounds.of(self.name, self.settings, which)

    @cached_property
    def parameters(self) -> frozenset[str]:
        """Names of the parameters that are this joint's."""
        return frozenset(spec.name.format(joint=self.name) for spec in PER_JOINT)

    def add_samples(self, rows: FloatArray) -> None:
        """Rows of time, position, velocity and effort, the effort in its publisher's units; of shape (n, 4)."""
        self.pairing.add_samples(self.settings.samples_to_si(rows))

    def advised(self, assessment: Assessment) -> Gains | None:
        """Recommended gains in the controller's units, None if there are none or the present ones are not known."""
        recommended = assessment.recommended
        if recommended is None or not recommended.found or not assessment.gains_known:
            return None
        return self.settings.from_si(recommended.gains)

    def being_advised(self, assessment: Assessment) -> bool:
        """Whether advice that would be applied is being worked out."""
        status = assessment.finding.status
        return status in WORTH_CHANGING and assessment.margin is not None and assessment.advice is None

    def why_not_applied(self, assessment: Assessment, *, has_controller: bool) -> str:
        """Why the advice cannot be applied, or ""; SI units."""
        recommendation, status = assessment.recommendation, assessment.finding.status
        if status not in WORTH_CHANGING:
            return f"{self.name} is {status.value}, which no gains have to change"
        if recommendation is None:
            return f"{self.name} has no advice: {assessment.margin_reason or 'it is being worked out'}"
        if recommendation.keep:
            return f"{self.name} has the wanted margin already; if it sticks, its friction is not what is believed"
        if self.advised(assessment) is None:
            reason = assessment.recommended.reason if assessment.recommended else ""
            return f"{self.name}: " + (reason if assessment.gains_known else "its gains are not known")
        if not has_controller:
            return f"{self.name} has no controller whose parameters could be written (parameter 'controller')"
        if math.isinf(self.bounds("stiffness_range")[1]) or math.isinf(self.bounds("damping_range")[1]):
            return f"{self.name} has no bounds: set limits.{self.name}.p_max and limits.{self.name}.d_max first"
        return ""
