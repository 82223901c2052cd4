# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 22: every option of every command is given bad values: each is refused in a sentence that names what was typed.

`python test/cli/test_every_error.py` prints all of them, to be read as one page.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from stickslip_ros.bags.simulated import RecordedJoint, write_simulation
from stickslip_ros.cli.main import build_parser, main
from stickslip_ros.cli.options import OutputFile, output_bag, output_folder
from stickslip_ros.settings.known_joints import load_joint

_JOINT = ["--model=puma560_joint1"]
# What makes a command right but for the option in question; {bag} is a recording, {table} a table.
_OTHERWISE = {
    "margin": _JOINT,
    "recommend": _JOINT,
    # Its contact is elastic, so that all options of the contact have an effect.
    "reversal": [*_JOINT, "--amplitude=0.01", "--frequency=0.1", "--presliding-stiffness=1e6"],
    "map": [*_JOINT, "--out=map.png"],
    "analyze": ["{bag}"],
    "compare": ["{bag}", "{bag}"],
    "identify": ["{bag}"],
    "watch": ["--once", "--patience=0.01"],
    "simulate": ["--out=simulated.mcap", "--duration=1"],
    "convert": ["{table}", "--out=converted.mcap"],
    "figures": ["1"],
    "demo": [],
    "warm-up": [],
}
_NUMBERS = ("nan", "inf", "-1", "many")
_TEXTS = ("", "no/such", "nonsense,")
# Values that mean something: a negative gain or speed, no bound, no topic, a name that anything may have.
_RIGHT: dict[str, tuple[str, ...]] = {
    "--stiffness": ("-1",), "--damping": ("-1",), "--integral": ("-1",), "--velocity": ("-1",), "--load": ("-1",),
    "--end": ("inf",), "--largest-stiffness": ("inf",), "--largest-damping": ("inf",),
    "--largest-damping-ratio": ("inf",), "--bandwidth": ("inf",), "--effort": ("inf",),
    "--presliding-stiffness": ("inf",), "--references": ("",), "--gains-topic": ("",),
    "--joint": ("",), "--model": ("",),
    "--controller": _TEXTS, "--names": _TEXTS, "--name": _TEXTS, "--what-if": ("",),
    "--simulated": ("",), "--speeds": ("",), "--recording": ("",),
}  # fmt: skip
# What is right elsewhere: an unstable joint does not follow a reference.
_WRONG_HERE = {("reversal", "--integral"): ("-1",)}
# Refused by these names rather than by the option's.
_OTHER_NAMES = (
    "unknown joint",
    "no recording begins with",
    "no samples of joint",
    "parameter file",
    "--column",
    "Dask",
)
_UGLY = ("Errno", "Traceback", "<class", " object at ", ".part", "invalid float", "numpy", "dtype")


def _bad_values(action: argparse.Action) -> tuple[str, ...]:
    if action.type in (float, int):
        return _NUMBERS
    if action.choices is not None:
        return ("nonsense",)
    if isinstance(action.type, OutputFile) or action.type in (output_folder, output_bag):
        return ("", "no/such/file", "file.nonsense") if isinstance(action.type, OutputFile) else ("",)
    return _TEXTS


def cases() -> Iterator[tuple[str, str, str]]:
    """Command, option, and a value that is not right."""
    parser = build_parser()
    commands = next(one for one in parser._actions if isinstance(one, argparse._SubParsersAction))
    for name, command in commands.choices.items():
        for action in command._actions:
            if action.nargs == 0 or not action.option_strings:
                continue
            option = action.option_strings[0]
            for value in _bad_values(action):
                if value not in _RIGHT.get(option, ()) or value in _WRONG_HERE.get((name, option), ()):
                    yield name, option, value


def said(command: str, option: str, value: str, files: dict[str, str]) -> tuple[int, str]:
    """Exit status and last line on stderr."""
    otherwise = [one.format(**files) for one in _OTHERWISE[command] if one.partition("=")[0] != option]
    error = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(error):
        try:
            status = main([command, *otherwise, f"{option}={value}"])
        except SystemExit as end:
            status = int(end.code or 0)
    lines = error.getvalue().strip().splitlines()
    return status, lines[-1] if lines else ""


def _make_files(folder: Path) -> dict[str, str]:
    known = load_joint("puma560_joint1")
    joint = RecordedJoint(joint=known.joint, gains=known.gains, velocities=(0.009,))
    write_simulation(folder / "arm.mcap", {"joint1": joint}, duration=1.0, rate=100.0)
    (folder / "table.csv").write_text("time,position\n0,0\n0.1,0\n0.2,0.1\n", encoding="utf-8")
    return {"bag": str(folder / "arm.mcap"), "table": str(folder / "table.csv")}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """A recording and a table."""
    return _make_files(tmp_path_factory.mktemp("files"))


