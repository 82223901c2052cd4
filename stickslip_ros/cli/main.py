# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The command `stickslip`: parses the arguments and calls one command.

Exit status: 0 done, 1 the command's own "no" (see its help), 2 bad usage or input; the reason is one
line on stderr.
"""

from __future__ import annotations

import argparse
import sys
from typing import NoReturn

import stickslip_ros
from stickslip_ros.cli import (
    analyze,
    convert,
    demo,
    figures,
    identify,
    margin,
    recommend,
    simulate,
    stability_map,
    watch,
)
from stickslip_ros.errors import InvalidParameterError, StickSlipError

_COMMANDS = (margin, recommend, analyze, identify, watch, stability_map, simulate, convert, figures, demo)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        print(f"{self.prog}: {message} (see {self.prog} --help)", file=sys.stderr)
        raise SystemExit(2)


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    parser = _Parser(prog="stickslip", description="Stick slip of robot joints: detection, margin, gains that cure it.")
    parser.add_argument("--version", action="version", version=stickslip_ros.__version__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Parser)
    for command in _COMMANDS:
        command.add_parser(commands)
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run one command; returns its exit status."""
    options = build_parser().parse_args(arguments)
    try:
        return _run(options)
    except BrokenPipeError:
        return 0
    except (StickSlipError, OSError) as error:
        print(f"stickslip: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _run(options: argparse.Namespace) -> int:
    """Run a command; what it refuses has the names of the options that were typed."""
    try:
        return int(options.run(options))
    except InvalidParameterError as error:
        # Of a field that is no option of the same name, the command tells which options it is made of.
        names = getattr(options, "made_of", {}).get(error.name)
        if names is None and getattr(options, error.name, None) is not None:
            names = (f"--{error.name.replace('_', '-')}",)
        raise error.as_typed(names) if names else error from error


if __name__ == "__main__":
    raise SystemExit(main())
