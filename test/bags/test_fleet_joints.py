# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 22, item 2: a fleet for triage: changes and their significance, alarms, a page that is sorted and filtered."""

from __future__ import annotations

import copy
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import browser
from hypothesis import given
from hypothesis import strategies as st
from support_bags import sticking

from stickslip_ros.analysis.analysis import AnalysisOptions, analyze
from stickslip_ros.analysis.analysis_json import bag_json
from stickslip_ros.analysis.fleet_joints import QUANTITIES, fleet_joints, parse_alarm
from stickslip_ros.analysis.report.fleet_page import sparkline, write_fleet_page
from stickslip_ros.analysis.trend import DAY, MONTH, Measured, trend
from stickslip_ros.bags.simulated import write_simulation
from stickslip_ros.cli.analyze import print_fleet
from stickslip_ros.cli.main import main
from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.settings.parameter_file import Parameters

pytestmark = pytest.mark.slow

_START = 1.79e9
_WEEK = 7.0 * DAY


@given(
    st.floats(-3.0, 3.0), st.floats(0.01, 10.0), st.integers(3, 12), st.integers(0, 1000),
)  # fmt: skip
def test_a_straight_line_is_found(slope: float, first: float, count: int, seed: int) -> None:
    """Whatever the dates and the errors of the values: of values on a line, that line."""
    generator = np.random.default_rng(seed)
    times = _START + np.sort(generator.uniform(0.0, MONTH, count))
    times[0], times[-1] = _START, _START + MONTH
    values = first + slope * (times - _START) / MONTH
    found = trend(times.tolist(), values.tolist(), generator.uniform(0.01, 1.0, count).tolist())
    assert found is not None
    assert found.a_month == pytest.approx(slope, abs=1e-9)
    assert found.relative == pytest.approx(slope / first, abs=1e-6)


def test_chance_is_seldom_called_a_change() -> None:
    """Of friction that stays as it is, told with errors, about 5 % of trends are called more than chance."""
    generator = np.random.default_rng(1)
    times = (_START + _WEEK * np.arange(6)).tolist()
    for errors in ([0.2] * 6, [math.nan] * 6):
        called = 0
        for _ in range(1000):
            found = trend(times, (8.0 + 0.2 * generator.standard_normal(6)).tolist(), errors)
            assert found is not None
            called += found.significant
        assert called <= 70


def test_too_little_for_a_trend() -> None:
    """Two recordings, or three of one day, are no trend of months."""
    assert trend([_START, _START + MONTH], [1.0, 2.0], [0.1, 0.1]) is None
    assert trend([_START, _START + 3600.0, _START + 7200.0], [1.0, 2.0, 3.0], [0.1] * 3) is None


@pytest.mark.parametrize(
    ("text", "first", "latest", "rings"),
    [
        ("coulomb=+15%", Measured(8.0, 0.1), Measured(9.3, 0.1), True),
        ("coulomb=+15%", Measured(8.0, 0.1), Measured(9.1, 0.1), False),
        ("coulomb=+15%", Measured(8.0, 0.1), Measured(6.0, 0.1), False),
        # By as much as chance makes of such errors.
        ("coulomb=+15%", Measured(8.0, 1.0), Measured(9.3, 1.0), False),
        ("reserve=-50%", Measured(0.8), Measured(0.3), True),
        ("reserve=-50%", Measured(0.8), Measured(0.5), False),
        ("reserve<20%", Measured(0.8), Measured(0.1), True),
        ("reserve < 20%", Measured(0.1), Measured(0.3), False),
        ("stick_slip>5%", Measured(0.0), Measured(0.06), True),
        ("stick_slip>5%", Measured(0.5), Measured(0.04), False),
        ("coulomb>9", Measured(8.0, 0.1), Measured(9.5, 0.1), True),
        ("coulomb>9", Measured(8.0, 0.1), Measured(9.5, 0.4), False),
    ],
)
def test_alarms(text: str, first: Measured, latest: Measured, rings: bool) -> None:
    """They ring for what they are about, and not for chance."""
    assert bool(parse_alarm(text).rings(first, latest)) is rings


@pytest.mark.parametrize(
    ("text", "right"),
    [
        ("coulomb", "like coulomb=+15%"), ("friction=+15%", ", ".join(QUANTITIES)), ("coulomb=+15", "in per cent"),
        ("coulomb=+0%", "above 0"), ("coulomb>5%", "without %"), ("reserve<0.2", "in per cent"),
        ("coulomb=+1.2.3%", "a number"), ("coulomb=15%", "like coulomb=+15%"),
    ],
)  # fmt: skip
def test_alarms_that_are_none(text: str, right: str) -> None:
    """The error has what was typed, and what would be right."""
    with pytest.raises(InvalidParameterError) as refused:
        parse_alarm(text)
    assert "'--alarm'" in str(refused.value)
    assert right in str(refused.value)
    assert text in str(refused.value)


