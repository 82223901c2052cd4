# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 22, item 4: tables of many joints, as people and programs write them, become bags."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from conftest import LIMIT
from support_bags import read_joint

from stickslip_ros.bags.storage.unpacking import UnpackLimit
from stickslip_ros.bags.table import RecordingError, load_recording, load_table
from stickslip_ros.bags.table_columns import POSITION, Named, assign, meaning
from stickslip_ros.cli.main import main

TIMES = 5.0 + 0.004 * np.arange(40)
POSITIONS = np.stack([0.1 * number + 0.02 * TIMES for number in range(7)], axis=1)


def write_text(path: Path, names: Sequence[str], columns: Sequence[np.ndarray], delimiter: str = ",") -> Path:
    """Write columns under their names; numbers have decimal commas where the delimiter is a semicolon."""
    rows = [delimiter.join(names)]
    for values in zip(*columns, strict=True):
        text = delimiter.join(f"{value:.12g}" for value in values)
        rows.append(text.replace(".", ",") if delimiter == ";" else text)
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("field", "unit", "si"),
    [
        ("position", "deg", np.pi / 180.0),
        ("position", "mm", 1e-3),
        ("position", "rev", 2.0 * np.pi),
        ("velocity", "turns/s", 2.0 * np.pi),
        ("position", "um", 1e-6),
        ("velocity", "deg/s", np.pi / 180.0),
        ("velocity", "mm/s", 1e-3),
        ("velocity", "rpm", 2.0 * np.pi / 60.0),
        ("effort", "mN·m", 1e-3),
    ],
)
def test_every_unit_becomes_si(field: str, unit: str, si: float, tmp_path: Path) -> None:
    """What docs/recordings.md lists of units, in brackets behind a name."""
    names, columns = ["time_s", f"{field} [{unit}]"], [TIMES, POSITIONS[:, 1]]
    if field != "position":
        names, columns = [*names, "position"], [*columns, POSITIONS[:, 0]]
    table = load_table(write_text(tmp_path / "a.csv", names, columns))
    (batch,) = table.batches.values()
    np.testing.assert_allclose(getattr(batch, field), si * POSITIONS[:, 1])


@pytest.mark.parametrize(
    ("name", "field", "joint", "unit"),
    [
        ("time_s", "time", "", "s"),
        ("timestamp", "time", "", ""),
        ("Time (s)", "time", "", "s"),
        ("%time", "time", "", ""),
        ("/joint_states/header/stamp", "time", "", ""),
        ("field.header.stamp", "time", "", ""),
        ("header.stamp.nanosec", "time", "", "ns"),
        ("stamp_ns", "time", "", "ns"),
        ("elapsed_ms", "time", "", "ms"),
        ("q1", "position", "joint1", ""),
        ("dq3", "velocity", "joint3", ""),
        ("tau_J[3]", "effort", "joint3", ""),
        ("q_d[0]", "reference_position", "joint0", ""),
        ("dq_d[0]", "reference_velocity", "joint0", ""),
        ("actual_q_0", "position", "joint0", ""),
        ("target_qd_5", "reference_velocity", "joint5", ""),
        ("shoulder_pos", "position", "shoulder", ""),
        ("position[0]", "position", "joint0", ""),
        ("position_deg_2", "position", "joint2", "deg"),
        ("shoulder_velocity_rad_per_s", "velocity", "shoulder", "rad_per_s"),
        ("/joint_states/shoulder_pan_joint/position", "position", "shoulder_pan_joint", ""),
        ("left/joint1/position", "position", "left/joint1", ""),
        ("J1_Position(deg)", "position", "J1", "deg"),
        ("Joint 2 Torque [Nm]", "effort", "Joint_2", "nm"),
        ("Speed [°/s]", "velocity", "", "deg_per_s"),
        ("Axis 1 speed [rpm]", "velocity", "Axis_1", "rpm"),
        ("c1 position [rev]", "position", "c1", "rev"),
        ("targetPosition3", "reference_position", "joint3", ""),
        ("reference_rad", "reference_position", "", "rad"),
        ("commanded_torque_nm", "effort", "", "nm"),
        ("time (millisec)", "time", "", "ms"),
        ("time_microsec", "time", "", "us"),
        ("angle (degree)", "position", "", "deg"),
        ("q1 [millimeters]", "position", "joint1", "mm"),
        ("vel (degrees/sec)", "velocity", "", "deg_per_s"),
    ],
)
def test_what_a_name_means(name: str, field: str, joint: str, unit: str) -> None:
    """The usual ways to write field, joint and unit into a column's name."""
    found = meaning(name)
    assert found is not None
    assert (found.field, found.joint, found.unit) == (field, joint, unit)


