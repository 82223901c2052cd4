# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiling everything ahead, in processes of its own: once after installation, and after every update.

Numba compiles a function when it is first called, in up to seconds in which the process that calls it does nothing
else, and keeps the memory that took. Here this is done by processes that end, one for each :data:`PARTS`; whoever
needs the functions loads them then in a fraction of a second. Processes that are started together compile once.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np
from numba.core import event

from stickslip_ros.compilation import cache_folder, forget_earlier_sources, marker, without_linear_algebra
from stickslip_ros.errors import StickSlipError
from stickslip_ros.interrupts import check
from stickslip_ros.parent_death import NICENESS, die_with_parent

if TYPE_CHECKING:
    from stickslip_ros.model.friction import Gains, Joint

_LOCK, _PROGRESS = "lock", "progress.json"
_REPORT_EVERY = 0.5  # time between two reports, s: a person sees the progress
_ENOUGH_TO_ESTIMATE = 0.1  # share of the work, 1: from here on its duration gives that of the rest
_AT_LEAST = 0.2  # least share of the time left at the last progress, 1: the last function is the longest
_COMPILED = "compiled"


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far compiling has come.

    Attributes
    ----------
    share : done, 0 to 1. left : estimate of the time left [s]. other_process : whether another process compiles.
    """

    share: float = 0.0
    left: float = 0.0
    other_process: bool = False

    def __str__(self) -> str:
        who = "another process compiles" if self.other_process else "compiling"
        return f"{who}, once after installation: {max(1, round(self.left))} s left"


@dataclass(frozen=True, kw_only=True)
class Part:
    """Functions that are compiled one after the other, because they share much.

    Attributes
    ----------
    use : calls them. functions : how many there are, those included that they call; seconds : that these took once.
        Both are no more than a measure of progress.
    node : whether the node needs them in its own process.
    """

    use: Callable[[], None]
    functions: int
    seconds: float
    node: bool


def _use_detection() -> None:
    from stickslip_ros.monitoring.assessment import MonitorOptions
    from stickslip_ros.monitoring.joint_monitor import JointMonitor
    from stickslip_ros.monitoring.samples import Batch

    # It moves and stands, twice.
    time = 0.01 * np.arange(400.0)
    position = np.interp(time, [0.0, 1.0, 2.0, 2.2, 3.2, 3.4, 4.0], [0.0, 0.1, 0.1, 0.2, 0.2, 0.3, 0.3])
    monitor = JointMonitor(options=MonitorOptions(learn=False))
    monitor.process(Batch(time=time, position=position, reference_position=position))
    monitor.assessment()
    monitor.finish()


def _use_messages() -> None:
    from stickslip_ros.bags.storage import _record_kernel as kernel
    from stickslip_ros.messages.blocks import Block
    from stickslip_ros.messages.joint_states import JointStateDecoder
    from stickslip_ros.messages.whole_turns import WholeTurns

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
    from stickslip_ros.monitoring.friction.slip_fit import Tolerances, fit_at_fixed_parameters
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
    problem = SlipProblem([window])
    fit_at_fixed_parameters(
        problem, Tolerances(), parameters=np.zeros(PARAMETERS), kinetic=np.zeros(1), unknowns=problem.detected(1.0),
        iterations=1,
    )  # fmt: skip


def _example() -> tuple[Joint, Gains]:
    from stickslip_ros.model.friction import Friction, Gains, Joint

    friction = Friction(stribeck=1.0, stribeck_velocity=0.1, lag=0.1, rise_time=0.1)
    return Joint(inertia=1.0, friction=friction), Gains(stiffness=100.0)


PARTS = {
    "verdict": Part(use=_use_verdict, functions=35, seconds=10.0, node=False),
    "detection": Part(use=_use_detection, functions=32, seconds=8.0, node=True),
    "simulation": Part(use=_use_simulation, functions=36, seconds=10.0, node=True),
    "messages": Part(use=_use_messages, functions=10, seconds=2.0, node=True),
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
        jobs = jobs or os.cpu_count() or 1
        # Ctrl-C is for this process, which ends the other one in its own time.
        self._process = subprocess.Popen(
            _command(jobs), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            start_new_session=True,
        )  # fmt: skip
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)
        self._rest, self._message = b"", b""
        self._reported, self._reported_at = Progress(left=_seconds(dict.fromkeys(PARTS, 1.0), jobs)), time.monotonic()

    def __enter__(self) -> Compilation:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    @property
    def progress(self) -> Progress:
        """Present progress."""
        assert self._process.stdout is not None
        *lines, self._rest = (self._rest + (self._process.stdout.read() or b"")).split(b"\n")
        for line in lines:
            try:
                self._reported, self._reported_at = Progress(**json.loads(line)), time.monotonic()
            except (ValueError, TypeError):
                self._message = line
        passed = time.monotonic() - self._reported_at
        return replace(self._reported, left=max(self._reported.left - passed, 0.0))

    @property
    def running(self) -> bool:
        """Whether the process still runs."""
        return self._process.poll() is None

    @property
    def failure(self) -> str:
        """Why compiling failed, "" if it succeeded or still runs."""
        if self.running or self._process.returncode == 0:
            return ""
        assert self.progress is not None
        return self._message.decode(errors="replace") or f"it ended with status {self._process.returncode}"

    def close(self) -> None:
        """End the process; functions that it has compiled by then are kept."""
        if self.running:
            self._process.kill()
        self._process.wait()
        assert self._process.stdout is not None
        self._process.stdout.close()


def compile_ahead(report: Callable[[Progress], None], jobs: int | None = None) -> str:
    """Compile what is not compiled yet, in other processes, and wait for it; returns why not, or "".

    Parameters
    ----------
    report : called now and then.

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
            report(compilation.progress)
            time.sleep(_REPORT_EVERY / 5.0)
        return compilation.failure


