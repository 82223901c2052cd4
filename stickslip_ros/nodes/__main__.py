# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The processes of the nodes, `python -m stickslip_ros.nodes monitor`: signals are handled before any import."""

from __future__ import annotations

import sys
from importlib import import_module

from stickslip_ros.interrupts import came, take_signals

_NODES = ("monitor", "replay", "simulated_joint")


def monitor() -> int:
    """Run the node `stickslip_monitor`; returns the exit status."""
    return _run("monitor")


def replay() -> int:
    """Run the node `replay`; returns the exit status."""
    return _run("replay")


def simulated_joint() -> int:
    """Run the node `simulated_joint`; returns the exit status."""
    return _run("simulated_joint")


def _run(name: str) -> int:
    take_signals(status=0)
    main = import_module(f"stickslip_ros.nodes.{name}").main
    return 0 if came() else int(main())


if __name__ == "__main__":
    if sys.argv[1:2] not in [[name] for name in _NODES]:
        raise SystemExit(f"the name of a node must come first, one of {', '.join(_NODES)}")
    raise SystemExit(_run(sys.argv[1]))