@pytest.mark.parametrize("measured", ["a torque [Nm]", "a effort", "a measured torque [Nm]"])
def test_what_a_motor_gave_serves_before_what_it_was_told(measured: str, tmp_path: Path) -> None:
    """A commanded torque, always 0 where the position is commanded, was taken for the effort."""
    columns = [TIMES, POSITIONS[:, 0], np.zeros(len(TIMES)), POSITIONS[:, 1]]
    path = write_text(tmp_path / "a.csv", ["time_s", "a position [rad]", "a torque cmd [Nm]", measured], columns)
    (batch,) = load_table(path).batches.values()
    np.testing.assert_allclose(batch.effort, POSITIONS[:, 1])


@pytest.mark.parametrize(
    "name", ["temperature_1", "position_error_2", "torque_sensor_nm", "feedforward_torque_nm", "measured_current_a",
             "index", "seq", "tick", "tcp_pos_x", "position [V]", "reference", "frame_id"]
)  # fmt: skip
def test_what_means_nothing_here(name: str) -> None:
    """Columns of other quantities are taken for none of ours."""
    assert meaning(name) is None


WIDE = {
    "q1 to q7": [f"q{number}" for number in range(1, 8)],
    "names": [f"{name}_pos" for name in ("base", "shoulder", "upper_arm", "elbow", "forearm", "wrist", "flange")],
    "arrays": [f"position[{number}]" for number in range(7)],
}
JOINTS = {
    "q1 to q7": [f"joint{number}" for number in range(1, 8)],
    "names": ["base", "shoulder", "upper_arm", "elbow", "forearm", "wrist", "flange"],
    "arrays": [f"joint{number}" for number in range(7)],
}


