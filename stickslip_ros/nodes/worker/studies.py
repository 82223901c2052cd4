# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Studies of slips beside the node's own work."""

from __future__ import annotations

from stickslip_ros.monitoring.friction.learner import FrictionLearner
from stickslip_ros.monitoring.study import study
from stickslip_ros.nodes.worker.process import SlowWork

_KIND = "study"


def attend(work: SlowWork, name: str, learner: FrictionLearner) -> None:
    """Take over what was found of a joint, and begin what is due."""
    done = work.pop_result((_KIND, name))
    if done is not None:
        learner.adopt(done.answer)
    if learner.study_is_due and work.has_room((_KIND, name)):
        question = learner.wanted_study()
        if question is not None and not work.submit((_KIND, name), study, question):
            learner.adopt(None)
