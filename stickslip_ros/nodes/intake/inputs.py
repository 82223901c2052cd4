# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the node was told or is sent and cannot use, in words: for its own status, and as the reason in a joint's."""

from __future__ import annotations

import math

from rclpy.node import Node

from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.nodes.gains.gain_intake import PD_GAINS, GainIntake
from stickslip_ros.nodes.intake.joint_state_topic import JointStateTopic
from stickslip_ros.nodes.intake.published_types import REFERENCES, PublishedTypes
from stickslip_ros.nodes.intake.references import reference_type_name
from stickslip_ros.nodes.intake.silence import SilentClock, SilentStates
from stickslip_ros.nodes.joints.watched_joints import WatchedJoint, WatchedJoints
from stickslip_ros.nodes.unknown_parameters import UnknownParameters

_STATES = "joint_states"


class Inputs:
    """See the module; :meth:`poll` is called now and then."""

    def __init__(self, node: Node, joints: WatchedJoints, gains: GainIntake, reference_type: str) -> None:
        self._joints, self._gains = joints, gains
        self._types = PublishedTypes(
            node,
            {
                _STATES: "sensor_msgs/msg/JointState",
                REFERENCES: reference_type_name(reference_type),
                PD_GAINS: "std_msgs/msg/Float64MultiArray",
            },
        )
        self._unknown_parameters = UnknownParameters(node)
        self._silent_states, self._silent_clock = SilentStates(node, _STATES), SilentClock(node)

    def poll(self, now: float, states: JointStateTopic | None) -> None:
        """Look at the graph and at what was given; ``now`` is a steady time [s]."""
        self._types.poll(now)
        self._silent_clock.poll(now)
        if states is not None:
            self._silent_states.poll(now, states.messages)
        self._unknown_parameters.poll(list(self._joints), now, others_may_come=self._joints.welcomes_others)

    @property
    def troubles(self) -> list[str]:
        """What there is to say of the node itself."""
        silences = [text for text in (self._silent_states.text, self._silent_clock.text) if text]
        return [*self._types.troubles.values(), *silences, *self._unknown_parameters.texts]

    def values(self) -> list[tuple[str, object]]:
        """The same as keys and values."""
        return [
            ("topics of another type", "; ".join(self._types.troubles.values())),
            ("parameters not understood", "; ".join(self._unknown_parameters.texts)),
        ]

    def missing(self, joint: WatchedJoint, assessment: Assessment) -> str:
        """Why something is not known of a joint that it was configured for, "" if that is not so."""
        reasons = []
        if math.isinf(joint.heard):
            reasons += [text for text in (self._types.troubles.get(_STATES, ""), self._silent_states.text) if text]
        if assessment.gains is None:
            why = self._gains.why_unknown(joint.name) or self._types.troubles.get(PD_GAINS, "")
            reasons += [f"gains not known: {why}"] if why else []
        if REFERENCES in self._types.troubles and assessment.velocity_source != "reference":
            reasons.append(f"no reference: {self._types.troubles[REFERENCES]}")
        if assessment.reference_follows:
            reasons.append("no reference: what is published only repeats what is measured")
        return "; ".join(reasons)
