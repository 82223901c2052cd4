# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The bytes that the node publishes mean what rclpy's of the same diagnoses do."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from stickslip_ros.output.diagnosis import Diagnosis, Level, diagnostic_array_bytes, status_bytes

TEXTS = st.text(st.characters(exclude_characters="\x00", exclude_categories=("Cs",)), max_size=9)
DIAGNOSES = st.builds(
    Diagnosis,
    level=st.sampled_from(Level),
    name=TEXTS,
    hardware_id=TEXTS,
    message=TEXTS,
    values=st.lists(st.tuples(TEXTS, TEXTS), max_size=4).map(tuple),
)


@given(
    st.integers(-(2**31), 2**31 - 1), st.integers(0, 999_999_999), st.lists(DIAGNOSES, max_size=4),
    st.sampled_from(["", "left/"]),
)  # fmt: skip
def test_they_mean_the_same(seconds: int, nanoseconds: int, diagnoses: list[Diagnosis], robot: str) -> None:
    """Issue 21: any statuses, texts of any length and in any script, at any place in the message."""
    array = DiagnosticArray(
        status=[
            DiagnosticStatus(
                level=bytes([one.level]), name=robot + one.name, hardware_id=robot + one.hardware_id,
                message=one.message, values=[KeyValue(key=key, value=value) for key, value in one.values],
            )
            for one in diagnoses
        ]
    )  # fmt: skip
    array.header.stamp = Time(sec=seconds, nanosec=nanoseconds)
    data = diagnostic_array_bytes(10**9 * seconds + nanoseconds, [status_bytes(one, robot) for one in diagnoses])
    # What rclpy fills up with is left over from elsewhere, so the bytes themselves differ.
    assert len(data) == len(serialize_message(array))
    assert deserialize_message(data, DiagnosticArray) == array


def test_what_is_no_text_is_told_all_the_same() -> None:
    """Half a character is replaced: one name from the graph does not silence the node."""
    broken = Diagnosis(level=Level.OK, name="a\ud800", hardware_id="a", message="", values=())
    found = deserialize_message(diagnostic_array_bytes(0, [status_bytes(broken)]), DiagnosticArray)
    assert found.status[0].name == "a?"
