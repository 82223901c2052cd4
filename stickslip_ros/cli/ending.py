# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""SIGTERM and SIGHUP as exceptions: what a command has begun to write is removed on its way out, as on Ctrl-C."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_SIGNALS = (signal.SIGTERM, signal.SIGHUP)
_OF_SIGNALS = 128  # exit statuses of those that a signal ended


class Ended(SystemExit):
    """A signal asks the process to end; ``status`` is its exit status then.

    An event loop lets a SystemExit out of a callback, and swallows other exceptions.
    """

    def __init__(self, number: int) -> None:
        self.status = _OF_SIGNALS + number
        super().__init__(self.status)


@contextmanager
def ended_by_exception() -> Iterator[None]:
    """Let the signals raise :class:`Ended`, where they would end the process and are not ignored (as by nohup)."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    process = os.getpid()

    def end(number: int, _: FrameType | None) -> None:
        # Children of a fork clean nothing up; and a second signal is not to disturb those who do.
        if os.getpid() != process:
            os._exit(_OF_SIGNALS + number)
        for one in taken:
            signal.signal(one, signal.SIG_IGN)
        raise Ended(number)

    taken = [number for number in _SIGNALS if signal.getsignal(number) == signal.SIG_DFL]
    for number in taken:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)
