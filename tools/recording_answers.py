# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Analysed recordings of `python -m tools.answers`, simulated and real, each by its index."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import elastic_joints
import numpy as np
import ordinary_days
import random_motions
import two_speeds
import varying_machines
from machines import Machine
from slider import slider

from stickslip_ros.analysis.analysis import AnalysisOptions, analyze
from stickslip_ros.analysis.analysis_json import bag_json, joint_json
from stickslip_ros.analysis.joint_analysis import JointAnalyzer
from stickslip_ros.bags.simulated import RecordedJoint, write_simulation
from stickslip_ros.bags.table import load_table
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.joint_simulation import simulate
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.settings.parameter_file import Parameters
from tools.model_answers import CONTACTS, HUNTS, KNOWN, SEED, Answer

SMOOTH = 60.0  # [s] of each motion that does not stick
SLOWLY_AND_BACK = (0.005, -0.005, 0.005, -0.005)  # [rad/s]
_STANDS_AFTER, _PERIOD = 3.0, 0.002  # [s]: when the reference of a hunting joint stops; between samples
_RATE = 1.0 / _PERIOD
# Changes of a machine; on its way of 0.16 rad an arm turns by 73°, and friction has three periods.
VARYING = {
    varying_machines.LOAD: {"gravity": 20.0, "bend": 8.0, "load_share": 0.1},
    varying_machines.WEIGHT: {"gravity": 20.0, "bend": 8.0},
    varying_machines.PLACE: {"ripple": 0.15, "stribeck_ripple": 0.15, "ripples": 19.0},
    varying_machines.EVEN: {},
}


def recording(index: int) -> Answer:
    """Analysis of a simulated recording."""
    case, simulated, number = RECORDINGS[index]
    return {"case": case, "joint": analysed(*simulated(number))}


def analysed(batch: Batch, gains: Gains | None) -> Answer:
    """What `stickslip analyze` writes of one joint of which at most the gains are known."""
    joint = JointAnalyzer("joint1", Parameters(), with_traces=False, at_once=1)
    if gains is not None:
        joint.change_gains(gains)
    references = np.column_stack([batch.time, batch.reference_position, batch.reference_velocity])
    joint.process(np.column_stack([batch.time, batch.position, batch.velocity, batch.effort]), references)
    joint.finish()
    return joint_json(joint.analysis())


def bag(index: int) -> Answer:
    """Analysis of a recording as rosbag2 has it: of compensated friction, reversals, several joints, noise, a load."""
    one = RecordedJoint(
        joint=KNOWN.joint, gains=KNOWN.gains, velocities=(0.008,), encoder_resolution=KNOWN.encoder_resolution
    )
    stiff = replace(one, gains=Gains(stiffness=6300.0, damping=200.0), velocities=SLOWLY_AND_BACK)
    joints = (
        {"joint1": stiff},
        {"joint1": replace(stiff, feedforward=0.8)},
        {"joint1": one, "joint2": replace(one, velocities=(0.02, 0.0, 0.003), load=2.0, velocity_noise=1e-3)},
    )[index]
    parameters = Parameters({"model.joint1": KNOWN.name})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.mcap"
        write_simulation(path, joints, duration=40.0, rate=500.0, jitter=1e-4, seed=SEED)
        found = bag_json(analyze(path, AnalysisOptions(parameters=parameters)))
    return {"case": ", ".join(joints), **{name: value for name, value in found.items() if name != "path"}}


def real_recording(index: int) -> Answer:
    """Analysis of every joint of a file of STICKSLIP_RECORDINGS."""
    path = real_files()[index]
    if path.stem.startswith("enslyon_slider"):
        return {"case": path.name, "joint": analysed(slider(path), Gains(stiffness=168.0))}
    joints = load_table(path).batches
    return {"case": path.name, "joints": {name: analysed(batch, None) for name, batch in joints.items()}}


def real_files() -> list[Path]:
    """Tables in the folder STICKSLIP_RECORDINGS; none where that is not set."""
    folder = os.environ.get("STICKSLIP_RECORDINGS")
    files = [path for path in Path(folder).rglob("*") if path.suffix in (".csv", ".npz")] if folder else []
    return sorted(files, key=lambda path: path.name)


def _stick_slip(number: int) -> tuple[Batch, None]:
    return random_motions.random_stick_slip(SEED + number).batch, None


def _smooth(number: int) -> tuple[Batch, None]:
    kind = tuple(random_motions.REFERENCES)[number]
    return random_motions.random_motion(kind, np.random.default_rng((SEED, number)), duration=SMOOTH), None


def _day(number: int) -> tuple[Batch, None]:
    return ordinary_days.ordinary_day(SEED + number).watched(with_reference=number % 2 == 0), None


def _hunting(number: int) -> tuple[Batch, Gains]:
    gains = replace(HUNTS, stiffness=(630.0, 800.0)[number])
    times = _PERIOD * np.arange(round(SMOOTH * _RATE))
    velocities = np.where(times < _STANDS_AFTER, 0.02, 0.0)
    references = _PERIOD * np.append(0.0, np.cumsum(velocities)[:-1])
    motion = simulate(KNOWN.joint, gains, references, velocities, period=_PERIOD)
    count = KNOWN.encoder_resolution
    return Batch(time=motion.time, position=count * np.round(motion.position / count), effort=motion.effort,
                 reference_position=references + _PERIOD * velocities), gains  # fmt: skip


def varying_recording(kind: str) -> tuple[Batch, Gains]:
    """The known joint to and fro, as an arm of its own weight, or with friction that varies."""
    machine = replace(Machine.of(KNOWN.joint), **VARYING[kind])
    gains = replace(KNOWN.gains, damping=2.0)
    return varying_machines.recorded(machine, gains, 0.008, KNOWN.encoder_resolution).batch, gains


def _turning(number: int) -> tuple[Batch, Gains]:
    contact = CONTACTS[number]
    one = elastic_joints.random_case(np.random.default_rng((SEED, number)), contact, turns=True)
    return one.samples, one.gains


def two_speeds_recording(_: int) -> tuple[Batch, Gains]:
    """The known joint, which sticks at two speeds."""
    return two_speeds.recording(Machine.of(KNOWN.joint), KNOWN.gains, KNOWN.encoder_resolution), KNOWN.gains


Simulated = Callable[[int], tuple[Batch, Gains | None]]
RECORDINGS: tuple[tuple[str, Simulated, int], ...] = (
    *(("stick-slip", _stick_slip, number) for number in range(5)),
    *((f"smooth: {kind}", _smooth, number) for number, kind in enumerate(random_motions.REFERENCES) if number % 2 == 0
      or kind == random_motions.HAND_GUIDING),
    *(("mixed day", _day, number) for number in range(5)),
    *(("hunting", _hunting, number) for number in range(2)),
    ("gravity", lambda _: varying_recording(varying_machines.WEIGHT), 0),
    ("friction varies with position", lambda _: varying_recording(varying_machines.PLACE), 0),
    *(("to and fro", _turning, number) for number in range(3)),
    ("two speeds", two_speeds_recording, 0),
)  # fmt: skip
