# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 22, item 1: two recordings, before and after a change; did it help, and is that more than chance?"""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from support_bags import KNOWN, WITHOUT_LEARNING, sticking

from stickslip_ros.analysis.analysis import AnalysisOptions, BagAnalysis, analyze
from stickslip_ros.analysis.comparison import (
    JointComparison,
    Measured,
    Quantity,
    Verdict,
    _error_of_mean,
    compare,
    sentence,
)
from stickslip_ros.bags.simulated import RecordedJoint, write_simulation
from stickslip_ros.cli.main import main
from stickslip_ros.model.friction import Gains
from stickslip_ros.settings.parameter_file import Parameters

pytestmark = pytest.mark.slow

STICKS = replace(sticking(0.0058), position_noise=1e-6)
CURED = replace(STICKS, gains=Gains(stiffness=7400.0, damping=40.0))
STIFFER = replace(STICKS, gains=Gains(stiffness=1200.0))
LEARNING = AnalysisOptions()
FINE = replace(STICKS, encoder_resolution=2e-6)  # whose friction is identified soon


def greased(share: float) -> RecordedJoint:
    """The joint with less Stribeck friction."""
    friction = replace(KNOWN.joint.friction, stribeck=share * KNOWN.joint.friction.stribeck)
    return replace(FINE, joint=replace(KNOWN.joint, friction=friction))


def analysed(
    path: Path, joint: RecordedJoint, *, duration: float = 25.0, seed: int = 1,
    options: AnalysisOptions = WITHOUT_LEARNING, name: str = "elbow", **more: Any,
) -> BagAnalysis:  # fmt: skip
    """The analysis of a joint's simulated recording."""
    write_simulation(path, {name: joint}, duration=duration, rate=500.0, seed=seed, **more)
    return analyze(path, options)


@cache
def analysis_of(joint: RecordedJoint, duration: float, seed: int, learning: bool) -> BagAnalysis:
    """The same, made once: tests compare one recording with several."""
    with TemporaryDirectory() as folder:
        options = LEARNING if learning else WITHOUT_LEARNING
        return analysed(Path(folder) / f"{seed}.mcap", joint, duration=duration, seed=seed, options=options)


def compared(
    before: RecordedJoint, after: RecordedJoint, *, durations: tuple[float, float] = (25.0, 25.0),
    options: AnalysisOptions = WITHOUT_LEARNING,
) -> JointComparison:  # fmt: skip
    """A joint's two recordings, compared."""
    found = [
        analysis_of(joint, duration, number, options is LEARNING)
        for number, (joint, duration) in enumerate(zip((before, after), durations, strict=True), start=1)
    ]
    (joint,) = compare(*found).joints
    return joint


def test_a_cure_helped_and_its_undoing_is_worse() -> None:
    """Other gains: stick-slip before and none after; the other way round it got worse; the gains are named."""
    helped = compared(STICKS, CURED)
    assert helped.verdict is Verdict.HELPED
    assert re.fullmatch(
        r"elbow: it helped: stick-slip for 9\d % of its moving time before, none in 24\.\d s after; "
        r"stiffness 630 to 7400 N·m/rad, damping 0 to 40 N·m·s/rad\.",
        sentence(helped),
    ), sentence(helped)
    worse = compared(CURED, STICKS)
    assert worse.verdict is Verdict.WORSE
    assert "elbow: it got worse: stick-slip for 0 % of its moving time before, 9" in sentence(worse)


def test_the_same_joint_twice_has_not_changed() -> None:
    """Other noise, and a year between: nothing is significant, friction is the same within its errors."""
    joint = compared(FINE, FINE, options=LEARNING)
    assert joint.verdict is Verdict.NO_CHANGE
    compared_ones = [one for one in joint.quantities if not one.missing]
    assert {"stick_slip_share", "usual_slip", "stiffness", "inertia", "stribeck"} <= {one.name for one in compared_ones}
    assert not [one.name for one in compared_ones if one.significant]
    assert sentence(joint).endswith("; the gains are the same; friction is the same within its errors.")