@pytest.mark.parametrize("kind", WIDE)
@pytest.mark.parametrize("ending", ["csv", "semicolon", "tsv", "parquet", "npz"])
def test_all_joints_of_one_table(kind: str, ending: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Seven joints in one table of any kind are seven joints of one bag, with the mapping shown."""
    names, columns = ["timestamp", *WIDE[kind]], [TIMES, *POSITIONS.T]
    if ending == "parquet":
        path = tmp_path / "log.parquet"
        pyarrow.parquet.write_table(pa.table(dict(zip(names, columns, strict=True))), path)
    elif ending == "npz":
        path = tmp_path / "log.npz"
        np.savez(path, **dict(zip(names, columns, strict=True)))
    else:
        delimiter = {"csv": ",", "semicolon": ";", "tsv": "\t"}[ending]
        path = write_text(tmp_path / f"log.{'tsv' if ending == 'tsv' else 'csv'}", names, columns, delimiter)
    out = tmp_path / "log.mcap"
    assert main(["convert", str(path), "--out", str(out)]) == 0
    shown = capsys.readouterr().err
    for number, joint in enumerate(JOINTS[kind]):
        batch = read_joint(out, joint)
        np.testing.assert_allclose(batch.time, TIMES, atol=2e-9)
        np.testing.assert_allclose(batch.position, POSITIONS[:, number], atol=1e-11)
        assert any(line.startswith(joint) and f"{names[1 + number]} [rad?]" in line for line in shown.splitlines())
    assert shown.index("time from timestamp [s?]") < shown.index("40 samples of")
    assert ("decimal commas" in shown) == (ending == "semicolon")


def test_every_field_of_every_joint(tmp_path: Path) -> None:
    """Velocities, efforts and references go with the positions of their joints, in SI units."""
    names = ["t_ms", "q1_deg", "q2_deg", "dq1 [deg/s]", "dq2 [deg/s]", "tau1", "tau2", "q1_ref_deg", "note_2"]
    values = [1e3 * TIMES, *np.rad2deg(POSITIONS[:, :2]).T, *np.full((2, 40), 3.0), *np.full((2, 40), 1.5)]
    path = write_text(tmp_path / "a.csv", names, [*values, np.rad2deg(POSITIONS[:, 0]), TIMES])
    table = load_table(path)
    assert list(table.batches) == ["joint1", "joint2"]
    assert table.unused == ("note_2",)
    first, second = table.batches.values()
    np.testing.assert_allclose(first.time, TIMES, atol=1e-12)
    np.testing.assert_allclose(second.position, POSITIONS[:, 1], atol=1e-10)
    np.testing.assert_allclose(second.velocity, np.deg2rad(3.0))
    np.testing.assert_allclose(first.effort, 1.5)
    np.testing.assert_allclose(first.reference_position, POSITIONS[:, 0], atol=1e-10)
    assert np.isnan(second.reference_position).all()


@pytest.mark.parametrize(
    ("values", "unit"),
    [
        (TIMES, "s"),
        (1.7e9 + TIMES, "s"),
        (1e3 * TIMES, "ms"),
        (1.7e12 + 1e3 * TIMES, "ms"),
        (1e6 * TIMES, "us"),
        (1.7e15 + 1e6 * TIMES, "us"),
        (1e9 * (TIMES - 5.0), "ns"),
        (1.7e18 + 1e9 * TIMES, "ns"),
    ],
)
def test_the_unit_of_time_is_told_by_its_values(values: np.ndarray, unit: str, tmp_path: Path) -> None:
    """`timestamp` in seconds, milliseconds, microseconds or nanoseconds, from zero or since 1970."""
    np.savez(tmp_path / "a.npz", timestamp=values, q1=POSITIONS[:, 0])
    table = load_table(tmp_path / "a.npz")
    assert [(use.unit, use.assumed) for use in table.time] == [(unit, True)]
    np.testing.assert_allclose(np.diff(table.batches["joint1"].time), 0.004, atol=1e-6)


def test_seconds_of_a_slow_logger_are_no_milliseconds(tmp_path: Path) -> None:
    """Two rows a second: steps of half a unit are seconds."""
    np.savez(tmp_path / "a.npz", timestamp=0.5 * np.arange(40), q1=POSITIONS[:, 0])
    assert load_table(tmp_path / "a.npz").time[0].unit == "s"


def test_stamps_in_two_columns_and_dates(tmp_path: Path) -> None:
    """Seconds and nanoseconds of a message's stamp are one time; dates are times too."""
    seconds, rest = 1_700_000_000 + np.arange(3), 1000 * np.arange(3)
    names = ["header.stamp.sec", "header.stamp.nanosec", "position[0]"]
    path = write_text(tmp_path / "a.csv", names, [seconds, rest, np.arange(3)])
    np.testing.assert_allclose(load_table(path).batches["joint0"].time, 1.7e9 + 1.000001 * np.arange(3), atol=3e-7)
    rows = ["2026-01-31 12:00:00.125,0.5", "2026-01-31 12:00:00.250,0.5"]
    (tmp_path / "b.csv").write_text("\n".join(["time,q", *rows]))
    dates = load_table(tmp_path / "b.csv").batches["joint1"].time
    assert dates.tolist() == [1769860800.125, 1769860800.25]


def test_what_other_programs_write(tmp_path: Path) -> None:
    """Comments above, a header that is a comment, blanks as delimiters, a byte order mark, empty cells, empty lines."""
    np.savetxt(tmp_path / "a.txt", np.column_stack([TIMES, POSITIONS[:, :2]]), header="time q1 q2")
    np.testing.assert_allclose(load_table(tmp_path / "a.txt").batches["joint2"].position, POSITIONS[:, 1])
    text = "# made by a logger\n\n\ufefftime_s;q1;comment\n0,5;1,5;fine\n\n0,6;;\n"
    (tmp_path / "b.csv").write_text(text.replace("\ufeff", ""), encoding="utf-8-sig")
    batch = load_table(tmp_path / "b.csv").batches["joint1"]
    assert batch.time.tolist() == [0.5, 0.6]
    assert batch.position[0] == 1.5
    assert np.isnan(batch.position[1])


def test_lists_and_structures_of_parquet(tmp_path: Path) -> None:
    """Columns of lists are a column a number; parts of structures are columns."""
    rows = POSITIONS[:, :3].tolist()
    for kind in (pa.list_(pa.float64()), pa.list_(pa.float64(), 3)):
        stamps = [{"stamp": {"sec": int(second), "nanosec": 5}} for second in range(40)]
        table = pa.table({"header": stamps, "position": pa.array(rows, kind)})
        pyarrow.parquet.write_table(table, tmp_path / "a.parquet")
        found = load_table(tmp_path / "a.parquet")
        assert list(found.batches) == ["joint0", "joint1", "joint2"]
        np.testing.assert_allclose(found.batches["joint2"].position, POSITIONS[:, 2])
        np.testing.assert_allclose(found.batches["joint2"].time, np.arange(40) + 5e-9)
    ragged = pa.table({"t": [0.1, 0.2], "position": [[1.0, 2.0], [1.0]]})
    pyarrow.parquet.write_table(ragged, tmp_path / "b.parquet")
    with pytest.raises(RecordingError, match="column 'position' must have as many values in every row"):
        load_table(tmp_path / "b.parquet")


@pytest.mark.slow
def test_lists_inside_of_structures_of_parquet(tmp_path: Path) -> None:
    """In a process that has loaded nothing else: it once ended in a traceback, as a part of pyarrow was not loaded."""
    message = [{"stamp": 0.1 * number, "position": row} for number, row in enumerate(POSITIONS[:, :2].tolist())]
    pyarrow.parquet.write_table(pa.table({"msg": message}), tmp_path / "a.parquet")
    command = [sys.executable, "-m", "stickslip_ros.cli.main", "convert", "a.parquet", "--out", "a.mcap"]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=LIMIT, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "40 samples of msg_0, msg_1" in done.stderr


def test_tables_in_an_archive_have_the_joints_names(tmp_path: Path) -> None:
    """An array of a column a joint, and the names beside it."""
    np.savez(tmp_path / "a.npz", time_s=TIMES, position_rad=POSITIONS, joints=np.array(list("abcdefg")), mass=3.0)
    table = load_table(tmp_path / "a.npz")
    assert list(table.batches) == list("abcdefg")
    np.testing.assert_allclose(table.batches["c"].position, POSITIONS[:, 2])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time_s,q1,q2\n0,1,2\n\n0.1,1,x7\n", "line 4, column 'q2': must be a number: 'x7'"),
        ("# by me\ntime_s;q1\n0;1,5\n0,1;1,5\n0,2;1.5 rad\n", "line 5, column 'q1': must be a number: '1.5 rad'"),
        ("time_s,q1\n0,1\n0.1,1,3\n", "line 3: must have the header's 2 values: it has 3"),
        ("time,q1\n2026-01-31 12:00:00,1\nyesterday,1\n", "line 3, column 'time': must be a date like"),
        ("0.0,1.0\n0.1,1.0\n", "or one named with stickslip convert --column time=COLUMN; has column1, column2"),
        ("0.0,1.0,\n0.1,1.0,\n", "or one named with stickslip convert --column time=COLUMN; has column1, column2"),
        (
            "//started anew\n0.0,1.0,3\n0.1,x,3\n",
            "or one named with stickslip convert --column time=COLUMN; has column1, column2, column3",
        ),
        ("time_s,q1\n0,1\n\0\0\0", "line 3: must have the header's 2 values: it has 1"),
        ("time_s,q1\n", "it has no rows under its line of names"),
        ("", "the file is empty"),
        ("time_s,tau1\n0,1\n", "needs a column position_rad or position_deg"),
        ("speed,q1\n0,1\n", "needs a column time_s or time_ms"),
        ("time_s,q1\n1e30,1\n", "no row has a time that a stamp can be"),
    ],
)
def test_what_cannot_be_read_is_named(text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Line and column, as an editor counts them; nothing is written."""
    (tmp_path / "a.csv").write_text(text)
    assert main(["convert", str(tmp_path / "a.csv"), "--out", str(tmp_path / "a.mcap")]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "a.mcap").exists()


@pytest.mark.parametrize("name", ["a.txt", "a.dat", "A.CSV"])
def test_columns_without_names_are_numbered(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Many laboratories write numbers alone, into files of any ending: they were refused."""
    rows = [f"{time:.9g} {place:.9g} {0.5 * place:.9g}\n" for time, place in zip(TIMES, POSITIONS[:, 0], strict=True)]
    (tmp_path / name).write_text("".join(rows))
    named = ("time=column1:s", "position=column2:deg", "reference_position=column3:deg")
    options = [word for one in named for word in ("--column", one)]
    assert main(["convert", str(tmp_path / name), "--out", str(tmp_path / "a.mcap"), *options]) == 0
    assert "its columns have no names, and are numbered" in " ".join(capsys.readouterr().err.split())
    batch = read_joint(tmp_path / "a.mcap", "joint1")
    np.testing.assert_allclose(batch.position, np.radians(POSITIONS[:, 0]), rtol=1e-6)
    np.testing.assert_allclose(batch.reference_position, np.radians(0.5 * POSITIONS[:, 0]), rtol=1e-6)


@pytest.mark.parametrize(
    ("first", "columns"),
    [
        ("2026-01-31 12:00:00.000,0.1,0.2", "time=column1 position=column2 velocity=column3"),
        ("2026-01-31T12:00:00Z,0.1,0.2", "time=column1 position=column2 velocity=column3"),
        ("2026-01-31;12:00:00.000;0,1;0,2", "time=column1 time=column2 position=column3 velocity=column4"),
        ("0.0,,0.1,0.2,", "time=column1 position=column3 velocity=column4"),
        (",0.1,0.2", "time=column1 position=column2 velocity=column3"),
        ("0.0,0.1,N/A", "time=column1 position=column2 velocity=column3"),
        ("0.0,NaN,null", "time=column1 position=column2 velocity=column3"),
        ("NaN,NaN,NaN", "time=column1 position=column2 velocity=column3"),
        (",,", "time=column1 position=column2 velocity=column3"),
    ],
)
def test_a_first_row_is_no_line_of_names(first: str, columns: str, tmp_path: Path) -> None:
    """Dates, and words for what is missing, were taken for names; a column that began empty was not there."""
    (tmp_path / "a.csv").write_text(f"# of a rig\n{first}\n{first}\n")
    named = [Named(field=field, column=column) for field, column in (one.split("=") for one in columns.split())]
    table = load_table(tmp_path / "a.csv", named)
    assert len(table.batches["joint1"]) == 2
    assert table.notes == ("its columns have no names, and are numbered",)


@pytest.mark.parametrize("above", ["Logger 3.1\n", "Logger\n\nRate: 10 Hz\n", "0.5\n"])
def test_lines_above_values_without_names(above: str, tmp_path: Path) -> None:
    """They were taken for the names."""
    rows = "".join(f"{time:.3f},{place:.9f}\n" for time, place in zip(TIMES, POSITIONS[:, 0], strict=True))
    (tmp_path / "a.dat").write_text(above + rows)
    named = [Named(field="time", column="column1"), Named(field=POSITION, column="column2")]
    table = load_table(tmp_path / "a.dat", named)
    np.testing.assert_allclose(table.batches["joint1"].position, POSITIONS[:, 0], atol=1e-8)
    assert f"below {above.count(chr(10))} other lines" in table.form


def test_names_in_a_comment_above_dates(tmp_path: Path) -> None:
    """The first row was taken for the names."""
    (tmp_path / "a.csv").write_text("# time,q1\n2026-01-31 12:00:00.5,0.1\n2026-01-31 12:00:00.6,0.2\n")
    np.testing.assert_allclose(load_table(tmp_path / "a.csv").batches["joint1"].position, [0.1, 0.2])


@pytest.mark.parametrize("name", ["a.xlsx", "a.csv", "a.mcap"])
def test_what_is_no_text_is_no_table(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A spreadsheet, say, text in UTF-16, or a bag."""
    (tmp_path / name).write_bytes("PK,\n1,2\n".encode("utf-16"))
    assert main(["convert", str(tmp_path / name), "--out", str(tmp_path / "b.mcap")]) == 2
    wanted = (
        "must be text in UTF-8 (not UTF-16), .parquet or .npz; a spreadsheet is saved as CSV, a bag analysed as it is"
    )
    assert wanted in capsys.readouterr().err


def test_a_column_has_one_meaning(tmp_path: Path) -> None:
    """A position was its own velocity, and the joint was named after its column."""
    (tmp_path / "a.csv").write_text("0.0,0.1\n0.1,0.2\n")
    for field in (POSITION, "velocity", "time"):
        named = [("time", "column1"), (POSITION, "column2"), (field, "column2")]
        with pytest.raises(RecordingError, match=f"column2' must be named once: it is for position and {field}"):
            load_table(tmp_path / "a.csv", [Named(field=one, column=column) for one, column in named])


def test_a_table_of_any_ending_is_told_how_to_become_a_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The command that is printed can be typed, blanks in its path or not."""
    path = tmp_path / "my rig.dat"
    path.write_text("0.0 0.1\n0.1 0.2\n")
    assert main(["analyze", str(path)]) == 2
    assert f"a table becomes one by stickslip convert '{path}' --out 'my rig.mcap'" in capsys.readouterr().err
    out, options = str(tmp_path / "my rig.mcap"), ["--column", "time=column1", "--column", "position=column2"]
    assert main(["convert", str(path), "--out", out, *options]) == 0
    assert f"now: stickslip analyze '{out}'" in " ".join(capsys.readouterr().err.split())


def test_first_stamps_that_no_row_could_have(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A bag without a sample was written, and called converted."""
    path = write_text(tmp_path / "a.csv", ["t", "q1"], [TIMES, POSITIONS[:, 0]])
    for first in ("-5", "1e30"):
        assert main(["convert", str(path), "--out", str(tmp_path / "a.mcap"), "--first-stamp", first]) == 2
        assert "must be such that the first stamp is after zero and at most 2147483647 s" in capsys.readouterr().err
    assert not (tmp_path / "a.mcap").exists()


def test_columns_of_one_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of two columns with the name q1 the second one was left out without a word."""
    path = write_text(tmp_path / "a.csv", ["t", "q1", "q1"], [TIMES, POSITIONS[:, 0], POSITIONS[:, 1]])
    out = tmp_path / "a.mcap"
    assert main(["convert", str(path), "--out", str(out)]) == 0
    assert "of columns of the same name only the first one is read: q1" in capsys.readouterr().err
    np.testing.assert_allclose(read_joint(out, "joint1").position, POSITIONS[:, 0], atol=1e-10)


def test_text_that_is_none(tmp_path: Path) -> None:
    """Names in another encoding are told with their line; a column of text in Parquet with its name."""
    (tmp_path / "a.csv").write_bytes("time_s;Drehmoment µ\n0;1\n".encode("latin-1"))
    with pytest.raises(RecordingError, match="line 1: must be text in UTF-8: it has the byte 0xb5"):
        load_table(tmp_path / "a.csv")
    pyarrow.parquet.write_table(pa.table({"t": [0.1], "q1": ["many"]}), tmp_path / "b.parquet")
    with pytest.raises(RecordingError, match=r"columns t, q1 must hold numbers: .*many"):
        load_table(tmp_path / "b.parquet")


def test_a_star_stands_for_the_joint(tmp_path: Path) -> None:
    """`--column 'position=q*:deg'` is about every joint; what is named of a field replaces what was found of it."""
    names = ["clock", "q1", "q2", "load_1", "load_2"]
    path = write_text(tmp_path / "a.csv", names, [1e3 * TIMES, *np.rad2deg(POSITIONS[:, :2]).T, TIMES, 2 * TIMES])
    out = tmp_path / "a.mcap"
    columns = ["--column", "time=clock:ms", "--column", "position=q*:deg", "--column", "effort=load_*:nm"]
    assert main(["convert", str(path), "--out", str(out), *columns, "--names", "shoulder, elbow"]) == 0
    batch = read_joint(out, "elbow")
    np.testing.assert_allclose(batch.position, POSITIONS[:, 1], atol=1e-10)
    np.testing.assert_allclose(batch.effort, 2 * TIMES, atol=1e-9)
    with pytest.raises(ValueError, match=r"no column 'p\*' for position; has clock, q1"):
        assign(names, [Named(field="position", column="p*")])
    with pytest.raises(ValueError, match="no column 'lod_1' for effort; did you mean 'load_1'"):
        assign(names, [Named(field="effort", column="lod_1")])


def test_degrees_without_a_unit_are_suspected(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Positions that would be many turns are asked about."""
    path = write_text(tmp_path / "a.csv", ["t", "q1"], [TIMES, np.linspace(0.0, 90.0, 40)])
    assert main(["convert", str(path), "--out", str(tmp_path / "a.mcap")]) == 0
    assert "joint1 spans 90 rad: is q1 in degrees? Then: --column 'position=q1:deg'" in capsys.readouterr().err


@pytest.mark.parametrize("names", ["a", "a,b,c", "a,a", "a,"])
def test_as_many_names_as_joints(names: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Names that do not fit are refused, with the joints that there are."""
    path = write_text(tmp_path / "a.csv", ["t", "q1", "q2"], [TIMES, *POSITIONS[:, :2].T])
    assert main(["convert", str(path), "--out", str(tmp_path / "a.mcap"), "--names", names]) == 2
    assert "'--names' must be 2 different names, separated by commas, of the joints joint1, joint2" in (
        capsys.readouterr().err
    )


def test_one_joint_of_several_is_asked_for(tmp_path: Path) -> None:
    """Who reads one joint of a wide table is told which there are, and how all become a bag."""
    path = write_text(tmp_path / "a.csv", ["t", "q1", "q2"], [TIMES, *POSITIONS[:, :2].T])
    np.testing.assert_allclose(load_recording(path, "joint2").batch.position, POSITIONS[:, 1])
    with pytest.raises(RecordingError, match=r"has several joints; there are joint1, joint2; .*stickslip convert"):
        load_recording(path)
    with pytest.raises(RecordingError, match="has no joint 'joint3'; there are joint1, joint2; all"):
        load_recording(path, "joint3")
    with pytest.raises(RecordingError, match="no joint 'jiont1'; did you mean 'joint1'"):
        load_recording(path, "jiont1")


def test_a_few_bytes_do_not_become_all_memory(tmp_path: Path) -> None:
    """Parquet shrinks what repeats to nothing: what it would become is bounded, and the option named that raises it."""
    count = 4_000_000
    table = pa.table({"t": pa.array(np.zeros(count)), "q1": pa.array(np.zeros(count))})
    path = tmp_path / "a.parquet"
    pyarrow.parquet.write_table(table, path)
    assert path.stat().st_size < 100_000
    with pytest.raises(RecordingError, match="unpacks to more than 50 MB; --largest-unpacked MB allows more"):
        load_table(path, limit=UnpackLimit(largest_unpacked=50.0))
    assert len(load_table(path, limit=UnpackLimit(largest_unpacked=65.0)).batches["joint1"]) == count


def test_nothing_is_overwritten_unasked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`convert` and `simulate` leave a bag that is there alone; --force writes over a file, never over a folder."""
    table = write_text(tmp_path / "a.csv", ["t", "q1"], [TIMES, POSITIONS[:, 0]])
    for command in (["convert", str(table)], ["simulate", "--duration", "0.2", "--first-stamp", "1"]):
        out = tmp_path / f"{command[0]}.mcap"
        assert main([*command, "--out", str(out)]) == 0
        before = out.read_bytes()
        out.write_bytes(before + b"mine")
        capsys.readouterr()
        assert main([*command, "--out", str(out)]) == 2
        said = capsys.readouterr().err
        assert f"'--out' must be a new file, or --force given to write over it: {out} is there already" in said
        assert out.read_bytes() == before + b"mine"
        assert main([*command, "--out", str(out), "--force"]) == 0
        assert out.read_bytes() == before
