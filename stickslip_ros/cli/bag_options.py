# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Options that say how a bag is read and judged; shared by the commands that take bags."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from stickslip_ros.analysis.analysis import AnalysisOptions
from stickslip_ros.bags.reading import joint_names
from stickslip_ros.bags.storage.unpacking import OPTION, UnpackLimit
from stickslip_ros.bags.topics import TopicChoice
from stickslip_ros.cli.options import add_flag, add_number, add_option, add_repeated, option_of
from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.monitoring.advice.limits import LIMIT_OPTIONS
from stickslip_ros.settings.known_joints import load_joint
from stickslip_ros.settings.parameter_file import Parameters
from stickslip_ros.settings.parameter_names import did_you_mean, nearest_joint, nearest_name
from stickslip_ros.settings.parameter_table import GAINS

GAINS_FORM = "[JOINT=]P[,D[,I]]"
GAINS_RULE = "finite and >= 0 (without the sign, if the motor counts against its joint)"
_EVERY = "*"
_ORDER = ("p", "d", "i")
SLOWEST = "slowest speed at which the joint has to move smoothly [rad/s]"
# Options of the advice: the parameter of every joint that each sets, and its help.
_LIMITS = {
    one.name: (f"limits.*.{one.parameter}", f"{one.help} [{one.unit}]")
    for one in LIMIT_OPTIONS
    if one.name in ("largest_stiffness", "largest_damping", "bandwidth")
} | {"slowest_velocity": ("slowest_velocity.*", SLOWEST)}


def add_bag_arguments(parser: argparse.ArgumentParser) -> None:
    """Options read by :func:`analysis_options`."""
    what = parser.add_argument_group("what to analyse")
    add_repeated(what, "--joint", "NAME", "analyse this joint only (with several robots: left/joint1); may be repeated")
    add_number(what, "--start", "S", "begin so many seconds after the first sample", 0.0)
    add_number(what, "--end", "S", "end so many seconds after the first sample", math.inf)
    add_unpack_argument(what)
    known = parser.add_argument_group("what is known of the joints")
    file = "ROS parameter file: of the monitor (config/monitor.yaml), or with a controller's gains; may be repeated"
    add_repeated(known, "--parameters", "FILE", file, type=Path)
    add_repeated(known, "--model", "[JOINT=]NAME", "known joint, or path of a joint file")
    units = "[N·m/rad, N·m·s/rad, N·m/(rad·s)]"
    add_repeated(known, "--gains", GAINS_FORM, f"gains of the controller, used until the bag has others {units}")
    add_flag(known, "--no-learning", "do not estimate friction from the motion (faster)")
    topics = parser.add_argument_group("topics, if the bag has several candidates")
    add_option(topics, "--states", "TOPIC", "joint states of one robot (default: of every robot)")
    references = "commanded motion, or the joint states of a leader; '' for none; may be repeated"
    add_option(topics, "--references", "[ROBOT=]TOPIC", references, action="append")
    add_option(topics, "--gains-topic", "TOPIC", "gains, such as /pd_gains; '' for none")
    add_option(topics, "--controller", "NODE", "node whose parameter events have the gains")


def add_limit_arguments(parser: argparse.ArgumentParser) -> None:
    """Limits of the advised gains, for every joint; read by :func:`analysis_options` where a command has them."""
    limits = parser.add_argument_group(
        "limits of the advised gains (others, and limits of single joints, by --parameters)"
    )
    for name, (_, text) in _LIMITS.items():
        add_number(limits, option_of(name), "X", text)


def add_unpack_argument(parser: Any) -> None:
    """The option that an :class:`~stickslip_ros.bags.storage.unpacking.UnpackLimit` is made of."""
    usual = UnpackLimit().largest_unpacked
    add_number(parser, OPTION, "MB", "largest decompressed size of a chunk or message, in MB", usual)


