# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What `stickslip watch --browser` hears, in a thread of its own: the monitors, and the motion of one joint that is
looked at.

Every sample of every joint would be too many for a page: of a joint that nobody looks at only the monitor's word is
kept.
"""

from __future__ import annotations

import math
import threading
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from rclpy.qos import ReliabilityPolicy

from stickslip_ros.cli.watch_listener import WatchListener
from stickslip_ros.cli.watch_view import JointView
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.nodes.intake.arrivals import JointStateTopic
from stickslip_ros.visible import visible

_LISTENED = 0.1  # [s] at once
_KEPT = 20_000  # rows of a joint's motion
_NONE = np.zeros((0, 3))


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """What is known at one moment.

    Attributes
    ----------
    joints, header : as the terminal's view has them.
    silent_for : how long no monitor has said anything [s]; infinite before the first word.
    samples, references : rows of time, position and velocity of each joint that is looked at.
    """

    joints: tuple[JointView, ...] = ()
    header: str = ""
    silent_for: float = math.inf
    samples: Mapping[str, FloatArray] = field(default_factory=dict)
    references: Mapping[str, FloatArray] = field(default_factory=dict)


class LiveListener:
    """A context manager: the thread ends with it.

    Attributes
    ----------
    snapshot : the latest; it is never changed, but replaced.
    """

    def __init__(self) -> None:
        self.snapshot = Snapshot()
        self._listener = WatchListener()
        self._looked_at: Counter[str] = Counter()  # by how many pages
        self._lock = threading.Lock()
        self._motions: dict[str, tuple[JointStateTopic, JointStateTopic]] = {}
        self._samples: dict[str, FloatArray] = {}
        self._references: dict[str, FloatArray] = {}
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="listener", daemon=True)

    def __enter__(self) -> LiveListener:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join(5.0)
        self._listener.close()

    def look_at(self, joint: str) -> None:
        """Somebody looks at a joint: its motion is kept from now on."""
        with self._lock:
            self._looked_at[joint] += 1

    def look_away(self, joint: str) -> None:
        """Somebody does no more."""
        with self._lock:
            self._looked_at[joint] -= 1

    def _run(self) -> None:
        while not self._ending.is_set():
            self._listener.listen(_LISTENED)
            with self._lock:
                looked_at = set(+self._looked_at)
            self._follow(looked_at)
            self.snapshot = Snapshot(
                joints=tuple(self._listener.joints()),
                header=self._listener.header(),
                silent_for=self._listener.silent_for,
                samples=dict(self._samples),
                references=dict(self._references),
            )

    def _follow(self, looked_at: set[str]) -> None:
        """Take the motion of the joints that are looked at, and leave the topics of all others."""
        robots = {joint.rpartition("/")[0] for joint in looked_at}
        for robot in [robot for robot in self._motions if robot not in robots]:
            for topic in self._motions.pop(robot):
                topic.close()
        for robot in robots - set(self._motions):
            self._motions[robot] = self._listener.motion(robot, ReliabilityPolicy.BEST_EFFORT)
        for kept in (self._samples, self._references):
            for joint in [joint for joint in kept if joint not in looked_at]:
                del kept[joint]
        now = time.monotonic()
        for robot, motion in self._motions.items():
            for topic, kept in zip(motion, (self._samples, self._references), strict=True):
                for name, rows in topic.samples_until(now).items():
                    joint = visible(f"{robot}/{name}" if robot else name)
                    if joint in looked_at:
                        kept[joint] = _continued(kept.get(joint, _NONE), rows[:, :3])


def _continued(kept: FloatArray, rows: FloatArray) -> FloatArray:
    """Rows and those that came after them, the latest ones; where time began anew what was before is dropped."""
    rows = rows[np.isfinite(rows[:, 0])]
    if len(kept) and len(rows) and rows[0, 0] < kept[-1, 0] - 1.0:
        kept = _NONE
    return np.concatenate([kept, rows])[-_KEPT:]
