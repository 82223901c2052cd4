# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A trajectory with the feed-forward in the effort of its points, as joint_trajectory_controller takes it.

The controller goes straight between points that have no velocity, along a cubic between points that have one, and
straight in the effort. Friction jumps where the motion turns round; so points are put in between where the effort would
be wrong otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import yaml

from stickslip_ros.cli.trajectory_table import FloatArray, GivenTrajectory
from stickslip_ros.files import write_whole
from stickslip_ros.model.compensation import Compensation
from stickslip_ros.model.friction import Friction

_QUICKEST = 1e-3  # [s] in which the effort goes from one side to the other
_CLOSE = 0.01  # of the largest effort: what is not worth a point
_NANO = 1_000_000_000
Efforts = Callable[[FloatArray], FloatArray]


def with_effort(
    given: GivenTrajectory, friction: Friction, share: float
) -> tuple[FloatArray, FloatArray, FloatArray | None, FloatArray]:
    """Time from the start [s], position [rad], velocity [rad/s] (None where none was given) and effort [N·m] of points.

    Parameters
    ----------
    share : of the friction that is fed forward [1].
    """
    compensation = Compensation(friction=friction, feedforward=share)

    def efforts(velocity: FloatArray) -> FloatArray:
        return np.asarray(compensation.feedforward_torque(velocity), dtype=float)

    times = given.time - given.time[0]
    velocity = None
    if given.velocity is None:
        time, position, effort = _along_lines(times, given.position, efforts)
    else:
        time, position, velocity, effort = _along_cubics(times, given.position, given.velocity, efforts)
    if effort[-1] != 0.0:
        # The controller holds the last point, and would go on pushing.
        before = max(time[-1] - _QUICKEST, 0.5 * (time[-2] + time[-1]))
        place = len(time) - 1
        effort = np.append(effort, 0.0)
        position = np.insert(position, place, np.interp(before, time, position))
        velocity = None if velocity is None else np.insert(velocity, place, np.interp(before, time, velocity))
        time = np.insert(time, place, before)
    return time, position, velocity, effort


def write_trajectory(path: Path, given: GivenTrajectory, friction: Friction, share: float) -> int:
    """Write a trajectory_msgs/JointTrajectory as YAML; returns the number of points.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    time, position, velocity, effort = with_effort(given, friction, share)
    points = []
    for index, instant in enumerate(np.rint(time * _NANO).astype(np.int64).tolist()):
        point: dict[str, object] = {"positions": [_rounded(position[index])]}
        if velocity is not None:
            point["velocities"] = [_rounded(velocity[index])]
        point["effort"] = [_rounded(effort[index])]
        point["time_from_start"] = {"sec": instant // _NANO, "nanosec": instant % _NANO}
        points.append(point)
    content = {"joint_names": [given.name], "points": points}
    text = yaml.safe_dump(content, default_flow_style=None, sort_keys=False, width=120)
    write_whole(path, "# trajectory_msgs/msg/JointTrajectory; rad, rad/s, N*m\n" + text)
    return len(points)


def _along_lines(
    times: FloatArray, positions: FloatArray, efforts: Efforts
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Between two points the effort is that of their speed; at each point it goes over to the next one."""
    gaps = np.diff(times)
    speeds = np.diff(positions) / gaps
    of_pieces = efforts(speeds)
    largest = float(np.abs(of_pieces).max())
    found = [(times[0], positions[0], of_pieces[0])]
    for index in range(1, len(times)):
        found.append((times[index], positions[index], of_pieces[index - 1]))
        if index < len(gaps) and abs(of_pieces[index] - of_pieces[index - 1]) > _CLOSE * largest:
            later = min(_QUICKEST, 0.5 * gaps[index])
            found.append((times[index] + later, positions[index] + later * speeds[index], of_pieces[index]))
    time, position, effort = np.array(found).T
    return time, position, effort


def _along_cubics(
    times: FloatArray, positions: FloatArray, velocities: FloatArray, efforts: Efforts
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Pieces are halved until the effort in their middle is that between their ends."""
    largest = max(float(np.abs(efforts(velocities)).max()), float(np.abs(efforts(np.gradient(positions, times))).max()))
    found = []

    def at(index: int, time: float) -> tuple[float, float, float, float]:
        """Time, position, velocity and effort on the cubic that begins at a given point."""
        width = times[index + 1] - times[index]
        s = (time - times[index]) / width
        (x0, x1), (v0, v1) = positions[index : index + 2], width * velocities[index : index + 2]
        bend, twist = 3.0 * (x1 - x0) - 2.0 * v0 - v1, v0 + v1 - 2.0 * (x1 - x0)
        velocity = (v0 + s * (2.0 * bend + s * 3.0 * twist)) / width
        position = x0 + s * (v0 + s * (bend + s * twist))
        return time, position, velocity, float(efforts(np.array([velocity]))[0])

    for index in range(len(times) - 1):
        pieces = [(at(index, float(times[index])), at(index, float(times[index + 1])))]
        while pieces:
            first, last = pieces.pop()
            middle = at(index, 0.5 * (first[0] + last[0]))
            wrong = abs(middle[3] - 0.5 * (first[3] + last[3])) > _CLOSE * largest
            if wrong and last[0] - first[0] > _QUICKEST:
                pieces += [(middle, last), (first, middle)]
            else:
                found.append(first)
    found.append(at(len(times) - 2, float(times[-1])))
    time, position, velocity, effort = np.array(found).T
    return time, position, velocity, effort


def _rounded(value: float) -> float:
    return float(f"{value:.9g}")
