# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip demo --compensation`: what compensating the friction of a joint does, over real DDS.

Feed-forward does nothing against stick-slip, and cures what reversals cost; feedback of more than the friction makes a
joint hunt. Exit status 0 only if all three were seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path

from rich.console import Console

from stickslip_ros.cli.demo_log import DemoListener, two_nodes
from stickslip_ros.cli.demo_picture import draw
from stickslip_ros.errors import StickSlipError

_STIFF, _DAMPED, _HARDLY_DAMPED = 6300.0, 200.0, 20.0  # [N·m/rad], [N·m·s/rad], likewise
_ONE_WAY = 4.0  # [s] between reversals
_FAST = 0.02  # [rad/s] smooth by itself, with hardly any damping
_SHARE, _TOO_MUCH = 0.5, 1.2  # of the friction
_CYCLES, _TURNS = 4, 2
_LIMIT = 60.0  # [s] for each of the things shown
_LEFT = 0.7  # of the error at a reversal: less is a help


class _Scene:
    """The joint, its monitor, and who looks at them."""

    def __init__(self, listener: DemoListener) -> None:
        self.listener = listener
        self._cycles = 0
        listener.wait_for_nodes(lambda: listener.status != "" and not math.isnan(listener.now))
        self.marks: list[tuple[float, str]] = []

    def begin(self, values: Mapping[str, object], called: str = "") -> None:
        """Set parameters of the joint, each named without it; what is seen from then on counts.

        Parameters
        ----------
        called : what that is called in the picture.
        """
        joint = self.listener.joint
        named = {".".join([kind, joint, *rest]): value for name, value in values.items()
                 for kind, *rest in [name.split(".")]}  # fmt: skip
        self._wait(self.listener.set_parameters(named).done, "the joint's parameters to be set")
        self._wait(self.listener.trigger("reset", "reset it").done, "the monitor to answer")
        # What was published before the reset does not count.
        self._wait(lambda: not self._reversals(), "the monitor to be reset")
        self.listener.listen(0.2)
        if called:
            self.marks.append((self.listener.now, called))
        self._cycles = len(self.listener.data.cycles)

    def _wait(self, reached: Callable[[], bool], what: str) -> None:
        self.listener.wait(reached, _LIMIT, what)

    def _reversals(self) -> float:
        """Their latest number."""
        return float(self.listener.value("reversals [1]") or 0.0)

    def slips(self) -> float:
        """Wait for some; returns the last one's way [rad]."""
        cycles = self.listener.data.cycles
        enough = self._cycles + _CYCLES
        self._wait(lambda: len(cycles) >= enough, "stick-slip")
        return abs(cycles[-1]["slip_distance"])

    def reversal(self) -> tuple[float, float]:
        """Wait for some; returns how long the joint stands [s], and its peak error [rad]."""
        self._wait(lambda: self._reversals() >= _TURNS, "reversals")
        values = [self.listener.value(f"reversal {what}") for what in ("standing [s]", "peak_error [rad]")]
        return float(values[0]), float(values[1])


def compensate(console: Console, out: Path, parameters: Mapping[str, object]) -> int:
    """Show it, and write a picture.

    Parameters
    ----------
    parameters : of the monitor.

    Raises
    ------
    StickSlipError
        If one of the things to show was not seen in time.
    """
    with two_nodes(console, "joint1", parameters, {}) as listener:
        scene = _Scene(listener)
        _show(console, scene)
        draw(listener.data, out, title="PUMA 560 joint 1, its friction compensated", marks=scene.marks, unit="rad")
    console.print(f"Picture: [bold]{out}[/]")
    return 0


def _show(console: Console, scene: _Scene) -> None:
    scene.begin({"feedforward": 0.0})
    console.print(f"[bold red]Stick-slip[/] with soft gains: slips of {1e3 * scene.slips():.2f} mrad.")
    scene.begin({"feedforward": 1.0}, "all friction fed forward")
    console.print(
        f"With all of the friction [bold]fed forward[/] it sticks as before: slips of {1e3 * scene.slips():.2f} mrad. "
        "At constant speed that is a constant torque, which changes nothing."
    )
    stiff = {"gains.p": _STIFF, "gains.d": _DAMPED, "profile": "reverse", "reversal_period": _ONE_WAY}
    scene.begin({"feedforward": 0.0, **stiff}, "stiff, turns round")
    standing, error = scene.reversal()
    console.print(
        f"With stiff gains it moves smoothly, and [bold]turns round[/] every {_ONE_WAY:g} s: there it stands for "
        f"{standing:.2g} s and falls behind by {1e3 * error:.3g} mrad."
    )
    scene.begin({"feedforward": _SHARE}, f"{100 * _SHARE:.0f} % fed forward")
    standing, left = scene.reversal()
    if not left < _LEFT * error:
        raise StickSlipError(
            f"no help: {1e3 * left:.3g} mrad at a reversal with feed-forward, {1e3 * error:.3g} without"
        )
    console.print(
        f"[bold green]Fed forward[/] at {100 * _SHARE:.0f} % of the friction, it stands for {standing:.2g} s and falls "
        f"behind by {1e3 * left:.3g} mrad."
    )
    moving = {"profile": "move", "velocity": _FAST, "gains.d": _HARDLY_DAMPED}
    scene.begin({"feedforward": 0.0, "feedback": _TOO_MUCH, **moving}, f"{100 * _TOO_MUCH:.0f} % fed back")
    console.print(
        f"[bold red]Feedback[/] by the measured speed, of {100 * _TOO_MUCH:.0f} % of the friction: at {1e3 * _FAST:g} "
        f"mrad/s, where the stiff joint is smooth by itself, it stops and slips by {1e3 * scene.slips():.2f} mrad."
    )
