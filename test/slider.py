# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Real recordings of a slider on a spring, as samples of a joint."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stickslip_ros.monitoring.samples import Batch


def slider(path: Path) -> Batch:
    """A slider's file: spring force over weight, pulled at the speed in the file's name through 168 N/m."""
    speed = 1e-6 * float(path.stem.rsplit("_v", 1)[1])
    with np.load(path) as archive:
        time, force_over_weight = archive["time_s"], archive["force_over_weight"].astype(float)
    reference = speed * time
    return Batch(
        time=time, position=reference - 0.0307 * 9.81 * force_over_weight / 168.0, reference_position=reference
    )
