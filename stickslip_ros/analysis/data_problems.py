# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What is wrong with the data of a joint, in words; and whether they allowed any judgement."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.detection.status import Status, TooFewSamples
from stickslip_ros.output.wording import constant_effort_text

NOT_JUDGED = (Status.UNKNOWN, Status.NOT_JUDGED)
_MOST_NAMED = 5  # joints
_OTHERWISE = "it moves too little, or turns too often"
REFERENCE_FOLLOWS = "what is published as its reference only repeats what is measured, and does not count"


def data_problems(assessment: Assessment, samples: int) -> list[str]:
    """What is wrong with a joint's samples, a sentence each; nothing if all is in order.

    Parameters
    ----------
    samples : how many came, those that were left out among them.
    """
    restarts = assessment.restarts
    texts = [f"{count} of {samples} samples left out: {why}" for why, count in assessment.dropped.items()]
    texts += [f"{count} of {samples} values left out: {why}" for why, count in assessment.blanked.items()]
    if math.isfinite(assessment.constant_effort):
        texts.append(constant_effort_text(assessment.constant_effort))
    if assessment.reference_follows:
        texts.append(REFERENCE_FOLLOWS)
    if restarts:
        times = "once" if restarts == 1 else f"{restarts} times"
        texts.append(f"stamps jump back {times}: the motion is followed anew from there")
    return texts


def lacks_data(status: Status, assessment: Assessment) -> bool:
    """Whether a joint could not be judged because of its data, not of its motion."""
    poor = isinstance(assessment.finding.reason, TooFewSamples) or assessment.restarts > 0
    return status is Status.UNKNOWN or (status is Status.NOT_JUDGED and poor)


def nothing_judged(found: Mapping[str, Any]) -> str:
    """Why no joint of a bag could be judged; "" if one could, or if the bag has an error of its own.

    Parameters
    ----------
    found : the bag's answer, as `analysis_json.bag_json` has it.
    """
    joints: Mapping[str, Mapping[str, Any]] = found.get("joints", {})
    if not joints or any(Status(joint["worst_status"]) not in NOT_JUDGED for joint in joints.values()):
        return ""
    texts = [f"{name}: {joint['reason'] or _OTHERWISE}" for name, joint in joints.items()]
    more = [f"and {len(texts) - _MOST_NAMED} more joints"] if len(texts) > _MOST_NAMED else []
    return f"bag {found['path']}: no joint could be judged: {'; '.join([*texts[:_MOST_NAMED], *more])}"