@given(st.lists(st.tuples(st.floats(0.0, 1e9), st.floats(-1e6, 1e6)), max_size=200))
def test_sparklines_stay_inside(points: list[tuple[float, float]]) -> None:
    """Whatever the values."""
    points.sort()
    drawn = sparkline([x for x, _ in points], [y for _, y in points])
    assert (drawn == "") == (len(points) < 2)
    for x, y in re.findall(r"(-?[\d.]+),(-?[\d.]+)", drawn):
        assert 0.0 <= float(x) <= 84.0
        assert 0.0 <= float(y) <= 20.0


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """Ten robots of seven joints, eight weeks: what one analysed bag shows, changed a little from week to week."""
    path = tmp_path_factory.mktemp("fleet") / "one.mcap"
    write_simulation(path, {"elbow": sticking(0.007)}, duration=16.0, rate=200.0, start=_START)
    options = AnalysisOptions(parameters=Parameters({"model.*": "puma560_joint1"}))
    one = bag_json(analyze(path, options))
    joint = one["joints"]["elbow"]
    assert joint["friction"]["coulomb_and_load"]["identified"]
    found = []
    for robot in range(10):
        for week in range(8):
            joints = {}
            for number in range(7):
                changed = copy.deepcopy(joint)
                friction = changed["friction"]["coulomb_and_load"]
                friction["std"] = 0.05
                if number == robot % 7:
                    friction["value"] *= 1.0 + 0.03 * week
                if number > 3:
                    changed |= {"status": "smooth", "worst_status": "smooth", "stick_slip_share": 0.0}
                joints[f"axis{number}"] = changed
            name = f"/data/robot{robot}/week{week}.mcap"
            found.append(one | {"path": name, "recorded": _START + week * _WEEK, "joints": joints})
    return found


def test_changes_and_alarms_of_a_fleet(answers: list[dict[str, Any]]) -> None:
    """The joints whose friction grows, and no others; these come first."""
    joints = fleet_joints(answers, [parse_alarm("coulomb=+15%")])
    ringing = [joint for joint in joints if joint.alarms]
    assert joints[: len(ringing)] == ringing
    assert {(joint.robot, joint.name) for joint in ringing} == {(f"robot{one}", f"axis{one % 7}") for one in range(10)}
    for joint in joints:
        line = joint.histories["coulomb"].trend
        assert line is not None
        assert line.significant is bool(joint.alarms)
        if joint.alarms:
            assert line.relative == pytest.approx(0.03 * MONTH / _WEEK, rel=0.02)


def test_short_recordings_are_no_history(answers: list[dict[str, Any]]) -> None:
    """Three seconds of motion are no point of a joint's history."""
    short = copy.deepcopy(answers[:8])
    for bag in short[1:]:
        bag["joints"]["axis0"]["moving_time"] = 3.0
    histories = next(one for one in fleet_joints(short) if one.name == "axis0").histories
    points = {name: len(history.points) for name, history in histories.items()}
    # The one recording that is long enough does not show whether viscous friction is a straight line.
    assert points.pop("viscous") == int(short[0]["joints"]["axis0"]["friction"]["viscous"]["identified"])
    assert set(points.values()) == {1}, points
    assert all(history.trend is None for history in histories.values())