def analysis_options(options: argparse.Namespace, gains_after: Sequence[str] = ()) -> AnalysisOptions:
    """What the options say.

    Parameters
    ----------
    gains_after : texts of --gains-after, before those of --gains.

    Raises
    ------
    StickSlipError
        If they cannot be; the text names the option.
    """
    given: dict[str, Any] = {}
    for text in options.model:
        joint, name = _of_joint(text)
        try:
            load_joint(name)
        except StickSlipError as error:
            raise StickSlipError(f"--model {text}: {error}") from error
        given[f"model.{joint}"] = name
    for option, texts in (("--gains", options.gains), ("--gains-after", gains_after)):
        for text in texts:
            joint, values = _of_joint(text)
            given |= {f"gains.{joint}.{kind}": number for kind, number in given_gains(option, values).items()}
    if options.no_learning:
        given["learn"] = False
    for name, (parameter, _) in _LIMITS.items():
        value = getattr(options, name, None)
        if value is not None:
            if not value > 0 or (name == "slowest_velocity" and value == math.inf):
                rule = "finite and > 0" if name == "slowest_velocity" else "> 0"
                raise InvalidParameterError(option_of(name), rule, value)
            if options.no_learning and not (options.model or options.parameters):
                rule = "left out with --no-learning, where no joint is known (--model, --parameters)"
                raise InvalidParameterError(option_of(name), rule, value)
            given[parameter] = value
    return AnalysisOptions(
        topics=topic_choice(options),
        joints=tuple(options.joint),
        start=options.start,
        end=options.end,
        parameters=Parameters.of_files(options.parameters, given),
        unpacking=UnpackLimit(largest_unpacked=options.largest_unpacked),
    )


def topic_choice(options: argparse.Namespace) -> TopicChoice:
    """The topics that the options name."""
    references = options.references
    return TopicChoice(
        states=options.states,
        references=None if references is None else tuple(topic for topic in references if topic),
        gains=options.gains_topic,
        controller=options.controller,
    )


def given_gains(option: str, text: str) -> dict[str, float]:
    """Gains p, d and i of the form 630,12,100, of which those at the end may be left out.

    Raises
    ------
    InvalidParameterError
        If they cannot be; the text has the option.
    """
    try:
        numbers = [float(value) for value in text.split(",")]
        if len(numbers) > len(_ORDER):
            raise ValueError
    except ValueError as error:
        raise InvalidParameterError(option, "of the form 630 or 630,12 or 630,12,100", text) from error
    if not all(map(can_be_a_gain, numbers)):
        raise InvalidParameterError(option, GAINS_RULE, text)
    return dict(zip(_ORDER, numbers, strict=False))


def gain_fields(option: str, text: str) -> dict[str, float]:
    """The same as fields of :class:`~stickslip_ros.model.friction.Gains`."""
    return {GAINS[kind]: value for kind, value in given_gains(option, text).items()}


def can_be_a_gain(number: float) -> bool:
    """Whether a controller with this gain drives its joint to where it ought to be."""
    return 0.0 <= number < math.inf


def _of_joint(text: str) -> tuple[str, str]:
    joint, equals, value = text.partition("=")
    return (joint, value) if equals else (_EVERY, text)


def check_named_joints(options: argparse.Namespace, chosen: AnalysisOptions, bags: Sequence[Path]) -> None:
    """See that every joint named in --gains and --model is in a bag, and that gains are not all recorded there; no more
    is read than it takes to see that.

    Raises
    ------
    StickSlipError
        If one is in none; the text has the option as it was typed, and the name that was probably meant. If --gains
        would have no effect.
    """
    typed = {
        f"{option_of(option)} {text}": _of_joint(text)[0]
        for option in ("gains", "gains_after", "model")
        for text in getattr(options, option, ())
    }
    named = {joint: text for text, joint in typed.items() if joint != _EVERY}
    # Where the gains of a joint are recorded from its first sample on, others have no effect.
    unused = {text: joint for text, joint in typed.items() if not text.startswith("--model")}
    missing, there = set(named), set[str]()
    for path in bags if missing or unused else ():
        try:
            for names, without in joint_names(path, chosen.topics, chosen.unpacking):
                there |= names
                missing -= names
                unused = {text: joint for text, joint in unused.items() if not without & ({joint} - {_EVERY} or names)}
                if not missing and not set(unused.values()) - {_EVERY} - there:
                    break
        except (StickSlipError, OSError):
            # Said of the bag when it is analysed.
            continue
    for joint in sorted(missing) if there else ():
        meant = did_you_mean(nearest_joint(joint, there) or nearest_name(joint, there))
        where = "the bag" if len(bags) == 1 else f"any of {len(bags)} bags"
        listed = ", ".join(sorted(there))
        raise StickSlipError(f"{named[joint]}: no joint {joint!r} in {where}{meant}; joints there: {listed}")
    for text in unused if there else ():
        raise StickSlipError(
            f"{text}: has no effect, for the gains are recorded from the first sample on; "
            "--gains-topic '' leaves the recorded ones out"
        )
