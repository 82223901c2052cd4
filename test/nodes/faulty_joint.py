# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A simulated joint whose controller fails in a chosen way at a chosen change of its gains."""

from __future__ import annotations

import os
import time

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from stickslip_ros.nodes.running import run
from stickslip_ros.nodes.simulated_joint import SimulatedJoint


class FaultyJoint(SimulatedJoint):
    """The parameter `fault` is none, reject, clamp, ignore, hang or die; `fault_after` counts changes of gains."""

    def __init__(self) -> None:
        super().__init__()
        self.declare_parameter("fault", "none")
        self.declare_parameter("fault_after", 1)
        self._changes = 0
        self.add_pre_set_parameters_callback(self._meddle)
        self.add_on_set_parameters_callback(self._reject)

    def _fails(self, parameters: list[Parameter]) -> bool:
        gains = any(parameter.name.startswith("gains.") for parameter in parameters)
        return gains and self._changes >= self.get_parameter("fault_after").value

    def _meddle(self, parameters: list[Parameter]) -> list[Parameter]:
        if any(parameter.name == "fault" for parameter in parameters):
            self._changes = 0
        if any(parameter.name.startswith("gains.") for parameter in parameters):
            self._changes += 1
        fault = self.get_parameter("fault").value
        if not self._fails(parameters) or fault in ("none", "reject"):
            return parameters
        if fault == "die":
            os._exit(1)
        if fault == "hang":
            time.sleep(12.0)
            return parameters
        if fault == "clamp" and self._changes > self.get_parameter("fault_after").value:
            return parameters  # what is put back is taken
        shares = {"clamp": 0.99, "ignore": 0.0}
        return [self._changed(parameter, shares[fault]) for parameter in parameters]

    def _changed(self, parameter: Parameter, share: float) -> Parameter:
        old = self.get_parameter(parameter.name).value
        return Parameter(parameter.name, Parameter.Type.DOUBLE, old + share * (parameter.value - old))

    def _reject(self, parameters: list[Parameter]) -> SetParametersResult:
        if self.get_parameter("fault").value == "reject" and self._fails(parameters):
            return SetParametersResult(successful=False, reason="not in this mode")
        return SetParametersResult(successful=True)


if __name__ == "__main__":
    raise SystemExit(run(FaultyJoint, None))
