# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`~/friction_feedforward`: torque of the known friction at the reference's speed, for a controller that adds it.

The topic is off unless a share is set. The torque is zero where friction is not known well, and where the reference
stands or is silent; it never exceeds the configured limit. A controller that adds it has to stop when no message comes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from rclpy.lifecycle import LifecycleNode
from sensor_msgs.msg import JointState

from stickslip_ros.model.bounds import LARGEST
from stickslip_ros.model.friction import Friction, steady_friction
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.nodes.publications import quiet_publisher
from stickslip_ros.nodes.watched_joints import WatchedJoint, WatchedJoints
from stickslip_ros.output.published import Findings
from stickslip_ros.settings.parameters import Feedforward

_SILENT = 0.1  # time without a reference, s: references come at 10 Hz at least
_LARGEST_ERROR = 0.1  # standard error of the Coulomb friction, 1: friction known less well is not compensated
_NEAR_REST = 0.1  # width of the change of direction, Stribeck velocities: the torque must not jump there


@dataclass(frozen=True, kw_only=True)
class _Heard:
    """Last reference: arrival, a steady time [s], stamp [s], position [rad] and velocity [rad/s]."""

    when: float
    stamp: float
    position: float
    velocity: float


class FrictionFeedforward:
    """Publisher of the torques, from references and findings that its owner passes on."""

    def __init__(self, node: LifecycleNode) -> None:
        self._node = node
        self._publisher = quiet_publisher(node, JointState, "~/friction_feedforward", 1)
        self._heard: dict[str, _Heard] = {}
        self._on: tuple[str, ...] = ()

    def close(self) -> None:
        """Remove the topic from the graph."""
        self._node.destroy_lifecycle_publisher(self._publisher)

    def hear(self, name: str, rows: FloatArray, now: float) -> None:
        """Store the last reference of rows of time, position and velocity, NaN where one is missing."""
        stamp, position, velocity = rows[-1, :3].tolist()
        before = self._heard.get(name)
        if math.isnan(velocity) and before is not None and stamp > before.stamp:
            velocity = (position - before.position) / (stamp - before.stamp)
        self._heard[name] = _Heard(when=now, stamp=stamp, position=position, velocity=velocity)

    def tick(self, joints: WatchedJoints, findings: Mapping[str, Findings], now: float) -> None:
        """Publish the present torques; zero, once, for joints whose share was set to zero."""
        on = joints.fed_forward
        if not on and not self._on:
            return
        named = (*on, *(name for name in self._on if name not in on))
        self._publish({name: self._torque(joints.get(name), findings.get(name), now) for name in named})
        self._on = on

    def silence(self) -> None:
        """Publish zero torques, and forget the references."""
        if self._on:
            self._publish(dict.fromkeys(self._on, 0.0))
        self._on = ()
        self._heard.clear()

    def _publish(self, torques: Mapping[str, float]) -> None:
        message = JointState(name=list(torques), effort=list(torques.values()))
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def _torque(self, joint: WatchedJoint | None, found: Findings | None, now: float) -> float:
        """Torque in the units of the joint's effort."""
        if joint is None or joint.trouble or found is None:
            return 0.0
        heard, friction = self._heard.get(joint.name), _known_well(joint, found.assessment)
        if heard is None or friction is None or now - heard.when > _SILENT:
            return 0.0
        return feedforward(joint.settings.feedforward, friction, heard.velocity) / joint.settings.effort_scale


def feedforward(settings: Feedforward, friction: Friction, velocity: float) -> float:
    """Torque [N·m] at the reference's velocity [rad/s]: the share of the steady friction, within the largest one.

    Within a tenth of the Stribeck velocity the torque changes direction smoothly, so that a reference that trembles
    about zero does not make it jump.
    """
    if not abs(velocity) < LARGEST:
        return 0.0
    near = math.tanh(abs(velocity) / (_NEAR_REST * float(friction.stribeck_velocity)))
    torque = settings.share * near * float(np.asarray(steady_friction(friction, velocity)))
    return min(max(torque, -settings.largest), settings.largest)


def _known_well(joint: WatchedJoint, assessment: Assessment) -> Friction | None:
    """Friction to compensate, as configured or as learnt; None where it is not known well enough."""
    estimate, learnt = assessment.estimate, assessment.joint
    if assessment.uncertainty is None or estimate is None or learnt is None:
        return None if joint.settings.joint is None else joint.settings.joint.friction
    if assessment.per_inertia:
        return None
    coulomb = estimate["coulomb"]
    if not coulomb.identified or not coulomb.std <= _LARGEST_ERROR * coulomb.value:
        return None
    return learnt.friction
