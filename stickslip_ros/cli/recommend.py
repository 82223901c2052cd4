# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip recommend`: advise gains, within limits, that make a joint move smoothly. No robot is touched.

Examples:
    stickslip recommend --model puma560_joint1 --largest-stiffness 2000
    stickslip recommend --model puma560_joint1 --velocity 0.005 --what-if 2000,30
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from stickslip_ros.cli.bag_options import SLOWEST, gain_fields
from stickslip_ros.cli.margin import (
    add_joint_arguments,
    conditions_from,
    joint_from,
    percent_text,
    refuse_of_a_rigid_contact,
)
from stickslip_ros.cli.options import (
    COMPENSATION,
    TRAJECTORY,
    add_flag,
    add_json,
    add_number,
    add_option,
    option_of,
    refuse_without_effect,
)
from stickslip_ros.cli.terminal import console_of_text, new_table, number_text, working
from stickslip_ros.cli.trajectory import read_trajectory, write_trajectory
from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.files import write_whole
from stickslip_ros.model._validation import require_not_negative, require_positive
from stickslip_ros.model.compensation import USUAL_FILTER, Compensation
from stickslip_ros.model.compensation_effect import (
    SHARES,
    CompensationEffect,
    compensation_effect,
    largest_harmless_share,
)
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.verdict import beyond_the_paper, verdict
from stickslip_ros.monitoring.advice.compensations import At, compensations
from stickslip_ros.monitoring.advice.limits import (
    LIMIT_OPTIONS,
    AdviceLimits,
    Criterion,
    ObservedLoop,
    by_field,
    limits_from,
)
from stickslip_ros.monitoring.advice.recommend import recommend
from stickslip_ros.monitoring.advice.recommendation import Kind, Recommendation, Variant
from stickslip_ros.monitoring.advice.sensitivity import Sensitivity, in_words, sensitivities
from stickslip_ros.output.as_json import json_text, margin_json, recommendation_json
from stickslip_ros.output.csv_table import write_csv
from stickslip_ros.output.published import number, numbers
from stickslip_ros.output.wording import OUTCOME_WORDS
from stickslip_ros.settings.known_joints import KnownJoint
from stickslip_ros.settings.parameter_table import GAINS

_LARGEST_RESERVE = 100.0  # where next to no damping is needed the reserve says nothing
_NEXT_TO_NOTHING = 1e-12  # [rad]: rounding
_SPEEDS = np.geomspace(0.01, 300.0, 46)  # Stribeck velocities of the feed-forward table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_joint_arguments(parser)
    wanted = parser.add_argument_group("what the advice must reach")
    defaults = AdviceLimits()
    wanted.add_argument(
        "--condition",
        choices=[one.value for one in Criterion],
        default=defaults.condition.value,
        help="exact: by the friction model (the default); paper: by Eq. (43), which holds for the paper's friction law",
    )
    reserve = "damping reserve to reach: damping in excess of that at which stick-slip ends, as a share of the latter"
    add_number(wanted, "--wanted-reserve", "R", reserve, defaults.wanted_margin)
    wanted.add_argument(
        "--steady-sliding", action=argparse.BooleanOptionalAction, default=defaults.steady_sliding,
        help="the speed must not oscillate about the commanded one either (the default)",
    )  # fmt: skip
    add_number(wanted, "--slowest-velocity", "V", SLOWEST)
    bounds = parser.add_argument_group("limits of the advised gains")
    for one in LIMIT_OPTIONS:
        add_number(bounds, option_of(one.name), "X", f"{one.help} [{one.unit}]", one.default)
    usual = f" (default: {defaults.samples_per_period:g})"
    add_number(bounds, "--sample-rate", "F", "sample rate of the controller [Hz]")
    add_number(bounds, "--samples-per-period", "N", f"least samples in a period of the crossover frequency{usual}")
    add_number(bounds, "--tracking-error", "X", "present tracking error [rad]; for --effort")
    beyond = parser.add_argument_group("the controller, for the exact condition")
    add_number(beyond, "--controller-period", "S", "period of a sampled controller [s]", 0.0)
    add_flag(beyond, "--control-delay", "the effort takes effect one controller period late")
    add_flag(parser, "--factors", "advise factors on the gains; for gains that are known per inertia only")
    add_option(parser, "--what-if", "P[,D[,I]]", "show the margin with these gains beside the present one")
    add_flag(parser, "--compensation", "also show the effect of friction compensation at the advised gains")
    over_speed = "write the feed-forward over speed (.csv, .yaml)"
    add_option(parser, "--compensation-out", "FILE", over_speed, type=COMPENSATION)
    table = "table (CSV, Parquet) of time, position and, if it has one, velocity; for --trajectory-out"
    add_option(parser, "--trajectory", "FILE", table, type=Path)
    effort = "write the --trajectory with the feed-forward as its effort, for joint_trajectory_controller"
    add_option(parser, "--trajectory-out", "FILE.yaml", effort, type=TRAJECTORY)
    name = "the joint's name in the controller (default: its name in the table)"
    add_option(parser, "--trajectory-joint", "NAME", name)
    add_number(parser, "--feedforward", "C", "share of the friction that the feed-forward compensates (default: 1)")
    usual = f" (default: {USUAL_FILTER:g})"
    add_number(parser, "--speed-filter", "S", f"time constant of the filter on the speed for compensation [s]{usual}")
    add_json(parser)
    made_of = by_field(lambda one: option_of(one.name))
    parser.set_defaults(load=0.0, made_of={**made_of, "wanted_margin": ("--wanted-reserve",)})


