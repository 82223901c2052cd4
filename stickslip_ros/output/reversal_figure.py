# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What a reversal looks like, and how it changes with speed and amplitude."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.reversal import ReferenceMotion, Reversal
from stickslip_ros.output.plotting import BLUE, GREEN, GREY, ORANGE, RED, Curve, Figure, Panel
from stickslip_ros.output.wording import with_prefix

FloatArray = NDArray[np.float64]

_MILLI = 1e3
_COLOURS = (BLUE, GREEN, ORANGE, RED)


# Reversals by the reference's amplitude [rad], and by its top speed [rad/s].
Dependences = Mapping[float, Mapping[float, Sequence[Reversal]]]


def reversal_figure(
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
            title=f"It falls behind by {with_prefix(turn.peak_error, 'rad')}",
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
