# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""How the monitor itself is doing: rate, latency and its causes, losses, backlog, processor and memory."""

from __future__ import annotations

import math
import os
import time
from collections import deque
from collections.abc import Sequence, Sized
from dataclasses import dataclass
from pathlib import Path

from stickslip_ros.nodes.intake.arrivals import JointStateTopic
from stickslip_ros.nodes.slow_work import SlowWork

_MOST_OF_A_CORE = 0.8  # use of a core by this process, 1: it has little time left then
_BUSY = 0.9  # use of all cores, 1: the machine has little time left then
_WAITED = 0.2  # share of the time that the process waited for a core, 1: other processes delay it then
_CLOCK_STEP = 0.1  # step of the system's clock, s: a clock that is only slewed steps less
_OVER = 2.0  # span of the figures, s: they follow the present, and several statuses are in it
_METERED_EVERY = 0.25  # time between two readings, s: each reads files of the system
_LATE = 0.25  # latency from message to status, s: a person notices a longer one
_WORK_LATE = 30.0  # age of the oldest question, s: a single one takes seconds
_RECENT = 10.0  # time after a loss, s: the warning stays long enough to be read
_TICKS = os.sysconf("SC_CLK_TCK")
_PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True, kw_only=True)
class Meters:
    """Meter readings at one time.

    Attributes
    ----------
    steady, system : clocks [s]. used : processor time of this process [s].
    waited : time that its main thread was ready and did not run [s]. busy, all : busy and total time of all cores [s].
    """

    steady: float
    system: float
    used: float
    waited: float
    busy: float
    all: float

    @staticmethod
    def read() -> Meters:
        """Present readings; a figure that the system does not have stays constant."""
        busy, total = _cores()
        return Meters(
            steady=time.monotonic(),
            system=time.time(),
            used=time.process_time(),
            waited=_waited(),
            busy=busy,
            all=total,
        )


def why_late(begin: Meters, end: Meters, *, late: float, delays: int, joints: int, load: float, cores: int) -> str:
    """Sentence on the cause of late statuses.

    Parameters
    ----------
    begin, end : readings. late : largest latency of a status between these [s]. delays : number of late statuses.
    load : mean number of processes that are ready to run [1].
    """
    duration = max(end.steady - begin.steady, 1e-9)
    own, waited = (end.used - begin.used) / duration, (end.waited - begin.waited) / duration
    busy = (end.busy - begin.busy) / (end.all - begin.all) if end.all > begin.all else 0.0
    step = (end.system - begin.system) - (end.steady - begin.steady)
    symptom = f"statuses were up to {late:.2g} s late: "
    here = f"with {100 * own:.0f} % of a core used here"
    if abs(step) > _CLOCK_STEP:
        return f"{symptom}the system's clock was set by {step:+.2g} s meanwhile"
    if own >= _MOST_OF_A_CORE:
        return f"{symptom}this node uses {100 * own:.0f} % of a core for {joints} joint{'s' if joints != 1 else ''}"
    if waited >= _WAITED or busy >= _BUSY:
        return f"{symptom}the machine is busy with other processes (load {load:.1f} on {cores} cores), {here}"
    return f"{symptom}{'one delay' if delays == 1 else f'{delays} delays'}, {here}"


def machine() -> tuple[float, int]:
    """Load of the last minute, and number of cores."""
    try:
        load = os.getloadavg()[0]
    except OSError:
        load = 0.0
    return load, os.cpu_count() or 1


def _waited() -> float:
    try:
        return int(Path("/proc/self/schedstat").read_text().split()[1]) * 1e-9
    except (OSError, IndexError, ValueError):
        return 0.0


def _cores() -> tuple[float, float]:
    """Busy and total time of all cores since the system began [s]."""
    try:
        with open("/proc/stat") as file:
            counts = [int(word) for word in file.readline().split()[1:9]]
    except (OSError, ValueError):
        return 0.0, 0.0
    idle = sum(counts[3:5])
    return (sum(counts) - idle) / _TICKS, sum(counts) / _TICKS