def run(options: argparse.Namespace) -> int:
    """Print the advice; exit status 0 if there are gains, 1 if no gains within the bounds reach the wanted margin."""
    known = joint_from(options)
    joint, gains, velocity = known.joint, known.gains, known.velocity
    limits = _limits(options)
    if options.sample_rate is not None:
        require_positive("sample_rate", options.sample_rate)
    for name in ("tracking_error", "speed_filter", "feedforward"):
        if getattr(options, name) is not None:
            require_not_negative(name, getattr(options, name))
    loop = ObservedLoop(
        conditions=conditions_from(options),
        sample_rate=math.nan if options.sample_rate is None else options.sample_rate,
        tracking_error=math.nan if options.tracking_error is None else options.tracking_error,
    )
    trial = what_if(options.what_if, gains) if options.what_if else None
    factors = options.factors or known.per_inertia
    _refuse(options, joint, factors=factors)
    given = None if options.trajectory is None else read_trajectory(options.trajectory, options.trajectory_joint)
    with working("working it out"):
        advice = recommend(joint, gains, velocity, limits, None, loop, gains_known=not factors)
        found: Sequence[Sensitivity] = ()
        if gains.stiffness > 0 and advice.velocity > 0:
            found = sensitivities(
                joint, gains, advice.velocity, loop.conditions,
                wanted_margin=limits.wanted_margin, condition=limits.condition,
            )  # fmt: skip
        result = recommendation_json(advice, found)
        if trial is not None:
            result["what_if"] = {
                "stiffness": float(trial.stiffness),
                "damping": float(trial.damping),
                "margin": margin_json(joint, trial, velocity, loop.conditions),
                "present_margin": margin_json(joint, gains, velocity, loop.conditions),
            }
        table = _compensation(options, known, advice, loop.conditions) if options.compensation else None
        if table is not None:
            result["compensation"] = table.as_json()
    if options.compensation_out is not None:
        _write_feedforward(options.compensation_out, joint.friction)
    if given is not None:
        share = 1.0 if options.feedforward is None else options.feedforward
        write_trajectory(options.trajectory_out, given, joint.friction, share)
    if options.json:
        print(json_text(result))
    else:
        _print(advice, found, joint)
        first = advice[Kind.LEAST_CHANGE]
        exact = limits.condition is Criterion.EXACT and not beyond_the_paper(joint, gains, loop.conditions)
        if first.found and exact and limits.steady_sliding:
            steady = verdict(joint, first.gains, advice.velocity).steady_reserve
            if steady > limits.wanted_margin:
                print(
                    f"With a reserve below {100.0 * steady:.0f} % the speed would swing, so that the wanted "
                    f"{100.0 * limits.wanted_margin:.0f} % are not enough; --no-steady-sliding allows it."
                )
        if table is not None:
            _print_table(table, advice.velocity)
        if trial is not None:
            _print_what_if(result["what_if"])
    return 0 if advice[Kind.LEAST_CHANGE].found else 1


