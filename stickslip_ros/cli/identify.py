# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip identify`: estimate a joint's inertia and friction from a recording, or from an experiment that moves it.

From a recording (a table that `stickslip convert` can read, or a bag with JointStates) the slips are fitted and, where
the effort is recorded, sliding too. The experiment moves the joint at each of the speeds and back again, with rests in
between, by the parameters of a simulated joint or by a trajectory for a joint_trajectory_controller.

Examples:
    stickslip identify robot.mcap --joint joint1 --out joint1.yaml
    stickslip identify --simulated /simulated_joint --speeds 0.005,0.02 --plan
"""

from __future__ import annotations

import argparse
import math
import signal
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.analysis.sample_checks import data_problems
from stickslip_ros.bags.reading import read_joint_with_gains
from stickslip_ros.bags.storage.formats import is_read_as_bag
from stickslip_ros.bags.storage.unpacking import UnpackLimit
from stickslip_ros.bags.table import RecordingError, find_recording, load_recording
from stickslip_ros.cli.bag_options import add_unpack_argument, gain_fields, topic_choice
from stickslip_ros.cli.options import JOINT_FILE, add_flag, add_json, add_number, add_option, option_of, refuse_given
from stickslip_ros.cli.terminal import console_of_text, new_table, print_warning, progress_bar, working
from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.interrupts import Interrupted
from stickslip_ros.model._validation import require_finite, require_not_negative, require_positive
from stickslip_ros.model.friction import JOINT_PARAMETERS, PRESLIDING_PARAMETERS, Gains
from stickslip_ros.monitoring.friction.estimate import COULOMB_AND_LOAD
from stickslip_ros.monitoring.identification import Identification, identify
from stickslip_ros.output import published
from stickslip_ros.output.as_json import json_text, parameter_json
from stickslip_ros.output.published import number
from stickslip_ros.output.wording import presliding_text
from stickslip_ros.settings.known_joints import joint_file_text, load_joint, write_joint_file

if TYPE_CHECKING:
    from stickslip_ros.monitoring.samples import Batch

# Options of an experiment, and their defaults.
_OF_EXPERIMENT: dict[str, Any] = {
    "speeds": None, "step_time": 15.0, "rest": 3.0, "largest_distance": 0.5, "largest_lag": 0.02, "plan": False,
}  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "recording",
        nargs="?",
        metavar="RECORDING",
        help="a table (.csv, .parquet, .npz), a bag (MCAP file, rosbag2 directory, .db3 or .bag file, LeRobot "
        "episode), or a known recording",
    )
    topics = parser.add_argument_group("topics, if the bag has several candidates")
    add_option(topics, "--states", "TOPIC", "joint states")
    add_option(topics, "--references", "TOPIC", "commanded motion; '' for none", action="append")
    add_option(topics, "--gains-topic", "TOPIC", "gains, such as /pd_gains; '' for none")
    add_unpack_argument(parser)
    gains = "gains of the controller [N·m/rad, N·m·s/rad, N·m/(rad·s)] (default: as recorded in the bag)"
    add_option(parser, "--gains", "P[,D[,I]]", gains)
    # The gains one by one, as they were given before --gains.
    parser.add_argument("--stiffness", type=float, help=argparse.SUPPRESS)
    parser.add_argument("--damping", type=float, default=0.0, help=argparse.SUPPRESS)
    parser.add_argument("--integral", type=float, default=0.0, help=argparse.SUPPRESS)
    model = "known joint, or path of a joint file, with values right within a factor of two"
    add_option(parser, "--model", "NAME", model)
    experiment = parser.add_argument_group("experiment, instead of a recording")
    add_option(experiment, "--simulated", "NODE", "node of a simulated joint, e.g. /simulated_joint")
    add_option(experiment, "--controller", "NODE", "node of a joint_trajectory_controller")
    add_option(parser, "--joint", "NAME", "joint to move, or to read from the bag", "joint1")
    add_option(experiment, "--speeds", "V,V", "speeds to move at, slowest first [rad/s]")
    for name, metavar, text in (
        ("step_time", "S", "time at each speed [s]"),
        ("rest", "S", "rest between speeds [s]"),
        ("largest_distance", "X", "refuse an experiment that moves further from the start than this [rad]"),
        ("largest_lag", "X", "stop if the joint is further than this from the controller's trajectory [rad]"),
    ):
        add_number(experiment, option_of(name), metavar, text, _OF_EXPERIMENT[name])
    add_flag(experiment, "--plan", "print the steps of the experiment and move nothing")
    parser.add_argument("--name", help="name of the joint in the joint file (default: of the recording or the joint)")
    add_option(parser, "--out", "FILE", "write a joint file (.yaml), which --model reads", type=JOINT_FILE)
    add_json(parser)
    parser.set_defaults(made_of={"prior": ("--model",)})


def run(options: argparse.Namespace) -> int:
    """Identify and print; exit status 0 if something was found, 1 if the motion shows nothing."""
    prior = None if options.model is None else load_joint(options.model)
    if prior is not None and prior.per_inertia:
        raise InvalidParameterError("--model", "a joint whose inertia is known", options.model)
    chosen = [bool(options.recording), bool(options.simulated), bool(options.controller)]
    if sum(chosen) != 1:
        raise StickSlipError("missing: one of RECORDING, --simulated NODE and --controller NODE")
    if options.recording:
        refuse_given(options, _OF_EXPERIMENT, "left out with a RECORDING: it is of an experiment")
    gains = _gains(options)
    if options.recording:
        path = Path(options.recording)
        path = path if is_read_as_bag(path) else find_recording(options.recording)
        batch, gains, references_off = _samples(path, options, gains)
        name, source = path.stem, f"Identified from {path.name}."
    else:
        experiment = _experiment(options)
        if experiment is None:
            return 0
        batch, heard, references_off = *experiment, math.nan
        gains = gains or heard
        name, source = options.joint, f"Identified by a ladder of speeds {options.speeds} rad/s."
    with working("fitting the slips"):
        found = identify(batch, gains, prior.joint if prior else None)
    problems = data_problems(found.state, len(batch), references_off)
    if sum(found.state.dropped.values()) == len(batch):
        raise RecordingError(f"{name}: {'; '.join(problems) or 'no samples'}")
    if options.json:
        print(json_text(_as_json(found)))
    else:
        _print(found, problems)
    if not found.parameters() and found.slips is None:
        return 1
    if options.out:
        slips = found.slips
        if found.per_inertia and prior is None and slips is not None:
            joint, gains = slips.joint(), slips.gains
        else:
            joint = found.joint(prior.joint if prior else None)
        source += f" What is not identified is of {prior.name}." if prior else ""
        text = joint_file_text(options.name or name, joint, found, gains, source)
        write_joint_file(options.out, text)
        if not options.json:
            console_of_text().print(f"Written to {options.out}.")
    return 0


def _samples(path: Path, options: argparse.Namespace, given: Gains | None) -> tuple[Batch, Gains | None, float]:
    """The samples; the gains: those that are given, else those that a bag has; and by how much the stamps of references
    that are not used for it are off [s], else NaN.
    """
    limit = UnpackLimit(largest_unpacked=options.largest_unpacked)
    if not is_read_as_bag(path):
        return load_recording(path, options.joint, limit).batch, given, math.nan
    # The controller of an experiment is another one's node.
    choice = replace(topic_choice(options), controller=None)
    if given is not None:
        choice = replace(choice, gains="")
    batch, recorded, off = read_joint_with_gains(path, options.joint, choice, limit)
    if len(recorded) > 1:
        raise RecordingError(
            f"bag {path}: the gains of {options.joint} change, and one set of gains is fitted: give them by --gains, "
            "or use stickslip analyze, which follows such changes"
        )
    return batch, given or next(iter(recorded), None), off


def _gains(options: argparse.Namespace) -> Gains | None:
    if options.gains is not None:
        refuse_given(options, {"stiffness": None}, "left out with --gains")
        return Gains(**gain_fields("--gains", options.gains))
    if options.stiffness is None:
        refuse_given(options, {"damping": 0.0, "integral": 0.0}, "given together with --stiffness")
        return None
    for name in ("stiffness", "damping", "integral"):
        require_finite(name, getattr(options, name))
    require_not_negative("stiffness", options.stiffness)
    return Gains(stiffness=options.stiffness, damping=options.damping, integral=options.integral)


def _experiment(options: argparse.Namespace) -> tuple[Batch, Gains | None] | None:
    """Run the ladder; None if it is only to be planned."""
    # ROS is needed for this alone.
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from stickslip_ros.nodes.speed_ladder import LadderNode, speed_ladder

    require_positive("largest_distance", options.largest_distance)
    require_positive("largest_lag", options.largest_lag)
    try:
        speeds = [float(word) for word in (options.speeds or "").split(",") if word]
    except ValueError as error:
        raise InvalidParameterError("--speeds", "numbers separated by commas", options.speeds) from error
    if not speeds:
        raise InvalidParameterError(
            "--speeds", "given for an experiment, one or more, such as 0.005,0.02", options.speeds
        )
    steps = speed_ladder(speeds, duration=options.step_time, rest=options.rest)
    way = sum(speeds) * options.step_time
    total = sum(step.duration for step in steps)
    console = console_of_text(stderr=True)
    console.print(
        f"{options.joint}: {len(steps)} steps in {total:.0f} s, up to {way:.3g} rad from where it is, and back."
    )
    if not way <= options.largest_distance:
        raise InvalidParameterError(
            "--speeds",
            f"so that the joint moves no further than --largest-distance, {options.largest_distance:g} rad",
            f"{options.speeds}, by which it moves {way:.3g} rad",
        )
    if options.plan:
        for step in steps:
            console.print(f"  {step.duration:6.1f} s at {step.velocity:+.4g} rad/s")
        return None
    # A signal is noticed between two steps of the node, which then brings the joint to rest.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = LadderNode(
            options.joint,
            simulated=options.simulated or "",
            controller=options.controller or "",
            largest_lag=options.largest_lag,
        )
        try:
            with progress_bar("moving") as bar:
                batch = node.run(steps, lambda done, _: bar(round(done), round(total)))
            return batch, node.gains
        finally:
            node.destroy_node()
    except Interrupted as interrupted:
        # Whichever signal it was, the experiment was interrupted.
        raise Interrupted(signal.SIGINT) from interrupted
    finally:
        rclpy.try_shutdown()


def _as_json(found: Identification) -> dict[str, Any]:
    """The friction as in the JSON of `analyze`; null for what is not known."""
    parameters, slips = found.parameters(), found.slips
    if slips is not None and math.isfinite(slips.coulomb_and_load.value):
        parameters[COULOMB_AND_LOAD] = (slips.coulomb_and_load, "slips")
    friction = {name: {**parameter_json(estimate), "from": origin} for name, (estimate, origin) in parameters.items()}
    frequency = slips.natural_frequency if slips is not None else None
    return {
        "friction": friction,
        "cycles": len(found.cycles),
        "slips": slips.slips if slips else 0,
        "rests_on": slips.summary() if slips else None,
        "mismatch": slips.mismatch or None if slips else None,
        "per_inertia": found.per_inertia,
        "natural_frequency": number(frequency.value) if frequency else None,
        "presliding": published.for_json(found.presliding, published.PRESLIDING),
        "sliding_speeds": [found.sliding.slowest, found.sliding.fastest] if found.sliding else None,
    }


def _print(found: Identification, problems: Sequence[str]) -> None:
    console = console_of_text()
    parameters = found.parameters()
    slips = found.slips
    speed = f"; usual speed {found.speed:.4g} rad/s" if math.isfinite(found.speed) else ""
    console.print(f"{len(found.cycles)} stick-slip cycles found{speed}.")
    for problem in problems:
        print_warning(console, problem)
    if slips is not None:
        console.print(f"[yellow]{slips.mismatch}[/]" if slips.mismatch else slips.summary())
    if not parameters:
        console.print(
            "[yellow]Friction could not be estimated: the motion has no slips, and no sliding with known effort.[/]"
        )
        return
    per_inertia = found.per_inertia
    rows = []
    for one in (*JOINT_PARAMETERS, *PRESLIDING_PARAMETERS):
        if one.name in parameters:
            unit = one.unit_where(per_inertia=per_inertia)
            rows.append((one.name.replace("_", " "), *parameters[one.name], unit))
    if per_inertia and slips is not None:
        rows.append(("natural frequency", slips.natural_frequency, "slips", "rad/s"))
    table = new_table(("", "value", "± error", "", ""), padding=(0, 1))
    for name, estimate, origin, unit in rows:
        sure = "[green]identified[/]" if estimate.identified else "[yellow]not identified[/]"
        note = f"{sure} [dim]from {origin}[/]"
        table.add_row(name, f"{estimate.value:.4g}", f"{estimate.std:.2g}", unit, note)
    console.print(table)
    if found.sliding is not None:
        console.print(
            f"Sliding was seen from {found.sliding.slowest:.3g} to {found.sliding.fastest:.3g} rad/s; "
            "beyond these speeds the friction curve is extrapolated."
        )
    stiffness = float(found.gains.stiffness) if found.gains is not None else math.nan
    gives_way = presliding_text(found.presliding, stiffness) if found.presliding is not None else ""
    if gives_way:
        console.print(f"The joint {gives_way}.")
    if slips is None or slips.normalised:
        return
    if math.isfinite(slips.load.value):
        console.print(f"Constant load {slips.load.value:.4g} ± {slips.load.std:.2g} N·m.")
    else:
        console.print(
            f"One direction only: Coulomb friction and load together {slips.coulomb_and_load.value:.4g} "
            f"± {slips.coulomb_and_load.std:.2g} N·m. Record motion in both directions to separate them. "
            "The prediction does not need this."
        )
