# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What is learnt of the contact of joints at rest: python -m benchmarks.presliding [JOINTS].

Random joints, contacts and encoders, moved to and fro or one way, followed from position, reference and gains.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stickslip_ros.monitoring.assessment import MonitorOptions
from stickslip_ros.monitoring.friction.presliding import PreslidingEstimate
from stickslip_ros.monitoring.joint_monitor import JointMonitor

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "monitoring"))
from elastic_joints import CONTACTS, Case, random_case


def learnt(case: Case) -> PreslidingEstimate | None:
    """What a monitor learns of it."""
    monitor = JointMonitor(gains=case.gains, options=MonitorOptions())
    monitor.process(case.samples)
    return monitor.assessment().presliding


def run(joints: int) -> None:
    """Print a line for each contact and motion."""
    for turns in (True, False):
        for contact in CONTACTS:
            generator = np.random.default_rng(7)
            cases = [random_case(generator, contact, turns=turns) for _ in range(joints)]
            _print(contact, turns, [(case, found) for case in cases if (found := learnt(case)) is not None], joints)


def _print(contact: str, turns: bool, seen: Sequence[tuple[Case, PreslidingEstimate]], joints: int) -> None:
    shown = [(case, found) for case, found in seen if found.shown]
    within = [abs(found.stiffness.value - case.stiffness) <= 1.96 * found.stiffness.std for case, found in shown]
    identified = [
        abs(found.stiffness.value / case.stiffness - 1.0) for case, found in shown if found.stiffness.identified
    ]
    bounds = [found.at_least <= case.stiffness for case, found in seen]
    told = [found.contact == case.contact for case, found in shown if found.contact]
    text = f"{contact:15s} {'to and fro' if turns else 'one way':10s} {len(seen)} of {joints} with rests to learn from"
    text += f"; creep shown {len(shown)}; 95 % intervals that hold {sum(within)} of {len(within)}"
    text += f"; lower bounds that hold {sum(bounds)} of {len(bounds)}; contact told {sum(told)} of {len(told)} right"
    if identified:
        text += f"; identified {len(identified)}, error {np.median(identified):.1%} median, {max(identified):.1%} most"
    print(text, flush=True)


if __name__ == "__main__":
    run(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
