# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Writing joint files: what was identified, with its errors, and what is only assumed."""

from __future__ import annotations

import os
from dataclasses import fields
from pathlib import Path

from stickslip_ros.errors import JointFileError
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.monitoring.friction.estimate import NAMES
from stickslip_ros.monitoring.identification import Identification

UNITS = {"inertia": "kg·m²"} | {entry.name: str(entry.metadata["unit"]) for entry in fields(Friction)}


def joint_file_text(name: str, joint: Joint, found: Identification, gains: Gains | None, source: str) -> str:
    """A joint file as text, every value with its unit, its error and where it comes from."""
    known = found.parameters()
    assumed = [parameter for parameter in NAMES if parameter not in known or not known[parameter][0].identified]

    each = " / inertia" if found.per_inertia else ""

    def line(parameter: str, value: float) -> str:
        note = UNITS[parameter] + (each if parameter in ("viscous", "stribeck", "coulomb") else "")
        if parameter in known:
            estimate, origin = known[parameter]
            note += f", ± {estimate.std:.2g}, from {origin}"
        if parameter in assumed:
            note += ", not identified"
        return f"{parameter}: {value:.6g}".ljust(32) + f"# {note}"

    lines = [f"# {text}" for text in source.splitlines()]
    if found.slips is not None and found.slips.mismatch:
        lines.append(f"# {found.slips.mismatch}")
    lines.append(f"name: {name}")
    if found.per_inertia:
        lines.append("per_inertia: true".ljust(32) + "# the gains were not known; all is over the inertia")
    lines += [line("inertia", float(joint.inertia)), "friction:"]
    lines += [f"  {line(parameter, float(getattr(joint.friction, parameter)))}" for parameter in NAMES[1:]]
    lines.append("gains:                          # of the controller then")
    gains = gains or Gains(stiffness=0.0)
    for parameter, unit in (("stiffness", "N·m/rad"), ("damping", "N·m·s/rad"), ("integral", "N·m/(rad·s)")):
        lines.append(f"  {parameter}: {float(getattr(gains, parameter)):.6g}".ljust(32) + f"# {unit}{each}")
    lines.append(f"velocity: {found.speed:.6g}".ljust(32) + "# rad/s, of the motion then")
    lines.append(f"encoder_resolution: {found.resolution:.6g}".ljust(32) + "# rad")
    lines.append(f"assumed: [{', '.join(assumed)}]")
    return "\n".join(lines) + "\n"


def write_joint_file(path: Path, text: str) -> None:
    """Write a joint file, whole or not at all.

    Raises
    ------
    JointFileError
        If the file exists already, or its folder cannot be written.
    """
    if path.suffix not in (".yaml", ".yml"):
        raise JointFileError(f"joint file {path}: the name must end in .yaml")
    if path.exists():
        raise JointFileError(f"joint file {path}: exists already; choose another name or remove it")
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise JointFileError(f"joint file {path}: {error.strerror}") from error
