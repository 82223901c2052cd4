# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A simulated joint under a controller, the node `late`, that answers when its parameters say so; and others set gains.

It prints every write that reaches it by `set_parameters_atomically`, which only the monitor uses, with the time.
"""

from __future__ import annotations

import contextlib
import time

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from stickslip_ros.nodes.simulated_joint import SimulatedJoint

GAINS = {"gains.joint1.p": 630.0, "gains.joint1.d": 0.0}


class Late(Node):
    """The controller, whose parameters say how it errs.

    `late_get`, `late_set` : how long an answer takes [s].
    `meddle` : after so many writes somebody sets p to 5000 between the answer to a question and what is written then.
    `shake` : after so many writes the joint becomes unstable. `unload` : the services vanish.
    """

    def __init__(self, joint: SimulatedJoint) -> None:
        super().__init__("late", start_parameter_services=False)
        self._joint = joint
        self._writes = 0
        for name, value in {
            **GAINS,
            "late_get": 0.0,
            "late_set": 0.0,
            "meddle": 0,
            "shake": 0,
            "unload": False,
        }.items():
            self.declare_parameter(name, value)
        # Each answers one question at a time: rclpy loses answers that are sent at the same time.
        self._services = [
            self.create_service(kind, f"/late/{name}", answer, callback_group=MutuallyExclusiveCallbackGroup())
            for kind, name, answer in (
                (ListParameters, "list_parameters", self._list),
                (GetParameters, "get_parameters", self._get),
                (SetParametersAtomically, "set_parameters_atomically", self._set_atomically),
            )
        ]
        self.create_service(
            SetParameters, "/late/set_parameters", self._set, callback_group=MutuallyExclusiveCallbackGroup()
        )
        # Not answered, but a client of parameters wants them to be there.
        self.create_service(GetParameterTypes, "/late/get_parameter_types", lambda _, answer: answer)
        self.create_service(DescribeParameters, "/late/describe_parameters", lambda _, answer: answer)
        self.add_post_set_parameters_callback(self._follow)

    def _value(self, name: str) -> float:
        return float(self.get_parameter(name).value)

    def _list(self, _: ListParameters.Request, response: ListParameters.Response) -> ListParameters.Response:
        response.result.names = list(GAINS)
        return response

    def _get(self, request: GetParameters.Request, response: GetParameters.Response) -> GetParameters.Response:
        response.values = [self.get_parameter(name).get_parameter_value() for name in request.names]
        if 0 < self._value("meddle") <= self._writes:
            self.set_parameters([Parameter("gains.joint1.p", value=5000.0), Parameter("meddle", value=0)])
        time.sleep(self._value("late_get"))
        return response

    def _set_atomically(
        self, request: SetParametersAtomically.Request, response: SetParametersAtomically.Response
    ) -> SetParametersAtomically.Response:
        changes = [Parameter.from_parameter_msg(message) for message in request.parameters]
        print(f"wrote {time.monotonic():.4f} {[(one.name, one.value) for one in changes]}", flush=True)
        self._writes += 1
        response.result = self.set_parameters_atomically(changes)
        time.sleep(self._value("late_set"))
        return response

    def _set(self, request: SetParameters.Request, response: SetParameters.Response) -> SetParameters.Response:
        response.results = [
            SetParametersResult(successful=one.successful, reason=one.reason)
            for one in self.set_parameters([Parameter.from_parameter_msg(message) for message in request.parameters])
        ]
        return response

    def _follow(self, changes: list[Parameter]) -> None:
        names = {one.name for one in changes}
        gains = [one for one in changes if one.name in GAINS]
        if gains:
            self._joint.set_parameters(gains)
        if "shake" in names:
            self._writes = 0
        if gains and 0 < self._value("shake") <= self._writes:
            self._joint.set_parameters([Parameter("gains.joint1.i", value=30.0 * self._value("gains.joint1.p"))])
        if "unload" in names and self.get_parameter("unload").value:
            for service in self._services:
                self.destroy_service(service)


def main() -> int:
    """Run both until they are interrupted."""
    rclpy.init()
    joint = SimulatedJoint()
    executor = MultiThreadedExecutor(8)
    for node in (joint, Late(joint)):
        executor.add_node(node)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()
    rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
