# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 20: names and messages of others command no terminal and no spreadsheet, wherever they come out."""

from __future__ import annotations

import csv
import io
import json
import math
import shutil
import unicodedata
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from hypothesis import example, given
from hypothesis import strategies as st
from support_bags import simulated_bag

from stickslip_ros.cli.main import main
from stickslip_ros.cli.monitor_client import WatchListener
from stickslip_ros.cli.terminal import Terminal
from stickslip_ros.cli.watch_view import view
from stickslip_ros.errors import StickSlipError
from stickslip_ros.output.as_json import json_text
from stickslip_ros.output.csv_table import write_csv
from stickslip_ros.settings.parameter_file import Parameters
from stickslip_ros.visible import visible

ESCAPES = "\x1b[31m\x1b]0;title\x07\x9b2J\x08\r\x7f\u202e\u2028"
NAME = (
    f"=cmd|'/C calc'!A0{ESCAPES}\nstickslip: all is well[link=http://x]joint[/link]</script><script>alert(1)</script>"
)


def commands(text: str) -> list[str]:
    """Characters in a text that do something, but for ends of lines."""
    return [one for one in text if unicodedata.category(one) in ("Cc", "Cf", "Cs", "Zl", "Zp") and one != "\n"]


@given(st.text())
@example("\ue000")
def test_texts_are_visible(text: str) -> None:
    """Nothing hidden stays, what is visible stays as it is, and twice is as once."""
    shown = visible(text)
    assert not commands(shown)
    assert "\n" not in shown
    assert visible(shown) == shown
    assert shown.isprintable()
    assert shown == text or not text.isprintable()
    assert "\n" not in str(StickSlipError(text))


@given(st.recursive(st.text(), lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=5))
def test_json_means_what_it_meant(content: object) -> None:
    """What is escaped comes back."""
    text = json_text(content)
    assert text.isprintable()
    assert json.loads(text) == content


CELLS = st.one_of(
    st.none(),
    st.floats(),
    st.integers(),
    st.text(st.characters(exclude_categories=["Cs"])),
    st.tuples(st.sampled_from("=+-@\t\r＝"), st.text("abc(),;\"'\n")).map("".join),
)


@given(rows=st.lists(st.lists(CELLS, min_size=1, max_size=4), max_size=4))
def test_cells_are_text_or_numbers(rows: list[list[object]], tmp_path_factory: pytest.TempPathFactory) -> None:
    """No cell begins a formula unless it is a number, which stays one; all text is there."""
    path = tmp_path_factory.mktemp("csv") / "a.csv"
    write_csv(path, rows)
    found = list(csv.reader(io.StringIO(path.read_bytes().decode(), newline="")))
    assert len(found) == len(rows)
    for row, cells in zip(rows, found, strict=True):
        for value, text in zip(row, cells, strict=False):
            if isinstance(value, str):
                assert text in (value, f"'{value}")
            elif isinstance(value, float):
                assert float(text) == value or math.isnan(value)
            if text[:1] in ("=", "+", "-", "@", "\t", "\r", "＝"):
                float(text)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A joint that sticks, of a hostile name and robot, in a bag of a hostile name."""
    return simulated_bag(tmp_path / f"a{ESCAPES.replace('/', '')}.mcap", names=(NAME, "other"), duration=6.0)


@pytest.mark.slow
def test_what_analyze_writes(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Table, JSON, CSV, page and fleet: the name is visible, on its line, and runs nothing."""
    written = {kind: tmp_path / f"written.{kind}" for kind in ("csv", "html")}
    arguments = ["analyze", str(bag), "--no-learning"]
    assert main([*arguments, "--csv", str(written["csv"]), "--html", str(written["html"])]) == 0
    printed = capsys.readouterr()
    assert "\\x1b[31m" in printed.out
    assert not commands(printed.out + printed.err)
    assert not [line for line in printed.out.splitlines() if line.startswith("stickslip:")]
    assert main([*arguments, "--json"]) == 0
    (answer,) = json.loads(capsys.readouterr().out)["bags"]
    assert visible(NAME) in answer["joints"]
    other = shutil.copy(bag, tmp_path / "other.mcap")
    fleet = ["--table", str(tmp_path / "fleet.csv"), "--joint", visible(NAME), "--no-learning"]
    assert main(["analyze", str(bag), str(other), *fleet]) == 0
    assert not commands(capsys.readouterr().out)
    for path in (written["csv"], tmp_path / "fleet.csv"):
        cells = [cell for row in csv.reader(path.read_text(encoding="utf-8").splitlines()) for cell in row]
        assert any(cell.startswith("'=cmd") for cell in cells)
        assert not [cell for cell in cells if cell.startswith(("=", "@"))]
    page = written["html"].read_text(encoding="utf-8")
    library = page[page.index("<script>") : page.index("</script>")]
    assert not commands(page.replace(library, "").replace("\t", ""))
    assert "<script>alert" not in page


@pytest.mark.slow
def test_what_is_refused(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One visible line, whatever was typed or recorded."""
    for arguments in (
        ["analyze", str(bag), "--joint", f"none{ESCAPES}"],
        ["analyze", f"none{ESCAPES}\n.mcap"],
        ["identify", str(bag), "--on", f"none{ESCAPES}"],
        ["margin", "--model", f"none{ESCAPES}\n"],
    ):
        assert main(arguments) == 2
        complaint = capsys.readouterr().err
        assert not commands(complaint)
        assert complaint.count("\n") == 1


def test_parameters_of_others(tmp_path: Path) -> None:
    """What is wrong with them is said visibly."""
    path = tmp_path / "a.yaml"
    path.write_text(f"stickslip_monitor: {{ros__parameters: {{{json.dumps('limits' + ESCAPES)}: 1}}}}")
    with pytest.raises(StickSlipError) as refused:
        Parameters.of_files([path])
    assert not commands(str(refused.value))


def test_what_watch_shows(ros_domain: int) -> None:
    """Statuses that anybody may publish: the view has one line for each, and only rich's own commands."""
    listener = WatchListener()
    try:
        status = DiagnosticStatus(
            level=DiagnosticStatus.ERROR, name=f"stickslip_monitor: {NAME}", hardware_id=NAME, message=NAME,
            values=[KeyValue(key="status", value=NAME), KeyValue(key="exact outcome", value=NAME)],
        )  # fmt: skip
        listener.note(status)
        out = io.StringIO()
        console = Terminal(file=out, width=2000)
        console.print(view(listener.joints(), f"header{ESCAPES}", console, duration=10.0))
        assert not commands(out.getvalue())
        assert not [line for line in out.getvalue().splitlines() if line.startswith("stickslip:")]
    finally:
        listener.close()
