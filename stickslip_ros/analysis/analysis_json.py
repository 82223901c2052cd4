# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""An analysis as the JSON object and the CSV table that `stickslip analyze` writes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stickslip_ros.analysis.analysis import BagAnalysis
from stickslip_ros.analysis.joint_analysis import JointAnalysis
from stickslip_ros.bags.topics import Topics
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.monitoring.friction.estimate import COULOMB_AND_LOAD, NAMES, FrictionEstimate
from stickslip_ros.output import as_json, published
from stickslip_ros.output.csv_table import write_csv
from stickslip_ros.output.published import number, numbers, numbers_or_null

CYCLE_COLUMNS = {
    "breakaway_s": "breakaway",
    "arrest_s": "arrest",
    "dwell_s": "dwell",
    "slip_distance_rad": "slip_distance",
    "position_rad": "position",
    "breakaway_friction_nm": "breakaway_friction",
}


def bag_json(analysis: BagAnalysis) -> dict[str, Any]:
    """One bag; where it has several robots, their topics by name, and of each joint whose it is and its name there."""
    only = analysis.robots.get("")
    read = (
        {"robots": {name: _topics(topics) for name, topics in analysis.robots.items()}}
        if only is None
        else {"topics": _topics(only)}
    )
    joints = {}
    for name, joint in analysis.joints.items():
        robot, own = analysis.owners.get(name, ("", name))
        joints[name] = ({"robot": robot, "joint": own} if robot else {}) | joint_json(joint)
    return {
        "path": analysis.path,
        "recorded": number(analysis.recorded),
        **read,
        "joints": joints,
        "warnings": list(analysis.warnings),
    }


def _topics(topics: Topics) -> dict[str, Any]:
    return {
        "joint_states": topics.states.topic,
        "references": [channel.topic for channel in topics.references],
        "gains": [channel.topic for channel in (*topics.gains, *topics.events)],
    }


def joint_json(joint: JointAnalysis) -> dict[str, Any]:
    """One joint; null for what is unknown. What status, worst status and share are says `judgement.py`."""
    state = joint.assessment
    margin = None
    if state.joint is not None and state.margin_gains is not None and state.margin is not None:
        margin = as_json.margin_json(state.joint, state.margin_gains, joint.velocity, exact=joint.exact)
        margin |= published.UNCERTAINTY.for_json(state) | published.EXACT_UNCERTAINTY.for_json(joint.exact)
        margin |= published.BELIEF.for_json(state)
    return {
        "samples": joint.samples,
        **numbers(joint, "start", "duration"),
        **published.for_json(state, published.SAMPLING, published.POSITION),
        **published.STATUS.for_json(joint.status),
        "worst_status": joint.worst.value,
        **numbers(joint, "stick_slip_share", "moving_time"),
        "reason": joint.reason,
        "stuck": None if joint.stuck is None else asdict(joint.stuck),
        "time_in": {status.value: number(joint.time_in(status)) for status in Status},
        **published.VELOCITY.for_json(joint.velocity),
        "segments": [
            {"start": one.start, "end": one.end, "status": one.status.value, "velocity": number(one.velocity)}
            for one in joint.segments
        ],
        "cycles": [published.for_json(cycle, *published.OF_CYCLE) for cycle in joint.cycles],
        "reversals": published.for_json(state.reversals, published.REVERSALS),
        "presliding": published.for_json(state.presliding, published.PRESLIDING),
        "ring": published.for_json(state.ring, published.RING),
        "transient": None if joint.transient is None else asdict(joint.transient),
        "friction": _friction(state.estimate, state.position),
        "gains": published.for_json(state.gains, published.GAINS, published.INTEGRAL_GAIN),
        "margin": margin,
        "exact_here": published.for_json(joint.exact_here, published.EXACT),
        "margin_reason": state.margin_reason,
        "recommendation": None
        if state.advice is None
        else as_json.recommendation_json(state.advice.recommendation, state.advice.sensitivities),
    }


def _friction(estimate: FrictionEstimate | None, position: float) -> dict[str, Any] | None:
    if estimate is None:
        return None
    found: dict[str, Any] = {
        name: as_json.parameter_json(estimate[name])
        for name in dict.fromkeys((*NAMES, *estimate.names, COULOMB_AND_LOAD))
    }
    found |= {
        "per_inertia": estimate.normalised,
        "slips": estimate.slips,
        "summary": estimate.summary(),
        "mismatch": estimate.mismatch,
        "dry": None if estimate.dry is None else as_json.dry_friction_json(estimate.dry),
        "growth": as_json.growth_json(estimate, position),
        "viscous_curvature": numbers_or_null(estimate.curvature, ("value", "std", "speed")),
        "stribeck_asymmetry": numbers_or_null(estimate.asymmetry, ("value", "std")),
    }
    return found


def write_cycles(path: Path, bags: Iterable[Mapping[str, Any]]) -> None:
    """Write every cycle of bags (as :func:`bag_json` has them) as a row of a CSV table; what is unknown is empty.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    rows = [["bag", "joint", *CYCLE_COLUMNS, "hunting"]]
    for bag in bags:
        for name, joint in bag.get("joints", {}).items():
            for cycle in joint["cycles"]:
                values = [cycle[field] for field in CYCLE_COLUMNS.values()]
                rows.append([bag["path"], name, *values, str(cycle["hunting"]).lower()])
    write_csv(path, rows)
