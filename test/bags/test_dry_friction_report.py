# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the dry friction depends on, in JSON, in words and in the report."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support_bags import sticking

from stickslip_ros.analysis.analysis import AnalysisOptions, BagAnalysis, analyze
from stickslip_ros.analysis.analysis_json import bag_json
from stickslip_ros.analysis.report.plots import position_dependence_plot, time_dependence_plot
from stickslip_ros.analysis.report.report import write_report
from stickslip_ros.bags.simulated import write_simulation
from stickslip_ros.monitoring.friction.dry_friction import DryFriction, dry_friction

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def analysis(tmp_path_factory: pytest.TempPathFactory) -> BagAnalysis:
    """Of a joint that sticks there and back under a load."""
    path = tmp_path_factory.mktemp("dry") / "bag.mcap"
    joint = replace(sticking(), velocities=(0.006, -0.006, 0.006, -0.006), load=1.0)
    write_simulation(path, {"shoulder": joint}, duration=80.0, rate=250.0)
    return analyze(path, AnalysisOptions(with_traces=True))


def planted(time: float) -> DryFriction:
    """Of slips with a drift and a ripple."""
    rng = np.random.default_rng(1)
    count = 45
    direction = np.where(np.arange(count) // 12 % 2 == 0, 1.0, -1.0)
    position = np.cumsum(direction * rng.uniform(0.015, 0.025, count))
    times = time + 2.0 * np.arange(count)
    kinetic = 8.0 + direction + 8.0 * 0.05 / 60.0 * (times - times.mean())
    kinetic += 0.5 * np.sin(2.0 * math.pi * 10.0 * position) + 0.01 * rng.standard_normal(count)
    dry = dry_friction(kinetic, direction, position, times)
    assert dry is not None
    return dry


def with_dry(analysis: BagAnalysis, dry: DryFriction | None) -> BagAnalysis:
    """The analysis, with that learnt of its joint."""
    joint = analysis.joints["shoulder"]
    estimate = joint.assessment.estimate
    assert estimate is not None
    state = replace(joint.assessment, estimate=replace(estimate, dry=dry))
    return replace(analysis, joints={"shoulder": replace(joint, assessment=state)})


def test_json_of_a_joint_that_is_as_it_should_be(analysis: BagAnalysis) -> None:
    """A load and nothing else."""
    dry = json.loads(json.dumps(bag_json(analysis)))["joints"]["shoulder"]["friction"]["dry"]
    assert dry["load"]["value"] == pytest.approx(1.0, abs=0.05)
    assert dry["load"]["significance"] < 0.01
    assert dry["ripple"] is dry["drift"] is dry["load_dependence"] is None
    assert dry["summary"] == ""
    assert sum(place["slips"] for place in dry["places"]) == dry["slips"] >= 12
    assert {place["direction"] for place in dry["places"]} == {1, -1}


def test_json_of_drift_and_ripple(analysis: BagAnalysis) -> None:
    found = with_dry(analysis, planted(analysis.joints["shoulder"].start))
    dry = json.loads(json.dumps(bag_json(found)))["joints"]["shoulder"]["friction"]["dry"]
    assert dry["ripple"]["amplitude"] == pytest.approx(0.5, rel=0.05)
    assert dry["ripple"]["period"] == pytest.approx(0.1, rel=0.02)
    assert dry["drift"]["value"] * 60.0 / 8.0 == pytest.approx(0.05, rel=0.1)
    assert "times a radian; it rises by" in dry["summary"]
    assert json.loads(json.dumps(bag_json(with_dry(analysis, None))))["joints"]["shoulder"]["friction"]["dry"] is None


def test_the_report_has_it(analysis: BagAnalysis, tmp_path: Path) -> None:
    """Two plots with their captions, and the sentence."""
    path = tmp_path / "report.html"
    write_report(path, with_dry(analysis, planted(analysis.joints["shoulder"].start)))
    text = path.read_text(encoding="utf-8")
    for words in ("Friction over position", "Friction over time", "Coulomb friction varies by ±0.5 N·m with position"):
        assert words in text
    for name in ("the curve is a ripple of ±0.5 N·m", "the line is its drift"):
        assert name in text
    write_report(path, analysis)
    text = path.read_text(encoding="utf-8")
    assert "no period stands out of the scatter" in text
    assert "Coulomb friction varies" not in text


def test_few_slips_are_not_drawn(analysis: BagAnalysis) -> None:
    dry = planted(0.0)
    few = dry_friction(dry.kinetic[:7], dry.direction[:7], dry.position[:7], dry.time[:7])
    joint = with_dry(analysis, few).joints["shoulder"]
    assert position_dependence_plot(joint) is time_dependence_plot(joint) is None
