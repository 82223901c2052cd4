# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip margin`: is this joint smooth at this speed, and by how much?"""

from __future__ import annotations

import argparse
import json
import math
from typing import Any

from rich.console import Console
from rich.table import Table

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model._friction_law import LAWS, PAPERS_LAW
from stickslip_ros.model.controlled import OperatingConditions
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.friction_parameters import FRICTION_PARAMETERS
from stickslip_ros.model.margin import change_factors
from stickslip_ros.model.units import unit_of
from stickslip_ros.output.as_json import margin_json
from stickslip_ros.settings.known_joints import KnownJoint, load_joint

# What is needed comes first, what cancels last.
_FRICTION = sorted(FRICTION_PARAMETERS, key=lambda one: (one.name == "coulomb", one.name == "viscous"))
_NOTES = {"coulomb": "; cancels from the result"}
_LAW = "how Stribeck friction falls with speed (default: the joint's, or the paper's hess_soom)"
_REQUIRED = ("stribeck", "stribeck_velocity")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_joint_arguments(parser)
    beyond = parser.add_argument_group("beyond the paper, for the exact verdict")
    beyond.add_argument("--load", type=float, metavar="T", default=0.0, help="constant torque [N·m] (default 0)")
    beyond.add_argument(
        "--controller-period", type=float, metavar="S", default=0.0, help="of a sampled controller [s] (default: none)"
    )
    beyond.add_argument(
        "--control-delay", action="store_true", help="the effort takes effect one controller period late"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")


def add_joint_arguments(parser: argparse.ArgumentParser) -> None:
    """Options that name a joint, its gains and its speed; read by :func:`joint_from`."""
    parser.add_argument(
        "--joint",
        metavar="NAME",
        help="known joint (config/joints) or path of a joint file; other options override its values",
    )
    parser.add_argument("--inertia", type=float, metavar="M", help=f"inertia [{unit_of(Joint, 'inertia')}]")
    parser.add_argument("--stiffness", type=float, metavar="KP", help=f"k_p [{unit_of(Gains, 'stiffness')}]")
    parser.add_argument("--damping", type=float, metavar="KV", help=f"k_v [{unit_of(Gains, 'damping')}] (default 0)")
    parser.add_argument("--integral", type=float, metavar="KI", help=f"k_i [{unit_of(Gains, 'integral')}] (default 0)")
    parser.add_argument("--velocity", type=float, metavar="V", help="commanded velocity [rad/s]")
    for one in _FRICTION:
        text = f"{one.help} [{one.unit}]{_NOTES.get(one.name, '')}"
        parser.add_argument(f"--{one.name.replace('_', '-')}", type=float, metavar="X", help=text)
    parser.add_argument("--law", choices=list(LAWS), help=_LAW)


def run(options: argparse.Namespace) -> int:
    """Print the margin; exit status 0 whatever the verdict."""
    joint, gains, velocity = joint_from(options)
    conditions = OperatingConditions(
        load=options.load, controller_period=options.controller_period, control_delay=options.control_delay
    )
    with Console(stderr=True).status("integrating (after installation this compiles for ten seconds)"):
        result = margin_json(joint, gains, velocity, conditions)
    if options.json:
        print(json.dumps(result, ensure_ascii=False))
    else:
        _print(result, joint, gains, velocity)
    return 0


def joint_from(options: argparse.Namespace) -> tuple[Joint, Gains, float]:
    """The joint, gains and velocity that the options give.

    Raises
    ------
    StickSlipError
        If something is missing or cannot be; the text names the option.
    """
    known: KnownJoint | None = load_joint(options.joint) if options.joint else None

    def value(name: str, fallback: Any) -> float:
        given = getattr(options, name)
        if given is None:
            given = fallback
        if given is None:
            raise InvalidParameterError(f"--{name.replace('_', '-')}", "given, or a --joint that has it", None)
        if not math.isfinite(given):
            raise InvalidParameterError(f"--{name.replace('_', '-')}", "a finite number", given)
        return float(given)

    friction = {
        name: value(name, getattr(known.joint.friction, name) if known else (None if name in _REQUIRED else 0.0))
        for name in (one.name for one in _FRICTION)
    }
    law = options.law or (known.joint.friction.law if known else PAPERS_LAW)
    joint = Joint(
        inertia=value("inertia", known.joint.inertia if known else None), friction=Friction(**friction, law=law)
    )
    gains = Gains(
        stiffness=value("stiffness", known.gains.stiffness if known else None),
        damping=value("damping", known.gains.damping if known else 0.0),
        integral=value("integral", known.gains.integral if known else 0.0),
    )
    return joint, gains, value("velocity", known.velocity if known else None)


def _print(result: dict[str, Any], joint: Joint, gains: Gains, velocity: float) -> None:
    console = Console(highlight=False, soft_wrap=True)
    if not result["applicable"]:
        console.print(f"[yellow]Eq. (43) is {result['reason']}[/]")
        _print_exact(console, result["exact"])
        return
    verdict = "[green]smooth[/]" if result["smooth"] else "[red]stick slip[/]"
    console.print(f"At {velocity:g} rad/s Eq. (43) predicts {verdict}.")
    table = Table(show_header=False, box=None, padding=(0, 2))
    rows = (
        ("energy margin", "energy_margin", "M·x˙_s²", "positive means smooth"),
        ("damping ratio", "damping_ratio", "", "ρ, controller and viscous friction together"),
        ("critical damping ratio", "critical_damping_ratio", "", "ρ at which the margin is zero"),
        ("reduction factor", "reduction_factor", "", "h of Eq. (32)"),
        ("steady Stribeck friction", "steady_stribeck", "N·m", "F_s,ss of Eq. (39)"),
        ("lowest smooth velocity", "lowest_smooth_velocity", "rad/s", "smooth at this and every higher speed"),
    )
    for label, key, unit, note in rows:
        value = "none" if result[key] is None else f"{result[key]:.4g}"
        table.add_row(label, value, unit, f"[dim]{note}[/]")
    console.print(table)
    _print_exact(console, result["exact"])
    factors = change_factors(joint, gains, velocity)
    words = {"stiffness": "stiffness", "damping": "damping", "velocity": "speed"}
    parts = [
        f"{words[name]} × {float(value):.3g}"
        for name, value in factors.items()
        if math.isfinite(float(value)) and float(value) > 0
    ]
    if parts:
        console.print(f"By Eq. (43) the verdict changes at {', or '.join(parts)}.")


def _print_exact(console: Console, exact: dict[str, Any]) -> None:
    if exact["smooth"] is None:
        console.print(f"[yellow]Integrated exactly: {exact['reason']}[/]")
        return
    word = "[green]smooth[/]" if exact["smooth"] else "[red]stick slip[/]"
    if exact["reason"]:
        word += f" ({exact['reason']})"
    details = [
        f"{label} {exact[key]:.4g}{unit}"
        for label, key, unit in (
            ("critical damping ratio", "critical_damping_ratio", ""),
            ("lowest smooth velocity", "lowest_smooth_velocity", " rad/s"),
            ("least smooth stiffness", "least_smooth_stiffness", " N·m/rad"),
        )
        if exact[key] is not None
    ]
    console.print("; ".join([f"Integrated exactly: {word}", *details]) + ".")