def test_new_grease_is_seen_in_the_friction() -> None:
    """Less Stribeck friction, same gains: it sticks on with smaller slips, and that one parameter is what changed."""
    joint = compared(FINE, greased(0.75), options=LEARNING)
    assert joint.verdict is Verdict.SMALLER_SLIPS
    friction = {one.name: one for one in joint.friction}
    changed = [name for name, one in friction.items() if one.significant]
    assert changed == ["stribeck"]
    stribeck = friction["stribeck"]
    assert stribeck.after.value / stribeck.before.value == pytest.approx(0.75, abs=0.03)
    assert "; the gains are the same; friction changed: Stribeck friction after a long rest 1.6" in sentence(joint)
    dried = compared(greased(0.75), FINE)
    assert dried.verdict is Verdict.LARGER_SLIPS


def test_a_little_stiffer_helps_in_part() -> None:
    """It sticks as often, with smaller slips, significantly."""
    joint = compared(STICKS, STIFFER)
    assert joint.verdict is Verdict.SMALLER_SLIPS
    assert joint.slip.significant
    assert not joint.share.significant
    assert re.search(r"slips of 0\.006\d* rad before, 0\.003\d* rad after", sentence(joint))


def test_other_speeds_are_not_compared() -> None:
    """Stick-slip ends with speed: faster motion that is smooth, or sticks less, says nothing of the change."""
    fast = replace(CURED, velocities=(0.03,))
    joint = compared(STICKS, fast)
    assert joint.verdict is Verdict.CANNOT_SAY
    assert "it stuck at 0.00581 rad/s, and after it moved so slowly for 0" in sentence(joint)
    assert joint.share.significant is None
    assert joint.slip.significant is None
    both = compared(STICKS, replace(STICKS, velocities=(0.0116,)))
    assert both.verdict is Verdict.CANNOT_SAY
    assert "it stuck at 0.00581 rad/s before and at 0.0116 rad/s after; record both at one speed" in sentence(both)
    # Slower is harder: smooth there counts.
    assert compared(STICKS, replace(CURED, velocities=(0.004,))).verdict is Verdict.HELPED


@pytest.mark.parametrize(("durations", "verdict"), [((8.0, 2.5), Verdict.NO_CHANGE), ((25.0, 8.0), Verdict.HELPED)])
def test_too_short_a_look_proves_nothing(durations: tuple[float, float], verdict: Verdict) -> None:
    """Two seconds without a slip of a joint that slips every second may be chance; seven are not."""
    joint = compared(STICKS, CURED, durations=durations)
    assert joint.verdict is verdict
    moving = joint.before.moving_time
    chance = (moving / (moving + joint.after.moving_time)) ** len(joint.before.cycles)
    assert (chance < 0.05) is (verdict is Verdict.HELPED)


def test_what_was_not_judged_is_not_compared() -> None:
    """A joint at rest is neither better nor worse."""
    joint = compared(STICKS, replace(STICKS, velocities=(0.0,)))
    assert joint.verdict is Verdict.CANNOT_SAY
    assert sentence(joint).startswith("elbow: not enough data to judge whether it helped; after: ")


def test_what_is_not_identified_is_not_compared() -> None:
    """Smooth motion shows nothing of the slips' friction: no number of it is compared, nor its margin."""
    joint = compared(FINE, CURED, options=LEARNING)
    assert joint.friction
    assert {one.significant for one in joint.friction} == {None}
    assert {one.missing for one in joint.friction} == {"after: the motion does not identify it"}
    assert joint.reserve.significant is None
    assert joint.verdict is Verdict.HELPED


def test_beyond_the_combined_errors() -> None:
    """95 %: 1.96 times the root of the squares' sum, neither less nor more."""

    def quantity(change: float, **more: Any) -> Quantity:
        before, after = Measured(value=10.0, error=0.3), Measured(value=10.0 + change, error=0.4)
        return Quantity(name="x", label="x", unit="", before=before, after=after, **more)

    assert quantity(0.97).significant is False
    assert quantity(0.99).significant is True
    assert quantity(-0.99).significant is True
    assert quantity(9.0, missing="why").significant is None
    assert quantity(0.0, certain=True).significant is True


