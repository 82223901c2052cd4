# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What is published of the joints: those with changes at once, the others in turn, each assessed anew before."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace

from rclpy.lifecycle import LifecycleNode

from stickslip_ros.monitoring.exact_question import NOT_COMPUTED, as_seen
from stickslip_ros.nodes.gains.ramps import Ramps
from stickslip_ros.nodes.intake.inputs import Inputs
from stickslip_ros.nodes.joints import joint_parameters
from stickslip_ros.nodes.joints.joint_parameters import OwnChange
from stickslip_ros.nodes.joints.scheduling import FEW, BatchProcessing, RoundRobin, urgent
from stickslip_ros.nodes.joints.watched_joints import WatchedJoint, WatchedJoints
from stickslip_ros.nodes.on_demand import recommended_compensation, stability_maps
from stickslip_ros.nodes.publications import Findings, Publications
from stickslip_ros.nodes.worker.process import SlowWork
from stickslip_ros.nodes.worker.questions import ExactWorker, attend_study
from stickslip_ros.output.diagnosis import Diagnosis

_STALE_AFTER = 1.0  # time without a sample, s: a joint that has been silent for longer is reported as silent
_SCAN_ALL = 0.2  # time between two scans of all joints for changes, s: a person notices no later report


class Reports:
    """Reports on the watched joints; ``findings`` has those on each, as assessed last."""

    def __init__(
        self,
        node: LifecycleNode,
        own_change: OwnChange,
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
        self._publish_statuses(own, assessed, assessed)
        published()
        if later:
            again = self._processing.may_wait(later, period)
            assessed_later = [name for name in later if name not in again or name not in self.findings]
            self._assess(assessed_later, now)
            self._publish_statuses(None, later, assessed_later)
            assessed = assessed + assessed_later
        self._publications.publish_tables(self.findings, reported)
        for topic in self._on_demand:
            topic.attend(self.findings, now)
        advised = {name: self.findings[name].advised for name in assessed if name in self.findings}
        with self._own_change:
            joint_parameters.set_recommended(self._node, advised)
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

    def _publish_statuses(self, own: Diagnosis | None, reported: Iterable[str], assessed: Iterable[str]) -> None:
        warn_margin = float(self._node.get_parameter("warn_margin").value)
        self._publications.publish_statuses(own, self.findings, reported, assessed, warn_margin=warn_margin)

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
