# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Writing joint files: what was identified, with its errors, and what is only assumed."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from stickslip_ros.errors import JointFileError, reason
from stickslip_ros.files import write_whole
from stickslip_ros.model._friction_law import PAPERS_LAW
from stickslip_ros.model.friction import (
    FRICTION_PARAMETERS,
    INERTIA,
    JOINT_PARAMETERS,
    PRESLIDING_PARAMETERS,
    FrictionParameter,
    Gains,
    Joint,
    Transmission,
)
from stickslip_ros.model.units import unit_of
from stickslip_ros.monitoring.friction.presliding import PreslidingEstimate
from stickslip_ros.monitoring.identification import Identification

_WIDTH = 32  # of a key with its value


def joint_file_text(name: str, joint: Joint, found: Identification, gains: Gains | None, source: str) -> str:
    """A joint file as text, every value with its unit, its error and where it comes from."""
    known = found.parameters()
    names = [parameter.name for parameter in JOINT_PARAMETERS]
    assumed = [name for name in names if name not in known or not known[name][0].identified]

    each = " / inertia" if found.per_inertia else ""

    def line(parameter: FrictionParameter, value: float) -> str:
        note = parameter.unit + (each if parameter.is_force else "")
        if parameter.name in known:
            estimate, origin = known[parameter.name]
            note += f", ± {estimate.std:.2g}, from {origin}"
        if parameter.name in assumed:
            note += ", not identified"
        return f"{parameter.name}: {value:.6g}".ljust(_WIDTH) + f"# {note}"

    lines = [f"# {text}" for text in source.splitlines()]
    if found.slips is not None and found.slips.mismatch:
        lines.append(f"# {found.slips.mismatch}")
    lines.append(f"name: {name}")
    if found.per_inertia:
        lines.append("per_inertia: true".ljust(_WIDTH) + "# the gains were not known; all is over the inertia")
    lines.append(line(INERTIA, float(joint.inertia)))
    if joint.transmission is not None:
        lines += _of_the_spring(joint.transmission)
    lines.append("friction:")
    rows = list(FRICTION_PARAMETERS)
    if joint.friction.law != PAPERS_LAW:
        lines.append(f"  law: {joint.friction.law}")
    if not joint.friction.rigid:
        lines.append(f"  contact: {joint.friction.contact}")
        rows += PRESLIDING_PARAMETERS
    lines += [f"  {line(one, float(getattr(joint.friction, one.name)))}" for one in rows]
    if found.presliding is not None and found.presliding.stiffness.identified and joint.friction.rigid:
        lines += _seen(found.presliding)
    lines.append("gains:                          # of the controller then")
    gains = gains or Gains(stiffness=0.0)
    for gain in ("stiffness", "damping", "integral"):
        lines.append(f"  {gain}: {float(getattr(gains, gain)):.6g}".ljust(_WIDTH) + f"# {unit_of(Gains, gain)}{each}")
    lines.append(f"velocity: {found.speed:.6g}".ljust(_WIDTH) + "# rad/s, of the motion then")
    lines.append(f"encoder_resolution: {found.resolution:.6g}".ljust(_WIDTH) + "# rad")
    lines.append(f"assumed: [{', '.join(assumed)}]")
    return "\n".join(lines) + "\n"


def _of_the_spring(transmission: Transmission) -> list[str]:
    """Resonance and antiresonance, which no slips show, as they were given."""
    lines = [
        f"{one.name}: {getattr(transmission, one.name):.6g}".ljust(_WIDTH) + f"# {one.metadata['unit']}, given"
        for one in fields(Transmission)
        if one.metadata
    ]
    return [*lines, f"encoder: {transmission.encoder}".ljust(_WIDTH) + "# side of the spring, given"]


def _seen(presliding: PreslidingEstimate) -> list[str]:
    """Comments that make the contact elastic where their marks are taken away."""
    parameter, estimate = PRESLIDING_PARAMETERS[0], presliding.stiffness
    rests = f"{parameter.unit}, ± {estimate.std:.2g}, from {presliding.rests} rests"
    return [
        f"  # {parameter.name}: {estimate.value:.6g}  # {rests}",
        f"  # contact: {presliding.contact}  # with both, verdicts come from simulation; Eq. (43) has a rigid contact",
    ]


def write_joint_file(path: Path, text: str) -> None:
    """Write a joint file, whole or not at all.

    Raises
    ------
    JointFileError
        If the file exists already, or its folder cannot be written.
    """
    if path.exists():
        raise JointFileError(f"joint file {path}: exists already; choose another name or remove it")
    try:
        write_whole(path, text)
    except OSError as error:
        raise JointFileError(f"joint file {path}: {reason(error)}") from error