@pytest.mark.parametrize("alike", [0.0, 0.6])
def test_slips_that_are_alike_count_for_less(alike: float) -> None:
    """Of two runs of the same joint whose slips wander, about one in twenty differs by more than the errors allow."""
    generator = np.random.default_rng(7)

    def mean_and_error() -> tuple[float, float]:
        values = np.zeros(60)
        values[0] = generator.standard_normal() / math.sqrt(1.0 - alike**2)
        for number in range(1, len(values)):
            values[number] = alike * values[number - 1] + generator.standard_normal()
        return float(values.mean()), _error_of_mean(values)

    beyond = 0
    for _ in range(1000):
        (one, error), (other, its_error) = mean_and_error(), mean_and_error()
        beyond += abs(one - other) > 1.96 * math.hypot(error, its_error)
    assert 0.03 < beyond / 1000 < 0.11


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two joints before; one of them, and another one, after."""
    folder = tmp_path_factory.mktemp("bags")
    paths = folder / "before.mcap", folder / "after.mcap"
    for path, joints in zip(paths, ({"elbow": STICKS, "wrist": CURED}, {"elbow": CURED, "hand": CURED}), strict=True):
        write_simulation(path, joints, duration=15.0, rate=500.0)
    return paths


def test_the_command(bags: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    """A table of what changed, the sentence, and what is in one recording only; the same as JSON."""
    command = ["compare", *map(str, bags), "--no-learning"]
    assert main(command) == 0
    printed = capsys.readouterr().out
    for text in (
        r"status +stick_slip +smooth +changed",
        r"stick-slip +9\d % +0 % +significantly less",
        r"gain: stiffness \[N·m/rad\] +630 +7400 +changed",
        r"elbow: it helped: stick-slip for",
        "warning: wrist is in the recording before only",
        "warning: hand is in the recording after only",
    ):
        assert re.search(text, printed), printed
    assert main([*command, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    elbow = found["joints"]["elbow"]
    assert list(found["joints"]) == ["elbow"]
    assert found["only_in"] == {"wrist": "before", "hand": "after"}
    assert elbow["verdict"] == "helped"
    assert elbow["summary"].startswith("elbow: it helped")
    assert elbow["before"]["status"] == "stick_slip"
    assert elbow["after"]["cycles"] == 0
    assert elbow["quantities"]["stick_slip_share"]["significant"] is True
    assert elbow["quantities"]["damping"] == {
        "unit": "N·m·s/rad", "before": {"value": 0.0, "std": 0.0}, "after": {"value": 40.0, "std": 0.0},
        "significant": True, "not_compared": None,
    }  # fmt: skip


def test_gains_that_were_not_recorded(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`--gains` is for both bags, `--gains-after` for the second; a joint that is in neither is an error."""
    for name, joint in (("before", STICKS), ("after", CURED)):
        write_simulation(tmp_path / f"{name}.mcap", {"elbow": joint}, duration=8.0, rate=500.0, with_gains=False)
    command = ["compare", str(tmp_path / "before.mcap"), str(tmp_path / "after.mcap"), "--no-learning", "--gains=630,0"]
    assert main(command) == 0
    assert "; the gains are the same." in capsys.readouterr().out
    assert main([*command, "--gains-after", "elbow=7400,40"]) == 0
    assert "stiffness 630 to 7400 N·m/rad, damping 0 to 40 N·m·s/rad" in capsys.readouterr().out
    assert main([*command, "--gains-after", "elbw=7400,40"]) == 2
    assert (
        "--gains-after elbw=7400,40: no joint 'elbw' in any of 2 bags; did you mean 'elbow'?" in capsys.readouterr().err
    )
    assert main([*command, "--gains-after", "elbow=-1"]) == 2
    assert "'--gains-after' must be finite and >= 0" in capsys.readouterr().err


