# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Signals that ask a process to end: they set a flag and wake what waits, and interrupt nothing.

An exception out of a signal handler would be raised wherever the process happens to be: in a finalizer, where Python
drops it; in the middle of a constructor of rclpy's or numba's, which then complains. Here the handlers only note the
signal. Loops ask for it at their steps, with :func:`came` or :func:`check`; a thread wakes those that sleep, and ends
the process where nobody has asked in time.
"""

from __future__ import annotations

import atexit
import os
import select
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from time import monotonic
from types import FrameType
from typing import NoReturn

_OF_SIGNALS = 128  # exit statuses of processes that a signal ended
_PATIENCE = 1.5  # [s] from a signal to the step that notices it: a person waits no longer
_INSISTENT = 1.0  # [s] after the first signal, from which on another one ends the process at once


class Interrupted(KeyboardInterrupt):
    """The process was asked to end by a signal of this number; ``status`` is its exit status then."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number, self.status = number, _OF_SIGNALS + number


class _Signals:
    """What this process knows of its signals."""

    def __init__(self) -> None:
        self.taken: frozenset[int] = frozenset()
        self.number = 0  # the first that came
        self.noticed = self.raised = False
        self.patience = _PATIENCE
        self.status: int | None = None
        self.lock = threading.Lock()
        self.wake: list[Callable[[], None]] = []
        self.clean_up: list[Callable[[], None]] = []


_signals = _Signals()


def take_signals(
    numbers: Sequence[signal.Signals] = (signal.SIGINT, signal.SIGTERM), *, status: int | None = None
) -> None:
    """Let signals only be noted, from now to the end of this process; call in its main thread, before all else.

    Parameters
    ----------
    status : exit status where the process has to be ended because it does not notice; None for 128 + the signal's
        number.
    """
    if _signals.taken:
        return
    _signals.taken, _signals.status = frozenset(numbers), status
    read, write = os.pipe2(os.O_CLOEXEC | os.O_NONBLOCK)
    signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(read,), name="signals", daemon=True).start()
    for number in numbers:
        signal.signal(number, _note)
        # System calls of libraries go on as if nothing had come.
        signal.siginterrupt(number, False)
    # At its very end Python takes its handlers back.
    atexit.register(_ignore_signals)
    # Whoever began this process may have held them back until now.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)


def _ignore_signals() -> None:
    for number in _signals.taken:
        signal.signal(number, signal.SIG_IGN)


def came() -> int:
    """The number of the signal that asks this process to end, 0 before; who is told it ends the process in order."""
    if _signals.number:
        _signals.noticed = True
    return _signals.number


def check() -> None:
    """End the work of the main thread here if the process has been asked to end.

    Raises
    ------
    Interrupted
        Once: what brings the work to its end is not interrupted.
    """
    if _signals.number and not _signals.raised and threading.current_thread() is threading.main_thread():
        _signals.noticed = _signals.raised = True
        raise Interrupted(_signals.number)


@contextmanager
def woken(wake: Callable[[], None], *, patience: float = _PATIENCE) -> Iterator[None]:
    """Have something called, in another thread, as soon as a signal comes, or at once if one has come.

    Parameters
    ----------
    patience : how long this thread may take to notice [s].
    """
    with _signals.lock:
        _signals.patience = patience
        _signals.wake.append(wake)
        if _signals.number:
            wake()
    try:
        yield
    finally:
        with _signals.lock:
            _signals.wake.remove(wake)


def at_hard_end(clean_up: Callable[[], None]) -> None:
    """Have something called, in another thread, where the process ends without noticing: it must not wait."""
    _signals.clean_up.append(clean_up)


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Begin processes of Python's ``multiprocessing`` that never see Ctrl-C: it is for this one, which ends them."""
    from multiprocessing import resource_tracker

    # It lets the signal through again when it begins its own process.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _note(number: int, _: FrameType | None) -> None:
    _signals.number = _signals.number or number


def _watch(read: int) -> None:
    """Wake what waits once a signal comes; end the process if nothing notices, or if more signals insist."""
    while not (number := _next(read, None)):
        pass
    _note(number, None)
    first = monotonic()
    with _signals.lock:
        for wake in _signals.wake:
            wake()
    while True:
        left = first + _signals.patience - monotonic()
        if left <= 0.0 and not _signals.noticed:
            _end()
        if _next(read, None if _signals.noticed else left) and monotonic() - first > _INSISTENT:
            _end()


def _next(read: int, timeout: float | None) -> int:
    """The next signal, 0 if none comes in time [s] or it is none of those that are taken."""
    if not select.select([read], [], [], timeout)[0]:
        return 0
    return next((number for number in os.read(read, 64) if number in _signals.taken), 0)


def _end() -> NoReturn:
    for clean_up in _signals.clean_up:
        with suppress(OSError):
            clean_up()
    os._exit(_OF_SIGNALS + _signals.number if _signals.status is None else _signals.status)
