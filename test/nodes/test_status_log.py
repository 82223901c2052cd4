# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 34, item 14: the log has one line at each change to or from stick-slip, and few of a joint that flaps."""

from __future__ import annotations

from stickslip_ros.nodes.publications import StatusLog


def lines_of(statuses: list[tuple[float, str]], joint: str = "joint1") -> list[str]:
    """What is written where a joint has these statuses at these times [s]."""
    lines: list[str] = []
    log = StatusLog(lambda line: lines.append(f"WARN {line}"), lambda line: lines.append(f"INFO {line}"))
    for now, word in statuses:
        log.note(joint, word, f"{word}: because", now)
    return lines


def test_a_line_at_each_change() -> None:
    """Stick-slip is a warning, its end is none; rest and smooth motion are no news."""
    words = ["unknown", "at_rest", "smooth", "smooth", "stick_slip", "stick_slip", "smooth", "at_rest", "at_risk"]
    assert lines_of([(100.0 * index, word) for index, word in enumerate(words)]) == [
        "WARN joint1: stick_slip: because (was smooth)",
        "INFO joint1: smooth: because (was stick_slip)",
        "WARN joint1: at_risk: because (was at_rest)",
    ]
    assert lines_of([(0.0, "stick_slip")]) == ["WARN joint1: stick_slip: because"]


def test_what_is_no_status_is_a_warning() -> None:
    """A joint that two nodes publish has none; names of others command no terminal."""
    lines = lines_of([(0.0, "smooth"), (20.0, "published twice"), (40.0, "smooth")], "a\x1b[2J")
    assert lines == [
        r"WARN a\x1b[2J: published twice: because (was smooth)",
        r"INFO a\x1b[2J: smooth: because (was published twice)",
    ]


def test_a_joint_that_flaps_floods_nothing() -> None:
    """An hour of changes every second has a dozen lines; the last state is told when it lasts."""
    flapping = [(float(now), "stick_slip" if now % 2 else "smooth") for now in range(3600)]
    lines = lines_of([*flapping, (3600.0, "smooth"), (4800.0, "smooth")])
    assert 3 < len(lines) < 15
    assert lines[0] == "WARN joint1: stick_slip: because (was smooth)"
    assert lines[1] == "WARN joint1: stick_slip: because (10 changes in 10 s)"
    assert lines[-1].startswith("INFO joint1: smooth: because (")
