# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The command `stickslip`: parses the arguments and calls one command.

Exit status: 0 done, 1 the command's own "no" (see its help), 2 bad usage or input; the reason is one
line on stderr.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import sys
from collections.abc import Container, Mapping, Sequence
from importlib import import_module
from types import MappingProxyType
from typing import Any, NamedTuple, NoReturn

import stickslip_ros
from stickslip_ros.errors import InvalidParameterError, StickSlipError, in_words
from stickslip_ros.interrupts import Interrupted, at_hard_end, check, take_signals
from stickslip_ros.visible import visible


class Command(NamedTuple):
    """A command: module of stickslip_ros.cli that is loaded for it, what it does, whether by compiled functions, and
    former names of its options, which go on working.
    """

    module: str
    summary: str
    compiled: bool = True
    former: Mapping[str, str] = MappingProxyType({})


_IDENTIFY = {"--on": "--joint", "--prior": "--model", "--largest-way": "--largest-distance"}
_STAMP = {"--start": "--first-stamp"}
_MODEL = {"--joint": "--model"}
_RESERVE = {"--wanted-margin": "--wanted-reserve"}
# Nothing else is loaded to name them.
COMMANDS = {
    "margin": Command("margin", "does this joint move smoothly at this speed, and by what margin?", former=_MODEL),
    "recommend": Command("recommend", "advise gains that make this joint move smoothly", former=_MODEL | _RESERVE),
    "reversal": Command(
        "reversal", "how long a joint stands, and how far it falls behind, where its motion reverses", former=_MODEL
    ),
    "analyze": Command("analyze", "detect stick-slip in recorded bags and advise gains"),
    "compare": Command("compare", "compare recordings from before and after a change: did it help?"),
    "identify": Command(
        "identify", "estimate a joint's inertia and friction from a recording or an experiment", former=_IDENTIFY
    ),
    "watch": Command("watch", "watch all joints live, in the terminal or a browser", compiled=False),
    "map": Command("stability_map", "draw the speeds and stiffnesses at which a joint sticks", former=_MODEL),
    "simulate": Command("simulate", "write a bag of simulated joints", former=_STAMP | _MODEL),
    "convert": Command("convert", "turn a table of samples into a bag", compiled=False, former=_STAMP),
    "figures": Command("figures", "draw the paper's figures, with their numbers"),
    "demo": Command(
        "demo", "detect, explain and cure stick-slip of a simulated joint, in half a minute", compiled=False
    ),
    "warm-up": Command("warm_up", "compile everything ahead, once after installation", compiled=False),
}

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_CURSOR_AND_EMPTY_LINE = b"\x1b[?25h\r\x1b[2K"
_OPTION, _NEGATIVE = re.compile(r"--[a-z][a-z-]*"), re.compile(r"-\.?\d")


_OTHER_SPELLINGS = {"analyse": "analyze"}
_EXAMPLES = "Examples:\n"  # what they begin with in the docstring of a command's module
# What argparse calls Python's types by their names.
_NO_NUMBER = {"invalid float value": "must be a number", "invalid int value": "must be a whole number"}


class _Paragraphs(argparse.HelpFormatter):
    """Wraps each paragraph by itself, and keeps the lines of the examples."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if text.startswith(_EXAMPLES):
            return text
        return "\n\n".join(super(_Paragraphs, self)._fill_text(part, width, indent) for part in text.split("\n\n"))


class _Parser(argparse.ArgumentParser):
    former: Mapping[str, str] = MappingProxyType({})

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        words = (word.partition("=") for word in args)
        return super().parse_known_args(
            ["".join((self.former.get(name, name), *more)) for name, *more in words], namespace
        )

    def error(self, message: str) -> NoReturn:
        for words, ours in _NO_NUMBER.items():
            message = message.replace(words, ours, 1)
        print(visible(f"{self.prog}: {message} (see {self.prog} --help)"), file=sys.stderr)
        raise SystemExit(2)


def build_parser(chosen: Container[str] = COMMANDS) -> argparse.ArgumentParser:
    """The parser of all commands, with the arguments of those that are chosen."""
    parser = _Parser(prog="stickslip", description="Stick-slip of robot joints: detection, margin, gains that cure it.")
    parser.add_argument("--version", action="version", version=stickslip_ros.__version__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Parser)
    for name, command in COMMANDS.items():
        if name not in chosen:
            commands.add_parser(name, help=command.summary)
            continue
        module = import_module(f"stickslip_ros.cli.{command.module}")
        description, heading, examples = (module.__doc__ or "").partition(_EXAMPLES)
        own = commands.add_parser(
            name, help=command.summary, description=description.strip(), epilog=heading + examples,
            formatter_class=_Paragraphs,
        )  # fmt: skip
        own.former = command.former
        module.add_arguments(own)
        own.set_defaults(run=module.run, compiled=command.compiled)
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run one command; returns its exit status. Without arguments it is the process's, and takes its signals."""
    if arguments is None:
        # What is ignored, as by nohup, stays so.
        take_signals([number for number in _SIGNALS if signal.getsignal(number) != signal.SIG_IGN])
        at_hard_end(_give_back_terminal)
    given = _with_negative_values(sys.argv[1:] if arguments is None else arguments)
    if not given:
        build_parser(()).print_help(sys.stderr)
        return 2
    given[0] = _OTHER_SPELLINGS.get(given[0], given[0])
    try:
        options = build_parser(given[:1]).parse_args(given)
        check()
        if options.compiled:
            _compile()
        return _run(options)
    except BrokenPipeError:
        # As of a command that SIGPIPE ended: its own status is not known, and 0 would be an all-clear.
        return 128 + signal.SIGPIPE
    except (StickSlipError, OSError) as error:
        from stickslip_ros.cli.terminal import complain

        complain(in_words(error))
        return 2
    except Interrupted as interrupted:
        return interrupted.status


def _give_back_terminal() -> None:
    """What draws a status hides the cursor meanwhile."""
    if os.isatty(2):
        os.write(2, _CURSOR_AND_EMPTY_LINE)


def _with_negative_values(given: Sequence[str]) -> list[str]:
    """Arguments in which `--gains -630,0` is `--gains=-630,0`: argparse takes it for two options."""
    found: list[str] = []
    for word in given:
        if found and _NEGATIVE.match(word) and _OPTION.fullmatch(found[-1]):
            found[-1] += f"={word}"
        else:
            found.append(word)
    return found


def _compile() -> None:
    """Compile what is not compiled yet, with a line about it where somebody looks."""
    from stickslip_ros.compilation import cache_folder, without_linear_algebra
    from stickslip_ros.warm_up import is_warm

    without_linear_algebra()
    # Where it cannot be kept, a command compiles what it calls itself.
    if cache_folder().permanent and not is_warm():
        from stickslip_ros.cli.warm_up import compile_and_say

        compile_and_say()


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