def _seconds(shares: Mapping[str, float], jobs: int) -> float:
    """Duration [s] of these shares of the parts with ``jobs`` parts at once, by the durations of the table."""
    each = [share * PARTS[name].seconds for name, share in shares.items()]
    return max(*each, sum(each) / jobs)


def _compile_all(jobs: int) -> None:
    """Compile every part, unless another process does; progress goes to standard output."""
    folder = cache_folder().path
    with (folder / _LOCK).open("w") as lock:
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError:
                _relay(folder / _PROGRESS)
                time.sleep(_REPORT_EVERY)
        if not is_warm():
            _compile_parts(jobs, folder / _PROGRESS)
            marker().touch()
            forget_earlier_sources()
            (folder / _PROGRESS).unlink(missing_ok=True)


def _relay(progress: Path) -> None:
    """Print the progress of the other process."""
    with contextlib.suppress(OSError, ValueError, TypeError):
        _print_progress(replace(Progress(**json.loads(progress.read_text())), other_process=True))


def _print_progress(progress: Progress) -> None:
    print(json.dumps(asdict(progress)), flush=True)


def _compile_parts(jobs: int, progress: Path) -> None:
    began = time.monotonic()
    left = dict.fromkeys(PARTS, 1.0)
    nominal = _seconds(left, jobs)
    known_share = known_at = 0.0
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        longest_first = sorted(PARTS, key=lambda name: -PARTS[name].seconds)
        running = {pool.submit(_compile_part, name, left) for name in longest_first}
        while running:
            remaining, passed = _seconds(left, jobs), time.monotonic() - began
            share = 1.0 - remaining / nominal
            if share > known_share:
                known_share, known_at = share, passed
            # The pace is that until the last progress, once enough is done; the time left counts down from there.
            pace = known_at / (known_share * nominal) if known_share > _ENOUGH_TO_ESTIMATE else 1.0
            rest = pace * remaining
            now = Progress(share=share, left=max(rest - (passed - known_at), _AT_LEAST * rest))
            _print_progress(now)
            progress.write_text(json.dumps(asdict(now)))
            done, running = wait(running, timeout=_REPORT_EVERY, return_when=FIRST_COMPLETED)
            for future in done:
                future.result()


def _compile_part(name: str, left: dict[str, float]) -> None:
    """Compile a part in a process of its own; ``left`` has the share of it that is still to be done."""
    # Not forked, so that numba's memory is its own.
    message = ""
    with subprocess.Popen(_command(name), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith(_COMPILED):
                left[name] = max(0.02, left[name] - 1.0 / PARTS[name].functions)
            else:
                message = line.strip() or message
    if process.returncode:
        raise StickSlipError(f"compiling {name} failed: {message or f'status {process.returncode}'}")
    left[name] = 0.0


class _CompilationListener(event.Listener):  # type: ignore[misc]
    """Listener that prints a line for every function that numba has compiled."""

    def on_start(self, event: event.Event) -> None:
        """Nothing yet."""

    def on_end(self, event: event.Event) -> None:
        """One more."""
        print(_COMPILED, flush=True)


def _command(what: str | int) -> list[str]:
    """That compiles a part, or all of them with so many at once, for as long as this process lives."""
    return [sys.executable, "-m", "stickslip_ros.warm_up", str(os.getpid()), str(what)]


def _main(parent: str, what: str) -> int:
    die_with_parent(int(parent))
    os.nice(NICENESS)
    try:
        if what in PARTS:
            without_linear_algebra()
            event.register("numba:compile", _CompilationListener())
            PARTS[what].use()
        else:
            _compile_all(int(what))
    except StickSlipError as error:
        print(error)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(_main(*sys.argv[1:]))
