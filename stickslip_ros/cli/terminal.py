# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Where commands print: names and messages of others appear as they are, and command no terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from stickslip_ros.visible import visible

_OF_LAYOUT = "\n"  # by which tables and paragraphs are made


class Terminal(Console):
    """A rich console whose texts hold no control characters but the ends of lines; what rich adds itself stays."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """See :meth:`rich.console.Console.render`."""
        for segment in super().render(renderable, options):
            if segment.control:
                yield segment
            else:
                yield Segment(visible(segment.text, kept=_OF_LAYOUT), segment.style)


def complain(text: str) -> None:
    """Say in one line on stderr what is wrong."""
    print(f"stickslip: {visible(text)}", file=sys.stderr)
