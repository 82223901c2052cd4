# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip demo`: detect, explain and cure the stick-slip of a simulated joint, over real DDS.

The demo starts a simulated joint and the monitor as two processes, waits for stick-slip, lets the monitor apply its
advice to the moving joint, and waits for smooth motion. The exit status is 0 only if stick-slip was detected before and
has ended after. With --recording a recorded joint takes the simulated joint's place and no gains are changed; 0 then
means that the recording was watched to its end. With --compensation the demo takes a minute and shows the effect of
friction compensation on stick-slip and at reversals, and that of too much of it.

Examples:
    stickslip demo
    stickslip demo --compensation
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console

from stickslip_ros.analysis.comparison import compare_joints
from stickslip_ros.analysis.joint_analysis import JointAnalysis, JointAnalyzer
from stickslip_ros.bags.table import find_recording, load_recording
from stickslip_ros.cli.compare import print_joints
from stickslip_ros.cli.options import DRAWING, add_flag, add_number, add_option, refuse_given
from stickslip_ros.cli.processes import NodeProcess, isolate
from stickslip_ros.cli.terminal import console_of_text
from stickslip_ros.cli.warm_up import compile_and_say
from stickslip_ros.errors import StickSlipError
from stickslip_ros.model._validation import require_positive
from stickslip_ros.output.published import RESERVE_FIELD
from stickslip_ros.settings.parameter_file import Parameters
from stickslip_ros.warm_up import is_warm

if TYPE_CHECKING:
    from stickslip_ros.cli.demo_log import DemoData, DemoListener

_JOINT = "joint1"
# Its friction is known; what is learnt from the first slips would move the advice while it is being followed.
_FORGETFUL: dict[str, object] = {"state_file": "none"}  # every demo begins from nothing
_KNOWN: dict[str, object] = {
    "joints": f"[{_JOINT}]",
    f"model.{_JOINT}": "puma560_joint1",
    "learn": "false",
    "allow_apply": "true",
    f"limits.{_JOINT}.p_max": 10000.0,
    f"limits.{_JOINT}.d_max": 300.0,
}
_CYCLES_TO_SEE = 4
_SMOOTH_TO_SEE = 7.0  # [s]: chance would hardly leave so many cycles out
_STICK_LIMIT = 20.0
_RATE = 500.0  # samples a second [Hz]: all processes of the demo have room on two slow cores
_SMOOTH_LIMIT = 25.0
_APPLY_LIMIT = 45.0
_ATTEMPTS = 3  # number of requests to apply the advice, 1
_STIFF, _DAMPED, _HARDLY_DAMPED = 6300.0, 200.0, 20.0  # [N·m/rad], [N·m·s/rad], likewise
_ONE_WAY = 4.0  # [s] between reversals
_FAST = 0.02  # [rad/s] smooth by itself, with hardly any damping
_SHARE, _TOO_MUCH = 0.5, 1.2  # of the friction
_CYCLES, _TURNS = 4, 2
_LIMIT = 60.0  # [s] for each of the things shown
_LEFT = 0.7  # of the error at a reversal: less is a help


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    drawn = "where to save the picture: .png, .svg or .pdf"
    add_option(parser, "--out", "FILE", drawn, "stickslip_demo.png", type=DRAWING)
    replayed = "replay a recorded joint instead: a table (.csv, .parquet, .npz), or the beginning of a known one's name"
    add_option(parser, "--recording", "NAME", replayed)
    compensated = "show what compensating the friction does and does not: stick-slip, reversals, too much of it"
    add_flag(parser, "--compensation", compensated)
    add_number(parser, "--speed", "X", "recorded seconds a second (default: so that it takes half a minute)")


def run(options: argparse.Namespace) -> int:
    """Run the demo."""
    if options.speed is not None:
        require_positive("speed", options.speed)
        if options.recording is None:
            refuse_given(options, {"speed": None}, "given together with --recording")
    if options.compensation and options.recording is not None:
        raise StickSlipError("--compensation and --recording exclude each other: nothing controls a recorded joint")
    try:
        import rclpy  # noqa: F401
    except ImportError as error:
        raise StickSlipError(f"the demo needs ROS 2 (rclpy): {error}; `make demo` installs it from wheels") from error
    console = console_of_text()
    domain = isolate()
    console.print(f"[dim]ROS domain {domain}, this machine only[/]")
    _compile(console)
    if options.recording:
        return _replay(console, options)
    if options.compensation:
        return _compensate(console, options.out)
    return _cure(console, options.out)


