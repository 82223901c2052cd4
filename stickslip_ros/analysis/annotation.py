# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What was found in a recording as a bag of its own, on the recording's time line: to be opened beside it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from stickslip_ros.analysis.joint_analysis import JointAnalyzer
from stickslip_ros.bags.writing import BagWriter
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.assessment import NOT_COMPUTED, Assessment, ExactQuestion, as_seen
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.output.diagnosis import (
    Diagnosis,
    cycle_diagnostic,
    diagnostic_array_bytes,
    joint_diagnostic,
    status_bytes,
)
from stickslip_ros.output.published import MARGIN_FIELDS, Findings, margin_row

DIAGNOSTICS, CYCLES, MARGINS = "/diagnostics", "/stickslip_monitor/cycles", "/stickslip_monitor/margins"
_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"


class Annotation(BagWriter):
    """Writes what a node would have published, at every piece of the recording; use as a context, and as a watcher.

    Parameters
    ----------
    path : of the bag to write. warn_margin : as of the monitor.
    """

    def __init__(self, path: Path, warn_margin: float) -> None:
        super().__init__(path, {DIAGNOSTICS: _ARRAY, CYCLES: _ARRAY, MARGINS: "std_msgs/msg/Float64MultiArray"})
        self._warn_margin = warn_margin
        self._verdicts: dict[str, tuple[ExactQuestion, ExactVerdict]] = {}

    def __call__(self, joints: dict[str, JointAnalyzer], found: dict[str, list[Cycle]], clock: float) -> None:
        """Write the cycles found and the state of every joint after a piece."""
        offset = clock if math.isfinite(clock) else 0.0
        cycles = sorted(
            ((cycle, name) for name, some in found.items() for cycle in some), key=lambda one: one[0].arrest
        )
        for cycle, name in cycles:
            self._write_diagnoses(CYCLES, cycle.arrest, offset, [cycle_diagnostic(name, cycle)])
        states = {name: joint.monitor.assessment() for name, joint in joints.items()}
        time = max((state.time for state in states.values() if math.isfinite(state.time)), default=math.nan)
        if not math.isfinite(time):
            return
        known = {
            name: Findings(assessment=state, exact=self._exact(name, state, joints[name]))
            for name, state in states.items()
        }
        diagnoses = [joint_diagnostic(name, one, self._warn_margin) for name, one in known.items()]
        self._write_diagnoses(DIAGNOSTICS, time, offset, diagnoses)
        rows = np.array([margin_row(one) for one in known.values()])
        table = self.table(",".join(states), ",".join(MARGIN_FIELDS), rows)
        self.write([self.serialized(_recorded(time + offset), MARGINS, table)])

    def _exact(self, name: str, state: Assessment, joint: JointAnalyzer) -> ExactVerdict:
        """The verdict by integration, worked out again where the question is another."""
        question = ExactQuestion.on(state, state.margin_gains, joint.settings.options.conditions)
        if question is None:
            return NOT_COMPUTED
        known = self._verdicts.get(name)
        if known is None or not known[0].answers(question):
            known = self._verdicts[name] = (question, question.verdict())
        return as_seen(known[1], state.finding.status)

    def _write_diagnoses(self, topic: str, time: float, offset: float, diagnoses: Iterable[Diagnosis]) -> None:
        data = diagnostic_array_bytes(round(time * 1e9), [status_bytes(one) for one in diagnoses])
        self.write([(_recorded(time + offset), topic, data)])


def _recorded(time: float) -> int:
    """Time of recording [ns]: where stamps jump, stamp and clock may be of different pieces; it has no sign."""
    return max(round(time * 1e9), 0)
