# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""When messages came, for those that have no stamp."""

from __future__ import annotations

from collections.abc import Sequence
from time import time

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node

ARRIVAL = "arrival"
_BY_THE_SYSTEM = "arrival by the system's clock (use_sim_time is true, and nothing is heard on /clock)"
_DRAIN = 0.02  # [s] for the first messages ever


class ArrivalTimes:
    """Times of arrival by the node's clock; ``first`` is that of the oldest message given last, by the system's.

    The middleware tells when a message came by the system's clock. Where the node follows simulated time, the
    messages that waited are spread over the time since the ones before; while that time stands, all of them came at it.
    Before the first message on /clock the system's clock counts. ``what`` names the time, for people.
    """

    def __init__(self, node: Node) -> None:
        self._clock = node.get_clock()
        self._before = np.nan
        self.first = np.nan
        self.what = ARRIVAL

    def of(self, infos: Sequence[dict[str, int]]) -> NDArray[np.float64]:
        """Times [s] of messages in the order of their arrival; to be called for every drain, also an empty one."""
        simulated = self._clock.ros_time_is_active
        now = 1e-9 * self._clock.now().nanoseconds
        without_clock = simulated and now == 0.0
        self.what = _BY_THE_SYSTEM if without_clock else ARRIVAL
        if without_clock:
            simulated, now = False, time()
        before = self._before if self._before <= now else now - _DRAIN
        self._before = np.nan if without_clock else now
        if not infos:
            return np.empty(0)
        received = np.array([info.get("received_timestamp") or 0 for info in infos])
        self.first = 1e-9 * float(received[0]) if received[0] else np.nan
        if received.all() and not simulated:
            return received * 1e-9
        return np.linspace(before, now, len(infos) + 1)[1:]
