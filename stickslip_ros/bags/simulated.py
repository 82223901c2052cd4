# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Recordings of simulated joints, to try everything without a robot."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stickslip_ros.bags.writing import GAINS, LAST_STAMP, REFERENCES, STATES, BagWriter, serialized_joint_states
from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.messages.joint_states import TYPE as JOINT_STATE
from stickslip_ros.model._validation import require_not_negative, require_positive
from stickslip_ros.model.compensation import Compensation, usual_compensation
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.monitoring.samples import FloatArray

# Of a sample, in a message of states and one of references [bytes].
_A_MESSAGE, _A_NAME, _VALUES_OF_A_JOINT = 110, 16, 40
_AT_ONCE = 10_000  # samples that are simulated and written at once


@dataclass(frozen=True, kw_only=True)
class RecordedJoint:
    """A joint to be recorded.

    Attributes
    ----------
    velocities : commanded one after the other, for equal parts of the recording [rad/s].
    encoder_resolution : of the position, 0 for none [rad]. encoder_phase : where within a count the joint begins [1].
    position_noise, velocity_noise : standard deviations [rad], [rad/s].
    load : constant torque against the controller [N·m].
    feedforward, feedback, push : shares of its friction that the controller compensates [1].

    Raises
    ------
    InvalidParameterError
        If there are no velocities, or one is not finite, or noise or resolution are negative.
    """

    joint: Joint
    gains: Gains
    velocities: tuple[float, ...]
    encoder_resolution: float = 0.0
    encoder_phase: float = 0.0
    position_noise: float = 0.0
    velocity_noise: float = 0.0
    load: float = 0.0
    feedforward: float = 0.0
    feedback: float = 0.0
    push: float = 0.0

    def __post_init__(self) -> None:
        if not self.velocities or not np.isfinite(self.velocities).all():
            raise InvalidParameterError("velocities", "one or more finite numbers", self.velocities)
        for name in (
            "encoder_resolution", "position_noise", "velocity_noise", "feedforward", "feedback", "push",
        ):  # fmt: skip
            require_not_negative(name, getattr(self, name))

    def compensation(self, period: float) -> Compensation | None:
        """What its controller adds, which looks once a period [s]; None if nothing."""
        if not (self.feedforward or self.feedback or self.push):
            return None
        return usual_compensation(
            self.joint.friction, period=period, resolution=self.encoder_resolution,
            feedforward=self.feedforward, feedback=self.feedback, push=self.push,
        )  # fmt: skip


def write_simulation(
    path: Path,
    joints: Mapping[str, RecordedJoint],
    *,
    duration: float,
    rate: float = 1000.0,
    start: float = 1.0,
    seed: int = 1,
    jitter: float = 0.0,
    with_gains: bool = True,
    compression: str = "zstd",
    progress: Callable[[int, int], None] = lambda _, __: None,
) -> None:
    """Simulate joints under PD control and write what rosbag2 would have recorded of them.

    Parameters
    ----------
    duration : [s]. rate : of joint states and references [Hz]. start : stamp of the beginning [s].
    seed : of the noise. jitter : standard deviation of the stamps, at most a fifth of the interval [s].
    with_gains : whether the gains are recorded too. progress : told how many samples of how many are written.

    Raises
    ------
    InvalidParameterError
        If a value cannot be, or the recording would be larger than the disk has room for.
    RecordingError
        If there is a directory of that name already.
    """
    require_positive("duration", duration)
    require_positive("rate", rate)
    require_not_negative("jitter", jitter)
    require_not_negative("start", start)
    if seed < 0:
        raise InvalidParameterError("seed", ">= 0", seed)
    if not joints:
        raise InvalidParameterError("joints", "at least one", dict(joints))
    if jitter * rate > 0.2:
        raise InvalidParameterError("jitter", f"at most a fifth of the interval {1.0 / rate:g} s", jitter)
    _check_length(path, joints, duration, rate, start)
    topics = {STATES: JOINT_STATE, REFERENCES: JOINT_STATE}
    if with_gains:
        topics[GAINS] = "std_msgs/msg/Float64MultiArray"
    generator = np.random.default_rng(seed)
    names = tuple(joints)
    tracks = {name: _Track(one, duration, rate) for name, one in joints.items()}
    with BagWriter(path, topics, compression) as writer:
        if with_gains:
            values = np.array([[float(one.gains.stiffness), float(one.gains.damping)] for one in joints.values()])
            writer.write([writer.serialized(round(start * 1e9), GAINS, writer.table(",".join(names), "p,d", values))])
        total = round(duration * rate)
        for begin in range(0, total, _AT_ONCE):
            progress(begin, total)
            count = min(_AT_ONCE, total - begin)
            times = start + (begin + 1 + np.arange(count)) / rate
            times += np.clip(jitter * generator.standard_normal(count), -0.4 / rate, 0.4 / rate)
            parts = [tracks[name].advance(begin, count, generator) for name in names]
            states = np.stack([measured for measured, _ in parts], axis=2)
            references = np.stack([desired for _, desired in parts], axis=2)
            writer.write(
                serialized_joint_states(REFERENCES, names, times, references),
                serialized_joint_states(STATES, names, times, states),
            )


def recording_size(names: Iterable[str], duration: float, rate: float) -> float:
    """How large a recording of joints becomes at most [bytes]: simulated numbers hardly shrink."""
    listed = [len(name.encode()) for name in names]
    joint = _VALUES_OF_A_JOINT + _A_NAME
    return duration * rate * (2 * _A_MESSAGE + sum(joint + 2 * length for length in listed))


def _check_length(path: Path, joints: Iterable[str], duration: float, rate: float, start: float) -> None:
    longest = LAST_STAMP - start
    if duration > longest:
        raise InvalidParameterError("duration", f"<= {longest:.10g} s: a stamp has no more seconds", duration)
    size = recording_size(joints, duration, rate)
    folder = next(one for one in path.absolute().parents if one.exists())
    free = shutil.disk_usage(folder).free
    if size > free:
        raise InvalidParameterError(
            "duration",
            f"so short that the recording has room: at {rate:g} Hz it takes up to {size / 1e9:.3g} GB, "
            f"and {folder} has {free / 1e9:.3g} GB left",
            duration,
        )


class _Track:
    """One joint along its recording."""

    def __init__(self, what: RecordedJoint, duration: float, rate: float) -> None:
        self._what, self._period = what, 1.0 / rate
        self._simulation = JointSimulation(
            what.joint, what.gains, load=what.load, compensation=what.compensation(self._period)
        )
        self._part = duration * rate / len(what.velocities)
        self._reference = 0.0

    def advance(self, begin: int, count: int, generator: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Measured and desired position, velocity and effort of the next periods, each of shape (count, 3)."""
        what = self._what
        part = np.minimum((begin + np.arange(count)) // self._part, len(what.velocities) - 1).astype(int)
        velocities = np.array(what.velocities)[part]
        ends = self._reference + self._period * np.cumsum(velocities)
        starts = np.append(self._reference, ends[:-1])
        self._reference = float(ends[-1])
        motion = self._simulation.advance(self._period, starts, velocities)
        position = motion.position + what.position_noise * generator.standard_normal(count)
        if what.encoder_resolution > 0.0:
            position = what.encoder_resolution * np.round(position / what.encoder_resolution + what.encoder_phase)
        velocity = motion.velocity + what.velocity_noise * generator.standard_normal(count)
        measured = np.stack([position, velocity, motion.effort], axis=1)
        return measured, np.stack([ends, velocities, np.full(count, np.nan)], axis=1)
