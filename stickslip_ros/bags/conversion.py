# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Tables of samples as bags."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from stickslip_ros.bags.simulated import GAINS, REFERENCES, STATES
from stickslip_ros.bags.writing import BagWriter
from stickslip_ros.messages.joint_states import TYPE as JOINT_STATE
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.samples import Batch


def write_recording(
    path: Path, batches: Mapping[str, Batch], start: float, gains: Gains | None = None, compression: str = "zstd"
) -> int:
    """Write samples of joints as a bag; returns how many of each.

    Parameters
    ----------
    batches : of each joint, all of the same times; samples without a time are left out.
    start : what is added to the times [s]. gains : of each joint's controller then, None if unknown.

    Raises
    ------
    RecordingError
        If there is a directory of that name already.
    """
    names = tuple(batches)
    time = batches[names[0]].time
    known = np.isfinite(time)
    times = time[known] + start
    parts = [batch.where(known) for batch in batches.values()]
    nothing = np.full(len(times), np.nan)
    states = np.stack([np.stack([one.position, one.velocity, one.effort], axis=1) for one in parts], axis=2)
    references = np.stack(
        [np.stack([one.reference_position, one.reference_velocity, nothing], axis=1) for one in parts], axis=2
    )
    topics = {STATES: JOINT_STATE}
    if np.isfinite(references).any():
        topics[REFERENCES] = JOINT_STATE
    if gains is not None:
        topics[GAINS] = "std_msgs/msg/Float64MultiArray"
    with BagWriter(path, topics, compression) as writer:
        if gains is not None and len(times):
            values = np.tile([float(gains.stiffness), float(gains.damping)], (len(names), 1))
            table = writer.table(",".join(names), "p,d", values)
            writer.write([writer.serialized(round(float(times[0]) * 1e9), GAINS, table)])
        streams = [writer.joint_states(STATES, names, times, states)]
        if REFERENCES in topics:
            streams.insert(0, writer.joint_states(REFERENCES, names, times, references))
        writer.write(*streams)
    return len(times)
