# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What friction compensation would buy, beside the gains that `stickslip recommend` advises; and as what to take it."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from stickslip_ros.cli.terminal import console_of_text, new_table
from stickslip_ros.files import write_whole
from stickslip_ros.model.compensation import Compensation
from stickslip_ros.model.compensation_effect import (
    SHARES,
    CompensationEffect,
    compensation_effect,
    largest_harmless_share,
)
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.monitoring.advice.compensations import At
from stickslip_ros.output.csv_table import write_csv
from stickslip_ros.output.published import number, numbers
from stickslip_ros.output.wording import OUTCOME_WORDS

_NEXT_TO_NOTHING = 1e-12  # [rad]: rounding
_SPEEDS = np.geomspace(0.01, 300.0, 46)  # Stribeck velocities of the feed-forward table


@dataclass(frozen=True, kw_only=True)
class CompensationTable:
    """What compensation does to one joint with given gains.

    Attributes
    ----------
    gains : with which. effects : by kind and share. harmless : the largest harmless share, by kind.
    """

    gains: Gains
    effects: Mapping[str, Mapping[float, CompensationEffect]]
    harmless: Mapping[str, float]

    def as_json(self) -> dict[str, Any]:
        """For JSON; null for what is not known."""
        return {
            "stiffness": float(self.gains.stiffness),
            "damping": float(self.gains.damping),
            "kinds": {
                kind: {
                    "largest_harmless_share": number(self.harmless[kind]),
                    "shares": [_effect_json(share, effect) for share, effect in effects.items()],
                }
                for kind, effects in self.effects.items()
            },
        }


def compensation_table(
    joint: Joint, gains: Gains, velocity: float, conditions: OperatingConditions, kinds: Mapping[str, At]
) -> CompensationTable:
    """Every kind at every share, the kinds beside each other: the integration holds no lock of Python's.

    Ten seconds on two cores; half a minute of a soft joint that moves slowly.
    """
    without = compensation_effect(joint, gains, velocity, conditions)

    def effects(at: At) -> dict[float, CompensationEffect]:
        return {
            share: compensation_effect(joint, gains, velocity, replace(conditions, compensation=at(share)))
            if share > 0
            else without
            for share in SHARES
        }

    def harmless(at: At) -> float:
        return largest_harmless_share(joint, gains, velocity, conditions, at, without)

    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        limits = {kind: pool.submit(harmless, at) for kind, at in kinds.items()}
        found = {kind: pool.submit(effects, at) for kind, at in kinds.items()}
        return CompensationTable(
            gains=gains,
            effects={kind: one.result() for kind, one in found.items()},
            harmless={kind: one.result() for kind, one in limits.items()},
        )


def print_table(found: CompensationTable, velocity: float) -> None:
    """For a person: first in words, then every number."""
    console = console_of_text()
    console.print(
        f"Compensation at {velocity:.4g} rad/s, with k_p {float(found.gains.stiffness):.4g} and "
        f"k_v {float(found.gains.damping):.4g}:"
    )
    headings = ("", "share", "model predicts", "ρ_c", "error", "swing", "at rest", "turning")
    table = new_table(headings, ("", "model predicts"), padding=(0, 1))
    for kind, effects in found.effects.items():
        for share, one in effects.items():
            if share == 0 and kind != next(iter(found.effects)):
                continue
            table.add_row(
                "[dim]none" if share == 0 else kind, f"{share:g}",
                _outcome(one),
                "-" if math.isnan(one.critical_damping_ratio) else f"{one.critical_damping_ratio:.2f}",
                *map(_milli, (one.steady_error, one.swing, one.standing_swing, one.peak_error)),
            )  # fmt: skip
    console.print(table)
    console.print(
        "[dim]Feed-forward compensates by the commanded speed, feedback by the measured speed, push by the sign of the "
        "tracking error, dither by shaking the joint. Share: of the friction that is compensated. ρ_c: damping ratio "
        "above which stick-slip ends. In mrad: error: tracking error at constant speed; swing: of that error; at rest: "
        "swing while the reference stands; turning: largest error where the reference turns round. Dither stops and "
        "starts the joint all the time: prediction and ρ_c then compare the motion at equal phases of the dither.[/]"
    )
    for text in _missing(found):
        console.print(f"[dim]{text}[/]")
    for kind, share in found.harmless.items():
        limit = "does harm at any share" if share < 0.1 else f"does no harm up to {share:.1f} times the friction"
        console.print(f"{kind.capitalize()} {limit}.")


def _outcome(effect: CompensationEffect) -> str:
    if effect.unstable:
        return "is unstable"
    return "-" if effect.outcome is None else OUTCOME_WORDS[effect.outcome.value]


def _missing(found: CompensationTable) -> list[str]:
    """Why a verdict or a ρ_c is not there, each reason once."""
    notes = [
        f"{kind}: {one.reason}." if one.outcome is None else f"{kind}: no damping ratio up to 20 ends stick-slip."
        for kind, effects in found.effects.items()
        for share, one in effects.items()
        if share > 0 and (one.outcome is None or math.isnan(one.critical_damping_ratio))
    ]
    return list(dict.fromkeys(notes))


def _milli(value: float) -> str:
    """A length in thousandths, in so many digits that small ones are not 0; "-" for none."""
    return "-" if math.isnan(value) else f"{1e3 * value:.3g}" if abs(value) >= _NEXT_TO_NOTHING else "0"


def write_feedforward(path: Path, friction: Friction) -> None:
    """The feed-forward as a table of torque over the reference's speed, CSV or YAML by the ending.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    one_way = float(friction.stribeck_velocity) * _SPEEDS
    speeds = np.concatenate([-one_way[::-1], [0.0], one_way])
    torques = np.asarray(Compensation(friction=friction, feedforward=1.0).feedforward_torque(speeds), dtype=float)
    if path.suffix == ".csv":
        rows = [[f"{speed:.6g}", f"{torque:.6g}"] for speed, torque in zip(speeds, torques, strict=True)]
        write_csv(path, [["velocity_rad_s", "torque_nm"], *rows])
        return
    content = {
        "friction_feedforward": {
            "velocity": [float(f"{speed:.6g}") for speed in speeds],
            "torque": [float(f"{torque:.6g}") for torque in torques],
        }
    }
    write_whole(path, "# rad/s, N*m\n" + yaml.safe_dump(content, default_flow_style=None, width=110))


def _effect_json(share: float, effect: CompensationEffect) -> dict[str, Any]:
    turn = effect.reversal
    return {
        "share": share,
        "outcome": None if effect.outcome is None else effect.outcome.value,
        "unstable": effect.unstable,
        "reason": effect.reason,
        **numbers(effect, "critical_damping_ratio", "steady_error", "swing", "standing_swing"),
        "reversal_peak_error": number(effect.peak_error),
        "reversal_standing": None if turn is None else number(turn.standing),
    }
