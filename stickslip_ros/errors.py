# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The exceptions of the package: each message names the value and what would be right."""


class StickSlipError(Exception):
    """Base of every error that the package raises on purpose."""


class InvalidParameterError(StickSlipError, ValueError):
    """A parameter is outside the range in which the physics means something."""

    def __init__(self, name: str, requirement: str, value: object) -> None:
        self.name = name
        super().__init__(f"{name!r} must be {requirement}: {value}")


class UnknownJointError(StickSlipError, KeyError):
    """A joint name that is not there; the message lists those that are."""

    def __init__(self, name: str, known: list[str]) -> None:
        super().__init__(f"unknown joint {name!r}; known joints: {', '.join(sorted(known))}")

    def __str__(self) -> str:
        return str(self.args[0])


class JointFileError(StickSlipError, ValueError):
    """A joint file that cannot be read as a joint."""
