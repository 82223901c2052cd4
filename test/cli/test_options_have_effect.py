# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issues 23 and 34: every option of `reversal`, `recommend`, `convert` and `analyze` changes what comes out, or is
refused where it cannot.

An option that is new has no row here, and fails until it has one.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from conftest import nightly

from stickslip_ros.bags.writing import BagWriter, serialized_joint_states
from stickslip_ros.cli.main import build_parser, main

pytestmark = pytest.mark.slow


@dataclass(frozen=True)
class Row:
    """An option's two values (one and none of a flag), and what it needs beside it, without which it is refused."""

    values: tuple[str | None, ...]
    needs: tuple[str, ...] = ()
    replaces: tuple[str, ...] = ()  # options of the base that are left out
    statuses: tuple[int, ...] = (0, 1)  # of which 2 is there where the option is a limit


_SOFT = ("--presliding-stiffness=1e5",)
_SPRING = ("--resonance=100", "--antiresonance=50")
_ADVISED = ("--model=puma560_joint1",)
_JOINT = {
    "--model": Row(("puma560_joint1", "erob80_100")),
    "--inertia": Row(("6.3", "60")), "--stiffness": Row(("630", "900")), "--damping": Row(("0", "5")),
    "--velocity": Row(("0.005", "0.05")),
    "--stribeck": Row(("1", "2")), "--stribeck-velocity": Row(("0.005", "0.01")), "--lag": Row(("0.01", "0.05")),
    "--rise-time": Row(("0.1", "1")), "--viscous": Row(("1", "9")), "--law": Row(("hess_soom", "exponential")),
    "--presliding-stiffness": Row(("1e5", "inf")), "--presliding-damping": Row(("0", "500"), _SOFT),
    "--contact": Row(("elasto_plastic", "lugre"), _SOFT),
    "--resonance": Row(("90", "100"), _SPRING[1:]),
    "--antiresonance": Row(("50", "60"), (*_SPRING[:1], "--encoder=load")),
    "--spring-damping": Row(("0.01", "0.3"), _SPRING), "--encoder": Row(("motor", "load"), _SPRING),
}  # fmt: skip
ROWS: dict[str, dict[str, Row]] = {
    "reversal": {
        **{name: row for name, row in _JOINT.items() if name != "--velocity"},
        "--model": Row(("puma560_joint1", "erob80_100"), ("--coulomb=8",)),
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
        "--wanted-reserve": Row(("0.1", "0.9")),
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
    "convert": {
        "--out": Row(("{folder}/one.mcap", "{folder}/two.mcap")),
        "--force": Row((None, ""), replaces=("--out",), needs=("--out={there}",), statuses=(0, 2)),
        "--names": Row(("a,b", "c,d")),
        "--column": Row(("effort=load*", "effort=load*:mnm")),
        "--first-stamp": Row(("1", "2")),
        "--stiffness": Row(("630", "900")),
        "--damping": Row(("0", "5"), ("--stiffness=630",)),
        "--integral": Row(("0", "100"), ("--stiffness=630",)),
        "--largest-unpacked": Row(("0.001", "64"), ("{zeros}",), ("{table}",), statuses=(0, 2)),
        "--compression": Row(("zstd", "none")),
    },
    "analyze": {
        "--brief": Row((None, ""), replaces=("--json",)),
        "--joint": Row(("left/joint1", "right/joint1")),
        "--start": Row(("0", "2")),
        "--end": Row(("5", "6")),
        "--largest-unpacked": Row(("0.001", "64"), statuses=(0, 2)),
        "--parameters": Row(("{gains}", "{others}")),
        "--model": Row(("puma560_joint1", "erob80_100")),
        "--gains": Row(("left/joint1=630", "left/joint1=900"), ("{second}", "--gains-topic="), ("{bag}",)),
        "--no-learning": Row((None, ""), replaces=("--no-learning",)),
        "--largest-stiffness": Row(("700", "inf"), _ADVISED),
        "--largest-damping": Row(("1", "inf"), _ADVISED),
        "--bandwidth": Row(("20", "inf"), _ADVISED),
        "--slowest-velocity": Row(("0.001", "0.01"), _ADVISED),
        "--states": Row(("/left/joint_states", "/right/joint_states")),
        "--references": Row(("''", "left=/left/joint_references")),
        "--gains-topic": Row(("/left/pd_gains", "''")),
        "--controller": Row(("/left/one", "/left/two")),
        "--json": Row((None, ""), replaces=("--json",)),
        "--csv": Row(("{folder}/one.csv", "{folder}/two.csv")),
        "--html": Row(("{folder}/one.html", "{folder}/two.html")),
        "--out": Row(("{folder}/one.mcap", "{folder}/two.mcap")),
        "--fail-on-stick-slip": Row((None, "")),
        "--results": Row((None, "{folder}/results")),
        "--reports": Row((None, "{folder}/reports"), ("{second}",)),
        "--alarm": Row(("stick_slip>5%", "stick_slip>99%")),
        "--table": Row(("{folder}/one.csv", "{folder}/two.csv")),
    },
}
# It cancels from the advice, as the help says.
NO_EFFECT = {("recommend", "--coulomb")}
# They say where the work is done, and change nothing of what comes out: test/bags/test_fleet.py.
NO_EFFECT |= {("analyze", "--jobs"), ("analyze", "--scheduler")}
BASE = {
    "reversal": ("--model=puma560_joint1", "--stiffness=6300", "--damping=200", "--amplitude=0.02", "--frequency=0.05",
                 "--json"),
    "recommend": ("--model=puma560_joint1", "--velocity=0.005", "--json"),
    "convert": ("{table}", "--out={folder}/log.mcap"),
    "analyze": ("{bag}", "--no-learning", "--json"),
}  # fmt: skip
SLOW: dict[str, set[str]] = {
    "recommend": {"--integral", "--controller-period", "--control-delay", "--presliding-stiffness",
                  "--presliding-damping", "--contact", "--compensation", "--speed-filter", "--resonance",
                  "--antiresonance", "--spring-damping", "--encoder"},
    "reversal": {"--out"}, "convert": set(), "analyze": {"--no-learning"},
}  # fmt: skip


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
    if value == "''":
        return [f"{option}="]
    if value == "no":
        return [option.replace("--", "--no-", 1)]
    return [f"{option}={value}"] if value else [option]


def _cases() -> Iterator[object]:
    for command in BASE:
        for option in options(command):
            if (command, option) not in NO_EFFECT:
                slow = option in SLOW[command]
                yield nightly(command, option) if slow else (command, option)


def _write_bag(path: Path, *, with_events: bool = True) -> None:
    """Two arms that move in steps after their references; the left one's gains are recorded, and two nodes change them
    later.
    """
    times = 1.0 + np.arange(0.0, 8.0, 0.01)
    events = "rcl_interfaces/msg/ParameterEvent"
    topics = {f"/{arm}/{name}": "sensor_msgs/msg/JointState" for arm in ("left", "right") for name in
              ("joint_states", "joint_references")}  # fmt: skip
    topics |= {"/left/pd_gains": "std_msgs/msg/Float64MultiArray", "/parameter_events": events}
    with BagWriter(path, topics) as writer:

        def event(node: str, gain: float) -> Any:
            empty = {
                f"{kind}_array_value": np.zeros(0, dtype) for kind, dtype in (("double", float), ("integer", np.int64))
            }
            empty |= {"byte_array_value": np.zeros(0, np.uint8), "bool_array_value": np.zeros(0, bool)}
            value = writer.message("rcl_interfaces/msg/ParameterValue", type=3, bool_value=False, integer_value=0,
                                   double_value=gain, string_value="", string_array_value=[], **empty)  # fmt: skip
            one = writer.message("rcl_interfaces/msg/Parameter", name="gains.joint1.p", value=value)
            stamp = writer.message("builtin_interfaces/msg/Time", sec=1, nanosec=0)
            return writer.message(events, stamp=stamp, node=node, new_parameters=[one], changed_parameters=[],
                                  deleted_parameters=[])  # fmt: skip

        gains = [writer.serialized(10**9, "/left/pd_gains", writer.table("joint1", "p,d", np.array([[630.0, 12.0]])))]
        gains += [
            writer.serialized(3 * 10**9, "/parameter_events", event(node, gain))
            for node, gain in (("/left/one", 500.0), ("/left/two", 700.0))
            if with_events
        ]
        streams = []
        for arm, slip in (("left", 0.01), ("right", 0.02)):
            steps, part = np.divmod(0.02 * times / slip, 1.0)
            position = slip * (steps + np.clip(part / 0.2, 0.0, 1.0) ** 2 * (3.0 - 2.0 * np.clip(part / 0.2, 0.0, 1.0)))
            values = np.full((len(times), 3, 1), np.nan)
            values[:, 0, 0] = position
            streams.append(serialized_joint_states(f"/{arm}/joint_states", ("joint1",), times, values))
            wanted = values.copy()
            wanted[:, 0, 0], wanted[:, 1, 0] = 0.02 * times, 0.02
            streams.append(serialized_joint_states(f"/{arm}/joint_references", ("joint1",), times, wanted))
        writer.write(gains, *streams)


@pytest.fixture(scope="session")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Trajectories, a table, bags and parameters, by the names that rows have."""
    folder = tmp_path_factory.mktemp("inputs")
    times = np.arange(0.0, 41.0, 10.0)
    for name, amplitude in (("one", 0.02), ("two", 0.03)):
        table = np.column_stack([times, amplitude * np.array([-1, 1, -1, 1, -1])])
        np.savetxt(folder / f"{name}.csv", table, delimiter=",", header="time_s,position_rad", comments="")
    columns = {name: 0.1 * np.arange(400.0) for name in ("time_s", "q1_deg", "q2_deg", "load1", "load2")}
    pyarrow.parquet.write_table(pa.table(columns), folder / "table.parquet")
    pyarrow.parquet.write_table(pa.table(dict.fromkeys(("time_s", "q1"), np.zeros(300_000))), folder / "zeros.parquet")
    _write_bag(folder / "bag.mcap")
    _write_bag(folder / "second.mcap", with_events=False)
    (folder / "there.mcap").touch()
    for name, gain in (("gains", 630), ("others", 900)):
        text = f"controller:\n  ros__parameters:\n    gains:\n      joint1: {{p: {gain}.0, d: 1.0}}\n"
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    return {path.stem: str(path) for path in folder.iterdir()}


def test_options_that_exclude_each_other(inputs: dict[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    """Processes here and workers elsewhere cannot both do the work."""
    assert main(["analyze", inputs["bag"], inputs["second"], "--jobs=2", "--scheduler=tcp://localhost:1"]) == 2
    assert "'--jobs' must be left out with --scheduler" in capsys.readouterr().err


@pytest.mark.parametrize(("command", "option"), list(_cases()))
def test_an_option_has_an_effect_or_is_refused(
    command: str, option: str, tmp_path: Path, inputs: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    """Two values of it do not give the same; without what it needs it is refused, by its name."""
    assert option in ROWS[command], f"{option} of stickslip {command} is new: give it a row here"
    row = ROWS[command][option]

    def words(folder: Path, given: tuple[str, ...]) -> list[str]:
        filled = [one.format(**inputs, folder=folder) for one in given]
        return sorted(filled, key=lambda one: one.startswith("--"))

    results = []
    for number, value in enumerate(row.values):
        folder = tmp_path / str(number)
        folder.mkdir()
        left_out = (option, *row.replaces)
        base = [one for one in BASE[command] if one.partition("=")[0] not in left_out]
        line = [command, *words(folder, (*base, *row.needs, *_typed(option, value)))]
        status = main(line)
        assert status in row.statuses, line
        files = {str(one.relative_to(folder)): one.read_bytes() for one in folder.rglob("*") if one.is_file()}
        results.append((status, capsys.readouterr().out.replace(str(folder), ""), files))
    assert results[0] != results[1]
    if row.needs and 2 not in row.statuses:
        # Another option may be missed first.
        others = {one.partition("=")[0] for one in row.needs}
        base = [one for one in BASE[command] if one.partition("=")[0] != option]
        folder = tmp_path / "refused"
        folder.mkdir()
        assert main([command, *words(folder, (*base, *_typed(option, row.values[-1])))]) == 2
        error = capsys.readouterr().err.splitlines()[-1]
        assert option in error or any(one in error for one in others), error
        assert list(folder.iterdir()) == []
