# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Frozen answers: what counts as a difference, and that every section has answers."""

from __future__ import annotations

import json
import math
import sys
from copy import deepcopy
from pathlib import Path

import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT))
from tools.answers import FLOOR, MISSING, compare, differences, main, sections, timed_answer, write

ANSWERS = {
    "verdicts": [{"case": "paper", "ratio": 0.25, "smooth": True, "reason": None}, {"ratio": math.nan}],
    "advice": [{"damping": 20.0, "limits": [0.0, math.inf], "text": "raise the damping"}],
}


def files(folder: Path, *contents: dict[str, object]) -> list[Path]:
    paths = [folder / f"{number}.json" for number in range(len(contents))]
    for path, content in zip(paths, contents, strict=True):
        write(path, content)
    return paths


def test_equal_files_differ_in_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 37, item 1: NaN is equal to NaN, infinity to infinity, and the order of keys is no matter."""
    other = dict(reversed(deepcopy(ANSWERS).items()))
    before, after = files(tmp_path, ANSWERS, other)
    assert main(["--compare", str(before), str(after)]) == 0
    assert capsys.readouterr().out == "all answers are equal to 1e-09\n"


def test_the_worst_difference_comes_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 37, item 1: numbers by their relative difference, above the tolerance alone; 1 as the exit status."""
    other = deepcopy(ANSWERS)
    other["verdicts"][0]["ratio"] *= 1.0 + 1e-6
    other["advice"][0]["damping"] *= 1.0 + 1e-3
    before, after = files(tmp_path, ANSWERS, other)
    assert [one.path for one in differences(ANSWERS, other)] == ["/advice/0/damping", "/verdicts/0/ratio"]
    assert main(["--compare", str(before), str(after)]) == 1
    printed = capsys.readouterr().out.splitlines()
    assert "/advice/0/damping" in printed[0]
    assert printed[-1] == "verdicts: 1 numbers (worst 1.00e-06), 0 other values"
    assert main(["--compare", str(before), str(after), "--tolerance", "1e-5"]) == 1
    assert main(["--compare", str(before), str(after), "--tolerance", "1e-2"]) == 0
    assert compare(before, after, 1e-2) == 0


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("verdicts", "smooth", False),
        ("verdicts", "smooth", 1),
        ("verdicts", "reason", "no answer"),
        ("verdicts", "ratio", math.nan),
        ("verdicts", "ratio", None),
        ("advice", "limits", [0.0]),
        ("advice", "text", "raise the stiffness"),
        ("advice", "new", 0.0),
    ],
)
def test_any_other_change_is_a_difference(section: str, key: str, value: object) -> None:
    """Issue 37, item 1: an answer, a text, a number that is none any more, an element or a key of one file alone."""
    other = deepcopy(ANSWERS)
    other[section][0][key] = value
    for one, two in ((ANSWERS, other), (other, ANSWERS)):
        (found,) = differences(one, two)
        assert found.path.startswith(f"/{section}/0/{key}")
        assert found.size == math.inf


def test_a_missing_key_and_a_missing_section_are_shown(tmp_path: Path) -> None:
    """Issue 37, item 1: nothing is left out silently."""
    other = deepcopy(ANSWERS)
    del other["verdicts"][0]["ratio"], other["advice"]
    found = differences(ANSWERS, other)
    assert [(one.path, one.after) for one in found] == [("/advice", MISSING), ("/verdicts/0/ratio", MISSING)]
    assert str(found[1]).endswith("/verdicts/0/ratio: 0.25 -> missing")
    assert compare(*files(tmp_path, ANSWERS, other), 1.0) == 1


def test_rounding_next_to_zero_is_no_difference() -> None:
    """Issue 37, item 1: of numbers below a floor the difference is relative to the floor."""
    assert not differences({"a": 0.0}, {"a": 0.5e-9 * FLOOR})
    assert differences({"a": 0.0}, {"a": 2e-9 * FLOOR})
    assert differences({"a": FLOOR}, {"a": FLOOR * (1.0 + 2e-9)})


@pytest.mark.slow
@pytest.mark.parametrize("name", sections())
def test_every_section_has_answers(name: str) -> None:
    """Issue 37, item 1: the first answer is computed, has a name and is JSON."""
    if sections()[name].count == 0:
        pytest.skip("recordings are not at hand (set STICKSLIP_RECORDINGS)")
    answer, _ = timed_answer(name, 0)
    assert "exception" not in answer
    assert answer["case"]
    assert not differences({name: [answer]}, {name: [json.loads(json.dumps(answer))]})
