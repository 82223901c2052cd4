# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Every parameter of the monitor, once: its declaration, its description, the names in YAML files come from here.

Gains, their limits and the advice are in the controller's units, of which one is `gain_scale` in SI units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from stickslip_ros.model.friction import INERTIA, JOINT_PARAMETERS, PRESLIDING_PARAMETERS, Gains
from stickslip_ros.model.units import in_ascii, unit_of
from stickslip_ros.monitoring.advice.limits import AdviceLimits
from stickslip_ros.monitoring.assessment import MonitorOptions

GAINS = {"p": "stiffness", "i": "integral", "d": "damping"}  # a controller's words, and ours
GAIN_UNITS = {key: in_ascii(unit_of(Gains, name)) for key, name in GAINS.items()}
RECOMMENDED = {key: GAINS[key] for key in ("p", "d")}
_NOT_SET = math.nan


@dataclass(frozen=True, kw_only=True)
class ParameterSpec:
    """A parameter: ``default`` tells its type, ``unit`` is "" where it has none.

    ``read_only`` : it cannot be changed while the node runs. ``dynamic_typing`` : values of other types are taken too.
    """

    name: str
    default: Any
    text: str
    unit: str = ""
    read_only: bool = False
    dynamic_typing: bool = False

    @property
    def description(self) -> str:
        """For people, with the unit, and what nan means where it is allowed."""
        unit = f" [{self.unit}]" if self.unit else ""
        open_value = "; nan: not set" if isinstance(self.default, float) and self.unit and "{" in self.name else ""
        return f"{self.text}{unit}{open_value}"


def _of_the_node() -> tuple[ParameterSpec, ...]:
    spec = ParameterSpec
    return (
        spec(name="joints", default=[""], text="joints to watch; [''] for every joint heard of", read_only=True),
        spec(
            name="controller",
            default="",
            text="node whose parameters gains.<joint>.p/.i/.d are followed, or a list of such nodes; empty: none",
            dynamic_typing=True,
        ),
        spec(
            name="reference_type",
            default="JointState",
            text="message on joint_references: JointState, or with control_msgs JointTrajectoryControllerState or "
            "MultiDOFStateStamped",
            read_only=True,
        ),
        spec(
            name="publish_rate",
            default=30.0,
            unit="Hz",
            text="how often diagnostics and margins are published",
            read_only=True,
        ),
        spec(name="autostart", default=True, text="whether the node configures and activates itself", read_only=True),
        spec(
            name="state_file",
            default="",
            text="where what was learnt is kept; empty: in ROS_HOME (~/.ros), by the node's name; none: nowhere",
            read_only=True,
        ),
        spec(
            name="allow_apply",
            default=False,
            text="whether ~/apply_recommendation may write gains to the controller",
        ),
        spec(
            name="apply_rate",
            default=0.3,
            unit="1/s",
            text="relative change of gains a second while they are applied",
        ),
    )


def _common() -> tuple[ParameterSpec, ...]:
    options, limits = MonitorOptions(), AdviceLimits()
    spec = ParameterSpec
    return (
        spec(
            name="warn_margin",
            default=options.warn_margin,
            unit="1",
            text="damping reserve rho/rho_c - 1 below which smooth motion is at risk",
        ),
        spec(
            name="wanted_margin",
            default=limits.wanted_margin,
            unit="1",
            text="damping reserve rho/rho_c - 1 that advice must reach",
        ),
        spec(
            name="confidence",
            default=limits.confidence,
            unit="1",
            text="probability with which advice must reach it, the friction learnt being uncertain",
        ),
        spec(
            name="condition",
            default=limits.condition.value,
            text="which condition advice must satisfy: paper (Eq. (43)) or exact",
        ),
        spec(
            name="steady_sliding",
            default=limits.steady_sliding,
            text="whether advice must also keep the sliding joint from swinging about its speed",
        ),
        spec(
            name="variant",
            default=options.variant.value,
            text="which advice is recommended: least_change, damping_only, stiffness_only",
        ),
        spec(
            name="samples_per_period",
            default=limits.samples_per_period,
            unit="1",
            text="how often the controller must act in a period of the crossover frequency that advice may ask for",
        ),
        spec(name="learn", default=options.learn, text="whether friction is learnt from the motion"),
        spec(
            name="memory",
            default=options.memory,
            unit="1",
            text="slips after which what they taught has faded to a third",
        ),
        spec(
            name="least_motion",
            default=options.least_motion,
            unit="s",
            text="how long motion must last before it is called smooth",
        ),
    )


