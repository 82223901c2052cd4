# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A robot and a monitor on two hosts, and a cable between them that is cut for some seconds and mended.

The hosts are network namespaces of this machine (iproute2, as root), from which nothing leads outside. Run by
test_faults_over_dds.py; exit status 77 where there is no right to make them.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time

from support_ros import STALE, Probe, probe

from stickslip_ros.cli.processes import NodeProcess
from stickslip_ros.parent_death import die_with_parent

NO_RIGHT = 77
_CUT = 12.0  # [s]
_NAMES = [f"stickslip_{os.getpid()}_{end}" for end in "ab"]
_LINKS = [f"ss{os.getpid() % 100_000}{end}" for end in "ab"]


def ip(*arguments: str) -> None:
    """Run ip; raises CalledProcessError if that fails."""
    subprocess.run(["ip", *arguments], check=True, capture_output=True)


def connect() -> None:
    """Two hosts and a cable."""
    for name in _NAMES:
        ip("netns", "add", name)
    ip("link", "add", _LINKS[0], "netns", _NAMES[0], "type", "veth", "peer", "name", _LINKS[1], "netns", _NAMES[1])
    for number, (name, link) in enumerate(zip(_NAMES, _LINKS, strict=True)):
        ip("-n", name, "addr", "add", f"10.213.0.{number + 1}/24", "dev", link)
        ip("-n", name, "link", "set", "lo", "up")
        ip("-n", name, "link", "set", link, "up")
        ip("-n", name, "route", "add", "224.0.0.0/4", "dev", link)


def watch(one: Probe, link: str) -> None:
    """The monitor, on this host, before the cut and after; ``link`` is its end of the cable."""
    one.wait(lambda: one.status("joint1") == "stick_slip", "stick-slip over the cable")
    ip("link", "set", link, "down")
    one.wait(lambda: one.diagnostics["joint1"][0] == STALE, "silence")
    one.spin(_CUT)
    assert one.diagnostics["joint1"][0] == STALE
    ip("link", "set", link, "up")
    ip("route", "add", "224.0.0.0/4", "dev", link)
    one.wait(lambda: one.diagnostics["joint1"][0] != STALE, "the joint to be heard again")
    one.wait(lambda: one.status("joint1") == "stick_slip", "stick-slip again")
    before = len(one.cycles)
    one.wait(lambda: len(one.cycles) > before + 1, "further cycles")


def main() -> int:
    """As the robot's keeper: make the hosts, start the robot there and this script here again."""
    if sys.argv[1:2] == ["watch"]:
        with NodeProcess("monitor", {"joints": "['']", "state_file": "none"}) as monitor, probe() as one:
            watch(one, sys.argv[2])
            assert "Traceback" not in monitor.output()
        return 0
    try:
        connect()
    except (OSError, subprocess.CalledProcessError) as error:
        print(f"no network namespaces here: {getattr(error, 'stderr', error)}", file=sys.stderr)
        return NO_RIGHT
    # One machine's shared memory would be a second cable.
    environment = {
        **os.environ,
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "ROS_DOMAIN_ID": "33",
    }
    here = ["ip", "netns", "exec", _NAMES[0], sys.executable, __file__, "watch", _LINKS[0]]
    there = ["ip", "netns", "exec", _NAMES[1], sys.executable, "-m", "stickslip_ros.nodes", "simulated_joint"]
    robot = subprocess.Popen(there, env=environment, preexec_fn=die_with_parent)
    try:
        time.sleep(0.5)
        return subprocess.run(here, env=environment, check=False, timeout=240.0).returncode
    finally:
        robot.kill()
        robot.wait()


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    finally:
        if sys.argv[1:2] != ["watch"]:
            for _name in _NAMES:
                subprocess.run(["ip", "netns", "del", _name], check=False, capture_output=True)
