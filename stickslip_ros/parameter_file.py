# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Joints and gains from YAML files of ROS parameters: the monitor's own, or a controller's."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from stickslip_ros.errors import StickSlipError
from stickslip_ros.joint_settings import COMMON, PER_JOINT, JointSettings, settings_of
from stickslip_ros.known_joints import load_joint

_MONITOR = "stickslip_monitor"
_SECTION = "ros__parameters"
_NODES_OWN = ("joints", "controller", "reference_type", "publish_rate", "allow_apply", "apply_rate", "use_sim_time")


class ParameterFileError(StickSlipError, ValueError):
    """A file of parameters that cannot be used; the text says why."""


@dataclass(frozen=True)
class Parameters:
    """Parameters by name; "*" stands for every joint that has none of its own; else the defaults of the table."""

    given: Mapping[str, Any] = field(default_factory=dict)

    def fingerprint(self) -> str:
        """What settings depend on, joint files included.

        Raises
        ------
        StickSlipError
            If a model cannot be loaded.
        """
        models = {
            value: load_joint(str(value)) for name, value in self.given.items() if name.startswith("model.") and value
        }
        return repr((sorted(self.given.items()), sorted(models.items())))

    @staticmethod
    def of_files(paths: Iterable[Path], given: Mapping[str, Any] | None = None) -> Parameters:
        """The parameters in files, the later ones before the earlier, and what is given before all.

        Raises
        ------
        ParameterFileError
            If a file cannot be read, holds no `ros__parameters`, or the monitor's section has a name it does not know.
        """
        found: dict[str, Any] = {}
        for path in paths:
            found |= _read(path)
        return Parameters(found | dict(given or {}))

    def settings_of(self, joint: str) -> JointSettings:
        """What they say of a joint.

        Raises
        ------
        StickSlipError
            If they make no joint; the text names the value.
        """
        values = {spec.name: self.given.get(spec.name, spec.default) for spec in COMMON}
        for spec in PER_JOINT:
            every, own = spec.name.format(joint="*"), spec.name.format(joint=joint)
            values[own] = self.given.get(own, self.given.get(every, spec.default))

        def typed(own: str) -> str:
            every = own.replace(f".{joint}", ".*", 1)
            return every if own not in self.given and every in self.given else own

        return settings_of(joint, values.__getitem__, typed)


def _read(path: Path) -> dict[str, Any]:
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ParameterFileError(f"parameter file {path}: {' '.join(str(error).split())}") from error
    sections = list(_sections("", content))
    if not sections:
        raise ParameterFileError(f"parameter file {path}: holds no {_SECTION}")
    found: dict[str, Any] = {}
    for node, parameters in sections:
        flat = dict(_flat("", parameters))
        if node.rpartition("/")[2] == _MONITOR:
            known = {spec.name.partition(".")[0] for spec in (*COMMON, *PER_JOINT)} | set(_NODES_OWN)
            unknown = sorted({name.partition(".")[0] for name in flat} - known - {"qos_overrides"})
            if unknown:
                raise ParameterFileError(
                    f"parameter file {path}: unknown parameter {', '.join(unknown)}; known: {', '.join(sorted(known))}"
                )
        found |= flat
    return found


def _sections(node: str, content: Any) -> Iterable[tuple[str, Any]]:
    if isinstance(content, Mapping):
        for key, value in content.items():
            if key == _SECTION:
                yield node, value
            else:
                yield from _sections(f"{node}/{key}".replace("//", "/"), value)


def _flat(prefix: str, content: Any) -> Iterable[tuple[str, Any]]:
    if isinstance(content, Mapping):
        for key, value in content.items():
            yield from _flat(f"{prefix}.{key}" if prefix else str(key), value)
    elif prefix:
        yield prefix, content
