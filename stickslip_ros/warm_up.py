# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiling everything ahead, in processes of its own: once after installation, and after every update.

Numba compiles a function when it is first called, in up to seconds in which the process that calls it does nothing
else, and keeps the memory that took. Here this is done by processes that end, one for each :data:`PARTS`; whoever
needs the functions loads them then in a fraction of a second. Processes that are started together compile once.
"""

from __future__ import annotations

import fcntl
import os
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stickslip_ros.compilation import cache_folder, forget_earlier_sources, marker, without_linear_algebra
from stickslip_ros.errors import StickSlipError
from stickslip_ros.interrupts import check
from stickslip_ros.parent_death import NICENESS, die_with_parent

if TYPE_CHECKING:
    from stickslip_ros.model.friction import Gains, Joint

_LOCK = "lock"
_LOOK_EVERY = 0.1  # time between two looks at whether it is done, s: Ctrl-C is noticed within it


@dataclass(frozen=True, kw_only=True)
class Part:
    """Functions that are compiled one after the other, because they share much.

    Attributes
    ----------
    use : calls them. node : whether the node needs them in its own process.
    """

    use: Callable[[], None]
    node: bool


def _use_detection() -> None:
    from stickslip_ros.monitoring.assessment import MonitorOptions
    from stickslip_ros.monitoring.detection.motion import MotionRecord
    from stickslip_ros.monitoring.joint_monitor import JointMonitor
    from stickslip_ros.monitoring.samples import Batch

    # It moves and stands, twice.
    time = 0.01 * np.arange(400.0)
    position = np.interp(time, [0.0, 1.0, 2.0, 2.2, 3.2, 3.4, 4.0], [0.0, 0.1, 0.1, 0.2, 0.2, 0.3, 0.3])
    monitor = JointMonitor(options=MonitorOptions(learn=False))
    monitor.process(Batch(time=time, position=position, reference_position=position))
    monitor.assessment()
    monitor.finish()
    MotionRecord().did_not_rest(slowed=True)


def _use_messages() -> None:
    from stickslip_ros.bags.storage import _record_kernel as kernel
    from stickslip_ros.messages.joint_states import Block, JointStateDecoder, WholeTurns

    # A JointState with no stamp, of one joint, "a", at position 0.
    message = struct.pack("<BBxx iI I4x I I2s2x Id I I", 0, 1, 0, 0, 1, 1, 2, b"a", 1, 0.0, 0, 0)
    JointStateDecoder().decode(Block.of_messages([(0, 0, message)], {}), np.arange(1))
    WholeTurns().removed("a", np.zeros((1, 4)))
    kernel.walk(np.frombuffer(message, dtype=np.uint8), 0, 1, np.empty((1, kernel.COLUMNS), dtype=np.int64))


def _use_verdict() -> None:
    from stickslip_ros.model.dimensionless import dimensionless_groups
    from stickslip_ros.model.exact import cycle_persists
    from stickslip_ros.model.outcome import outcomes, steady_damping_ratio
    from stickslip_ros.model.simulation import simulate_cycles
    from stickslip_ros.model.steady_sliding import sliding_damping_ratio

    joint, gains = _example()
    groups = dimensionless_groups(joint, gains, 0.05)
    cycle_persists(groups)
    outcomes(groups)
    steady_damping_ratio(groups)
    sliding_damping_ratio(groups)
    simulate_cycles(groups, 1)


def _use_simulation() -> None:
    from stickslip_ros.model.joint_simulation import simulate
    from stickslip_ros.monitoring.friction.bristles import bristle_fits
    from stickslip_ros.monitoring.friction.slip_data import SlipData
    from stickslip_ros.monitoring.friction.slip_fit import Prior, Tolerances, fit_slips
    from stickslip_ros.monitoring.friction.slip_problem import PARAMETERS, SlipProblem
    from stickslip_ros.monitoring.friction.slip_windows import ForceSource, SlipWindow

    joint, gains = _example()
    time = 0.01 * np.arange(20.0)
    simulate(joint, gains, 5.0 * time, np.full(20, 5.0), period=0.01)
    window = SlipWindow(
        direction=1, rest_begin=0.0, breakaway=0.05, arrest=0.15, rest_position=0.0, rest_error=1e-3,
        source=ForceSource.GAINS, gains=gains, times=time, references=time, forces=0.0 * time, reference_speed=1.0,
        observed=np.arange(6, 15), values=np.linspace(0.0, 1.0, 9), gaps=np.full(9, 0.01), resolution=0.1, noise=0.0,
        sample_interval=0.01,
    )  # fmt: skip
    data, zeros = SlipData([window]), np.zeros(PARAMETERS)
    fit_slips(
        SlipProblem(data), Prior.of(zeros, zeros + 1.0, zeros - 1.0, zeros + 1.0), Tolerances(),
        parameters=zeros, unknowns=data.detected(1.0), iterations=1, scored=True,
    )  # fmt: skip
    bristle_fits([window] * 4)


def _example() -> tuple[Joint, Gains]:
    from stickslip_ros.model.friction import Friction, Gains, Joint

    friction = Friction(stribeck=1.0, stribeck_velocity=0.1, lag=0.1, rise_time=0.1)
    return Joint(inertia=1.0, friction=friction), Gains(stiffness=100.0)


# The longest first.
PARTS = {
    "verdict": Part(use=_use_verdict, node=False),
    "simulation": Part(use=_use_simulation, node=True),
    "detection": Part(use=_use_detection, node=True),
    "messages": Part(use=_use_messages, node=True),
}


def is_warm() -> bool:
    """Whether everything is compiled already, and kept."""
    return marker().exists()


def load_for_node() -> None:
    """Load what the node calls itself, compiled before or compiled now; the rest is for its second process."""
    for part in PARTS.values():
        if part.node:
            part.use()


class Compilation:
    """Compiles in another process; a context manager that ends it.

    Parameters
    ----------
    jobs : how many parts are compiled at once; None for one a core.
    """

    def __init__(self, jobs: int | None = None) -> None:
        # Where the folder goes with this process it has to be chosen here.
        cache_folder()
        self._began, self._message = time.monotonic(), ""
        # Ctrl-C is for this process, which ends the other one in its own time.
        self._process = subprocess.Popen(
            _command(jobs or os.cpu_count() or 1), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, start_new_session=True, text=True, errors="replace",
        )  # fmt: skip

    def __enter__(self) -> Compilation:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __str__(self) -> str:
        seconds = round(time.monotonic() - self._began)
        return f"compiling, once after installation: {seconds} s so far, usually less than half a minute"

    @property
    def running(self) -> bool:
        """Whether the process still runs."""
        return self._process.poll() is None

    @property
    def failure(self) -> str:
        """Why compiling failed, "" if it succeeded or still runs."""
        if self.running or self._process.returncode == 0:
            return ""
        assert self._process.stdout is not None
        self._message = self._message or self._process.stdout.read().strip()
        return self._message or f"it ended with status {self._process.returncode}"

    def close(self) -> None:
        """End the process; functions that it has compiled by then are kept."""
        if self.running:
            self._process.kill()
        self._process.wait()
        assert self._process.stdout is not None
        self._process.stdout.close()


def compile_ahead(report: Callable[[str], None], jobs: int | None = None) -> str:
    """Compile what is not compiled yet, in other processes, and wait for it; returns why not, or "".

    Parameters
    ----------
    report : called now and then with what is being done.

    Raises
    ------
    Interrupted
        If this process is asked to end meanwhile; the others are ended.
    """
    if is_warm():
        return ""
    with Compilation(jobs) as compilation:
        while compilation.running:
            check()
            report(str(compilation))
            time.sleep(_LOOK_EVERY)
        return compilation.failure


def _compile_all(jobs: int) -> None:
    """Compile every part, once another process that does so has ended."""
    with (cache_folder().path / _LOCK).open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not is_warm():
            with ThreadPoolExecutor(max_workers=jobs) as pool:
                list(pool.map(_compile_part, PARTS))
            marker().touch()
            forget_earlier_sources()


def _compile_part(name: str) -> None:
    """Compile a part in a process of its own: not forked, so that numba's memory is its own."""
    done = subprocess.run(
        _command(name), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", check=False
    )
    if done.returncode:
        *_, message = ["", *done.stdout.strip().splitlines()]
        raise StickSlipError(f"compiling {name} failed: {message or f'status {done.returncode}'}")


def _command(what: str | int) -> list[str]:
    """That compiles a part, or all of them with so many at once, for as long as this process lives."""
    return [sys.executable, "-m", "stickslip_ros.warm_up", str(os.getpid()), str(what)]


def _main(parent: str, what: str) -> int:
    die_with_parent(int(parent))
    os.nice(NICENESS)
    try:
        if what in PARTS:
            without_linear_algebra()
            PARTS[what].use()
        else:
            _compile_all(int(what))
    except StickSlipError as error:
        print(error)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(_main(*sys.argv[1:]))
