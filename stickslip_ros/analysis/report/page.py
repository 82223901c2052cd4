# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A page with plots as one HTML file that needs nothing else: no network, no server."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

import stickslip_ros
from stickslip_ros.errors import StickSlipError
from stickslip_ros.files import write_whole

# Where a figure goes; no name in a page can be mistaken for it, since names are escaped.
_PLACE = "<!--plot-->"
YEAR_2001 = 978_307_200.0  # [s] stamps before it are no dates


def write_page(path: Path, title: str, body: str, figures: Sequence[Any]) -> None:
    """Write a page; ``body`` holds a place for each figure, in order. Nothing is there before it is whole.

    Raises
    ------
    StickSlipError
        If the package bokeh is missing.
    OSError
        If it cannot be written.
    """
    try:
        from bokeh.embed import components
        from bokeh.resources import Resources
    except ImportError as error:
        raise StickSlipError(f"a report needs the package {error.name}: pip install bokeh") from error
    script, divs = components(tuple(figures)) if figures else ("", ())
    for div in divs:
        body = body.replace(_PLACE, div, 1)
    library = "\n".join(Resources(mode="inline", components=["bokeh"]).js_raw) if figures else ""
    folder = resources.files("stickslip_ros.analysis.report").joinpath("static")
    style, own = (folder.joinpath(name).read_text(encoding="utf-8") for name in ("style.css", "page.js"))
    scripts = f"<script>{library}</script>\n{script}\n<script>{own}</script>" if figures else ""
    page = f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta name="generator" content="stickslip_ros {stickslip_ros.__version__}">
<link rel="icon" href="data:,">
<title>{escape(title)}</title>
<style>{style}</style>
</head>
<body>
{body}
<footer class="faint">Made by stickslip_ros {stickslip_ros.__version__}, after B. Armstrong-Hélouvry, “Stick Slip and
Control in Low-Speed Motion”, IEEE Transactions on Automatic Control 38(10), 1993. Times are of the messages’ own
stamps.</footer>
{scripts}
</body>
</html>
"""
    write_whole(path, page)


def drawn(title: str, caption: str) -> str:
    """The place of a figure, with what it shows in words."""
    return (
        f"<figure><h3>{escape(title)}</h3><div class='plot' role='img' aria-label='{escape(caption)}'>{_PLACE}</div>"
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def anchor(name: str) -> str:
    """What a section of any name is linked to by."""
    return "joint-" + "".join(one if one.isalnum() else f"-{ord(one):x}-" for one in name)
