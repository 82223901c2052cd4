# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip margin`: does this joint move smoothly at this speed, and by what margin?

Examples:
    stickslip margin --model puma560_joint1 --velocity 0.003
    stickslip margin --inertia 6.3 --stiffness 630 --velocity 0.005 --stribeck 1.6 --stribeck-velocity 0.0058
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from stickslip_ros.cli.options import add_flag, add_json, add_number, add_option, option_of, refuse_without_effect
from stickslip_ros.cli.terminal import console_of_tables, console_of_text, fitting_table, number_text, working
from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.model._friction_law import CONTACTS, ELASTO_PLASTIC, LAWS, PAPERS_LAW
from stickslip_ros.model._validation import require_not_negative
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import (
    FRICTION_PARAMETERS,
    PRESLIDING_PARAMETERS,
    Friction,
    Gains,
    Joint,
    Transmission,
)
from stickslip_ros.model.hunting import hunting, largest_non_hunting_integral, least_quiet_stiffness
from stickslip_ros.model.margin import change_factors
from stickslip_ros.model.outcome import Outcome
from stickslip_ros.model.transmission import SIDES
from stickslip_ros.model.units import unit_of
from stickslip_ros.model.verdict import HUNTING
from stickslip_ros.output.as_json import json_text, margin_json
from stickslip_ros.output.published import number, numbers
from stickslip_ros.output.wording import OUTCOME_WORDS, angle_text
from stickslip_ros.settings.known_joints import KnownJoint, load_joint

# What is needed comes first, what cancels last.
_FRICTION = [
    *sorted(FRICTION_PARAMETERS, key=lambda one: (one.name == "coulomb", one.name == "viscous")),
    *PRESLIDING_PARAMETERS,
]
_NOTES = {"coulomb": "; it matters for hunting, reversals, compensation and two masses only"}
_CONTACT = "how a contact of finite presliding stiffness yields (default: the joint's, or elasto_plastic)"
_SPRING = {
    "resonance": "frequency at which motor and load swing on the spring between them (default: they are rigid)",
    "antiresonance": "frequency at which the load swings while the motor is held",
    "spring_damping": f"damping ratio of the load on that spring (default: {Transmission.spring_damping})",
}
_LAW = "how Stribeck friction falls with speed (default: the joint's, or the paper's hess_soom)"
_REQUIRED = ("inertia", "stiffness", "velocity", "stribeck", "stribeck_velocity")
# Of what may be left out where no model is given.
_DEFAULTS: Mapping[str, Any] = {
    **dict.fromkeys(("damping", "integral", *(one.name for one in _FRICTION)), 0.0),
    "presliding_stiffness": math.inf, "law": PAPERS_LAW, "contact": ELASTO_PLASTIC,
}  # fmt: skip
_WORTH_TELLING = 1e3  # a factor on a gain or the speed that somebody might set
_FASTEST = 1e4  # [rad/s]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_joint_arguments(parser)
    add_conditions(parser, "load and sampled control")
    add_json(parser)


def add_conditions(parser: argparse.ArgumentParser, title: str) -> None:
    """Options of load and sampled control; read by :func:`conditions_from`."""
    beyond = parser.add_argument_group(title)
    add_number(beyond, "--load", "T", "constant torque [N·m]", 0.0)
    add_number(beyond, "--controller-period", "S", "period of a sampled controller [s]; 0: a continuous one", 0.0)
    add_flag(beyond, "--control-delay", "the effort takes effect one controller period late")


def conditions_from(options: argparse.Namespace) -> OperatingConditions:
    """Load and sampled control that the options give."""
    return OperatingConditions(
        load=options.load, controller_period=options.controller_period, control_delay=options.control_delay
    )


