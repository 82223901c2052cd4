# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Sphinx: `make docs` builds docs/ into docs/_build/html, and any warning is an error."""

from __future__ import annotations

import re
from collections.abc import Iterator

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

import stickslip_ros

project = "stickslip_ros"
author = "The stickslip_ros developers"
copyright = f"2026, {author}"  # noqa: A001
version = release = stickslip_ros.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
myst_enable_extensions = ["dollarmath", "colon_fence"]
exclude_patterns = ["_build"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
autodoc_typehints_format = "short"
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False  # they stand in the signature

html_theme = "furo"
html_title = f"stickslip_ros {version}"
html_copy_source = False
html_math_renderer = "mathml"

_ENTRY = re.compile(r"[a-z]\w*(?:, [a-z]\w*)* : ")
_NEXT_ENTRY = re.compile(r"[;,.] (?=[a-z]\w*(?:, [a-z]\w*)* : )")


def _tidy(_app: Sphinx, _what: str, _name: str, _object: object, _options: object, lines: list[str]) -> None:
    """Docstrings of this project as numpydoc wants them: after the colon stands no type, but what it is.

    Several entries may share a line there, and bars are absolute values, not substitutions.
    """
    text = "\n".join(lines).replace("|", "\\|")
    lines[:] = "\n".join(_section(part) for part in re.split(r"\n(?=\w+\n-{3,}\n)", text)).split("\n")


def _section(text: str) -> str:
    heading = re.match(r"(?:Parameters|Attributes)\n-+\n", text)
    if heading is None:
        return text
    body, _, rest = text[heading.end() :].partition("\n\n")
    return heading.group() + "\n".join(_entries(body)) + ("\n\n" + rest if rest else "\n")


def _entries(body: str) -> Iterator[str]:
    for entry in re.split(r"\n(?=\S)", body):
        for part in _NEXT_ENTRY.split(" ".join(entry.split())):
            if _ENTRY.match(part):
                name, _, meaning = part.partition(" : ")
                yield f"{name}\n    {meaning}"
            else:
                yield part


def _mathml(translator: HTML5Translator, node: nodes.math | nodes.math_block) -> None:
    """Mathematics that browsers draw by themselves, so that pages need no network."""
    block = isinstance(node, nodes.math_block)
    latex, _, tag = node.astext().partition("\\tag")
    number = f'<span style="float:right">({tag.strip(" {}")})</span>' if tag else ""
    drawn = convert(latex.strip(), display="block" if block else "inline")
    translator.body.append(f'<div class="math">{number}{drawn}</div>' if block else drawn)
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Sphinx calls this."""
    app.connect("autodoc-process-docstring", _tidy, priority=100)
    app.add_html_math_renderer("mathml", (_mathml, None), (_mathml, None))