def test_one_of_a_kind_is_told_so(
    answers: list[dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Issue 40, item 6: "1 recording", "1 robot", "1 joint"; what changes by nothing has no sign; the terminal names a
    broken bag too.
    """
    still = [copy.deepcopy(one) for one in answers[:3]]
    for bag in still:
        bag["joints"] = {"axis0": bag["joints"]["axis0"]}
    for bag, change in zip(still, (1e-5, 0.0, -1e-5), strict=True):
        bag["joints"]["axis0"]["friction"]["coulomb_and_load"]["value"] = 8.0 * (1.0 + change)
    broken = {"path": "/data/robot0/broken.mcap", "error": "bag /data/robot0/broken.mcap: neither one nor the other"}
    page = tmp_path / "fleet.html"
    write_fleet_page(page, [*still, broken], fleet_joints(still))
    text = " ".join(page.read_text(encoding="utf-8").split())
    assert "1 of 1 joint of 1 robot stuck" in text
    assert "1 recording could not be analysed" in text
    assert "-0.0<" not in text
    write_fleet_page(page, [*still, broken], fleet_joints(still), with_alarms=True)
    text = " ".join(page.read_text(encoding="utf-8").split())
    assert "0 joints have an alarm.</strong> <strong class='at_risk'>1 recording could" in text
    write_fleet_page(page, still[:1], fleet_joints(still[:1]))
    assert "Stick-slip in 1 recording<" in page.read_text(encoding="utf-8")
    print_fleet(fleet_joints(still), [*still, broken])
    assert "1 bag could not be analysed: /data/robot0/broken.mcap" in capsys.readouterr().out


def test_terminal_and_page_have_the_same(
    answers: list[dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Issue 40, item 6: a fleet's joint has one status and one share, those of its last recording; the terminal had
    the status of the longest motion, and the share of all.
    """
    found = copy.deepcopy(answers[:3])
    for number, bag in enumerate(found):
        sticks = dict.fromkeys(("status", "worst_status"), "stick_slip") | {"stick_slip_share": 0.25}
        smooth = dict.fromkeys(("status", "worst_status"), "smooth") | {"stick_slip_share": 0.0, "moving_time": 900.0}
        bag["joints"] = {"axis0": bag["joints"]["axis0"] | (sticks if number == 2 else smooth)}
    joints = fleet_joints(found)
    page = tmp_path / "fleet.html"
    write_fleet_page(page, found, joints)
    print_fleet(joints, found)
    (line,) = [line.split() for line in capsys.readouterr().out.splitlines() if "axis0" in line]
    assert line[2:5] == ["stick_slip", "25", "%"]
    table = page.read_text(encoding="utf-8").partition("<table id='joints'")[2].partition("</table>")[0]
    assert "data-status='stick_slip'" in table
    assert re.search(r"data-sort='0.25'>.*</svg>25<", table)


def test_the_page_is_sorted_and_filtered(answers: list[dict[str, Any]], tmp_path: Path) -> None:
    """In Chromium: heads sort, what has no value stands last, the filter and the alarms choose, a joint has plots."""
    alarms = [parse_alarm("coulomb=+15%")]
    page = tmp_path / "fleet.html"
    reports = {found["path"]: tmp_path / "re ports" / f"{number}.html" for number, found in enumerate(answers)}
    hostile = copy.deepcopy(answers)
    hostile[-1]["joints"] = {"</script><script>alert(1)</script>\x1b[31m": hostile[-1]["joints"]["axis6"]}
    write_fleet_page(page, hostile, fleet_joints(hostile, alarms), reports, with_alarms=True)
    with browser() as view:
        view.open(page)
        view.wait(lambda: view.run("return document.documentElement.dataset.joints") == "ready", "the joints")
        rows = "[...document.querySelectorAll('#joints tbody tr')]"
        assert view.run(f"return {rows}.length") == 71
        assert view.run(f"return {rows}[0].dataset.alarm") == "yes"
        assert "re%20ports/" in view.run(f"return {rows}[0].querySelector('a').getAttribute('href')")
        change = 6
        for order in ("descending", "ascending"):
            view.run(f"document.querySelectorAll('#joints th button')[{change}].click()")
            head = f"document.querySelectorAll('#joints th')[{change}]"
            assert view.run(f"return {head}.getAttribute('aria-sort')") == order
            values = view.run(f"return {rows}.map(row => Number(row.cells[{change}].dataset.sort))")
            told = [value for value in values if value is not None and math.isfinite(value)]
            assert told == sorted(told, reverse=order == "descending")
            assert values[: len(told)] == told
        type_it = "one.dispatchEvent(new Event('input'))"
        view.run(f"const one = document.getElementById('filter'); one.value = 'ROBOT3 axis'; {type_it}")
        shown = f"return {rows}.filter(row => !row.hidden).map(row => row.cells[0].textContent)"
        assert view.run(shown) == ["robot3"] * 7
        view.run(f"const one = document.getElementById('ringing'); one.checked = true; {type_it}")
        assert view.run(shown) == ["robot3"]
        view.run(f"{rows}.find(row => !row.hidden).querySelector('button').click()")
        assert view.run("return document.getElementById('chosen').textContent") == "robot3 axis3"
        drawn = "return Bokeh.documents[0].get_model_by_name('coulomb history').data.value.length"
        assert view.run(drawn) == 8
        assert view.run("return document.querySelectorAll('#recordings tbody tr').length") == 8
        assert view.complaints() == []


def test_reports_and_alarms_of_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each bag has its report, which the page links to; kept answers do not lose it; alarms are told, and make 1."""
    for robot in ("left", "right"):
        (tmp_path / robot).mkdir()
        write_simulation(
            tmp_path / robot / "monday.mcap", {"elbow": sticking(0.007)}, duration=9.0, rate=200.0, start=_START
        )
    page, reports = tmp_path / "fleet.html", tmp_path / "reports"
    command = ["analyze", str(tmp_path / "left"), str(tmp_path / "right"), "--results", str(tmp_path / "kept")]
    linked = [*command, "--html", str(page), "--reports", str(reports)]
    assert main(linked) == 0
    assert sorted(one.name for one in reports.iterdir()) == ["left-monday.html", "right-monday.html"]
    assert "href='reports/left-monday.html'" in page.read_text(encoding="utf-8")
    (reports / "left-monday.html").unlink()
    assert main(linked) == 0
    assert (reports / "left-monday.html").exists()
    capsys.readouterr()
    assert main([*command, "--alarm", "stick_slip>5%"]) == 1
    assert capsys.readouterr().out.count("alarm: ") == 2
    assert main([*command, "--alarm", "stick_slip>5%", "--json"]) == 1
    assert len(json.loads(capsys.readouterr().out)["alarms"]) == 2
    assert main([*command, "--alarm", "coulomb=15"]) == 2
