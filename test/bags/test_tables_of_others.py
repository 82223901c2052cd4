# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 34: tables as other programs write them; each test is a row of docs/recordings.md#what-is-read."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from support_bags import read_joint

from stickslip_ros.bags.table import load_table
from stickslip_ros.bags.table_columns import FIELDS, Named, assign
from stickslip_ros.cli.main import main

TIMES = 5.0 + 0.01 * np.arange(30)


def used(names: Sequence[str], *named: Named) -> dict[str, dict[str, str]]:
    """The columns of each joint's fields."""
    found = assign(names, named)
    return {joint: {field: one.name for field, one in fields.items()} for joint, fields in found.joints.items()}


@pytest.mark.parametrize(
    ("layout", "names", "joints"),
    [
        ("rostopic echo -p of a JointControllerState",
         ["time", "field.header.seq", "field.header.stamp", "field.set_point", "field.process_value",
          "field.process_value_dot", "field.process_value_filtered", "field.error", "field.time_step", "field.command",
          "field.p", "field.i", "field.d", "field.i_clamp"],
         {"": {"position": "field.process_value", "velocity": "field.process_value_dot",
               "reference_position": "field.set_point"}}),
        ("gains beside positions",
         ["time", "q1", "q1_ref", "field.position_p", "field.position_i", "field.position_d", "field.position_i_clamp"],
         {"joint1": {"position": "q1", "reference_position": "q1_ref"}}),
        ("rostopic echo -p of a JointTrajectoryControllerState",
         ["time", "field.joint_names0", "field.desired.positions0", "field.desired.time_from_start",
          "field.actual.positions0", "field.actual.velocities0", "field.error.positions0"],
         {"joint0": {"position": "field.actual.positions0", "velocity": "field.actual.velocities0",
                     "reference_position": "field.desired.positions0"}}),
        ("a JointTrajectoryControllerState of ROS 2",
         ["header.stamp.sec", "header.stamp.nanosec", "reference.positions[0]", "feedback.positions[0]",
          "feedback.velocities[0]", "error.positions[0]", "output.positions[0]", "output.effort[0]",
          "speed_scaling_factor"],
         {"joint0": {"position": "feedback.positions[0]", "velocity": "feedback.velocities[0]",
                     "reference_position": "reference.positions[0]"}}),
        ("references by their joints", ["t", "elbow_pos", "elbow_reference", "wrist_pos", "wrist_goal"],
         {"elbow": {"position": "elbow_pos", "reference_position": "elbow_reference"},
          "wrist": {"position": "wrist_pos", "reference_position": "wrist_goal"}}),
        ("one joint, and a reference without its name", ["t", "q1", "goal_position"],
         {"joint1": {"position": "q1", "reference_position": "goal_position"}}),
        ("columns named after joints", ["timestamp", "joint1", "joint2"],
         {"joint1": {"position": "joint1"}, "joint2": {"position": "joint2"}}),
        ("others beside joints", ["timestamp", "seq", "j1", "j2", "temperature"],
         {"j1": {"position": "j1"}, "j2": {"position": "j2"}}),
        ("targets and actual values",
         ["timestamp", "FR_0_target", "FR_0_actual", "FR_0_error", "kneeDesired", "kneeMeas", "hip_actual", "v_target"],
         {"FR_0": {"position": "FR_0_actual", "reference_position": "FR_0_target"},
          "knee": {"position": "kneeMeas", "reference_position": "kneeDesired"}}),
        ("commands and feedback with units", ["t", "knee cmd [deg]", "knee fbk [deg]", "knee_vel"],
         {"knee": {"position": "knee fbk [deg]", "velocity": "knee_vel", "reference_position": "knee cmd [deg]"}}),
        ("actual values beside positions", ["t", "q1", "volts_target", "volts_actual"],
         {"joint1": {"position": "q1"}}),
        ("a motor's current beside a joint", ["t", "hip_current_target", "hip_current_actual", "j1"],
         {"j1": {"position": "j1"}}),
        ("an arm's joints beside its tool",
         ["t", "current_pos_x", "current_pos_y", "current_pos_z", "goal_pos_x", "force_x", "joint_1", "joint_2"],
         {"joint_1": {"position": "joint_1"}, "joint_2": {"position": "joint_2"}}),
        ("q1 beside a tool", ["t", "pos_x", "pos_y", "pos_z", "ee_pos[0]", "q1"], {"joint1": {"position": "q1"}}),
        ("a gantry", ["t", "x_pos", "y_pos", "z_pos"],
         {"x": {"position": "x_pos"}, "y": {"position": "y_pos"}, "z": {"position": "z_pos"}}),
        ("a gantry's targets", ["t", "x_target", "x_actual"],
         {"x": {"position": "x_actual", "reference_position": "x_target"}}),
        ("joints as in a URDF", ["timestamp", "shoulder_pan_joint", "elbow_joint"],
         {"shoulder_pan_joint": {"position": "shoulder_pan_joint"}, "elbow_joint": {"position": "elbow_joint"}}),
    ],
)  # fmt: skip
def test_layouts(layout: str, names: list[str], joints: dict[str, dict[str, str]]) -> None:
    """What the columns of known programs are, by their names."""
    assert used(names) == joints, layout


