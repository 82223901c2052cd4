# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip simulate`: write a bag of simulated joints, as rosbag2 would have recorded it.

Joint n moves at n times the speed, so that the first of several joints stick and the last ones do not.

Examples:
    stickslip simulate --out robot.mcap
    stickslip simulate --out robot.mcap --names shoulder,elbow --duration 30 --velocity-noise 0.001
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np

from stickslip_ros.bags.simulated import RecordedJoint, write_simulation
from stickslip_ros.bags.writing import COMPRESSIONS
from stickslip_ros.cli.options import (
    add_bag_output,
    add_flag,
    add_number,
    add_option,
    refuse_to_overwrite,
    refuse_without_effect,
)
from stickslip_ros.cli.terminal import console_of_text, progress_bar
from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.friction import Gains
from stickslip_ros.settings.known_joints import load_joint

_COMPENSATIONS = {
    "feedforward": "share of the friction that the controller compensates, by the commanded speed",
    "feedback": "share of the Coulomb friction that it compensates, by the measured speed",
    "push": "share of the friction that it compensates, by the sign of the error",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_bag_output(parser)
    add_option(parser, "--model", "NAME", "known joint, or path of a joint file", "puma560_joint1")
    add_option(parser, "--names", "A,B", "names of the joints", "joint1")
    add_option(parser, "--velocity", "V[,V]", "speeds, one after the other [rad/s] (default: of the known joint)")
    add_number(parser, "--stiffness", "KP", "k_p [N·m/rad] (default: of the known joint)")
    add_number(parser, "--damping", "KV", "k_v [N·m·s/rad] (default: of the known joint)")
    add_number(parser, "--load", "T", "constant torque [N·m]", 0.0)
    for name, text in _COMPENSATIONS.items():
        add_number(parser, f"--{name}", "C", text, 0.0)
    add_number(parser, "--duration", "S", "duration of the recording [s]", 60.0)
    add_number(parser, "--rate", "F", "sample rate [Hz]", 1000.0)
    add_number(parser, "--resolution", "X", "resolution of the encoder [rad] (default: of the known joint)")
    add_number(parser, "--position-noise", "X", "standard deviation of the positions [rad]", 0.0)
    add_number(parser, "--velocity-noise", "X", "standard deviation of the velocities [rad/s]", 0.0)
    add_number(parser, "--jitter", "S", "standard deviation of the time stamps [s]", 0.0)
    seed = "seed of the noise and of the first position within an encoder count (default: 1, and on a count)"
    add_option(parser, "--seed", "N", seed, type=int)
    add_number(parser, "--first-stamp", "S", "time stamp of the first sample [s] (default: now)")
    add_flag(parser, "--no-gains", "do not record the gains")
    add_option(parser, "--compression", None, "compression of the chunks", "zstd", choices=sorted(COMPRESSIONS))
    parser.set_defaults(
        made_of={"velocities": ("--velocity",), "encoder_resolution": ("--resolution",), "start": ("--first-stamp",)}
    )


def run(options: argparse.Namespace) -> int:
    """Simulate and write."""
    refuse_to_overwrite(options)
    known = load_joint(options.model)
    velocities = _velocities(options.velocity) if options.velocity is not None else (known.velocity,)
    names = [name.strip() for name in options.names.split(",")]
    if len(set(names)) != len(names) or not all(names):
        raise InvalidParameterError("--names", "different names, separated by commas", options.names)
    gains = Gains(
        stiffness=known.gains.stiffness if options.stiffness is None else options.stiffness,
        damping=known.gains.damping if options.damping is None else options.damping,
    )
    resolution = known.encoder_resolution if options.resolution is None else options.resolution
    random = bool(resolution or options.position_noise or options.velocity_noise or options.jitter)
    refuse_without_effect(options, "seed", met=random, needs="noise, --jitter or --resolution")
    if options.seed is not None and options.seed < 0:
        raise InvalidParameterError("seed", ">= 0", options.seed)
    phases = np.zeros(len(names)) if options.seed is None else np.random.default_rng(options.seed).random(len(names))
    joints = {
        name: RecordedJoint(
            joint=known.joint,
            gains=gains,
            velocities=tuple((number + 1) * velocity for velocity in velocities),
            encoder_resolution=resolution,
            encoder_phase=float(phases[number]),
            position_noise=options.position_noise,
            velocity_noise=options.velocity_noise,
            load=options.load,
            **{kind: getattr(options, kind) for kind in _COMPENSATIONS},
        )
        for number, name in enumerate(names)
    }
    with progress_bar("simulating") as progress:
        write_simulation(
            options.out,
            joints,
            duration=options.duration,
            rate=options.rate,
            start=math.floor(time.time()) if options.first_stamp is None else options.first_stamp,
            seed=1 if options.seed is None else options.seed,
            jitter=options.jitter,
            with_gains=not options.no_gains,
            compression=options.compression,
            progress=progress,
        )
    console_of_text(stderr=True).print(
        f"{options.out}: {options.duration:g} s of {', '.join(names)}; now: stickslip analyze {options.out}"
    )
    return 0


def _velocities(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError as error:
        raise InvalidParameterError("--velocity", "numbers separated by commas", text) from error
