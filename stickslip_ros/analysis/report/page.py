# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A page with plots as one HTML file that needs nothing else: no network, no server."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import stickslip_ros
from stickslip_ros.analysis.words import percent
from stickslip_ros.files import write_whole
from stickslip_ros.model.compensation_effect import CompensationEffect
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.output.wording import OUTCOME_TEXTS, counted, status_words
from stickslip_ros.visible import visible

_OF_LAYOUT = "\n\t"
_NOT_ASCII = re.compile(rf"[^ -~{_OF_LAYOUT}]")  # all that may be invisible


@dataclass(frozen=True, eq=False)
class Plot:
    """A figure with what it shows in words, for those who do not see it; a wide one has the page's width."""

    figure: Any
    title: str
    caption: str
    wide: bool = False


def write_page(path: Path, template: str, plots: Sequence[Plot], *, own_script: str = "", **values: Any) -> None:
    """Write a page; nothing is there before it is whole.

    Parameters
    ----------
    template : name of a file in the folder of templates. plots : all that it draws. values : what else it names.
    own_script : name of a file in the folder of static ones, that this page has beside every page's.

    Raises
    ------
    ImportError
        If the package bokeh is missing, or jinja2, which it brings.
    OSError
        If it cannot be written.
    """
    from bokeh.document import Document
    from bokeh.embed import components
    from bokeh.resources import Resources
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    figures, document = [plot.figure for plot in plots], Document()
    # Once for all: each figure that is added alone has bokeh search all that were added before.
    with document.models.freeze():
        for figure in figures:
            document.add_root(figure)
    script, divs = components(figures) if plots else ("", ())
    library = "\n".join(Resources(mode="inline", components=["bokeh"]).js_raw) if plots else ""
    scripts = ("page.js", own_script) if own_script else ("page.js",)
    style, *own = map(static_text, ("style.css", *scripts))
    environment = Environment(
        loader=PackageLoader("stickslip_ros.analysis.report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
        finalize=_visible,
    )
    environment.filters |= {
        "number": number_text,
        "counted": counted,
        "words": status_words,
        "anchor": _anchor,
        "percent": percent_text,
        "outcome": _outcome,
        "svg": Markup,
    }
    environment.tests["finite"] = math.isfinite
    joined = "\n".join(own)
    # The marked ones are this package's own, and bokeh's; all else is escaped.
    page = environment.get_template(template).render(
        version=stickslip_ros.__version__,
        style=Markup(style),
        scripts=Markup(f"<script>{library}</script>\n{_escaped(script)}\n<script>{joined}</script>" if plots else ""),
        divs={plot: Markup(div) for plot, div in zip(plots, divs, strict=True)},
        **values,
    )
    write_whole(path, page)


def static_text(name: str) -> str:
    """A style or a script of the pages, by the name of its file."""
    return (
        resources.files("stickslip_ros.analysis.report").joinpath("static").joinpath(name).read_text(encoding="utf-8")
    )


def number_text(value: float | None, form: str = ".3g", unit: str = "") -> str:
    """A number as the pages write it, zero without a sign; a dash where it is unknown."""
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{float(value):{form}}"
    return f"{text if float(text) else text.lstrip('+-')}{unit}"


def _outcome(exact: ExactVerdict | CompensationEffect) -> str:
    return "–" if exact.outcome is None else OUTCOME_TEXTS[exact.outcome]


def percent_text(share: float | None) -> str:
    """A share in per cent, as the pages write it; a dash where it is unknown."""
    return percent(math.nan if share is None else share).replace("-", "–")


def _anchor(name: str) -> str:
    """What a section of any name is linked to by."""
    return "joint-" + "".join(one if one.isalnum() else f"-{ord(one):x}-" for one in name)


def _visible(value: Any) -> Any:
    """What others named, as it may stand on a page; what is marked is this package's own."""
    return visible(value, kept=_OF_LAYOUT) if type(value) is str else value


def _escaped(script: str) -> str:
    """A script whose strings have escapes for what is not seen."""
    return _NOT_ASCII.sub(lambda found: one if (one := found[0]).isprintable() else f"\\u{ord(one):04x}", script)