def test_nothing_in_common(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two recordings of different joints have nothing to compare."""
    for name in ("shoulder", "elbow"):
        write_simulation(tmp_path / f"{name}.mcap", {name: STICKS}, duration=2.0, rate=200.0)
    assert main(["compare", str(tmp_path / "shoulder.mcap"), str(tmp_path / "elbow.mcap"), "--no-learning"]) == 2
    said = capsys.readouterr().err
    assert "no joint is in both bags: shoulder before, elbow after" in said


def test_configured_friction_and_learnt_are_not_compared(tmp_path: Path) -> None:
    """A margin of configured friction has no error: it is compared with its like alone."""
    configured = AnalysisOptions(parameters=Parameters({"learn": False, "model.*": "puma560_joint1"}))
    before = analysed(tmp_path / "1.mcap", STICKS, options=configured)
    learnt = analysis_of(FINE, 25.0, 1, True)
    (joint,) = compare(before, learnt).joints
    assert joint.reserve.missing == "configured in one recording, learnt in the other"
    cured = analysed(tmp_path / "3.mcap", CURED, options=configured)
    (joint,) = compare(before, cured).joints
    assert joint.reserve.significant is True


def test_the_page_has_the_rows_of_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 40: terminal and page show the same rows with the same texts, and no markup of the one in the other."""
    for name, joint in (("before", STICKS), ("after", CURED)):
        write_simulation(tmp_path / f"{name}.mcap", {"elbow": joint}, duration=8.0, rate=500.0)
    page = tmp_path / "page.html"
    command = ["compare", str(tmp_path / "before.mcap"), str(tmp_path / "after.mcap"), "--no-learning"]
    assert main([*command, "--model", "puma560_joint1", "--html", str(page)]) == 0
    table = capsys.readouterr().out.partition("\nelbow ")[2].partition("\nelbow: ")[0].splitlines()[1:]
    shown = [re.split(r"  +", line.strip()) for line in table if not line.startswith("not compared")]
    html = page.read_text(encoding="utf-8").partition("<tbody>")[2].partition("</tbody>")[0]
    cells = [re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL) for row in html.split("<tr>")[1:]]
    drawn = [[re.sub(r"<[^>]*>", "", cell).strip() for cell in row] for row in cells]
    assert ["model predicts", "sticks", "moves steadily"] in shown
    assert [
        [cell.replace("stick-slip", "stick_slip") if row[0] == "status" else cell for cell in row if cell]
        for row in drawn
    ] == shown


def test_the_page_is_there_before_the_table(bags: tuple[Path, Path], tmp_path: Path) -> None:
    """The page was lost where `head` closed the pipe of the table, and the table with `--html` in a full folder."""
    page = tmp_path / "page.html"
    command = [sys.executable, "-m", "stickslip_ros.cli.main", "compare", *map(str, bags), "--no-learning"]
    with subprocess.Popen([*command, "--html", str(page)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.close()
    assert page.exists()


@pytest.mark.slow
def test_the_page(bags: tuple[Path, Path], tmp_path: Path) -> None:
    """One file that needs no network: the sentence, the table, and both motions drawn over each other."""
    from browser import browser

    path = tmp_path / "page.html"
    assert main(["compare", *map(str, bags), "--no-learning", "--html", str(path), "--json"]) == 0
    text = path.read_text(encoding="utf-8")
    assert not re.search(r"<(script|img|iframe)[^>]*\ssrc=|<link[^>]*href=['\"](?!data:)", text)
    for said in ("elbow: it helped", "Before: before.mcap; after: after.mcap", "significantly less", "wrist is in the"):
        assert said in text
    with browser() as page:
        page.open(path)
        drawn = "return Bokeh.documents[0].roots()[0].renderers.map(one => [...one.data_source.data.{}])"
        (times, after_times), (ways, after_ways) = (page.run(drawn.format(axis)) for axis in ("x", "y"))
        assert not page.complaints()
    for time, way in ((times, ways), (after_times, after_ways)):
        # Six cycles of some 1.15 s, each from its own beginning.
        assert time[0] == way[0] == 0.0
        assert 6.0 < time[-1] < 8.0
        assert way[-1] / time[-1] == pytest.approx(0.0058, rel=0.1)
    # Before it rests for most of the time, after it never does.
    rests = [np.mean(np.diff(way[::25]) < 0.1 * np.mean(np.diff(way[::25]))) for way in (ways, after_ways)]
    assert rests[0] > 0.4
    assert rests[1] < 0.01
