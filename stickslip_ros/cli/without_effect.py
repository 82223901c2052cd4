# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Options that have no effect beside the others are refused: who gave them believes that they have one."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import dataclass

from stickslip_ros.errors import StickSlipError
from stickslip_ros.model.friction import Friction


@dataclass(frozen=True, kw_only=True)
class Need:
    """What some options need to have an effect.

    Attributes
    ----------
    options : that need it; without the dashes, words joined by underscores. met : whether it is there.
    text : what it is, for a person: "needs …".
    """

    options: tuple[str, ...]
    met: bool
    text: str


def refuse_without_effect(options: argparse.Namespace, needs: Iterable[Need]) -> None:
    """Refuse options that were given and have no effect; None and False are what nobody gave.

    Raises
    ------
    StickSlipError
        The text names the option, and what it needs.
    """
    for need in needs:
        for name in need.options:
            given = getattr(options, name)
            if not need.met and given is not None and given is not False:
                raise StickSlipError(f"--{name.replace('_', '-')} has no effect here: it needs {need.text}")


def contact_need(friction: Friction) -> Need:
    """Of the options of a joint: a rigid contact has no damping, and does not yield."""
    return Need(
        options=("contact", "presliding_damping"),
        met=not friction.rigid,
        text="a finite --presliding-stiffness, or a --model that has one",
    )