def _compile(console: Console) -> None:
    """Before the joint moves: what came first would be seen late."""
    if is_warm():
        return
    console.print("Compiling, once after installation; every other start takes a second.")
    failure = compile_and_say()
    if failure:
        raise StickSlipError(failure)


@contextmanager
def _two_nodes(console: Console, of_joint: Mapping[str, object]) -> Iterator[DemoListener]:
    """Processes of a simulated joint, with these parameters, and of its monitor; yields the listener to both."""
    from stickslip_ros.cli.demo_log import CONTROLLER, DemoListener

    with (
        NodeProcess("simulated_joint", {"joints": f"[{_JOINT}]", **of_joint}) as simulated,
        NodeProcess("monitor", {**_KNOWN, **_FORGETFUL, "controller": CONTROLLER}) as monitor,
        closing(DemoListener(_JOINT, console, [simulated, monitor], "rad")) as listener,
    ):
        console.print(
            "Two nodes started: [bold]simulated_joint[/] (PUMA 560 joint 1, the paper's friction) and [bold]monitor[/]."
        )
        yield listener


def _cure(console: Console, out: Path) -> int:
    from stickslip_ros.cli.demo_log import draw

    with _two_nodes(console, {"rate": _RATE}) as listener:
        listener.wait_for_nodes(lambda: not math.isnan(listener.now) and listener.value("stiffness [N*m/rad]") != "")
        console.print(
            f"The joint is commanded to move at {listener.value('velocity [rad/s]')} rad/s, "
            f"k_p = {listener.value('stiffness [N*m/rad]')} N·m/rad, "
            f"k_v = {listener.value('damping [N*m*s/rad]')} N·m·s/rad."
        )
        data = listener.data

        def sticks() -> bool:
            judged = bool(data.margins) and not math.isnan(data.margins[-1][RESERVE_FIELD])
            return judged and listener.status == "stick_slip" and len(data.cycles) >= _CYCLES_TO_SEE

        listener.wait(sticks, _STICK_LIMIT, "stick-slip")
        listener.wait(lambda: listener.value("recommendation") != "", _STICK_LIMIT, "advice")
        console.print(
            f"[bold red]Stick-slip[/]: {len(data.cycles)} cycles, the last slip "
            f"{1e3 * data.cycles[-1]['slip_distance']:.2f} mrad after {data.cycles[-1]['dwell']:.2f} s at rest. "
            f"Damping reserve: [red]{_reserve(data)}[/]: so much of the damping that ends stick-slip is "
            "missing."
        )
        console.print(f"Advice: [bold]{listener.value('recommendation')}[/].")
        changed_at, gains_before = listener.now, _gains_heard(listener)
        console.print(
            "Asked to apply it ([bold]~/apply_recommendation[/]), the monitor ramps the gains in small steps while the "
            "joint moves, and watches it. The reserve is of the gains in force; the status follows seconds later."
        )
        for left in reversed(range(_ATTEMPTS)):
            answer = listener.trigger("apply_recommendation", "apply its advice")
            listener.wait(answer.done, _APPLY_LIMIT, "the gains to be applied")
            # What a busy machine cut short may have been enough.
            if answer.result().success or listener.status == "smooth":
                break
            if not left:
                raise StickSlipError(f"not applied: {answer.result().message}")
            # On a busy machine a node may be silent for so long that the monitor stops, as it should.
            console.print(f"[yellow]Not applied[/]: {answer.result().message}. It is asked again.")
        applied = "Applied" if answer.result().success else "Applied in part"
        console.print(f"{applied}: {answer.result().message}.")
        applied_at = listener.now
        smooth_since: list[float] = []

        def smooth_for_long() -> bool:
            if listener.status != "smooth":
                smooth_since.clear()
            elif not smooth_since:
                smooth_since.append(listener.now)
            return bool(smooth_since) and listener.now - smooth_since[0] >= _SMOOTH_TO_SEE

        listener.wait(smooth_for_long, _SMOOTH_LIMIT, "smooth motion")
        late = [cycle for cycle in data.cycles if cycle["arrest"] > smooth_since[0]]
        if late or not data.margins[-1][RESERVE_FIELD] > 0:
            raise StickSlipError(f"not cured: {len(late)} cycles after the change, damping reserve {_reserve(data)}")
        console.print(
            f"[bold green]Smooth[/]: no cycle for {listener.now - smooth_since[0]:.0f} s. "
            f"Damping reserve: [green]{_reserve(data)}[/]{_wanted(data)}."
        )
        halves = (
            _half(data, -math.inf, changed_at, gains_before),
            _half(data, applied_at, math.inf, _gains_heard(listener)),
        )
        between = len(data.cycles) - sum(len(half.cycles) for half in halves)
        console.print(f"Before the ramp and after it ({between} slips while the gains rose are in neither):")
        print_joints(console, [compare_joints(*halves)])
        draw(
            data,
            out,
            title="PUMA 560 joint 1 at 5.8 mrad/s: stick-slip, and its cure",
            marks=[(changed_at, "advised gains set, in steps")],
            unit="rad",
        )
    console.print(f"Picture: [bold]{out}[/]")
    return 0


