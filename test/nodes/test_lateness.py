# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Why statuses were late is said by what was measured."""

from __future__ import annotations

import time
from types import SimpleNamespace

import pytest

from stickslip_ros.nodes.self_diagnosis import Meters, SelfDiagnosis, why_late

BEGIN = Meters(steady=10.0, system=1000.0, used=5.0, waited=1.0, busy=50.0, all=100.0)


@pytest.mark.parametrize(
    ("changes", "joints", "delays", "text"),
    [
        ({"used": 6.9}, 60, 9, "this node uses 95 % of a core for 60 joints"),
        ({"used": 6.9, "busy": 54.0}, 1, 9, "this node uses 95 % of a core for 1 joint"),
        ({"used": 5.16, "busy": 53.9}, 1, 9, "the machine is busy with other processes (load 6.2 on 2 cores), with 8 % "
                                             "of a core used here"),
        ({"used": 5.16, "waited": 2.0}, 1, 9, "the machine is busy with other processes (load 6.2 on 2 cores), with"),
        ({"used": 5.16}, 1, 1, "one delay, with 8 % of a core used here"),
        ({"used": 5.16}, 1, 3, "3 delays, with 8 % of a core used here"),
        ({"used": 5.16, "system": 1005.0}, 1, 3, "the system's clock was set by +3 s meanwhile"),
        ({"used": 5.16, "all": 100.0}, 1, 1, "one delay"),
    ],
)  # fmt: skip
def test_the_sentence_says_what_is_the_case(changes: dict[str, float], joints: int, delays: int, text: str) -> None:
    """Issue 15: one joint at 8 % of a core is not called too many joints."""
    after = {"steady": 12.0, "system": 1002.0, "used": 5.1, "waited": 1.0, "busy": 50.4, "all": 104.0, **changes}
    said = why_late(BEGIN, Meters(**after), late=0.4, delays=delays, joints=joints, load=6.2, cores=2)
    assert said.startswith(f"statuses were up to 0.4 s late: {text}")


def test_meters_of_this_process() -> None:
    """Issue 15: work is seen in the process's own time and in that of the cores."""
    begin = Meters.read()
    while (end := Meters.read()).steady < begin.steady + 0.3:
        pass
    assert end.used - begin.used > 0.02
    assert end.busy > begin.busy > 0
    assert end.all > begin.all
    assert end.waited >= begin.waited >= 0


def test_the_processor_is_in_per_cent() -> None:
    """A process that works all the time uses most of a core, or as much of it as others leave."""
    states = SimpleNamespace(oldest=0.0, waiting=0, lost=0, publishers=1, messages=0, reset_figures=lambda: None)
    work = SimpleNamespace(process_ids=(), skipped=0, lateness=0.0, waiting=0, failures=0)
    diagnosis = SelfDiagnosis(states, work, ())  # type: ignore[arg-type]
    diagnosis.note(behind=False)
    begin, used = time.monotonic(), time.process_time()
    while time.monotonic() < begin + 0.3:
        pass
    states.messages = 30
    diagnosis.note(behind=False)
    figures, duration = dict(diagnosis.values()), time.monotonic() - begin
    assert figures["processor [%]"] == pytest.approx(100.0 * (time.process_time() - used) / duration, rel=0.5)
    assert figures["message rate [Hz]"] == pytest.approx(30.0 / duration, rel=0.5)