def add_joint_arguments(parser: argparse.ArgumentParser, *, velocity: bool = True) -> None:
    """Options that name a joint, its gains and, if wanted, its speed; read by :func:`joint_from`."""
    model = "known joint (config/joints), or path of a joint file; other options override its values"
    add_option(parser, "--model", "NAME", model)
    add_number(parser, "--inertia", "M", f"inertia [{unit_of(Joint, 'inertia')}]")
    add_number(parser, "--stiffness", "KP", f"k_p [{unit_of(Gains, 'stiffness')}]")
    add_number(parser, "--damping", "KV", f"k_v [{unit_of(Gains, 'damping')}] (default: 0)")
    add_number(parser, "--integral", "KI", f"k_i [{unit_of(Gains, 'integral')}] (default: 0)")
    if velocity:
        add_number(parser, "--velocity", "V", "commanded velocity [rad/s]")
    else:
        parser.set_defaults(velocity=0.0)
    for one in _FRICTION:
        text = f"{one.help} [{one.unit}]{_NOTES.get(one.name, '')}"
        add_number(parser, option_of(one.name), "X", text)
    parser.add_argument("--law", choices=list(LAWS), help=_LAW)
    parser.add_argument("--contact", choices=list(CONTACTS), help=_CONTACT)
    for name, text in _SPRING.items():
        add_number(parser, option_of(name), "X", f"{text} [{unit_of(Transmission, name)}]")
    parser.add_argument(
        "--encoder", choices=SIDES, help=f"side of that spring that is measured (default: {Transmission.encoder})"
    )


def run(options: argparse.Namespace) -> int:
    """Print the margin; exit status 0 whatever the verdict."""
    given = joint_from(options)
    joint, gains, velocity = given.joint, given.gains, given.velocity
    conditions = conditions_from(options)
    with working("integrating"):
        result = margin_json(joint, gains, velocity, conditions)
        if result["exact"]["reason"] == HUNTING:
            result["hunting"] = _hunting(joint, gains, conditions)
        if (
            velocity == 0
            and gains.integral != 0
            and not joint.friction.rigid
            and result["exact"]["outcome"] is not None
        ):
            result["rigid_contact"] = _on_a_rigid_contact(joint, gains, conditions)
    if options.json:
        print(json_text(result))
    else:
        _print(result, joint, gains, velocity)
    return 0 if result["applicable"] or result["exact"]["outcome"] is not None else 1


def joint_from(options: argparse.Namespace) -> KnownJoint:
    """The joint that the options give, with its gains and a velocity: the known one, with other values.

    Raises
    ------
    StickSlipError
        If something is missing or cannot be; the text names the option.
    """
    known = load_joint(options.model) if options.model else None
    if known is not None:
        usual: Mapping[str, Any] = {
            **vars(known),
            **vars(known.joint),
            **vars(known.joint.friction),
            **vars(known.gains),
        }
    else:
        usual = _DEFAULTS
        missing = [name for name in _REQUIRED if getattr(options, name) is None]
        if missing:
            raise StickSlipError(f"missing: {', '.join(map(option_of, missing))}, or a --model that has them")

    def value(name: str) -> float:
        given = getattr(options, name)
        if given is None:
            return float(usual[name])
        # Only what is infinite by default may be.
        if not math.isfinite(given) and given != _DEFAULTS.get(name):
            raise InvalidParameterError(option_of(name), "a finite number", given)
        return float(given)

    friction: dict[str, Any] = {one.name: value(one.name) for one in _FRICTION}
    friction |= {name: getattr(options, name) or usual[name] for name in ("law", "contact")}
    joint = Joint(inertia=value("inertia"), friction=Friction(**friction), transmission=_transmission(options, known))
    gains = Gains(**{name: value(name) for name in ("stiffness", "damping", "integral")})
    # With another sign it drives the joint away from where it ought to be, however slowly.
    require_not_negative("integral", gains.integral)
    velocity = value("velocity")
    if abs(velocity) > _FASTEST:
        raise InvalidParameterError("--velocity", f"at most {_FASTEST:g} rad/s", velocity)
    if known is None:
        return KnownJoint(name="joint", joint=joint, gains=gains, velocity=velocity)
    return replace(known, name=options.model, joint=joint, gains=gains, velocity=velocity)


def _transmission(options: argparse.Namespace, known: KnownJoint | None) -> Transmission | None:
    before = None if known is None else known.joint.transmission
    values = {name: getattr(options, name) for name in (*_SPRING, "encoder") if getattr(options, name) is not None}
    met = before is not None or {"resonance", "antiresonance"} <= set(values)
    needs = "--resonance and --antiresonance, or a --model that has them"
    refuse_without_effect(options, *values, met=met, needs=needs)
    return Transmission.given({**({} if before is None else vars(before)), **values})