def _reserve(data: DemoData) -> str:
    return f"{100.0 * data.margins[-1][RESERVE_FIELD]:+.0f} %"


def _wanted(data: DemoData) -> str:
    """Why the advised gains have more damping than the wanted reserve."""
    steady, critical = (data.margins[-1][f"exact_{name}_damping_ratio"] for name in ("steady", "critical"))
    needed = 100.0 * (steady / critical - 1.0)
    return f" (with less than {needed:+.0f} % the speed would swing)" if needed > 0 else ""


def _gains_heard(listener: DemoListener) -> dict[str, object]:
    """The gains that the monitor knows, as parameters."""
    keys = {"p": "stiffness [N*m/rad]", "d": "damping [N*m*s/rad]"}
    return {f"gains.{_JOINT}.{name}": float(listener.value(key)) for name, key in keys.items()}


def _half(data: DemoData, begin: float, end: float, gains: dict[str, object]) -> JointAnalysis:
    """What was heard from one time to another [s], analysed as a recording is."""
    given = {f"model.{_JOINT}": _KNOWN[f"model.{_JOINT}"], "learn": False, **gains}
    joint = JointAnalyzer(_JOINT, Parameters(given), with_traces=False, at_once=1)
    states = [(*row, math.nan) for row in data.states if begin <= row[0] <= end]
    references = [(*row, math.nan) for row in data.references if begin <= row[0] <= end]
    joint.process(np.array(states), np.array(references))
    joint.finish()
    return joint.analysis()


def _replay(console: Console, options: argparse.Namespace) -> int:
    from stickslip_ros.cli.demo_log import START_LIMIT, DemoListener, draw, last_line

    path = find_recording(options.recording)
    recording = load_recording(path)
    batch = recording.batch
    length = float(batch.time[-1] - batch.time[0])
    factor = options.speed if options.speed is not None else max(1.0, length / 30.0)
    with ExitStack() as stack:
        monitor = stack.enter_context(NodeProcess("monitor", {"joints": f"[{_JOINT}]", **_FORGETFUL}))
        listener = DemoListener(_JOINT, console, [monitor], recording.unit)
        stack.callback(listener.close)
        listener.listen(1.0)
        listener.wait_for_nodes(lambda: listener.diagnostic is not None)
        replay = stack.enter_context(NodeProcess("replay", {"recording": path, "joint": _JOINT, "time_factor": factor}))
        console.print(
            f"Replaying [bold]{recording.name}[/]: {len(batch)} samples, {length:.1f} s, {factor:.3g} times as fast."
        )
        seen: dict[str, None] = {}

        def ended() -> bool:
            if listener.data.states:
                seen.setdefault(listener.status)
            return not replay.running

        listener.wait(ended, length / factor + START_LIMIT, "the end of the recording")
        if replay.wait(1.0) != 0 or not listener.data.states:
            raise StickSlipError(f"the recording was not published: {last_line(replay.output())}")
        cycles = listener.data.cycles
        console.print(
            f"Watched to its end: [bold]{len(cycles)} stick-slip cycles[/]; "
            f"statuses on the way: {', '.join(filter(None, seen))}."
        )
        title = f"{recording.name}: {len(cycles)} stick-slip cycles"
        draw(listener.data, options.out, title=title, unit=recording.unit)
    console.print(f"Picture: [bold]{options.out}[/]")
    return 0


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


def _compensate(console: Console, out: Path) -> int:
    """What compensation does to stick-slip and at reversals: feed-forward does nothing against the one, and cures what
    the others cost; feedback of more than the friction makes a joint hunt. StickSlipError unless all three were seen.
    """
    from stickslip_ros.cli.demo_log import draw

    with _two_nodes(console, {}) as listener:
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
