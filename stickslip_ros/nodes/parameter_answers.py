# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Answers to every request to set parameters: in rclpy an exception in a callback leaves a request without answer."""

from __future__ import annotations

import traceback
from collections.abc import Callable

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from stickslip_ros.errors import StickSlipError

_LONGEST_REASON = 500  # length of a reason, characters: it may quote a value of any length

Check = Callable[[list[Parameter]], None]


def refuse_by(node: Node, check: Check) -> None:
    """Refuse parameters for which a check raises; the text of the exception is the reason.

    Parameters
    ----------
    check : called with the parameters as they would be. It raises StickSlipError for invalid values.
    """

    def answer(parameters: list[Parameter]) -> SetParametersResult:
        try:
            for parameter in parameters:
                if parameter.type_ == Parameter.Type.NOT_SET and node.has_parameter(parameter.name):
                    raise StickSlipError(f"{parameter.name} cannot be deleted")
            check(parameters)
        except StickSlipError as error:
            return SetParametersResult(successful=False, reason=_printable(str(error)))
        except Exception as error:
            node.get_logger().error(traceback.format_exc(), throttle_duration_sec=10.0)
            return SetParametersResult(successful=False, reason=_printable(f"{type(error).__name__}: {error}"))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(answer)


def follow_by(node: Node, apply: Check) -> None:
    """Apply parameters that were set; an error is logged, because the answer must not wait for it."""

    def followed(parameters: list[Parameter]) -> None:
        try:
            apply(parameters)
        except Exception:
            node.get_logger().error(traceback.format_exc(), throttle_duration_sec=10.0)

    node.add_post_set_parameters_callback(followed)


def _printable(text: str) -> str:
    """Reason that any message can hold: bounded, and valid UTF-8."""
    return " ".join(text.encode("utf-8", "replace").decode("utf-8").split())[:_LONGEST_REASON]