def _refuse(options: argparse.Namespace, joint: Joint, *, factors: bool) -> None:
    """What has no effect, or would be guessed."""
    refuse_of_a_rigid_contact(options, joint.friction)
    refuse = partial(refuse_without_effect, options)
    refuse("speed_filter", met=options.compensation, needs="--compensation")
    refuse("tracking_error", met=options.effort < math.inf, needs="--effort")
    refuse("sample_rate", met=options.controller_period == 0, needs="no --controller-period, for which it stands")
    sampled = bool(options.controller_period or options.sample_rate)
    refuse("samples_per_period", met=sampled, needs="--controller-period or --sample-rate")
    refuse("trajectory", met=options.trajectory_out is not None, needs="--trajectory-out")
    given = options.trajectory is not None
    refuse("trajectory_out", "trajectory_joint", "feedforward", met=given, needs="--trajectory")
    met = options.effort == math.inf or options.tracking_error is not None
    refuse("effort", met=met, needs="--tracking-error")
    written = [name for name in ("compensation_out", "trajectory_out") if getattr(options, name) is not None]
    if (options.compensation or written) and not joint.friction.coulomb > 0:
        raise StickSlipError(
            "most of what is compensated is Coulomb friction, which is not known: give --coulomb [N·m], > 0, or a "
            "--model that has it"
        )
    if written and factors:
        raise StickSlipError(
            f"{option_of(written[0])} needs torques: where gains are known per inertia only, friction is too"
        )


def _limits(options: argparse.Namespace) -> AdviceLimits:
    return AdviceLimits(
        wanted_margin=options.wanted_reserve,
        condition=Criterion(options.condition),
        steady_sliding=options.steady_sliding,
        slowest_velocity=options.slowest_velocity,
        **({} if options.samples_per_period is None else {"samples_per_period": options.samples_per_period}),
        **limits_from(lambda one: getattr(options, one.name)),
    )


def what_if(text: str, gains: Gains) -> Gains:
    """The present gains with others in their place, of the form 2000,30 or, as it once was, p=2000,d=30.

    Raises
    ------
    InvalidParameterError
        If the text has another form.
    """
    if "=" not in text:
        return replace(gains, **gain_fields("--what-if", text))
    changes = {}
    for word in text.split(","):
        key, _, value = word.partition("=")
        try:
            changes[GAINS[key.strip()]] = float(value)
        except (KeyError, ValueError) as error:
            raise InvalidParameterError("--what-if", "of the form 2000,30 or p=2000,d=30 (p, d and i)", text) from error
    if not all(math.isfinite(value) for value in changes.values()):
        raise InvalidParameterError("--what-if", "of finite gains", text)
    return replace(gains, **changes)


def _print(advice: Recommendation, found: Sequence[Sensitivity], joint: Joint) -> None:
    console = console_of_text()
    name = "the paper's approximation, Eq. (43)" if advice.condition is Criterion.PAPER else "the friction model"
    if not joint.friction.of_the_paper:
        name += f" (Eq. (43) does not hold for the law {joint.friction.law_in_words})"
    first = advice[Kind.LEAST_CHANGE]
    colour = "green" if first.found else "yellow"
    speed = f" at {advice.velocity:.4g} rad/s" if first.found else ""
    console.print(f"By {name}{speed}: [{colour}]{first.reason}[/].")
    if first.found and not advice.keep:
        headings = ("", "stiffness", "damping", "reserve", "bandwidth", "error", "noise", "model predicts")
        table = new_table(headings, ("", "model predicts"), padding=(0, 1, 0, 0))
        if advice.present is not None:
            table.add_row("[dim]present", *_variant_row(advice.present, advice))
        for variant in advice.variants:
            table.add_row(variant.kind.value.replace("_", " "), *_variant_row(variant, advice))
        if advice.beside is not None:
            name = "by Eq. (43)" if advice.condition is Criterion.EXACT else "by the model"
            # The reserve of the other condition is another number.
            beside = replace(advice.beside, reserve=math.nan)
            table.add_row(f"[dim]{name}", *_variant_row(beside, advice))
        console.print(table)
        units = "Stiffness in N·m/rad, damping in N·m·s/rad"
        if not advice.gains_known:
            units = "Damping: of controller and joint together"
        console.print(
            f"[dim]{units}; reserve: damping in excess of that at which stick-slip ends; bandwidth: crossover of the "
            "position loop in rad/s; error: tracking error at constant speed; noise: in the torque, from "
            "the measured speed; × 1: as at present; model predicts: what the joint does in the end.[/]"
        )
    if first.slides_steadily is False:
        console.print(
            "[yellow]The joint's speed may go on oscillating without sticking; "
            "with --steady-sliding the advised gains end that too.[/]"
        )
    if first.found and 0 < advice.slowest_smooth_velocity < math.inf:
        here = f"{advice.velocity:.3g} rad/s, and at " if advice.slowest_smooth_velocity > advice.velocity else ""
        console.print(
            f"With these gains the joint moves smoothly at {here}{advice.slowest_smooth_velocity:.3g} rad/s and faster."
        )
    elif first.found and advice.slowest_smooth_velocity == 0:
        console.print("With these gains the joint moves smoothly at every speed.")
    if advice.resonance:
        console.print(f"{advice.resonance[0].upper()}{advice.resonance[1:]}.")
    mechanics = in_words(tuple(found))
    if mechanics:
        console.print(f"{mechanics}.")
    elasticities = [f"{one.parameter.replace('_', ' ')} {one.elasticity:+.2f}" for one in found]
    if any(math.isfinite(one.elasticity) for one in found):
        console.print(f"[dim]Sensitivity of ρ/ρ_c (% per 1 % more of a parameter): {', '.join(elasticities)}.[/]")


