# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A number that is published is one row in one table, and every output has it from there."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.joint_simulation import simulate
from stickslip_ros.model.outcome import Outcome
from stickslip_ros.model.reversal import Reversal
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.assessment import Assessment, MonitorOptions
from stickslip_ros.monitoring.detection.reversals import ReversalRecord
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.monitoring.friction.estimate import ParameterEstimate
from stickslip_ros.monitoring.friction.presliding import PreslidingEstimate
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.ring import RingEstimate
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.output import published
from stickslip_ros.output.diagnosis import cycle_diagnostic, joint_diagnostic
from stickslip_ros.output.published import MARGIN_FIELDS, SECTIONS, Findings, Published, Section, margin_row

KNOWN = ExactVerdict(
    smooth=False,
    outcome=Outcome.STICKS,
    critical_damping_ratio=0.3,
    damping_reserve=-0.8,
    steady_damping_ratio=0.4,
    lowest_smooth_velocity=0.2,
    least_smooth_stiffness=900.0,
    stick_slip_probability=0.9,
)


@pytest.fixture(scope="module")
def state() -> Assessment:
    """A joint of which everything is known: it has slipped, learnt, has advice and gains on trial."""
    friction = Friction(stribeck=3.0, stribeck_velocity=0.1, lag=0.02, rise_time=0.3, viscous=1.0, coulomb=5.0)
    joint = Joint(inertia=1.0, friction=friction)
    references = 5e-5 * np.arange(40_000.0)
    motion = simulate(joint, Gains(stiffness=100.0), references, np.full(40_000, 0.05))
    batch = Batch(time=motion.time, position=1e-5 * np.round(motion.position / 1e-5), reference_position=references)
    options = MonitorOptions(trial=Gains(stiffness=150.0, damping=4.0))
    monitor = JointMonitor(joint, Gains(stiffness=100.0), options, studies_at_once=True)
    monitor.process(batch)
    last = Reversal(
        time=1.0, direction=1, standing=0.1, lost_motion=0.01, peak_error=0.02, running_error=0.01, stops=0,
        settles_after=0.1,
    )  # fmt: skip
    reversals = ReversalRecord(count=1, last=last, standing=0.1, lost_motion=0.01, peak_error=0.02, largest_error=0.02)
    stiffness = ParameterEstimate(value=1e4, std=100.0, identified=True)
    presliding = PreslidingEstimate(stiffness=stiffness, at_least=9e3, contact="lugre", rests=10)
    ring = RingEstimate(frequency=8.0, frequency_std=0.1, damping_ratio=0.02, damping_ratio_std=0.001, rests=9)
    return replace(monitor.assessment(), reversals=reversals, presliding=presliding, ring=ring)


def with_a_row_more(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Every section gets a row; returns the names of these by section."""
    names = {}
    groups = {name: found for name, found in vars(published).items() if name.startswith("OF_")}
    for name, section in [(name, found) for name, found in vars(published).items() if isinstance(found, Section)]:
        names[name] = new = f"new of {name.lower()}"
        row = Published(value=lambda _: 1.5, unit="m", diagnostics=new, json=new, fleet=new)
        longer = replace(section, rows=(*section.rows, row))
        monkeypatch.setattr(published, name, longer)
        groups = {of: tuple(longer if one is section else one for one in found) for of, found in groups.items()}
    for of, found in groups.items():
        monkeypatch.setattr(published, of, found)
    return names


def test_every_row_is_in_the_diagnostics(state: Assessment, monkeypatch: pytest.MonkeyPatch) -> None:
    """A row added to a section is published with its unit, without a change elsewhere."""
    names = with_a_row_more(monkeypatch)
    diagnosis = joint_diagnostic("a", Findings(assessment=state, exact=KNOWN, trial=KNOWN), 0.1)
    assert state.last_cycle is not None
    keys = [key for key, _ in (*diagnosis.values, *cycle_diagnostic("a", state.last_cycle).values)]
    for name, new in names.items():
        assert any(key.endswith(f"{new} [m]") for key in keys), name


def test_every_row_is_in_the_json_and_the_fleets_table(state: Assessment, monkeypatch: pytest.MonkeyPatch) -> None:
    """Likewise in the JSON of an analysis, and in the columns of a fleet's table."""
    from stickslip_ros.analysis.analysis_json import joint_json
    from stickslip_ros.analysis.fleet_joints import rows_of
    from stickslip_ros.analysis.joint_analysis import JointAnalysis
    from stickslip_ros.settings.parameter_file import Parameters

    names = with_a_row_more(monkeypatch)
    analysis = JointAnalysis(
        name="a", samples=1, start=0.0, end=40.0, status=Status.STICK_SLIP, worst=Status.STICK_SLIP, reason="",
        segments=(), transient=None, cycles=(state.last_cycle,) if state.last_cycle else (),
        velocity=state.velocity, assessment=state, exact=KNOWN, settings=Parameters().settings_of("a"), traces=None,
    )  # fmt: skip
    found = joint_json(analysis)
    text = json.dumps(found)
    (row,) = rows_of([{"path": "x", "joints": {"a": found}}])
    for name, new in names.items():
        if name.startswith("TRIAL") or name == "CYCLES":  # a recording has no gains on trial; its cycles are listed
            continue
        assert f'"{new}": 1.5' in text, name
        assert name.startswith("CYCLE") or row[new] == 1.5, name


def test_the_places_of_the_margin_table(state: Assessment) -> None:
    """Others rely on the order: places are told one by one, none twice, and without a gap."""
    places = [row.margins.place for section in SECTIONS for row in section.rows if row.margins is not None]
    assert sorted(places) == list(range(len(places)))
    assert MARGIN_FIELDS == (
        "status", "applicable", "energy_margin", "damping_ratio", "critical_damping_ratio", "reduction_factor",
        "steady_stribeck", "natural_frequency", "velocity", "lowest_smooth_velocity", "stiffness", "damping", "cycles",
        "exact_smooth", "exact_critical_damping_ratio", "exact_lowest_smooth_velocity", "exact_least_smooth_stiffness",
        "margin_std", "stick_slip_probability", "stiffness_factor", "damping_factor", "trial_energy_margin",
        "trial_damping_ratio", "trial_critical_damping_ratio", "trial_exact_smooth", "exact_steady_damping_ratio",
        "reversal_standing", "reversal_peak_error", "exact_damping_reserve",
    )  # fmt: skip
    numbers = dict(zip(MARGIN_FIELDS, margin_row(Findings(assessment=state, exact=KNOWN, trial=KNOWN)), strict=True))
    assert numbers["stiffness"] == 100.0
    assert numbers["exact_smooth"] == 0.0
    assert np.isfinite(list(numbers.values())).all(), numbers