def test_a_column_without_effect_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A reference that is named serves, where there is one joint; else an error says which joint it could be of."""
    rows = "\n".join(f"{time:.9g},{0.1 * time},{0.1 * time + 0.01},0" for time in TIMES)
    (tmp_path / "a.csv").write_text(f"time_s,present_position,wanted,other\n{rows}\n", encoding="utf-8")
    out = tmp_path / "a.mcap"
    assert main(["convert", str(tmp_path / "a.csv"), "--out", str(out), "--column", "reference_position=wanted"]) == 0
    np.testing.assert_allclose(read_joint(out, "joint1").reference_position, 0.1 * TIMES + 0.01)
    (tmp_path / "b.csv").write_text(f"time_s,q1,q2,wanted\n{rows}\n", encoding="utf-8")
    capsys.readouterr()
    assert (
        main(["convert", str(tmp_path / "b.csv"), "--out", str(tmp_path / "b.mcap"), "--column", "effort=wanted"]) == 2
    )
    said = capsys.readouterr().err
    assert "--column effort=wanted: has no effect" in said
    assert "joint1, joint2" in said
    two = [Named(field="position", column="a"), Named(field="position", column="b"), Named(field="time", column="t")]
    assert set(used(["t", "a", "b"], *two)) == {"a", "b"}
    with pytest.raises(ValueError, match="--column time=u: has no effect"):
        assign(["t", "u", "q1"], [two[2], Named(field="time", column="u")])


TABLES = (
    ["time", "position", "velocity", "current", "note"],
    ["time_s", "q1", "q2", "tau1", "tau2", "goal"],
    ["timestamp", "joint1", "joint2"],
    ["time", "field.set_point", "field.process_value", "field.position_p", "field.position_d"],
    ["time", "stamp", "elbow_pos", "elbow_ref", "wrist_pos", "load_1", "load_2"],
)


@pytest.mark.parametrize("names", TABLES, ids=lambda names: ",".join(names))
def test_every_column_named_serves_or_is_refused(names: list[str]) -> None:
    """Whatever is named of whatever field: it serves as that, or an error has it as it was typed."""
    for field in FIELDS:
        for column in names:
            named = Named(field=field, column=column)
            try:
                found = assign(names, [named])
            except ValueError as error:
                said = str(error)
                refused = f"--column {field}={column}" in said or "needs a column" in said
                if not refused:
                    raise
                continue
            fields = [{"time": one.name} for one in found.time]
            fields += [{name: one.name for name, one in some.items()} for some in found.joints.values()]
            assert {field: column} in [{name: one[name]} for one in fields for name in one], (field, column)


def test_names_as_they_are_shown_and_typed(tmp_path: Path) -> None:
    """`%time` is taken as it stands in the file; a star stands for every column that is nothing else."""
    rows = "\n".join(f"{round(1.7e18) + 10_000_000 * number},{0.1 * number},{0.2 * number}" for number in range(30))
    (tmp_path / "a.csv").write_text(f"%time,left,right\n{rows}\n", encoding="utf-8")
    out = tmp_path / "a.mcap"
    columns = ["--column", "time=%time:ns", "--column", "position=*"]
    assert main(["convert", str(tmp_path / "a.csv"), "--out", str(out), *columns]) == 0
    np.testing.assert_allclose(read_joint(out, "right").position, 0.2 * np.arange(30))


def test_a_star_for_joints_is_suggested(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A table whose columns mean nothing is refused with what would read it."""
    (tmp_path / "a.csv").write_text("timestamp,left,right\n0,1,2\n", encoding="utf-8")
    assert main(["convert", str(tmp_path / "a.csv"), "--out", str(tmp_path / "a.mcap")]) == 2
    assert "--column 'position=*'" in capsys.readouterr().err
    named = [Named(field="position", column="*")]
    assert list(load_table(tmp_path / "a.csv", named).batches) == ["left", "right"]