@pytest.mark.parametrize("command", sorted({command for command, _, _ in cases()}))
def test_every_bad_value_is_refused_in_a_sentence(
    command: str, files: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exit status 2; one line that names the option and what would be right, in words, and nothing is written."""
    monkeypatch.chdir(tmp_path)
    for name, option, value in cases():
        if name != command:
            continue
        status, line = said(command, option, value, files)
        where = f"{command} {option}={value!r}: [{status}] {line}"
        assert status == 2, where
        assert line.startswith("stickslip"), where
        assert option in line or any(word in line for word in _OTHER_NAMES), where
        assert not any(word in line for word in _UGLY), where
        assert list(tmp_path.iterdir()) == [], where


_REVERSAL = f"reversal {_JOINT[0]} --stiffness 6300 --damping 200"
_TURNS = f"{_REVERSAL} --amplitude 0.1 --frequency 1"


@pytest.mark.parametrize(
    ("command", "text"),
    [
        ("nonsense", "nonsense"),
        ("margin --model puma560_joint1 --control-delay", "'--controller-period' must be > 0 where there is a control"),
        ("margin --model nothing", "unknown joint 'nothing'; known joints: dynamixel_mx106, "),
        ("margin --inertia 6.3", "missing: --stiffness, --velocity, --stribeck, --stribeck-velocity, or a --model"),
        ("margin --model puma560_joint1 --velocity 1e300", "'--velocity' must be at most 10000 rad/s"),
        ("margin --model puma560_joint1 --inertia -1", "'--inertia' must be finite and > 0: -1.0"),
        ("margin --model puma560_joint1 --integral -5", "'--integral' must be finite and >= 0: -5.0"),
        ("recommend --model puma560_joint1 --integral -5", "'--integral' must be finite and >= 0: -5.0"),
        ("recommend --model puma560_joint1 --what-if x=1", "of the form 2000,30 or p=2000,d=30"),
        ("recommend --model puma560_joint1 --what-if p=nan", "of finite gains"),
        (
            "recommend --model puma560_joint1 --largest-stiffness -1",
            "'--least-stiffness' and '--largest-stiffness' must be",
        ),
        ("recommend --model puma560_joint1 --effort 0", "'--effort' must be"),
        ("figures 7", "'figure' must be one of 1, 5, 6, 8, 9, 11, 12, 13, 14: 7"),
        ("map --model puma560_joint1 --points 3", "'--points' must be >= 100: 3"),
        ("map --stiffness 3", "missing: --inertia, --velocity, --stribeck, --stribeck-velocity, or a --model"),
        ("identify", "one of RECORDING, --simulated NODE and --controller NODE"),
        ("identify nothing.csv", "nothing.csv"),
        ("identify --simulated /a --controller /b", "one of RECORDING"),
        ("identify --simulated /a --speeds fast", "numbers separated by commas"),
        ("identify --simulated /a --speeds -0.1", "finite and > 0"),
        ("identify --controller /a", "'--speeds' must be given for an experiment"),
        ("identify --simulated /a", "one or more"),
        ("identify --simulated /a --speeds 0.1 --step-time nan", "'--step-time' must be"),
        ("identify --simulated /a --speeds 0.1,0.3", "--largest-distance"),
        ("identify slider_1100 --stiffness 168 --prior no_such_joint", "no_such_joint"),
        ("demo --recording nothing", "no recording begins with 'nothing': "),
        ("demo --recording /no/such/file.csv", "no such file"),
        ("demo --out /no/such/folder/a.png", "in a folder that exists"),
        ("demo --out picture.bmp", "must end in .png, .svg or .pdf"),
        ("watch --seconds 0", "'--seconds' must be"),
        (_REVERSAL, "missing: --amplitude, or a --trajectory"),
        (f"{_REVERSAL} --amplitude 0.1", "missing: --frequency, or a --trajectory"),
        (f"{_REVERSAL} --amplitude -0.1 --frequency 1", "'--amplitude' must be finite and > 0: -0.1"),
        (f"{_REVERSAL} --amplitude 0.1 --frequency 1e-9", "'--frequency' must be >= "),
        (f"{_REVERSAL} --amplitude 1e-6 --frequency 1e9", "'--frequency' must be <= "),
        (f"{_TURNS} --trajectory x.csv", "'--amplitude' must be left out where there is a --traj"),
        (f"{_TURNS} --contact lugre --presliding-stiffness 0", "'--presliding-stiffness' must be > 0"),
        (f"{_TURNS} --stiffness 0", "'--stiffness' must be finite and > 0"),
        (f"{_TURNS} --integral -10", "'--integral' must be finite and >= 0"),
        (
            f"{_REVERSAL} --trajectory x.csv --triangle",
            "--triangle has no effect here: it needs --amplitude and --freq",
        ),
        (f"{_TURNS} --contact lugre", "--contact has no effect here: it needs a finite --presl"),
        (f"{_TURNS} --presliding-damping 1", "--presliding-damping has no effect here"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(command: str, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Issues 2, 3, 4, 5 and 23: exit status 2, the reason in one line on stderr, nothing on stdout."""
    with pytest.raises(SystemExit, match=r"^2$"):
        raise SystemExit(main(command.split()))
    captured = capsys.readouterr()
    # The demo says first on which domain it is.
    assert captured.out == "" or command.startswith("demo")
    *before, line = captured.err.strip().splitlines()
    assert text in line
    assert line.startswith("stickslip")
    # What an experiment would do is said first.
    assert len(before) == ("--largest-distance" in text)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        made = _make_files(Path(temporary))
        os.chdir(temporary)
        for case in cases():
            print(" ".join(case[:2]) + f"={case[2]!r}\n    {said(*case, made)[1]}")
