# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 23: every option of `reversal` and `recommend` changes what comes out, or is refused where it cannot.

An option that is new has no row here, and fails until it has one.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from stickslip_ros.cli.main import build_parser, main


@dataclass(frozen=True)
class Row:
    """An option's two values (one and none of a flag), and what it needs beside it, without which it is refused."""

    values: tuple[str | None, ...]
    needs: tuple[str, ...] = ()
    replaces: tuple[str, ...] = ()  # options of the base that are left out


_SOFT = ("--presliding-stiffness=1e5",)
_JOINT = {
    "--joint": Row(("puma560_joint1", "erob80_100")),
    "--inertia": Row(("6.3", "60")), "--stiffness": Row(("630", "900")), "--damping": Row(("0", "5")),
    "--velocity": Row(("0.005", "0.05")),
    "--stribeck": Row(("1", "2")), "--stribeck-velocity": Row(("0.005", "0.01")), "--lag": Row(("0.01", "0.05")),
    "--rise-time": Row(("0.1", "1")), "--viscous": Row(("1", "9")), "--law": Row(("hess_soom", "exponential")),
    "--presliding-stiffness": Row(("1e5", "inf")), "--presliding-damping": Row(("0", "500"), _SOFT),
    "--contact": Row(("elasto_plastic", "lugre"), _SOFT),
}  # fmt: skip
ROWS: dict[str, dict[str, Row]] = {
    "reversal": {
        **{name: row for name, row in _JOINT.items() if name != "--velocity"},
        "--joint": Row(("puma560_joint1", "erob80_100"), ("--coulomb=8",)),
        "--coulomb": Row(("8", "9")),
        "--integral": Row(("0", "9000")),
        "--amplitude": Row(("0.02", "0.03")),
        "--frequency": Row(("0.05", "0.06")),
        "--triangle": Row((None, "")),
        "--trajectory": Row(("{one}", "{two}"), replaces=("--amplitude", "--frequency")),
        "--load": Row(("0", "3")),
        "--controller-period": Row(("0", "0.01")),
        "--control-delay": Row((None, ""), ("--controller-period=0.01",)),
        "--out": Row(("{folder}/one.png", "{folder}/two.png")),
        "--json": Row((None, "")),
    },
    "recommend": {
        **_JOINT,
        # The advice may be the same; ρ_c beside it is not.
        "--presliding-damping": Row(("0", "500"), (*_SOFT, "--what-if=p=700")),
        "--contact": Row(("elasto_plastic", "lugre"), (*_SOFT, "--what-if=p=700")),
        "--integral": Row(("0", "100")),
        "--condition": Row(("exact", "paper")),
        "--wanted-margin": Row(("0.1", "0.9")),
        "--steady-sliding": Row(("", "no")),
        "--slowest-velocity": Row(("0.001", "0.005")),
        "--least-stiffness": Row(("0", "2e4")),
        "--largest-stiffness": Row(("700", "inf")),
        "--least-damping": Row(("0", "900")),
        "--largest-damping": Row(("1", "inf")),
        "--least-damping-ratio": Row(("0", "2")),
        "--largest-damping-ratio": Row(("0.3", "inf")),
        "--bandwidth": Row(("20", "inf")),
        "--sample-rate": Row(("20", "2000")),
        "--samples-per-period": Row(("10", "200"), ("--sample-rate=200",)),
        "--effort": Row(("8", "900"), ("--tracking-error=0.01",)),
        "--tracking-error": Row(("0.001", "0.1"), ("--effort=9",)),
        "--controller-period": Row(("0", "0.02")),
        "--control-delay": Row((None, ""), ("--controller-period=0.002",)),
        "--factors": Row((None, "")),
        "--what-if": Row((None, "p=900")),
        "--compensation": Row((None, "")),
        "--compensation-out": Row(("{folder}/one.csv", "{folder}/two.csv")),
        "--speed-filter": Row(("0.01", "0.1"), ("--compensation",)),
        "--trajectory": Row(("{one}", "{two}"), ("--trajectory-out={folder}/out.yaml",)),
        "--trajectory-out": Row(("{folder}/one.yaml", "{folder}/two.yaml"), ("--trajectory={one}",)),
        "--trajectory-joint": Row(("elbow", "wrist"), ("--trajectory={one}", "--trajectory-out={folder}/out.yaml")),
        "--feedforward": Row(("0.5", "1"), ("--trajectory={one}", "--trajectory-out={folder}/out.yaml")),
        "--json": Row((None, "")),
    },
}
# It cancels from the advice, as the help says.
NO_EFFECT = {("recommend", "--coulomb")}
BASE = {
    "reversal": ("--joint=puma560_joint1", "--stiffness=6300", "--damping=200", "--amplitude=0.02", "--frequency=0.05",
                 "--json"),
    "recommend": ("--joint=puma560_joint1", "--velocity=0.005", "--json"),
}  # fmt: skip
SLOW = {"--integral", "--controller-period", "--control-delay", "--presliding-stiffness", "--presliding-damping",
        "--contact", "--compensation", "--speed-filter"}  # fmt: skip