def test_names_of_joints_in_a_message(tmp_path: Path) -> None:
    """What rostopic and ros2 topic echo of a JointState, the latter without a line of names."""
    rows = [f"{1_700_000_000 + number},{round(1e9 * number)},base,hip,knee,{number},2,0.1,0.2" for number in range(5)]
    (tmp_path / "a.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    batches = load_table(tmp_path / "a.csv").batches
    assert list(batches) == ["hip", "knee"]
    assert batches["hip"].position.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert batches["knee"].velocity.tolist() == [0.2] * 5
    header = "%time,field.header.stamp,field.name0,field.name1,field.position0,field.position1"
    (tmp_path / "b.csv").write_text(f"{header}\n1,2,hip,knee,0.1,0.2\n2,3,hip,knee,0.1,0.2\n", encoding="utf-8")
    assert list(load_table(tmp_path / "b.csv").batches) == ["hip", "knee"]


def write_rows(path: Path, header: str, rows: Sequence[str], above: str = "") -> Path:
    """A table of text."""
    path.write_text(above + "\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def test_date_and_time_in_two_columns(tmp_path: Path) -> None:
    """A date and a time of the day are one time; a date that is read in no one way leaves the time of the day."""
    clocks = [f"12:00:{number // 10:02d}.{number % 10}00" for number in range(30)]
    rows = [f"2026-01-31,{clock},{number}" for number, clock in enumerate(clocks)]
    table = load_table(write_rows(tmp_path / "a.csv", "date,time,q1", rows))
    expected = 1769860800.0 + 0.1 * np.arange(30)
    np.testing.assert_allclose(table.batches["joint1"].time, expected, atol=1e-6)
    named = [Named(field="time", column="a"), Named(field="time", column="b")]
    table = load_table(write_rows(tmp_path / "b.csv", "a,b,q1", rows), named)
    np.testing.assert_allclose(table.batches["joint1"].time, expected, atol=1e-6)
    rows = [f"31/01/2026,{clock},{number}" for number, clock in enumerate(clocks)]
    table = load_table(write_rows(tmp_path / "c.csv", "Date,Time,q1", rows))
    np.testing.assert_allclose(table.batches["joint1"].time, 43200.0 + 0.1 * np.arange(30))
    assert table.unused == ("Date",)


def test_newest_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Rows in the other order are turned round, and that is said."""
    rows = [f"{0.1 * number:.3f},{number}" for number in range(299, -1, -1)]
    path = write_rows(tmp_path / "a.csv", "time_s,q1", rows)
    assert load_table(path).batches["joint1"].position.tolist() == list(range(300))
    assert main(["convert", str(path), "--out", str(tmp_path / "a.mcap")]) == 0
    assert "its rows are newest first" in capsys.readouterr().err


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
def test_lines_above_the_names(delimiter: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What a logger writes above its table is passed over; lines of errors are still counted from the top."""
    above = "Logger 3.1 of today\nSerial: 123\nOperator, me, and, others\n\nSampling rate: 10 Hz\n"
    rows = [delimiter.join((f"{0.1 * number:.3f}", f"{number}", "4")) for number in range(30)]
    header = delimiter.join(("time_s", "q1", "x"))
    table = load_table(write_rows(tmp_path / "a.csv", header, rows, above))
    assert table.batches["joint1"].position.tolist() == list(range(30))
    assert "below 5 other lines" in table.form
    rows[20] = rows[20].replace("20", "20x")
    path = write_rows(tmp_path / "b.csv", header, rows, above)
    assert main(["convert", str(path), "--out", str(tmp_path / "b.mcap")]) == 2
    assert "line 27, column 'q1': must be a number: '20x'" in capsys.readouterr().err


def test_lines_above_the_names_with_empty_cells(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A program that fills every line with commas: its first line was taken for the names."""
    above = "Servo plot,2,,,\nCurves,2,,low,high\n-1,7,angle,#ffff00,0\n"
    path = write_rows(
        tmp_path / "a.csv", "Time[ms],q1,x,,", [f"{10 * number},{number},4,," for number in range(30)], above
    )
    table = load_table(path)
    assert table.batches["joint1"].position.tolist() == list(range(30))
    assert (table.unused, table.notes) == (("x",), ())


def test_units_as_they_are_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`rad/s` and N·m may be typed; an error lists units as they may be typed."""
    rows = [f"{0.1 * number:.3f},{number},90,2" for number in range(30)]
    path = write_rows(tmp_path / "a.csv", "time_s,q1,v1,tau1", rows)
    out = ["--out", str(tmp_path / "a.mcap"), "--force"]
    columns = ["--column", "velocity=v1:deg/s", "--column", "effort=tau1:N·m"]
    assert main(["convert", str(path), *out, *columns]) == 0
    np.testing.assert_allclose(read_joint(tmp_path / "a.mcap", "joint1").velocity, np.pi / 2)
    assert main(["convert", str(path), *out, "--column", "velocity=v1:furlong"]) == 2
    said = capsys.readouterr().err
    assert "must be a unit of rad/s, deg/s" in said
    listed = said.rpartition("a unit of ")[2].partition(": furlong")[0].split(", ")
    for unit in listed:
        assert main(["convert", str(path), *out, "--column", f"velocity=v1:{unit}"]) == 0, unit


def test_a_time_without_a_unit_is_named_where_only_it_has_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The option that is to be typed has the column's name; it had FIELD and COLUMN, and a unit of angles."""
    path = write_rows(tmp_path / "a.csv", "time,q1_deg", [f"{0.1 * number:.3f},{number}" for number in range(30)])
    assert main(["convert", str(path), "--out", str(tmp_path / "a.mcap")]) == 0
    assert "To set it: --column time=time:ms" in " ".join(capsys.readouterr().err.split())


def test_a_unit_of_a_position_is_that_of_its_joint(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """References and speeds without a unit have that of their joint's position; those that have one keep it."""
    path = write_rows(tmp_path / "a.csv", "time_s,q1,q1_ref,dq1,q2,q2_ref,dq2_rad_per_s", [
        f"{0.1 * number:.3f},{number},{number},90,{number},{number},1" for number in range(30)
    ])  # fmt: skip
    columns = ["--column", "position=q1:deg", "--column", "position=q2:mm"]
    assert main(["convert", str(path), "--out", str(tmp_path / "a.mcap"), *columns]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "q1_ref [deg?]" in said
    assert "dq1 [deg/s?]" in said
    assert "guessed (time by its values, else as the joint's position or as usual)" in said
    first, second = (read_joint(tmp_path / "a.mcap", joint) for joint in ("joint1", "joint2"))
    np.testing.assert_allclose(first.reference_position, np.deg2rad(np.arange(30)))
    np.testing.assert_allclose(first.velocity, np.pi / 2)
    np.testing.assert_allclose(second.reference_position, 0.001 * np.arange(30))
    np.testing.assert_allclose(second.velocity, 1.0)


def test_encoder_counts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Counts are a unit whose number a turn is asked for; whole numbers over many turns are suspected to be counts."""
    rows = [f"{0.1 * number:.3f},{7 * number},{number},{number},{number}" for number in range(300)]
    header = "time_s,pos (5),pos (7),target pos (5),target pos (7)"
    path = write_rows(tmp_path / "a.csv", header, rows)
    out = ["--out", str(tmp_path / "a.mcap"), "--force"]
    assert main(["convert", str(path), *out]) == 0
    said = capsys.readouterr().err
    assert "is pos (5) in encoder counts? Then: " in said
    # The hint, followed to the letter, keeps every joint.
    options = shlex.split(said.rpartition("Then: ")[2].strip())
    assert main(["convert", str(path), *out, *options]) == 0
    batch = read_joint(tmp_path / "a.mcap", "joint7")
    np.testing.assert_allclose(batch.position, 2 * np.pi * np.arange(300) / 4096)
    np.testing.assert_allclose(batch.reference_position, batch.position)
    np.testing.assert_allclose(read_joint(tmp_path / "a.mcap", "joint5").position, 7 * batch.position)
    path = write_rows(tmp_path / "b.csv", "time_s,pos_ticks", [",".join(row.split(",")[:2]) for row in rows])
    for more, told in (
        ([], "say how many make a turn, as in --column 'position=pos_ticks:counts/4096'"),
        (["--column", "position=pos_ticks:counts/0"], "must be a unit of rad, deg, rev, counts/4096"),
        (["--column", "position=pos_ticks:counts"], "with the counts that make a turn, as in pos_ticks:counts/4096"),
    ):
        assert main(["convert", str(path), *out, *more]) == 2
        assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ("names", "joints"),
    [(("q1", "q2"), ("joint1", "joint2")), (("elbow_pos", "wrist_pos"), ("elbow", "wrist")),
     (("hip_pos", "q2_rad"), ("hip", "joint2"))],
)  # fmt: skip
def test_hints_keep_every_joint(
    names: tuple[str, str], joints: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Degrees without a unit are asked about, and the options that are suggested name all joints."""
    rows = [f"{0.1 * number:.3f},{0.5 * number},{0.001 * number}" for number in range(300)]
    path = write_rows(tmp_path / "a.csv", ",".join(("time_s", *names)), rows)
    out = ["--out", str(tmp_path / "a.mcap"), "--force"]
    assert main(["convert", str(path), *out]) == 0
    said = capsys.readouterr().err
    assert main(["convert", str(path), *out, *shlex.split(said.rpartition("Then: ")[2].strip())]) == 0
    factor = 1.0 if "rad" in names[1] else np.pi / 180.0
    np.testing.assert_allclose(read_joint(tmp_path / "a.mcap", joints[1]).position, 0.001 * np.arange(300) * factor)
    np.testing.assert_allclose(read_joint(tmp_path / "a.mcap", joints[0]).position, np.deg2rad(0.5 * np.arange(300)))
