# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 22, item 5: outputs are checked before the work, and nothing that was worked out is lost to a late error."""

from __future__ import annotations

import argparse
import importlib
import json
from pathlib import Path
from typing import Any

import pytest
from bags.support_bags import simulated_bag, write_mcap

from stickslip_ros.cli import analyze as analyze_command
from stickslip_ros.cli.main import COMMANDS, build_parser, main
from stickslip_ros.cli.options import OutputFile, output_bag, output_folder
from stickslip_ros.files import write_whole

FUNCTIONS = (output_folder, output_bag)
# Options and arguments that are paths, and are read.
READ = {"trajectory", "bags", "before", "after", "parameters"}


def actions(command: str) -> list[argparse.Action]:
    """What the parser of a command takes."""
    commands = next(one for one in build_parser()._actions if isinstance(one, argparse._SubParsersAction))
    return list(commands.choices[command]._actions)


OUTPUTS = [
    (command, action.option_strings[0], action.type)
    for command in COMMANDS
    for action in actions(command)
    if isinstance(action.type, OutputFile) or action.type in FUNCTIONS
]
IDS = [f"{command} {option}" for command, option, _ in OUTPUTS]


def refusal(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """What a command says that is refused before it begins."""
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    return captured.err


def test_every_output_is_of_a_kind_that_is_checked() -> None:
    """No option that names a file or folder is without a check, but for those that are read."""
    for command in COMMANDS:
        for action in actions(command):
            unchecked = action.type is Path or (
                action.type is None and action.dest in ("out", "html", "csv", "table", "results")
            )
            assert not unchecked or action.dest in READ, f"{command} {action.option_strings or action.dest}"
    assert {option for _, option, _ in OUTPUTS} >= {"--out", "--html", "--csv", "--table", "--results"}
    assert len(OUTPUTS) >= 11


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The commands whose work was begun."""
    found: list[str] = []
    for name, command in COMMANDS.items():
        module = importlib.import_module(f"stickslip_ros.cli.{command.module}")

        def run(_: argparse.Namespace, name: str = name) -> int:
            found.append(name)
            return 0

        monkeypatch.setattr(module, "run", run)
    monkeypatch.setattr("stickslip_ros.cli.main._compile", lambda: None)
    return found


def arguments(command: str, option: str, path: Path) -> list[str]:
    """A command with this output, and what it needs besides."""
    needed = {"analyze": ["x.mcap"], "convert": ["x.csv"], "compare": ["a.mcap", "b.mcap"]}
    return [command, *needed.get(command, []), option, str(path)]


def right_name(kind: Any) -> str:
    return "new" if kind is output_folder else "new.mcap" if kind is output_bag else f"new{kind.endings[0]}"


@pytest.mark.parametrize(("command", "option", "kind"), OUTPUTS, ids=IDS)
def test_what_cannot_be_written_is_refused_before_the_work(
    command: str, option: str, kind: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str], begun: list[str]
) -> None:
    """A folder that is not there, a file in its place, no permission, another ending: one sentence with the option."""
    name = right_name(kind)
    (tmp_path / "file").write_text("")
    # Nobody, root neither, makes files there.
    wrong = [tmp_path / "file" / name, Path("/proc/self/fd") / name]
    if kind is not output_folder:
        (tmp_path / f"folder{Path(name).suffix}").mkdir()
        wrong += [tmp_path / f"folder{Path(name).suffix}", tmp_path / "missing" / name, tmp_path / "a.xlsx"]
    else:
        wrong += [tmp_path / "file"]
    for path in wrong:
        said = refusal(arguments(command, option, path), capsys)
        assert said.startswith(f"stickslip {command}: argument {option}: ")
        assert str(path) in said
        assert "[Errno" not in said
        assert ".part" not in said
        assert said.count("\n") == 1
    assert not begun
    assert main(arguments(command, option, tmp_path / name)) == 0
    assert begun == [command]
    assert sorted(path.name for path in tmp_path.iterdir() if not path.is_dir()) == ["file"]


def test_what_would_be_right_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A spreadsheet for a table, a missing folder, another bag format."""
    said = refusal(["analyze", "x.mcap", "--table", "x.xlsx"], capsys)
    assert "argument --table: must end in .csv or .parquet: 'x.xlsx'" in said
    missing = tmp_path / "missing" / "x.mcap"
    assert f"argument --out: must be in a folder that exists: '{missing}'" in refusal(
        ["simulate", "--out", str(missing)], capsys
    )
    for name in ("x.db3", "x.bag", "x.csv"):
        said = refusal(["convert", "x.csv", "--out", name], capsys)
        assert f"argument --out: must end in .mcap, or name a new folder: '{name}'" in said


def test_no_input_is_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Neither a bag that is read nor what another option writes."""
    bag = simulated_bag(tmp_path / "x.mcap", duration=1.0)
    before = bag.read_bytes()
    assert main(["analyze", str(bag), "--out", str(bag)]) == 2
    assert "'--out' must be another file than the recording" in capsys.readouterr().err
    assert bag.read_bytes() == before
    table = str(tmp_path / "x.csv")
    assert main(["analyze", str(bag), "--csv", table, "--table", table]) == 2
    assert "'--table' must be another file than that of --csv" in capsys.readouterr().err


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated_bag(tmp_path_factory.mktemp("bag") / "x.mcap", names=("shoulder", "elbow"), duration=4.0)


def full_disk(*_: object, **__: object) -> None:
    raise OSError(28, "No space left on device")


@pytest.mark.parametrize(
    ("option", "name", "function"),
    [("--csv", "x.csv", "write_cycles"), ("--table", "x.csv", "write_table"), ("--html", "x.html", "write_report")],
)
def test_a_late_error_takes_only_its_own_file(
    option: str, name: str, function: str, bag: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """The disk is full when a file is written: the table is printed, the others are written, a sentence says which."""
    monkeypatch.setattr(analyze_command, function, full_disk)
    others = {"--csv": "cycles.csv", "--table": "joints.csv", "--html": "page.html"}
    others[option] = name
    outputs = [word for one, file in others.items() for word in (one, str(tmp_path / file))]
    assert main(["analyze", str(bag), "--no-learning", *outputs]) == 2
    captured = capsys.readouterr()
    assert "shoulder" in captured.out
    assert captured.err == f"stickslip: {option} {tmp_path / name} was not written: no space left on device\n"
    written = {path.name for path in tmp_path.iterdir()}
    assert written == set(others.values()) - {name}


@pytest.mark.parametrize("when", ["a message", "the end"])
def test_annotations_that_cannot_be_written_take_no_answer(
    when: str, bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The disk is full in the middle of --out, or at its end: the answer is there, and no half of a bag."""
    monkeypatch.setattr(f"mcap.writer.Writer.{'add_message' if when == 'a message' else 'finish'}", full_disk)
    out = tmp_path / "out.mcap"
    assert main(["analyze", str(bag), "--no-learning", "--json", "--out", str(out)]) == 2
    captured = capsys.readouterr()
    assert list(json.loads(captured.out)["bags"][0]["joints"]) == ["shoulder", "elbow"]
    assert captured.err == f"stickslip: --out {out} was not written: no space left on device\n"
    assert not list(tmp_path.iterdir())


def test_errors_of_files_are_sentences(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No number of the system's, no name of a part: the file that was meant, and the reason."""
    with pytest.raises(OSError, match="No such file") as raised:
        write_whole(tmp_path / "missing" / "x.txt", "")
    assert raised.value.filename == str(tmp_path / "missing" / "x.txt")
    for command, what in (
        (["analyze", "x.mcap", "--parameters"], "parameter file "),
        (["margin", "--model"], "joint file "),
        (["convert", "--out", str(tmp_path / "x.mcap")], "recording "),
    ):
        missing = tmp_path / ("missing.csv" if command[0] == "convert" else "missing.yaml")
        assert main([*command, str(missing)]) == 2
        assert capsys.readouterr().err == f"stickslip: {what}{missing}: no such file or directory\n"


@pytest.mark.parametrize(
    ("option", "meant"),
    [
        ("--gains=sholder=630,12", "; did you mean 'shoulder'?"),
        ("--model=elbw=puma560_joint1", "; did you mean 'elbow'?"),
        ("--gains=wrist=630", ""),
    ],
)
def test_joints_that_are_in_no_bag(
    option: str, meant: str, bag: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """A joint of `--gains` or `--model` that is nowhere is an error, with the name that was probably meant."""
    name = option.split("=")[1]
    typed = option.replace("=", " ", 1)
    assert main(["analyze", str(bag), option]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    said = f"stickslip: {typed}: no joint '{name}' in the bag{meant}; joints there: elbow, shoulder\n"
    assert captured.err == said
    # In one of several bags it is no error.
    other = simulated_bag(tmp_path / "y.mcap", names=(name,), duration=1.0, with_gains=False)
    assert main(["analyze", str(bag), str(other), option, "--no-learning", "--json"]) == 0


def test_names_are_no_matter_where_no_bag_is_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of a bag that cannot be read that is said, and not that it has no such joint."""
    empty = write_mcap(tmp_path / "x.mcap", [])
    assert main(["analyze", str(empty), "--gains", "a=630"]) == 2
    said = capsys.readouterr().err
    assert "no joint 'a'" not in said
    assert str(empty) in said


@pytest.mark.parametrize("text", ["-630,0", "-.5", "630,-12"])
def test_negative_gains_are_no_options(text: str, bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`--gains -630,0` is read as gains, and refused as such."""
    assert main(["analyze", str(bag), "--gains", text]) == 2
    said = capsys.readouterr().err
    assert "expected one argument" not in said
    assert "'--gains' must be finite and >= 0" in said
    assert text in said


@pytest.mark.parametrize("value", ["-0.008", "-8e-3"])
def test_negative_numbers_are_no_options(value: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Neither with an exponent, which argparse takes for an option."""
    assert main(["margin", "--model", "puma560_joint1", "--velocity", value]) == 0
    assert "At -0.008 rad/s" in capsys.readouterr().out
