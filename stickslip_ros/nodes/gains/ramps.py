# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The services that change gains, `~/apply_recommendation` and `~/restore_gains`: which ramps they make, and may."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from time import monotonic

from rclpy.node import Node

from stickslip_ros.messages.gain_parameters import GainPair
from stickslip_ros.nodes.gains.gain_application import GainApplication
from stickslip_ros.nodes.gains.gain_intake import GainIntake
from stickslip_ros.nodes.gains.motion_watch import MotionWatch
from stickslip_ros.nodes.gains.ramp_journal import RampJournal, UnfinishedRamp
from stickslip_ros.nodes.gains.ramp_service import NotYetError, RampService, RefusedError
from stickslip_ros.nodes.joints.watched_joints import WatchedJoint

APPLY, RESTORE = "apply_recommendation", "restore_gains"


class Ramps:
    """See the module.

    Parameters
    ----------
    node : has the services and the parameters. joints : those watched. gains : knows their controllers.
    not_yet : why nothing can be judged yet, "" if it can; it may raise :class:`RefusedError`.
    state_path : of the state file, beside which the journal lies; None for no journal.
    """

    def __init__(
        self,
        node: Node,
        joints: Mapping[str, WatchedJoint],
        gains: GainIntake,
        not_yet: Callable[[], str],
        state_path: Path | None,
    ) -> None:
        self._node, self._joints, self._gains, self._not_yet = node, joints, gains, not_yet
        self._journal = RampJournal(state_path and state_path.with_name(f"{state_path.stem}.ramps.json"))
        self._service = RampService(node, {APPLY: self._to_the_advice, RESTORE: self._back})
        self._logged: set[str] = set()

    def tick(self, now: float) -> None:
        """Take requests and carry on with what is asked for; ``now`` is a steady time [s]."""
        self._service.tick(now)

    def stop(self, why: str) -> None:
        """End what is under way; the gains stay as they are."""
        self._service.stop(why)

    def close(self) -> None:
        """Take the services from the graph."""
        self._service.close()

    @property
    def busy(self) -> bool:
        """Whether gains are being changed, and motion must be seen at once."""
        return self._service.busy

    @property
    def state(self) -> str:
        """What is done, or how it ended."""
        return self._service.state

    @property
    def outcomes(self) -> Mapping[str, str]:
        """The last message on each joint."""
        return self._service.outcomes

    @property
    def trouble(self) -> str:
        """What a person should know, "" if there is nothing."""
        troubles = [self._journal.trouble]
        if not self._service.busy:
            troubles += [self._service.state if self._service.failed else ""]
            troubles += [self._unfinished(ramp) for ramp in self._journal.values()]
        return "; ".join(trouble for trouble in troubles if trouble)

    def withdraw(self) -> None:
        """Write nothing more of what was asked for until now: the permission has been taken away."""
        self._service.withdraw()

    def hear_gains(self, joint: WatchedJoint) -> None:
        """Look whether a ramp that was cut off still is of concern, now that the joint's gains are known."""
        ramp = self._journal.get(joint.name)
        gains = joint.monitor.gains
        if ramp is None or gains is None or self._service.busy or self._controller_name(joint.name) != ramp.controller:
            return
        now = GainPair.from_si(gains, joint.settings.gain_scale)
        if now.same(ramp.before) or not now.between(ramp.before, ramp.target):
            self._journal.end(joint.name)
            self._node.get_logger().info(f"{joint.name} has {now} now; the ramp that was cut off is forgotten")
        elif joint.name not in self._logged:
            self._logged.add(joint.name)
            self._node.get_logger().warning(self._unfinished(ramp))

    def _unfinished(self, ramp: UnfinishedRamp) -> str:
        joint = self._joints.get(ramp.joint)
        gains = joint.monitor.gains if joint is not None else None
        now = ""
        if joint is not None and gains is not None:
            now = f", now {GainPair.from_si(gains, joint.settings.gain_scale)}"
        return (
            f"a ramp of {ramp.joint}'s gains in {ramp.controller}, begun {ramp.begun}, did not come to a good end: "
            f"before {ramp.before}, asked {ramp.target}{now}; the service ~/{RESTORE} goes back to those before"
        )

    def _controller_name(self, joint: str) -> str:
        controller = self._gains.controller_of(joint)
        return controller.remote if controller is not None else ""

    def _require_permission(self) -> None:
        not_yet = self._not_yet()
        if not_yet:
            raise NotYetError(not_yet)
        if not self._node.get_parameter("allow_apply").value:
            raise RefusedError("allow_apply is false; set it to true where gains may be written")

    def _to_the_advice(self) -> list[GainApplication]:
        """The ramps that lead to the advice, for every joint that needs it."""
        self._require_permission()
        ramps, reasons = [], []
        for joint in self._joints.values():
            assessment = joint.monitor.assessment()
            if joint.being_advised(assessment):
                raise NotYetError(f"the advice for {joint.name} is being worked out")
            has_controller = self._gains.controller_of(joint.name) is not None
            reason = joint.why_not_applied(assessment, has_controller=has_controller)
            if reason:
                reasons.append(reason)
            else:
                ramps.append(self._ramp(joint))
        if not ramps:
            raise RefusedError("; ".join(reasons) or "no joint is watched yet")
        return ramps

    def _back(self) -> list[GainApplication]:
        """The ramps that lead back to where ramps began that did not come to a good end."""
        self._require_permission()
        ramps, reasons = [], []
        for name, unfinished in self._journal.items():
            joint = self._joints.get(name)
            if joint is None or self._controller_name(name) != unfinished.controller:
                reasons.append(f"{unfinished.controller}, which had the gains of {name}, is not there")
            else:
                ramps.append(self._ramp(joint, unfinished))
        if not ramps:
            raise RefusedError("; ".join(reasons) or "there is no ramp that was cut off, or made nothing better")
        return ramps

    def _ramp(self, joint: WatchedJoint, back_to: UnfinishedRamp | None = None) -> GainApplication:
        controller = self._gains.controller_of(joint.name)
        assert controller is not None
        return GainApplication(
            joint.name,
            controller,
            MotionWatch(joint, monotonic),
            self._journal,
            scale=joint.settings.gain_scale,
            bounds=lambda: (joint.bounds("stiffness_range"), joint.bounds("damping_range")),
            rate=float(self._node.get_parameter("apply_rate").value),
            allowed=lambda: bool(self._node.get_parameter("allow_apply").value),
            clock=monotonic,
            log=self._node.get_logger(),
            back_to=back_to,
        )
