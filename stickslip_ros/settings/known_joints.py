# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Joint files: identified joints are data, one small YAML file each, loaded by name or by path; and written, with the
errors of what was identified, and what is only assumed.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, fields
from os import environ
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.errors import InvalidParameterError, JointFileError, UnknownJointError, reason
from stickslip_ros.files import write_whole
from stickslip_ros.model._friction_law import PAPERS_LAW
from stickslip_ros.model._validation import require_finite, require_not_negative
from stickslip_ros.model.friction import (
    FRICTION_PARAMETERS,
    INERTIA,
    JOINT_PARAMETERS,
    PRESLIDING_PARAMETERS,
    Friction,
    FrictionParameter,
    Gains,
    Joint,
    Transmission,
)
from stickslip_ros.model.units import unit_of
from stickslip_ros.regular_files import read_yaml

if TYPE_CHECKING:
    from stickslip_ros.monitoring.friction.presliding import PreslidingEstimate
    from stickslip_ros.monitoring.identification import Identification

_PACKAGE = "stickslip_ros"
_WORDS = ("law", "contact")  # of the friction, that are no numbers
_WIDTH = 32  # of a key with its value


@dataclass(frozen=True, kw_only=True)
class KnownJoint:
    """A joint file's content.

    Attributes
    ----------
    name : of the joint; joint : inertia and friction.
    gains : of its controller; velocity : a speed to try [rad/s]; encoder_resolution : [rad], 0 for none.
    assumed : names of the values that have no source.
    per_inertia : whether inertia, friction and gains are known but for a common factor; the inertia then is 1.
    """

    name: str
    joint: Joint
    gains: Gains
    velocity: float = 0.0
    encoder_resolution: float = 0.0
    assumed: tuple[str, ...] = field(default=())
    per_inertia: bool = False

    def __post_init__(self) -> None:
        require_finite("velocity", self.velocity)
        require_not_negative("encoder_resolution", self.encoder_resolution)


def config_folder() -> Path:
    """Where the package's configuration lies: of the checkout, the ROS install space, or the Python prefix.

    Raises
    ------
    JointFileError
        If it is in none of these places.
    """
    prefixes = [Path(prefix) for prefix in environ.get("AMENT_PREFIX_PATH", "").split(":") if prefix]
    candidates = [Path(__file__).resolve().parents[2] / "config"]
    candidates += [prefix / "share" / _PACKAGE / "config" for prefix in [*prefixes, Path(sys.prefix)]]
    for candidate in candidates:
        if (candidate / "joints").is_dir():
            return candidate
    raise JointFileError(f"no config folder in any of: {', '.join(map(str, candidates))}")


def known_joint_names() -> list[str]:
    """Names that :func:`load_joint` takes."""
    return sorted(path.stem for path in (config_folder() / "joints").glob("*.yaml"))


def load_joint(name_or_path: str) -> KnownJoint:
    """Load a known joint by its name, or any joint file by its path (a path ends in .yaml).

    Raises
    ------
    UnknownJointError
        If there is no such known joint.
    JointFileError
        If the file cannot be read as a joint.
    """
    if name_or_path.endswith((".yaml", ".yml")):
        path = Path(name_or_path)
    else:
        names = known_joint_names()
        if name_or_path not in names:
            raise UnknownJointError(name_or_path, names)
        path = config_folder() / "joints" / f"{name_or_path}.yaml"
    try:
        content = read_yaml(path)
    except (OSError, ValueError) as error:
        raise JointFileError(f"joint file {path}: {reason(error)}") from error
    try:
        return _parse(content)
    except InvalidParameterError as error:
        raise JointFileError(f"joint file {path}: {error}") from error
    except (KeyError, TypeError, ValueError) as error:
        text = f"missing key {error}" if isinstance(error, KeyError) else str(error)
        raise JointFileError(f"joint file {path}: {text}") from error


def _parse(content: Any) -> KnownJoint:
    if not isinstance(content, dict):
        raise TypeError("must be a mapping with name, inertia, friction and gains")
    names = {entry.name for one in (KnownJoint, Transmission) for entry in fields(one)}
    _refuse_unknown(content, (names | {"inertia", "friction"}) - {"joint"})
    friction, gains = content["friction"], content["gains"]
    _refuse_unknown(friction, {entry.name for entry in fields(Friction)})
    _refuse_unknown(gains, {entry.name for entry in fields(Gains)})
    values: dict[str, Any] = {key: value if key in _WORDS else float(value) for key, value in friction.items()}
    return KnownJoint(
        name=str(content["name"]),
        joint=Joint(
            inertia=float(content["inertia"]),
            friction=Friction(**values),
            transmission=Transmission.given(content),
        ),
        gains=Gains(**{key: float(value) for key, value in gains.items()}),
        velocity=float(content.get("velocity", 0.0)),
        encoder_resolution=float(content.get("encoder_resolution", 0.0)),
        assumed=tuple(content.get("assumed", ())),
        per_inertia=bool(content.get("per_inertia", False)),
    )


def _refuse_unknown(content: Any, known: set[str]) -> None:
    if not isinstance(content, dict):
        raise TypeError(f"expected a mapping with {', '.join(sorted(known))}, got {content!r}")
    unknown = sorted(set(map(str, content)) - known)
    if unknown:
        raise ValueError(f"unknown key {', '.join(unknown)}; known: {', '.join(sorted(known))}")


def joint_file_text(name: str, joint: Joint, found: Identification, gains: Gains | None, source: str) -> str:
    """A joint file as text, every value with its unit, its error and where it comes from."""
    known = found.parameters()
    # On a contact that slips show to yield there is neither lag nor rise time.
    names = [one.name for one in JOINT_PARAMETERS if found.slips is None or one.name in found.slips.names]
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
    rows = [one for one in FRICTION_PARAMETERS if one.name in names]
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
