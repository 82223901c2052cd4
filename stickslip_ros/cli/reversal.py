# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip reversal`: what friction does where the motion turns round.

Examples:
    stickslip reversal --model puma560_joint1 --amplitude 0.2 --frequency 0.1
    stickslip reversal --model puma560_joint1 --amplitude 0.2 --frequency 0.1 --triangle --out reversal.png
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.cli.margin import (
    add_conditions,
    add_joint_arguments,
    conditions_from,
    joint_from,
    judged,
    refuse_of_a_rigid_contact,
)
from stickslip_ros.cli.options import (
    PICTURE,
    add_flag,
    add_json,
    add_number,
    add_option,
    refuse_given,
    refuse_without_effect,
)
from stickslip_ros.cli.terminal import console_of_text, new_table, working
from stickslip_ros.cli.trajectory import read_trajectory
from stickslip_ros.errors import StickSlipError
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.reversal import (
    TURN,
    ReferenceMotion,
    Reversal,
    followed,
    reversal_map,
    reversals,
    sampled,
    sine,
    through,
    triangle,
    turning_points,
)
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.output.as_json import json_text
from stickslip_ros.output.plotting import BLUE, GREEN, GREY, ORANGE, RED, Curve, Figure, Panel, save
from stickslip_ros.output.published import number
from stickslip_ros.output.wording import angle_text