def refuse_of_a_rigid_contact(options: argparse.Namespace, friction: Friction) -> None:
    """Refuse what a rigid contact has not: it has no damping, and does not yield."""
    needs = "a finite --presliding-stiffness, or a --model that has one"
    refuse_without_effect(options, "contact", "presliding_damping", met=not friction.rigid, needs=needs)


def _hunting(joint: Joint, gains: Gains, conditions: OperatingConditions) -> dict[str, Any]:
    """How it hunts, and which gains would not; null where none of those that are tried do not."""
    found = hunting(joint, gains, conditions)
    return {
        **numbers(found, "period", "amplitude"),
        "starts": list(found.starts),
        "unstable": list(found.unstable),
        "largest_quiet_integral": number(largest_non_hunting_integral(joint, gains, conditions)) or None,
        "least_quiet_stiffness": number(least_quiet_stiffness(joint, gains, conditions)),
    }


def _on_a_rigid_contact(joint: Joint, gains: Gains, conditions: OperatingConditions) -> dict[str, Any]:
    """What the same joint would do if a contact did not give way, which is the paper's law."""
    rigid = replace(joint, friction=replace(joint.friction, presliding_stiffness=math.inf, presliding_damping=0.0))
    found = hunting(rigid, gains, conditions)
    return {
        "hunts": found.hunts,
        "unstable": bool(found.unstable),
        **numbers(found, "period", "amplitude"),
        "starts": list(found.starts),
    }


def _rigid_in_words(found: dict[str, Any], *, hunts: bool) -> str:
    """What presliding does to it, beside a rigid contact."""
    if found["unstable"]:
        return "With a rigid contact its motion would grow without end."
    if found["hunts"] is None:
        return "What it would do with a rigid contact cannot be followed."
    if not found["hunts"]:
        return f"With a rigid contact it would {'settle: presliding makes it hunt' if hunts else 'settle too'}."
    text = f"With a rigid contact it would hunt{' too' if hunts else ''}, by ±{angle_text(found['amplitude'])}"
    return f"{text}." if hunts else f"{text}: presliding lets it settle."


def _hunts_in_words(found: dict[str, Any]) -> str:
    text = "It hunts"
    if found["amplitude"] is not None and found["period"] is not None:
        text += f" by ±{angle_text(found['amplitude'])}, once in {found['period']:.3g} s"
    integral, stiffness = found["largest_quiet_integral"], found["least_quiet_stiffness"]
    less = (
        "no k_i down to a thousandth of the present one ends that"
        if integral is None
        else f"with k_i up to {integral:.3g} it does not"
    )
    more = (
        "no k_p up to a thousand times the present one does"
        if stiffness is None
        else f"with k_p from {stiffness:.3g} it does not"
    )
    text = f"{text}; {less}, {more}."
    if found["unstable"]:
        text += (
            f" From {min(found['unstable']):g} times as far off as static friction holds, its motion grows without end."
        )
    return text


def _print(result: dict[str, Any], joint: Joint, gains: Gains, velocity: float) -> None:
    console = console_of_text()
    console.print(f"[dim]{judged(joint, gains)}[/]")
    exact = result["exact"]
    if exact["outcome"] is None:
        console.print(f"[yellow]The model gives {exact['reason']}.[/]")
    else:
        does = OUTCOME_WORDS[exact["outcome"]]
        if velocity == 0 and exact["outcome"] == Outcome.STEADY.value:
            does = "comes to rest"
        text = f"At {velocity:g} rad/s the joint {does}, as the model predicts by integration of Eqs (4)-(6)"
        if exact["reason"]:
            text += f" ({exact['reason']})"
        console.print(f"{text}.")
        if exact["depends_on_start"]:
            console.print("[yellow]The outcome depends on how the joint starts; this is for the worst start.[/]")
    if "hunting" in result:
        console.print(_hunts_in_words(result["hunting"]))
    if "rigid_contact" in result:
        console.print(_rigid_in_words(result["rigid_contact"], hunts="hunting" in result))
    if not result["applicable"]:
        console.print(f"[yellow]Eq. (43) is {result['reason']}.[/]")
    if result["applicable"] or exact["critical_damping_ratio"] is not None:
        _print_side_by_side(result)
    if not result["applicable"]:
        return
    factors = change_factors(joint, gains, velocity)
    words = {"stiffness": "stiffness", "damping": "damping", "velocity": "speed"}
    parts = [
        f"{words[name]} × {float(value):.3g}"
        for name, value in factors.items()
        if 1.0 / _WORTH_TELLING < float(value) < _WORTH_TELLING
    ]
    if parts:
        console.print(f"[dim]The verdict of Eq. (43), the paper's approximation, changes at {', or '.join(parts)}.[/]")


