# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What was found in a recording as a bag of its own, on the recording's time line: to be opened beside it."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.analysis.joint_analysis import JointAnalyzer
from stickslip_ros.bags.writing import BagWriter
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.assessment import NOT_COMPUTED, Assessment, ExactQuestion, as_seen
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.output.diagnosis import Diagnosis, cycle_diagnostic, joint_diagnostic
from stickslip_ros.output.published import MARGIN_FIELDS, Findings, margin_row

DIAGNOSTICS, CYCLES, MARGINS = "/diagnostics", "/stickslip_monitor/cycles", "/stickslip_monitor/margins"
_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"


class Annotation:
    """Writes what a node would have published, at every piece of the recording; use as a context, and as a watcher.

    Parameters
    ----------
    path : of the bag to write. warn_margin : as of the monitor.
    """

    def __init__(self, path: Path, warn_margin: float) -> None:
        self._writer = BagWriter(path, {DIAGNOSTICS: _ARRAY, CYCLES: _ARRAY, MARGINS: "std_msgs/msg/Float64MultiArray"})
        self._warn_margin = warn_margin
        self._verdicts: dict[str, tuple[ExactQuestion, ExactVerdict]] = {}

    def __enter__(self) -> Annotation:
        self._writer.__enter__()
        return self

    def __exit__(self, *raised: Any) -> None:
        self._writer.__exit__(*raised)

    def __call__(self, joints: dict[str, JointAnalyzer], found: dict[str, list[Cycle]], clock: float) -> None:
        """Write the cycles found and the state of every joint after a piece."""
        offset = clock if math.isfinite(clock) else 0.0
        cycles = sorted(
            ((cycle, name) for name, some in found.items() for cycle in some), key=lambda one: one[0].arrest
        )
        for cycle, name in cycles:
            self._write(CYCLES, self._array(cycle.arrest, [cycle_diagnostic(name, cycle)]), cycle.arrest + offset)
        states = {name: joint.monitor.assessment() for name, joint in joints.items()}
        time = max((state.time for state in states.values() if math.isfinite(state.time)), default=math.nan)
        if not math.isfinite(time):
            return
        diagnoses: list[Diagnosis] = []
        rows: list[list[float]] = []
        for name, state in states.items():
            known = Findings(assessment=state, exact=self._exact(name, state, joints[name]))
            diagnoses.append(joint_diagnostic(name, known, self._warn_margin))
            rows.append(margin_row(known))
        self._write(DIAGNOSTICS, self._array(time, diagnoses), time + offset)
        self._write(
            MARGINS, self._writer.table(",".join(states), ",".join(MARGIN_FIELDS), np.array(rows)), time + offset
        )

    def _exact(self, name: str, state: Assessment, joint: JointAnalyzer) -> ExactVerdict:
        """The verdict by integration, worked out again where the question is another."""
        question = ExactQuestion.on(state, state.margin_gains, joint.settings.options.conditions)
        if question is None:
            return NOT_COMPUTED
        known = self._verdicts.get(name)
        if known is None or not known[0].answers(question):
            known = self._verdicts[name] = (question, question.verdict())
        return as_seen(known[1], state.finding.status)

    def _array(self, time: float, diagnoses: list[Diagnosis]) -> Any:
        make: Callable[..., Any] = self._writer.message
        statuses = [
            make(
                "diagnostic_msgs/msg/DiagnosticStatus",
                level=int(one.level),
                name=one.name,
                message=one.message,
                hardware_id=one.hardware_id,
                values=[make("diagnostic_msgs/msg/KeyValue", key=key, value=value) for key, value in one.values],
            )
            for one in diagnoses
        ]
        return make(_ARRAY, header=self._writer.header(time), status=statuses)

    def _write(self, topic: str, message: Any, time: float) -> None:
        # Where stamps jump, stamp and clock may be of different pieces; a time of recording has no sign.
        self._writer.write([self._writer.serialized(max(round(time * 1e9), 0), topic, message)])
