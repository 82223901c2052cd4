# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Nodes forked from a process that has loaded compiled functions, which costs each of them nearly a second of a core.

So is the second process of a monitor, which costs as much again: it waits for the first question beside its node.
Where the start or the end of a process is the claim, tests use those of :mod:`stickslip_ros.cli.processes`.
"""

from __future__ import annotations

import fcntl
import gc
import os
import pickle
import runpy
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from functools import cache
from multiprocessing import util
from pathlib import Path
from typing import BinaryIO

from stickslip_ros.cli import processes
from stickslip_ros.parent_death import die_with_parent

_LARGEST = 200_000  # size of a request, B: a Unix socket takes no larger message by default
_NUMBER = 32  # size of a process id or an exit status in text, B
_SPAWNED = "--multiprocessing-fork"  # the last word of the command of a process that multiprocessing spawns
_MOST_DESCRIPTORS, _HIGH = 8, 200  # descriptors that such a process is given, 1; a number beyond theirs


class NodeProcess(processes.NodeProcess):
    """One node, as :class:`stickslip_ros.cli.processes.NodeProcess`, forked."""

    assert "_begin" in vars(processes.NodeProcess)

    @staticmethod
    def _begin(command: list[str], log: BinaryIO) -> _Fork:  # type: ignore[override]
        return _Fork(command, log.fileno())


class _Fork:
    """A forked process, with the methods of subprocess.Popen that are used."""

    def __init__(self, command: list[str], log: int) -> None:
        self._command, self._status = command, -1
        self._keeper, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        request = pickle.dumps((command, Path.cwd(), dict(os.environ)))
        with theirs:
            socket.send_fds(_server()[0], [request], [theirs.fileno(), log])
        self.pid = int(self._keeper.recv(_NUMBER))

    def poll(self) -> int | None:
        """Exit status, None before the end."""
        try:
            return self.wait(0.0)
        except subprocess.TimeoutExpired:
            return None

    def wait(self, timeout: float) -> int:
        """Exit status, after waiting for the end."""
        if self._keeper.fileno() != -1:
            self._keeper.settimeout(timeout)
            try:
                self._status = int(self._keeper.recv(_NUMBER))
            except (TimeoutError, BlockingIOError):
                raise subprocess.TimeoutExpired(self._command, timeout) from None
            self._keeper.close()
        return self._status

    def send_signal(self, number: int) -> None:
        """Send a signal to a process that has not ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End the process without a warning."""
        self.send_signal(signal.SIGKILL)


@cache
def _server() -> tuple[socket.socket, subprocess.Popen[bytes]]:
    """The connection to the process that forks, and this; it is begun with the first node, and ends with the tests."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        number, environment = theirs.fileno(), {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, __file__, str(number)]
        return ours, subprocess.Popen(command, env=environment, pass_fds=[number], preexec_fn=die_with_parent)


def _serve(requests: socket.socket) -> None:
    """Fork nodes, each by a process that waits for its end, until the tests are over."""
    _load()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while True:
        request, descriptors, *_ = socket.recv_fds(requests, _LARGEST, 2)
        if not request:
            return
        if not os.fork():
            requests.close()
            return _keep(*descriptors, *pickle.loads(request))
        for descriptor in descriptors:
            os.close(descriptor)


def _load() -> None:
    """Load what nodes would load one by one, but for rclpy: its tracing has threads, which a fork would not have."""
    from stickslip_ros.compilation import without_linear_algebra
    from stickslip_ros.nodes import slow_work  # noqa: F401
    from stickslip_ros.warm_up import PARTS, is_warm

    if is_warm():
        without_linear_algebra()
        for part in PARTS.values():
            part.use()
    assert len(os.listdir("/proc/self/task")) == 1
    gc.collect()
    gc.freeze()


def _keep(asked: int, log: int, command: list[str], folder: Path, environment: dict[str, str]) -> None:
    """Be a node; its parent tells who asked for it the node's number, and then its exit status."""
    die_with_parent()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    node = os.fork()
    if node:
        os.write(asked, str(node).encode())
        _, status = os.waitpid(node, 0)
        os.write(asked, str(os.waitstatus_to_exitcode(status)).encode())
        os._exit(0)
    die_with_parent()
    os.setsid()
    os.close(asked)
    for number in (1, 2):
        os.dup2(log, number)
    os.close(log)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if command[1] == "-m":
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        sys.argv = command[2:]
        if sys.argv[1] == "monitor":
            _fork_second()
        runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
    else:
        sys.argv = command[1:]
        sys.path.insert(0, str(Path(sys.argv[0]).parent))
        runpy.run_path(sys.argv[0], run_name="__main__")


def _fork_second() -> None:
    """Fork the process for slow work, while the node has no threads; it is the first that multiprocessing spawns."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    second = os.fork()
    if not second:
        ours.close()
        return _become_second(theirs)
    theirs.close()
    spawn = util.spawnv_passfds

    def take(path: bytes, arguments: Sequence[str], descriptors: Sequence[int]) -> int:
        if arguments[-1] != _SPAWNED or ours.fileno() == -1:
            return spawn(path, arguments, descriptors)
        with ours:
            socket.send_fds(ours, [pickle.dumps((arguments, descriptors))], descriptors)
        return second

    util.spawnv_passfds = take
    return None


def _become_second(request: socket.socket) -> None:
    """Wait for what multiprocessing would have spawned, and do it; end if the node ends before."""
    die_with_parent()
    with request:
        words, received, *_ = socket.recv_fds(request, _LARGEST, _MOST_DESCRIPTORS)
    if not words:
        os._exit(0)
    arguments, numbers = pickle.loads(words)
    moved = [fcntl.fcntl(one, fcntl.F_DUPFD, _HIGH) for one in received]
    for one in received:
        os.close(one)
    for one, number in zip(moved, numbers, strict=True):
        os.dup2(one, number)
        os.close(one)
    sys.argv = arguments[-2:]
    exec(arguments[-2], {"__name__": "__main__"})


if __name__ == "__main__":
    _serve(socket.socket(fileno=int(sys.argv[1])))