def options(command: str) -> Iterator[str]:
    """All of a command, by their first names."""
    parser = build_parser()
    commands = next(one for one in parser._actions if isinstance(one, argparse._SubParsersAction))
    for action in commands.choices[command]._actions:
        if action.option_strings and not isinstance(action, argparse._HelpAction):
            yield action.option_strings[0]


def _typed(option: str, value: str | None) -> list[str]:
    if value is None:
        return []
    if value == "no":
        return [option.replace("--", "--no-", 1)]
    return [f"{option}={value}"] if value else [option]


def _cases() -> Iterator[object]:
    for command in BASE:
        for option in options(command):
            if (command, option) not in NO_EFFECT:
                slow = command == "recommend" and option in SLOW
                yield pytest.param(command, option, marks=[pytest.mark.slow] if slow else [])


@pytest.mark.parametrize(("command", "option"), list(_cases()))
def test_an_option_has_an_effect_or_is_refused(
    command: str, option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two values of it do not give the same; without what it needs it is refused, by its name."""
    assert option in ROWS[command], f"{option} of stickslip {command} is new: give it a row here"
    row = ROWS[command][option]
    times = np.arange(0.0, 41.0, 10.0)
    for name, amplitude in (("one", 0.02), ("two", 0.03)):
        table = np.column_stack([times, amplitude * np.array([-1, 1, -1, 1, -1])])
        np.savetxt(tmp_path / f"{name}.csv", table, delimiter=",", header="time_s,position_rad", comments="")
    inputs = {name: str(tmp_path / f"{name}.csv") for name in ("one", "two")}

    def words(folder: Path, given: tuple[str, ...]) -> list[str]:
        return [one.format(**inputs, folder=folder) for one in given]

    results = []
    for number, value in enumerate(row.values):
        folder = tmp_path / str(number)
        folder.mkdir()
        left_out = (option, *row.replaces)
        base = [one for one in BASE[command] if one.partition("=")[0] not in left_out]
        line = [command, *base, *words(folder, (*row.needs, *_typed(option, value)))]
        assert main(line) in (0, 1), line
        files = {one.name: one.read_bytes() for one in folder.iterdir()}
        results.append((capsys.readouterr().out.replace(str(folder), ""), files))
    assert results[0] != results[1]
    if row.needs:
        # Another option may be missed first.
        others = {one.partition("=")[0] for one in row.needs}
        base = [one for one in BASE[command] if one.partition("=")[0] != option]
        folder = tmp_path / "refused"
        folder.mkdir()
        assert main([command, *base, *words(folder, tuple(_typed(option, row.values[-1])))]) == 2
        error = capsys.readouterr().err.splitlines()[-1]
        assert option in error or any(one in error for one in others), error
        assert list(folder.iterdir()) == []
