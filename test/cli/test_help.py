# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 40, item 6: what somebody sees who types the name of the program, or of a command, for the first time."""

from __future__ import annotations

import shlex

import pytest

from stickslip_ros.cli.main import COMMANDS, build_parser, main


def _help(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    with pytest.raises(SystemExit) as end:
        main([*words, "--help"])
    assert end.value.code == 0
    return capsys.readouterr().out


def test_without_a_command_the_commands_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    """It is no answer to a question, so that the exit status is that of bad usage, and stdout is empty."""
    assert main([]) == 2
    shown = capsys.readouterr()
    assert not shown.out
    assert all(f"\n    {name}" in shown.err for name in COMMANDS)


def test_british_spelling_of_analyze(capsys: pytest.CaptureFixture[str]) -> None:
    """`stickslip analyse` is `stickslip analyze`; the list of commands has one of them."""
    assert _help(capsys, "analyse") == _help(capsys, "analyze")
    assert "analyse " not in _help(capsys)


@pytest.mark.parametrize("command", COMMANDS)
def test_each_help_has_two_examples_that_parse(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    """They stand at the end, each whole on a line of its own."""
    _, _, examples = _help(capsys, command).partition("\nExamples:\n")
    lines = examples.strip().splitlines()
    assert len(lines) == 2
    for line in lines:
        words = shlex.split(line)
        assert words[:2] == ["stickslip", command]
        build_parser(words[1:2]).parse_args(words[1:])


def test_paragraphs_of_a_help_stay_apart(capsys: pytest.CaptureFixture[str]) -> None:
    """The first sentence says what a command does; what follows is not run into it."""
    assert "needed.\n\nA bag is" in _help(capsys, "analyze")
