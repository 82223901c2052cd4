# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled functions of the node: loaded at once if they are there, else compiled by another process meanwhile."""

from __future__ import annotations

import gc
from time import monotonic

from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node

from stickslip_ros.compilation import NOT_KEPT, cache_folder, without_linear_algebra
from stickslip_ros.warm_up import Compilation, compile_ahead, is_warm, load_for_node

_REPORT_EVERY = 10.0  # time between two lines in the log, s: compiling takes half a minute


class CompiledParts:
    """Compiled functions of the node; :meth:`poll` is called now and then.

    Attributes
    ----------
    ready : whether all functions can be called. state : what is being done, in words, "" if nothing is being compiled.
    """

    def __init__(self, log: RcutilsLogger) -> None:
        self._log = log
        self._compilation: Compilation | None = None
        self._began = monotonic()
        self.ready, self.state = False, ""
        if is_warm():
            self._load()
            return
        folder = cache_folder()
        if not folder.permanent:
            log.warning(f"{NOT_KEPT}; until then it is compiled at every start")
        self._compilation = Compilation()
        self._report()

    def poll(self, now: float) -> None:
        """Report what is being done, and load the functions once they are compiled; ``now`` is a steady time [s]."""
        if self._compilation is None or self.ready:
            return
        if self._compilation.running:
            self._report()
            return
        failure = self._compilation.failure
        self.close()
        if failure:
            self._log.error(f"compiling ahead failed, and is done in this process instead: {failure}")
        else:
            self._log.info(f"compiled in {now - self._began:.0f} s")
        self._load()

    def _report(self) -> None:
        self.state = str(self._compilation)
        self._log.info(self.state, throttle_duration_sec=_REPORT_EVERY)

    def _load(self) -> None:
        without_linear_algebra()
        load_for_node()
        # The loaded objects stay. Searching these for garbage again and again would hold up intake for 0.1 s.
        gc.collect()
        gc.freeze()
        self.ready, self.state = True, ""

    def close(self) -> None:
        """End the other process."""
        if self._compilation is not None:
            self._compilation.close()
            self._compilation = None


def wait_until_compiled(node: Node) -> None:
    """Wait until everything is compiled, with a line in the log now and then.

    Raises
    ------
    Interrupted
        If the process is asked to end meanwhile.
    """
    log = node.get_logger()
    failure = compile_ahead(lambda text: log.info(text, throttle_duration_sec=_REPORT_EVERY))
    if failure:
        log.error(f"compiling ahead failed, and is done in this process instead: {failure}")
    without_linear_algebra()
