# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Options that say how a bag is read and judged; shared by the commands that take bags."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from stickslip_ros.analysis.analysis import AnalysisOptions
from stickslip_ros.bags.storage.unpacking import OPTION, UnpackLimit
from stickslip_ros.bags.topics import TopicChoice
from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.settings.known_joints import load_joint
from stickslip_ros.settings.parameter_file import Parameters

_EVERY = "*"


def add_bag_arguments(parser: argparse.ArgumentParser) -> None:
    """Options read by :func:`analysis_options`."""
    what = parser.add_argument_group("what to analyse")
    what.add_argument(
        "--joint",
        action="append",
        metavar="NAME",
        default=[],
        help="this joint only (of several robots: left/joint1); may be repeated",
    )
    what.add_argument("--start", type=float, metavar="S", default=0.0, help="seconds after the first sample")
    what.add_argument("--end", type=float, metavar="S", default=math.inf, help="seconds after the first sample")
    add_unpack_argument(what)
    known = parser.add_argument_group("what is known of the joints")
    known.add_argument(
        "--parameters", type=Path, action="append", metavar="FILE", default=[],
        help="ROS parameters: the monitor's (config/monitor.yaml), or a controller's gains; may be repeated",
    )  # fmt: skip
    known.add_argument(
        "--model", action="append", metavar="[JOINT=]NAME", default=[], help="known joint, or path of a joint file"
    )
    known.add_argument(
        "--gains", action="append", metavar="[JOINT=]P[,D]", default=[],
        help="of the controller, until others are recorded [N·m/rad, N·m·s/rad]",
    )  # fmt: skip
    known.add_argument("--no-learning", action="store_true", help="do not learn friction from the motion: faster")
    topics = parser.add_argument_group("topics, where there are several that could be meant")
    topics.add_argument("--states", metavar="TOPIC", help="joint states of one robot (default: every robot's)")
    topics.add_argument(
        "--references", action="append", metavar="[ROBOT=]TOPIC",
        help="desired motion, or the joint states of a leader; '' for none; may be repeated",
    )  # fmt: skip
    topics.add_argument("--gains-topic", metavar="TOPIC", help="gains, as pd_gains; '' for none")
    topics.add_argument("--controller", metavar="NODE", help="whose parameter events hold the gains")


def add_unpack_argument(parser: Any) -> None:
    """The option read by :func:`unpack_limit`."""
    usual = UnpackLimit().largest_unpacked
    parser.add_argument(
        OPTION, type=float, metavar="MB", default=usual,
        help="a compressed chunk or message may become so large (default: %(default)g), a file so or a thousandfold",
    )  # fmt: skip


def unpack_limit(options: argparse.Namespace) -> UnpackLimit:
    """What the option says.

    Raises
    ------
    InvalidParameterError
        If it is not positive and finite.
    """
    return UnpackLimit(largest_unpacked=options.largest_unpacked)


def analysis_options(options: argparse.Namespace, **more: Any) -> AnalysisOptions:
    """What the options say.

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
    for text in options.gains:
        joint, values = _of_joint(text)
        try:
            numbers = [float(value) for value in values.split(",")]
            if len(numbers) > 2 or not all(math.isfinite(number) for number in numbers):
                raise ValueError
        except ValueError as error:
            raise InvalidParameterError("--gains", "of the form 630 or 630,12 or joint1=630,12", text) from error
        given |= dict(zip((f"gains.{joint}.p", f"gains.{joint}.d"), numbers, strict=False))
    if options.no_learning:
        given["learn"] = False
    references = options.references
    return AnalysisOptions(
        topics=TopicChoice(
            states=options.states,
            references=None if references is None else tuple(topic for topic in references if topic),
            gains=options.gains_topic,
            controller=options.controller,
        ),
        joints=tuple(options.joint),
        start=options.start,
        end=options.end,
        parameters=Parameters.of_files(options.parameters, given),
        unpacking=unpack_limit(options),
        **more,
    )


def _of_joint(text: str) -> tuple[str, str]:
    joint, equals, value = text.partition("=")
    return (joint, value) if equals else (_EVERY, text)


def check_output(path: Path, inputs: list[Path]) -> None:
    """Refuse to write over what is read.

    Raises
    ------
    InvalidParameterError
        If the path is one of the inputs.
    """
    if path.exists() and any(one.exists() and path.samefile(one) for one in inputs):
        raise InvalidParameterError("output", "another file than the recording", path)