class SelfDiagnosis:
    """Figures of the last seconds; :meth:`note` is called with every status published."""

    def __init__(self, states: JointStateTopic, work: SlowWork, joints: Sized) -> None:
        self._states, self._work, self._joints = states, work, joints
        self._readings: deque[tuple[Meters, float, int]] = deque()  # processor time, the worker's too [s], messages
        self._notes: deque[tuple[float, float, int]] = deque()  # time [s], latency [s], messages waiting
        self._memory: list[float] = [math.nan]  # of this process and its worker [MB]
        self._lost_at, self._lost, self._skipped = -math.inf, 0, 0

    def note(self, *, behind: bool) -> None:
        """Read the figures, immediately after statuses were published; those of a node that is behind do not count."""
        if behind:
            self._states.reset_figures()
            return
        now = time.monotonic()
        latency = time.time() - self._states.oldest
        self._notes.append((now, latency, self._states.waiting))
        while len(self._notes) > 2 and now - self._notes[1][0] >= _OVER:
            self._notes.popleft()
        if not self._readings or now - self._readings[-1][0].steady >= _METERED_EVERY:
            meters = Meters.read()
            used = meters.used + sum(_processor_time(pid) for pid in self._work.process_ids)
            self._readings.append((meters, used, self._states.messages))
            self._memory = [_resident_memory(pid) for pid in (os.getpid(), *self._work.process_ids)]
            while len(self._readings) > 2 and now - self._readings[1][0].steady >= _OVER:
                self._readings.popleft()
        if self._states.lost > self._lost or self._work.skipped > self._skipped:
            self._lost_at = now
        self._lost, self._skipped = self._states.lost, self._work.skipped
        self._states.reset_figures()

    @property
    def trouble(self) -> str:
        """Sentence on losses, late statuses or late work, "" if there are none."""
        if self._notes and self._notes[-1][0] - self._lost_at < _RECENT:
            return f"{self._lost} messages lost, {self._skipped} questions skipped so far"
        late = [latency for _, latency, _ in self._notes if latency > _LATE]
        if late:
            load, cores = machine()
            return why_late(
                self._readings[0][0],
                Meters.read(),
                late=max(late),
                delays=len(late),
                joints=len(self._joints),
                load=load,
                cores=cores,
            )
        if self._work.lateness > _WORK_LATE:
            return f"friction and advice are {self._work.lateness:.0f} s behind"
        return ""

    def values(self) -> Sequence[tuple[str, float]]:
        """The figures, each under a key with its unit."""
        rate = processor = math.nan
        if len(self._readings) > 1:
            (begin, used, messages), (end, used_now, messages_now) = self._readings[0], self._readings[-1]
            duration = end.steady - begin.steady
            rate, processor = (messages_now - messages) / duration, 100.0 * (used_now - used) / duration
        return [
            ("messages received [1]", self._states.messages),
            ("message rate [Hz]", rate),
            ("messages lost [1]", self._states.lost),
            ("publishers of joint_states [1]", self._states.publishers),
            ("latency from message to status [s]", self._notes[-1][1] if self._notes else math.nan),
            ("messages waiting [1]", max((waiting for _, _, waiting in self._notes), default=0)),
            ("questions under way [1]", self._work.waiting),
            ("oldest question [s]", self._work.lateness),
            ("questions skipped, the worker being late [1]", self._work.skipped),
            ("questions that failed [1]", self._work.failures),
            ("processor [%]", processor),
            ("memory [MB]", self._memory[0]),
            ("memory of the worker [MB]", sum(self._memory[1:])),
        ]


def _processor_time(pid: int) -> float:
    """Processor time of another process [s]; 0 if it has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / _TICKS


def _resident_memory(pid: int) -> float:
    """Memory of a process [MB]; 0 if it has ended."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE / 1e6
    except OSError:
        return 0.0
