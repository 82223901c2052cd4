# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Tables of samples as bags."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stickslip_ros.bags.simulated import GAINS, REFERENCES, STATES
from stickslip_ros.bags.writing import BagWriter
from stickslip_ros.messages.joint_states import TYPE as JOINT_STATE
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.samples import Batch


def write_recording(
    path: Path, batch: Batch, name: str, start: float, gains: Gains | None = None, compression: str = "zstd"
) -> int:
    """Write samples of one joint as a bag; returns how many.

    Parameters
    ----------
    start : what is added to the times [s]. gains : of the controller then, None if unknown.

    Raises
    ------
    RecordingError
        If there is a directory of that name already.
    """
    batch = batch.where(np.isfinite(batch.time))
    times = batch.time + start
    nothing = np.full(len(batch), np.nan)
    states = np.stack([batch.position, batch.velocity, batch.effort], axis=1)[:, :, None]
    references = np.stack([batch.reference_position, batch.reference_velocity, nothing], axis=1)[:, :, None]
    topics = {STATES: JOINT_STATE}
    if np.isfinite(references).any():
        topics[REFERENCES] = JOINT_STATE
    if gains is not None:
        topics[GAINS] = "std_msgs/msg/Float64MultiArray"
    with BagWriter(path, topics, compression) as writer:
        if gains is not None and len(times):
            table = writer.table(name, "p,d", np.array([[float(gains.stiffness), float(gains.damping)]]))
            writer.write([writer.serialized(round(float(times[0]) * 1e9), GAINS, table)])
        streams = [writer.joint_states(STATES, (name,), times, states)]
        if REFERENCES in topics:
            streams.insert(0, writer.joint_states(REFERENCES, (name,), times, references))
        writer.write(*streams)
    return len(batch)
