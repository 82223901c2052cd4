# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Text of others for people: what is no visible character is written as its code, so that it commands no terminal."""

from __future__ import annotations

import unicodedata

# Controls (of terminals), formats (which turn the direction of writing), surrogates, separators of lines.
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})


def visible(text: str, *, kept: str = "") -> str:
    r"""The text, with ``\x1b``, ``\n`` or ``\u202e`` for characters that are not seen but do something.

    Parameters
    ----------
    kept : characters that stay as they are.
    """
    # Most texts are plain, and asked for often.
    if text.isascii() and text.isprintable():
        return text
    return "".join(_shown(one) if one not in kept and unicodedata.category(one) in _HIDDEN else one for one in text)


def _shown(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")
