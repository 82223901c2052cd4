# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What `stickslip watch --browser` works out itself: what other gains would do, the present cycle's loop, the map."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from stickslip_ros.model.extinction_map import ExtinctionMap
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.output.as_json import margin_json
from stickslip_ros.output.stability_map import MapSubject, map_of

_MAP_POINTS = 400
_LEAST_SAMPLES = 8
_SMOOTHED = 5  # samples on either side, where a velocity has to be derived


def what_if(subject: MapSubject) -> dict[str, Any]:
    """The margin of Eq. (43) and the exact verdict, as `stickslip margin --json` has them; a tenth of a second."""
    return margin_json(subject.joint, subject.gains, subject.velocity)


def joint_map(subject: MapSubject) -> ExtinctionMap:
    """The map about a joint's operating point; a second."""
    return map_of(subject, _MAP_POINTS)


def phase_loop(samples: FloatArray, references: FloatArray, duration: float) -> tuple[FloatArray, FloatArray]:
    """The last seconds in the phase plane: position less its reference, or less an even motion [rad]; velocity [rad/s].

    Parameters
    ----------
    samples : rows of time, position and velocity. references : rows of time and position, none where none is known.
    """
    empty = np.zeros(0)
    if not len(samples):
        return empty, empty
    rows = samples[samples[:, 0] >= samples[-1, 0] - duration]
    rows = rows[np.isfinite(rows[:, :2]).all(axis=1)]
    if len(rows) < _LEAST_SAMPLES or not rows[-1, 0] > rows[0, 0]:
        return empty, empty
    time, position, velocity = rows[:, 0], rows[:, 1], rows[:, 2]
    if not np.isfinite(velocity).all():
        number = np.arange(len(rows))
        ahead, behind = np.minimum(number + _SMOOTHED, len(rows) - 1), np.maximum(number - _SMOOTHED, 0)
        velocity = (position[ahead] - position[behind]) / np.maximum(time[ahead] - time[behind], 1e-9)
    if len(references) and references[-1, 0] >= time[0]:
        desired = np.interp(time, references[:, 0], references[:, 1])
    else:
        desired = position[0] + (position[-1] - position[0]) * (time - time[0]) / (time[-1] - time[0])
    return position - desired, velocity


def cycle_duration(values: dict[str, float]) -> float:
    """How long to look back for one cycle [s]: the last one's length and a little more; three seconds without any."""
    dwell, slip = values.get("last dwell [s]", math.nan), values.get("last slip duration [s]", math.nan)
    period = dwell + slip
    return min(max(1.3 * period, 0.5), 20.0) if math.isfinite(period) else 3.0