def _per_joint() -> tuple[ParameterSpec, ...]:
    spec = ParameterSpec
    least, largest = AdviceLimits().damping_ratio_range
    found = [
        spec(
            name="model.{joint}",
            default="",
            text="known joint (config/joints) or path of a joint file (.yaml); empty: none",
            read_only=True,
        ),
    ]
    for parameter in (*JOINT_PARAMETERS, *PRESLIDING_PARAMETERS):
        name = "inertia.{joint}" if parameter is INERTIA else f"friction.{{joint}}.{parameter.name}"
        text = f"{parameter.name.replace('_', ' ')}; overrides the model's"
        found.append(spec(name=name, default=_NOT_SET, unit=in_ascii(parameter.unit), text=text))
    for key, unit in GAIN_UNITS.items():
        text = "gain of the controller, used until one is heard from"
        found.append(spec(name=f"gains.{{joint}}.{key}", default=_NOT_SET, unit=unit, text=text))
    for key, word in RECOMMENDED.items():
        text = f"{word} on trial: its margin is published, and nothing is set"
        found += [
            spec(name=f"trial.{{joint}}.{key}", default=_NOT_SET, unit=GAIN_UNITS[key], text=text),
            spec(name=f"limits.{{joint}}.{key}_min", default=0.0, unit=GAIN_UNITS[key], text="least gain to recommend"),
            spec(
                name=f"limits.{{joint}}.{key}_max",
                default=math.inf,
                unit=GAIN_UNITS[key],
                text="largest gain to recommend",
            ),
        ]
    return (
        *found,
        spec(name="limits.{joint}.damping_ratio_min", default=least, unit="1", text="least damping ratio to recommend"),
        spec(
            name="limits.{joint}.damping_ratio_max",
            default=largest,
            unit="1",
            text="largest damping ratio to recommend",
        ),
        spec(
            name="limits.{joint}.bandwidth",
            default=math.inf,
            unit="rad/s",
            text="largest crossover frequency to recommend",
        ),
        spec(
            name="limits.{joint}.effort",
            default=math.inf,
            unit="N*m",
            text="largest effort that advised gains may ask for now",
        ),
        spec(
            name="slowest_velocity.{joint}",
            default=_NOT_SET,
            unit="rad/s",
            text="the joint shall be smooth from this speed on, instead of at the present",
        ),
        spec(
            name="gain_scale.{joint}",
            default=1.0,
            unit="1",
            text="N*m/rad in one unit of the controller's p, and so on for d",
        ),
        spec(name="effort_scale.{joint}", default=1.0, unit="1", text="N*m in one unit of the effort in joint states"),
        spec(
            name="feedforward.{joint}.share",
            default=0.0,
            unit="1",
            text="of the known friction that ~/friction_feedforward has, at the reference's speed; 0: off",
        ),
        spec(
            name="feedforward.{joint}.largest",
            default=0.0,
            unit="N*m",
            text="torque that ~/friction_feedforward never exceeds; to be set before the share",
        ),
        spec(
            name="load.{joint}",
            default=0.0,
            unit="N*m",
            text="constant torque against the controller, for the exact verdict",
        ),
        spec(
            name="controller_period.{joint}",
            default=0.0,
            unit="s",
            text="of a sampled controller; 0: continuous, or not known",
        ),
        spec(
            name="control_delay.{joint}",
            default=False,
            text="whether the effort takes effect one controller period late",
        ),
    )


OF_THE_NODE = _of_the_node()  # concern no joint: recordings have no use for them
COMMON = _common()  # how every joint is judged
PER_JOINT = _per_joint()  # `{joint}` stands for the joint's name