def _variant_row(variant: Variant, advice: Recommendation) -> list[str]:
    if not variant.found:
        return ["[yellow]none[/]"]
    if advice.gains_known:
        gains = [f"{variant.stiffness:.4g}", f"{variant.damping:.4g}"]
    else:
        gains = [f"× {variant.stiffness_factor:.3g}", f"× {variant.damping_factor:.3g}"]
    return [
        *gains,
        _percent(variant.reserve),
        f"{variant.bandwidth:.3g}",
        _factor(variant.tracking_error_factor),
        _factor(variant.noise_factor),
        "" if variant.outcome is None else OUTCOME_WORDS[variant.outcome.value],
    ]


def _factor(factor: float) -> str:
    return f"× {factor:.2g}" if math.isfinite(factor) else ""


def _percent(reserve: float) -> str:
    if math.isnan(reserve):
        return ""
    return f"{100 * reserve:.0f} %" if reserve < _LARGEST_RESERVE else "∞"


def _print_what_if(result: dict[str, Any]) -> None:
    console = console_of_text()
    now, then = result["present_margin"], result["margin"]
    console.print(f"What if p = {result['stiffness']:.4g} and d = {result['damping']:.4g}:")
    table = new_table(("", "now", "then"), padding=(0, 1))
    exact = [one["exact"] for one in (now, then)]
    outcomes = [OUTCOME_WORDS.get(one["outcome"], "no answer") for one in exact]
    table.add_row("model predicts", *outcomes)
    reserves = [one["damping_reserve"] for one in exact]
    table.add_row("damping reserve", *map(percent_text, reserves))
    speeds = [one["lowest_smooth_velocity"] for one in exact]
    table.add_row("lowest smooth speed (rad/s)", *(number_text(one, ".4g") for one in speeds))
    words = {True: "[green]smooth[/]", False: "[red]stick-slip[/]", None: "no answer"}
    table.add_row("Eq. (43)", words[now["smooth"]], words[then["smooth"]])
    console.print(table)


@dataclass(frozen=True, kw_only=True)
class _CompensationTable:
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


def _compensation(
    options: argparse.Namespace, known: KnownJoint, advice: Recommendation, conditions: OperatingConditions
) -> _CompensationTable:
    """Every kind at every share with the advised gains, or with the present ones where there are none; the kinds beside
    each other: the integration holds no lock of Python's.

    Ten seconds on two cores; half a minute of a soft joint that moves slowly.
    """
    joint, velocity, variant = known.joint, advice.velocity, advice[Kind.LEAST_CHANGE]
    if not velocity > 0:
        raise InvalidParameterError("--velocity", "> 0 for a table of compensation", velocity)
    gains = variant.gains if variant.found else known.gains
    kinds = compensations(
        joint, gains, conditions,
        resolution=known.encoder_resolution,
        speed_filter=USUAL_FILTER if options.speed_filter is None else options.speed_filter,
    )  # fmt: skip
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
        return _CompensationTable(
            gains=gains,
            effects={kind: one.result() for kind, one in found.items()},
            harmless={kind: one.result() for kind, one in limits.items()},
        )


def _print_table(found: _CompensationTable, velocity: float) -> None:
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


def _missing(found: _CompensationTable) -> list[str]:
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


def _write_feedforward(path: Path, friction: Friction) -> None:
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