def judged(joint: Joint, gains: Gains, *, coulomb: bool = False) -> str:
    """What the verdict is on, in the order of Eqs (1)-(6); Coulomb friction where it matters."""
    friction = joint.friction
    parts = [
        f"M {float(joint.inertia):.4g} kg·m²",
        f"k_p {float(gains.stiffness):.4g} N·m/rad",
        f"k_v {float(gains.damping):.4g} N·m·s/rad",
        *([f"k_i {float(gains.integral):.4g} N·m/(rad·s)"] if gains.integral else []),
        *([f"Coulomb friction {float(friction.coulomb):.4g} N·m"] if coulomb or joint.transmission else []),
        f"Stribeck friction {float(friction.stribeck):.4g} N·m at {float(friction.stribeck_velocity):.4g} rad/s",
        f"lag {float(friction.lag):.4g} s",
        f"rise time {float(friction.rise_time):.4g} s",
        f"viscous {float(friction.viscous):.4g} N·m·s/rad",
        *([] if friction.rigid else [f"presliding stiffness {float(friction.presliding_stiffness):.4g} N·m/rad"]),
        *([] if joint.transmission is None else [joint.transmission.in_words]),
        *([] if friction.of_the_paper else [f"law {friction.law_in_words}"]),
    ]
    return f"Joint: {', '.join(parts)}."


def _print_side_by_side(result: dict[str, Any]) -> None:
    """The prediction and Eq. (43); a narrow terminal has no room for what the numbers mean."""
    exact = result["exact"]
    console = console_of_tables()

    def number(value: float | None, unit: str = "") -> str:
        return number_text(value, ".4g", unit)

    paper = {True: "[green]smooth[/]", False: "[red]stick-slip[/]", None: "-"}[result["smooth"]]
    outcome = "-" if exact["outcome"] is None else OUTCOME_WORDS[exact["outcome"]]
    headings = ("", "model predicts", "Eq. (43)", "meaning")
    rows = (
        ("the joint", outcome, paper, "sticks, swings about its speed, or moves steadily"),
        ("damping ratio ρ", number(result["damping_ratio"]), "-", "of controller and viscous friction together"),
        (
            "ρ_c", number(exact["critical_damping_ratio"]), number(result["critical_damping_ratio"]),
            "critical damping ratio: above it stick-slip ends",
        ),
        ("damping reserve", percent_text(exact["damping_reserve"]), "-", "ρ/ρ_c - 1: damping in excess of ρ_c"),
        ("ρ_steady", number(exact["steady_damping_ratio"]), "-", "above it every start ends in steady motion"),
        (
            "lowest smooth speed", number(exact["lowest_smooth_velocity"], " rad/s"),
            number(result["lowest_smooth_velocity"], " rad/s"), "no stick-slip at this speed and faster",
        ),
        (
            "least smooth stiffness", number(exact["least_smooth_stiffness"], " N·m/rad"), "-",
            "no stick-slip, with the present damping",
        ),
        ("energy margin", "-", number(result["energy_margin"], " M·ẋ_s²"), "of a cycle: positive is smooth"),
        ("reduction factor", "-", number(result["reduction_factor"]), "h of Eq. (32)"),
        ("steady Stribeck friction", "-", number(result["steady_stribeck"], " N·m"), "F_s,ss of Eq. (39)"),
    )  # fmt: skip
    # Beyond the paper's case some have no answer.
    answered = [
        dict(zip(headings, (*cells, f"[dim]{meaning}[/]"), strict=True))
        for *cells, meaning in rows
        if cells[1:] != ["-", "-"]
    ]
    console.print(fitting_table(console, answered, headings[-1:], ("", "meaning"), padding=(0, 2)))


def percent_text(share: float | None) -> str:
    """A share with its sign; "-" for none."""
    return "-" if share is None else f"{100.0 * share:+.0f} %"
