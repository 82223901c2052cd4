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
from stickslip_ros.monitoring.advice.limits import LIMIT_OPTIONS, AdviceLimits
from stickslip_ros.monitoring.assessment import MonitorOptions

GAINS = {"p": "stiffness", "i": "integral", "d": "damping"}  # a controller's words, and ours
GAIN_UNITS = {key: in_ascii(unit_of(Gains, name)) for key, name in GAINS.items()}
RECOMMENDED = {key: GAINS[key] for key in ("p", "d")}
_NOT_SET = math.nan


@dataclass(frozen=True)
class ParameterSpec:
    """A parameter: ``default`` tells its type, ``unit`` is "" where it has none.

    ``read_only`` : it cannot be changed while the node runs. ``dynamic_typing`` : values of other types are taken too.
    """

    name: str
    default: Any
    unit: str
    text: str
    read_only: bool = False
    dynamic_typing: bool = False

    @property
    def description(self) -> str:
        """For people, with the unit, and what nan means where it is allowed."""
        unit = f" [{self.unit}]" if self.unit else ""
        open_value = "; nan: not set" if isinstance(self.default, float) and self.unit and "{" in self.name else ""
        return f"{self.text}{unit}{open_value}"


_row = ParameterSpec
_USUAL, _LIMITS = MonitorOptions(), AdviceLimits()
# Parameters that concern no joint: recordings have no use for them.
OF_THE_NODE = (
    _row("joints", [""], "", "joints to watch; [''] for every joint heard of", read_only=True),
    _row("controller", "", "",
         "node whose parameters gains.<joint>.p/.i/.d are followed, or a list of such nodes; empty: none",
         dynamic_typing=True),
    _row("reference_type", "JointState", "",
         "message on joint_references: JointState, or with control_msgs JointTrajectoryControllerState or "
         "MultiDOFStateStamped", read_only=True),
    _row("publish_rate", 30.0, "Hz", "how often diagnostics and margins are published", read_only=True),
    _row("autostart", True, "", "whether the node configures and activates itself", read_only=True),
    _row("state_file", "", "",
         "where what was learnt is kept; empty: in ROS_HOME (~/.ros), by the node's name; none: nowhere",
         read_only=True),
    _row("allow_apply", False, "", "whether ~/apply_recommendation may write gains to the controller"),
    _row("apply_rate", 0.3, "1/s", "relative change of gains a second while they are applied"),
)  # fmt: skip
# How every joint is judged.
COMMON = (
    _row("warn_margin", _USUAL.warn_margin, "1",
         "damping reserve rho/rho_c - 1 below which smooth motion is at risk"),
    _row("wanted_margin", _LIMITS.wanted_margin, "1", "damping reserve rho/rho_c - 1 that advice must reach"),
    _row("confidence", _LIMITS.confidence, "1",
         "probability with which advice must reach it, the friction learnt being uncertain"),
    _row("condition", _LIMITS.condition.value, "",
         "which condition advice must satisfy: paper (Eq. (43)) or exact"),
    _row("steady_sliding", _LIMITS.steady_sliding, "",
         "whether advice must also keep the sliding joint from swinging about its speed"),
    _row("variant", _USUAL.variant.value, "",
         "which advice is recommended: least_change, damping_only, stiffness_only"),
    _row("samples_per_period", _LIMITS.samples_per_period, "1",
         "how often the controller must act in a period of the crossover frequency that advice may ask for"),
    _row("learn", _USUAL.learn, "", "whether friction is learnt from the motion"),
    _row("memory", _USUAL.memory, "1", "slips after which friction is learnt anew, at the latest"),
    _row("least_motion", _USUAL.least_motion, "s", "how long motion must last before it is called smooth"),
)  # fmt: skip
# `{joint}` stands for the joint's name.
PER_JOINT = (
    _row("model.{joint}", "", "", "known joint (config/joints) or path of a joint file (.yaml); empty: none",
         read_only=True),
    *(
        _row("inertia.{joint}" if one is INERTIA else f"friction.{{joint}}.{one.name}", _NOT_SET, in_ascii(one.unit),
             f"{one.name.replace('_', ' ')}; overrides the model's")
        for one in (*JOINT_PARAMETERS, *PRESLIDING_PARAMETERS)
    ),
    *(
        _row(f"gains.{{joint}}.{key}", _NOT_SET, unit, "gain of the controller, used until one is heard from")
        for key, unit in GAIN_UNITS.items()
    ),
    *(
        _row(f"trial.{{joint}}.{key}", _NOT_SET, GAIN_UNITS[key],
             f"{word} on trial: its margin is published, and nothing is set")
        for key, word in RECOMMENDED.items()
    ),
    *(
        _row(f"limits.{{joint}}.{one.parameter}", one.default, in_ascii(one.unit), one.help)
        for one in LIMIT_OPTIONS
    ),
    _row("slowest_velocity.{joint}", _NOT_SET, "rad/s",
         "the joint shall be smooth from this speed on, instead of at the present"),
    _row("gain_scale.{joint}", 1.0, "1", "N*m/rad in one unit of the controller's p, and so on for d"),
    _row("effort_scale.{joint}", 1.0, "1", "N*m in one unit of the effort in joint states"),
    _row("feedforward.{joint}.share", 0.0, "1",
         "of the known friction that ~/friction_feedforward has, at the reference's speed; 0: off"),
    _row("feedforward.{joint}.largest", 0.0, "N*m",
         "torque that ~/friction_feedforward never exceeds; to be set before the share"),
    _row("load.{joint}", 0.0, "N*m", "constant torque against the controller, for the exact verdict"),
    _row("controller_period.{joint}", 0.0, "s", "of a sampled controller; 0: continuous, or not known"),
    _row("control_delay.{joint}", False, "", "whether the effort takes effect one controller period late"),
)  # fmt: skip
