# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Text of others for people: what is no visible character is written as its code, so that it commands no terminal."""

from __future__ import annotations

from collections.abc import Sequence


def visible(text: str, *, kept: str = "") -> str:
    r"""The text, with ``\x1b``, ``\n`` or ``\u202e`` for characters that are not seen but do something.

    Parameters
    ----------
    kept : characters that stay as they are.
    """
    # Controls of terminals, what turns the direction of writing, separators, characters without a common meaning.
    if text.isprintable():
        return text
    return "".join(one if one in kept or one.isprintable() else _shown(one) for one in text)


def full_name(robot: str, joint: str) -> str:
    """A joint's name with that of its robot, which is "" where there is one only; visible."""
    return visible(f"{robot}/{joint}" if robot else joint)


def listed(names: Sequence[str], most: int) -> str:
    """So many of the names at most, for a sentence."""
    return f"{', '.join(names[:most])}{', …' if len(names) > most else ''}"


def _shown(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")
