# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the monitor finds, in the sentences that people read: in diagnostics, warnings and reports alike."""

from __future__ import annotations

from stickslip_ros.monitoring.friction.change import FrictionChange


def friction_change_text(change: FrictionChange | None) -> str:
    """What changed and when; "" if nothing did."""
    if change is None:
        return ""
    text = f"friction changed abruptly at {change.time:.1f} s"
    if change.learning_anew:
        return f"{text}; learning anew"
    what = ", ".join(f"{one.name.replace('_', ' ')} {one.old:.3g} to {one.new:.3g}" for one in change.differences)
    return f"{text}: {what or 'in ways that the slips since do not name'}"