_AMPLITUDES = (0.25, 1.0, 4.0)  # times the one that is asked for
_SPEEDS = np.geomspace(0.1, 10.0, 13)  # likewise of the top speed
_MOST_SHOWN = 20
_MILLI = 1e3
_COLOURS = (BLUE, GREEN, ORANGE, RED)
Make = Callable[[float, float, Joint, Gains], ReferenceMotion]
_TOP_SPEED: dict[Make, float] = {sine: 2.0 * math.pi, triangle: 4.0}  # of amplitude times frequency
# Reversals by the reference's amplitude [rad], and by its top speed [rad/s].
Dependences = Mapping[float, Mapping[float, Sequence[Reversal]]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_joint_arguments(parser, velocity=False)
    motion = parser.add_argument_group("the commanded motion: a sine by default")
    add_number(motion, "--amplitude", "A", "amplitude of the motion: half of peak to peak [rad]")
    add_number(motion, "--frequency", "F", "frequency of the motion [Hz]")
    add_flag(motion, "--triangle", "triangle in place of the sine: constant speed 4·A·F to and fro")
    table = "table (CSV, Parquet) of time and position, followed in straight lines"
    add_option(motion, "--trajectory", "FILE", table, type=Path)
    add_conditions(parser, "the controller")
    drawn = "draw the motion, and how the error depends on speed and amplitude"
    add_option(parser, "--out", "FILE.png", drawn, type=PICTURE)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Print what the reversals do; exit status 0."""
    given = joint_from(options)
    joint, gains = given.joint, given.gains
    _refuse(options, joint, gains)
    conditions = conditions_from(options)
    reference, words, make = _reference(options, joint, gains)
    with working("integrating"):
        found = reversals(joint, gains, reference, conditions)
        if not found:
            raise StickSlipError(f"{words} {_why_none(reference)}")
        dependences: Dependences = {}
        if make is not None and options.out is not None:
            dependences = _dependences(options, make, joint, gains, conditions)
    if options.json:
        print(json_text({"reversals": [_as_json(turn) for turn in found]}))
    else:
        _print(found, words, joint, gains)
    if options.out is not None:
        reference = sampled(reference, joint, gains, conditions)  # as the reversals are of
        position = followed(joint, gains, reference, conditions).position
        subject = f"{options.model or 'The joint'}, {words}"
        figure = _figure(subject, reference, position, found, dependences, name=options.out.stem)
        for path in save(figure, options.out.parent):
            if not options.json:
                print(path)
    return 0


def _refuse(options: argparse.Namespace, joint: Joint, gains: Gains) -> None:
    """What would be guessed, or have no effect."""
    if options.coulomb is None and joint.friction.coulomb == 0:
        raise StickSlipError(
            "missing: --coulomb [N·m], on which reversals depend; 0 only if the joint has no Coulomb friction"
        )
    needs = "--amplitude and --frequency, not a --trajectory"
    refuse_without_effect(options, "triangle", met=options.trajectory is None, needs=needs)
    refuse_of_a_rigid_contact(options, joint.friction)


def _why_none(reference: ReferenceMotion) -> str:
    if turning_points(reference.position, TURN * float(np.ptp(reference.position))):
        return "turns round, but so quickly that no turn takes three periods of the controller"
    return "does not turn round"


def _reference(options: argparse.Namespace, joint: Joint, gains: Gains) -> tuple[ReferenceMotion, str, Make | None]:
    """The reference, its name, and how others of its kind are made; None if it is a trajectory of the user's own."""
    if options.trajectory is not None:
        refuse_given(options, {"amplitude": None, "frequency": None}, "left out where there is a --trajectory")
        given = read_trajectory(options.trajectory)
        return through(given.time, given.position, joint, gains), f"the trajectory of {options.trajectory}", None
    for name in ("amplitude", "frequency"):
        if getattr(options, name) is None:
            raise StickSlipError(f"missing: --{name}, or a --trajectory")
    make: Make = triangle if options.triangle else sine
    kind = "triangle" if options.triangle else "sine"
    reference = make(options.amplitude, options.frequency, joint, gains)
    speed = _TOP_SPEED[make] * options.amplitude * options.frequency
    return (
        reference,
        f"a {kind} of ±{options.amplitude:g} rad at {options.frequency:g} Hz (up to {speed:.3g} rad/s)",
        make,
    )


def _dependences(
    options: argparse.Namespace, make: Make, joint: Joint, gains: Gains, conditions: OperatingConditions
) -> Dependences:
    speeds = (_TOP_SPEED[make] * options.amplitude * options.frequency * _SPEEDS).tolist()
    found = {}
    for amplitude in (factor * options.amplitude for factor in _AMPLITUDES):
        references = [make(amplitude, speed / (_TOP_SPEED[make] * amplitude), joint, gains) for speed in speeds]
        turns = reversal_map(joint, gains, references, conditions, workers=os.cpu_count() or 1)
        found[amplitude] = dict(zip(speeds, turns, strict=True))
    return found


def _as_json(turn: Reversal) -> dict[str, Any]:
    return {name: value if isinstance(value, int) else number(value) for name, value in asdict(turn).items()}


def _print(found: Sequence[Reversal], words: str, joint: Joint, gains: Gains) -> None:
    console = console_of_text()
    console.print(f"[dim]{judged(joint, gains, coulomb=True)}[/]")
    worst = max(found, key=lambda turn: turn.peak_error)
    console.print(f"Where {words} turns round, the joint {_in_words(worst)}")
    headings = "turns\nat", "stands", "lost\nmotion", "peak\nerror", "steady\nerror", "further\nstops"
    table = new_table((*headings, "follows\nagain after"), padding=(0, 1))
    for turn in found[:_MOST_SHOWN]:
        table.add_row(
            f"{turn.time:.3f} s", _seconds(turn.standing), _milli(turn.lost_motion), _milli(turn.peak_error),
            _milli(turn.running_error), str(turn.stops), _seconds(turn.settles_after),
        )  # fmt: skip
    console.print(table)
    console.print(
        "[dim]Turns at: time of the reversal; lost motion: distance that the reference moves before the joint follows; "
        "peak error: largest tracking error until the next reversal; steady error: the usual error before the next "
        "reversal; further stops: after the first one; follows again after: time until the last stop ends.[/]"
    )
    if len(found) > _MOST_SHOWN:
        console.print(f"[dim]{len(found) - _MOST_SHOWN} more; --json has all.[/]")


def _in_words(turn: Reversal) -> str:
    if not math.isfinite(turn.standing):
        return "[red]does not move at all[/] before the reference turns again."
    stands = f"stands for {turn.standing:.3g} s" if turn.standing > 0 else "does not stop"
    then = "then moves without another stop" if turn.stops == 0 else f"[red]then stops {turn.stops} times more[/]"
    return f"{stands}, falls behind by up to {_milli(turn.peak_error)}, {then}."


def _seconds(value: float) -> str:
    return f"{value:.3f} s" if math.isfinite(value) else "never moves"


def _milli(value: float) -> str:
    return angle_text(value) if math.isfinite(value) else "-"


def _figure(
    subject: str,
    reference: ReferenceMotion,
    position: FloatArray,
    turns: Sequence[Reversal],
    dependences: Dependences,
    *,
    name: str,
) -> Figure:
    """Three panels: the motion round the last reversal, its following error, and both against speed and amplitude.

    Parameters
    ----------
    position : at the end of each of the reference's periods [rad]. turns : at least one.
    """
    turn = turns[-1]
    times = reference.period * np.arange(1.0, len(reference.position))
    begin, end = _window(turn, turns, float(times[-1]))
    shown = (times >= begin) & (times <= end)
    since = times[shown] - turn.time
    wanted, real = reference.position[1:][shown], position[shown]
    origin = float(np.interp(turn.time, times, reference.position[1:]))
    where = "a rest"
    motion = [
        Curve(label="reference", x=since, y=_MILLI * (wanted - origin), colour=GREY, style="--"),
        Curve(label="joint", x=since, y=_MILLI * (real - origin), colour=RED),
    ]
    if math.isfinite(turn.standing):
        where = f"stands {turn.standing:.3g} s, then moves"
    error = [Curve(label="", x=since, y=_MILLI * (wanted - real), colour=RED)]
    panels = [
        Panel(
            x_label="time since the reference turned [s]", y_label="position [mrad]", curves=tuple(motion),
            title=f"The joint {where}",
        ),
        Panel(
            x_label="time since the reference turned [s]", y_label="following error [mrad]", curves=tuple(error),
            title=f"It falls behind by {angle_text(turn.peak_error)}",
        ),
    ]  # fmt: skip
    if dependences:
        panels += [
            _against_speed("largest error [mrad]", "The error, by amplitude", dependences, "peak_error", _MILLI),
            _against_speed("stands for [s]", "The stop, by amplitude", dependences, "standing", 1.0),
        ]
    return Figure(name=name, title=subject, note="By integration of Eqs (4)-(6).", panels=tuple(panels))


def _window(turn: Reversal, turns: Sequence[Reversal], last: float) -> tuple[float, float]:
    """What is shown round a reversal [s]."""
    half = turn.time - turns[-2].time if len(turns) > 1 else last - turn.time
    ahead = min(half, 4.0 * turn.settles_after + 0.1 * half) if math.isfinite(turn.settles_after) else half
    back = min(half, max(0.5 * ahead, turn.standing if math.isfinite(turn.standing) else 0.0))
    return turn.time - back, min(turn.time + ahead, last)


def _against_speed(label: str, title: str, dependences: Dependences, of: str, scale: float) -> Panel:
    """The worst reversal over the top speed, a curve for each amplitude."""
    curves = []
    for (amplitude, turns), colour in zip(dependences.items(), _COLOURS, strict=False):
        worst = [max((getattr(turn, of) for turn in found), default=math.nan) for found in turns.values()]
        values = scale * np.array(worst)
        curves.append(
            Curve(
                label=f"±{_MILLI * amplitude:.3g} mrad", x=_MILLI * np.array(list(turns)),
                y=np.where(np.isfinite(values) & (values > 0), values, np.nan), colour=colour,
            )
        )  # fmt: skip
    return Panel(
        x_label="top speed of the reference [mrad/s]", y_label=label, curves=tuple(curves), title=title,
        logarithmic=True,
    )  # fmt: skip
