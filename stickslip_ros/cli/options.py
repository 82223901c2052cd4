# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Options that many commands have, in one form; and those that have no effect beside the others, which are refused: who
gave them believes that they have one.

Every option that names an output is of one of the types here, checked before any work is done. A type is called by
argparse while it reads the options; what it refuses is said with the option's name.
"""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from stickslip_ros.errors import InvalidParameterError, StickSlipError, optional_packages, reason
from stickslip_ros.files import check_writable

# What looks like the ending of a file: a folder of that name was hardly meant.
_ENDING = re.compile(r"\.[A-Za-z][A-Za-z0-9]{0,6}$")
_BAG_FILE = ".mcap"


def add_option(group: Any, name: str, metavar: str | None, text: str, default: Any = None, **more: Any) -> None:
    """Add an option that takes a value; its help ends with the default, if it has one. ``more`` is argparse's."""
    shown = " (default: %(default)s)" if default else ""
    group.add_argument(name, metavar=metavar, default=default, help=f"{text}{shown}", **more)


def add_repeated(group: Any, name: str, metavar: str, text: str, **more: Any) -> None:
    """Add an option that may be given several times; what was given is a list."""
    add_option(group, name, metavar, text, [], action="append", **more)


def add_number(group: Any, name: str, metavar: str, text: str, default: float | None = None) -> None:
    """Add an option that takes a number; its help ends with the default, where that is a finite number."""
    shown = "" if default is None or not math.isfinite(default) else f" (default: {default:g})"
    group.add_argument(name, type=float, metavar=metavar, default=default, help=f"{text}{shown}")


def add_flag(group: Any, name: str, text: str) -> None:
    """Add an option without a value."""
    group.add_argument(name, action="store_true", help=text)


def add_json(group: Any) -> None:
    """Add ``--json``."""
    add_flag(group, "--json", "print one JSON object and nothing else")


def option_of(name: str) -> str:
    """An option as it is typed, by its name among the values that were read."""
    return f"--{name.replace('_', '-')}"


def refuse_given(options: argparse.Namespace, defaults: Mapping[str, Any], rule: str) -> None:
    """Refuse options with another value than their default, which are here by their names; ``rule``: what they must be,
    such as left out.
    """
    for name, default in defaults.items():
        if (given := getattr(options, name)) != default:
            raise InvalidParameterError(option_of(name), rule, given)


def refuse_without_effect(options: argparse.Namespace, *names: str, met: bool, needs: str) -> None:
    """Refuse options that were given and have no effect, for what they need is not there; None and False are what
    nobody gave.

    Parameters
    ----------
    met : whether what they need is there. needs : what that is, for a person.
    """
    for name in names:
        given = getattr(options, name)
        if not met and given is not None and given is not False:
            raise StickSlipError(f"{option_of(name)} has no effect here: it needs {needs}")


@dataclass(frozen=True, eq=False)  # argparse looks types up by their hash
class OutputFile:
    """A file in a folder that is there.

    Attributes
    ----------
    endings : that its name may have. packages : that an ending needs.
    new : whether it must not be there yet.
    """

    endings: tuple[str, ...]
    packages: Mapping[str, str] = field(default_factory=dict)
    new: bool = False

    def __call__(self, text: str) -> Path:
        """The path; refused is what cannot be written."""
        path = Path(text)
        if path.suffix not in self.endings:
            raise argparse.ArgumentTypeError(f"must end in {_either(self.endings)}: {text!r}")
        if path.suffix in self.packages:
            with optional_packages(f"a {path.suffix} file"):
                import_module(self.packages[path.suffix])
        if path.is_dir():
            raise argparse.ArgumentTypeError(f"must be a file: {text!r} is a folder")
        if self.new and path.exists():
            raise argparse.ArgumentTypeError(f"must be a new file: {text!r} is there already")
        # Where it is a link, what it leads to is written.
        _require_writable(Path(os.path.realpath(path)), text)
        return path


def output_folder(text: str) -> Path:
    """A folder, which is made if it is not there; refused is what cannot be written."""
    path = Path(text)
    if not text:
        raise argparse.ArgumentTypeError("must name a folder: ''")
    if path.exists() and not path.is_dir():
        raise argparse.ArgumentTypeError(f"must be a folder: {text!r} is a file")
    _require_writable(_nearest(path) / "file", text)
    return path


def output_bag(text: str) -> Path:
    """A bag: a file that ends in .mcap, or a new folder; refused is what cannot be written."""
    path = Path(text)
    if path.suffix == _BAG_FILE:
        return OutputFile((_BAG_FILE,))(text)
    rule = f"must end in {_BAG_FILE}, or name a new folder: {text!r}"
    if not path.name or _ENDING.search(path.name):
        raise argparse.ArgumentTypeError(rule)
    if path.exists():
        raise argparse.ArgumentTypeError(f"{rule} is there already")
    _require_writable(_nearest(path) / "file", text)
    return path


PAGE = OutputFile((".html", ".htm"), {".html": "bokeh", ".htm": "bokeh"})
CSV = OutputFile((".csv",))
TABLE = OutputFile((".csv", ".parquet"), {".parquet": "pyarrow"})
PICTURE = OutputFile((".png",))
COMPENSATION = OutputFile((".csv", ".yaml"))
TRAJECTORY = OutputFile((".yaml",))
DRAWING = OutputFile((".png", ".svg", ".pdf"))
JOINT_FILE = OutputFile((".yaml", ".yml"), new=True)


def add_bag_output(parser: argparse.ArgumentParser) -> None:
    """The bag that a command writes, and the option read by :func:`refuse_to_overwrite`."""
    add_option(parser, "--out", "BAG", "a file that ends in .mcap, or a new folder", type=output_bag, required=True)
    add_flag(parser, "--force", "overwrite an existing file")


def refuse_to_overwrite(options: argparse.Namespace) -> None:
    """Refuse a bag that is there, unless that is wanted.

    Raises
    ------
    InvalidParameterError
        If it is there; the text names the option.
    """
    if options.out.exists() and not options.force:
        rule = "a new file, or --force given to write over it"
        raise InvalidParameterError("--out", rule, f"{options.out} is there already")


def refuse_inputs(outputs: Mapping[str, Path | None], inputs: Iterable[Path]) -> None:
    """Refuse to write over what is read, or one output over another.

    Parameters
    ----------
    outputs : by option.

    Raises
    ------
    InvalidParameterError
        If a path is one of the inputs, or of two options; the text names the option.
    """
    read = [one for one in inputs if one.exists()]
    taken: dict[Path, str] = {}
    for option, path in outputs.items():
        if path is None:
            continue
        if path.exists() and any(path.samefile(one) for one in read):
            raise InvalidParameterError(option, "another file than the recording", path)
        other = taken.setdefault(path.resolve(), option)
        if other != option:
            raise InvalidParameterError(option, f"another file than that of {other}", path)


def _nearest(path: Path) -> Path:
    """The folder that is there in which a path, and the folders above it, are to be made."""
    return next(one for one in (path.absolute(), *path.absolute().parents) if one.exists())


def _require_writable(path: Path, text: str) -> None:
    folder = path.parent
    if not folder.exists():
        raise argparse.ArgumentTypeError(f"must be in a folder that exists: {text!r}; there is no {str(folder)!r}")
    if not folder.is_dir():
        raise argparse.ArgumentTypeError(f"must be in a folder: {text!r}; {str(folder)!r} is a file")
    try:
        check_writable(path)
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{text!r} cannot be written: {str(folder)!r}: {reason(error)}") from error


def _either(words: tuple[str, ...]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"
