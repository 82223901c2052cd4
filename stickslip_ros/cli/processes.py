# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Nodes as processes of their own, which end with the command that started them, however it ends."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import BinaryIO

from stickslip_ros.parent_death import die_with_parent

_DOMAINS = range(1, 102)  # those whose ports lie below Linux's ephemeral range
_PORTS = Path("/proc/net")
_FIRST_PORT, _PORTS_EACH = 7400, 250  # of a domain, as DDS has them


def isolate() -> int:
    """Keep this process and its children on this machine and on a ROS domain of their own; returns the domain.

    A ROS_DOMAIN_ID that the user has set is kept.
    """
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    domain = os.environ.setdefault("ROS_DOMAIN_ID", str(random.SystemRandom().choice(free_domains())))
    return int(domain)


def free_domains() -> list[int]:
    """The ROS domains that nobody on this machine uses; all of them where the system does not tell."""
    used = set()
    for table in ("udp", "udp6"):
        try:
            lines = (_PORTS / table).read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            continue
        used |= {(int(line.split()[1].rpartition(":")[2], 16) - _FIRST_PORT) // _PORTS_EACH for line in lines}
    return [domain for domain in _DOMAINS if domain not in used] or list(_DOMAINS)


class NodeProcess:
    """One node run as a process; a context manager that ends it.

    Parameters
    ----------
    module : name of a module of stickslip_ros.nodes, or path of a script (.py).
    parameters : ROS parameters, name to value in YAML.
    remappings : ROS remappings, from to.
    params_file : of further parameters.
    """

    def __init__(
        self,
        module: str,
        parameters: dict[str, object],
        remappings: dict[str, str] | None = None,
        params_file: Path | None = None,
    ) -> None:
        self.module = module
        arguments = [item for name, value in parameters.items() for item in ("-p", f"{name}:={value}")]
        arguments += [item for name, value in (remappings or {}).items() for item in ("-r", f"{name}:={value}")]
        if params_file is not None:
            arguments += ["--params-file", str(params_file)]
        target = [module] if module.endswith(".py") else ["-m", "stickslip_ros.nodes", module]
        self._log = tempfile.TemporaryFile()  # noqa: SIM115
        self._process = self._begin([sys.executable, *target, "--ros-args", *arguments], self._log)

    @staticmethod
    def _begin(command: list[str], log: BinaryIO) -> subprocess.Popen[bytes]:
        """Begin the process; tests fork it in place of this."""
        # A session of its own, so that Ctrl-C reaches the command first, which then ends its nodes in order.
        return subprocess.Popen(
            command, stdout=log, stderr=subprocess.STDOUT, start_new_session=True,
            preexec_fn=_begin if command[1] == "-m" else die_with_parent,
        )  # fmt: skip

    def __enter__(self) -> NodeProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self._log.close()

    @property
    def running(self) -> bool:
        """Whether the process still runs."""
        return self._process.poll() is None

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def wait(self, timeout: float) -> int:
        """Exit status, after waiting for the end for at most ``timeout`` seconds."""
        return self._process.wait(timeout)

    def output(self) -> str:
        """What the process has printed so far."""
        # The process writes where the file's offset is, and shares it: reading must not move it.
        log = self._log.fileno()
        return os.pread(log, os.fstat(log).st_size, 0).decode(errors="replace")

    def kill(self) -> None:
        """End the process without a warning."""
        self._process.kill()
        self._process.wait(5.0)

    def stop(self) -> int:
        """Interrupt, and kill if that does not help; returns the exit status."""
        for signal_number, patience in ((signal.SIGINT, 5.0), (signal.SIGKILL, 5.0)):
            if self.running:
                self._process.send_signal(signal_number)
            try:
                return self._process.wait(patience)
            except subprocess.TimeoutExpired:
                continue
        raise RuntimeError(f"process {self._process.pid} ({self.module}) cannot be ended")


def _begin() -> None:
    die_with_parent()
    # Until the node takes its signals: Python has a traceback for those that come while it starts.
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
