# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Dataclasses as plain data and back, whatever Python and numpy make of their type hints."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from stickslip_ros.nodes.kept_state import _is_array, from_plain, to_plain

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Everything:
    """Each kind of hint that a state file's dataclasses have."""

    alias: FloatArray
    written: NDArray[np.int64]
    plain: np.ndarray
    number: float | None
    perhaps: FloatArray | None


def test_arrays_come_back_from_json() -> None:
    """Issue 15: with numpy 2.5 the state file was called damaged, and what was learnt was lost at every restart."""
    whole = Everything(np.array([1.5, 2.5]), np.array([1, 2]), np.eye(2), None, np.zeros((0, 2)))
    again = from_plain(Everything, json.loads(json.dumps(to_plain(whole))))
    for name in ("alias", "written", "plain", "perhaps"):
        assert np.array_equal(getattr(again, name).ravel(), getattr(whole, name).ravel())
    assert again.number is None


@pytest.mark.skipif(sys.version_info < (3, 12), reason="the statement `type` came with Python 3.12")
def test_an_alias_of_arrays_is_an_array() -> None:
    """Issue 15: as numpy 2.5 spells NDArray, whatever numpy is installed here."""
    names: dict[str, object] = {"np": np}
    exec("type Alias[Kind] = np.ndarray[tuple[int, ...], np.dtype[Kind]]\nfound = Alias[np.float64]", names)
    assert _is_array(names["found"])
    assert not _is_array(float)


@pytest.mark.parametrize("text", ['["a"]', "[[1], [1, 2]]", '{"a": 1}', "null"])
def test_what_is_no_array_is_refused(text: str) -> None:
    """Issue 15: a damaged file is still told from a good one."""
    data = {"alias": json.loads(text), "written": [1], "plain": [1.0], "number": None, "perhaps": None}
    with pytest.raises(ValueError, match=r"Everything\.alias"):
        from_plain(Everything, data)


@dataclass(frozen=True)
class Several:
    """A tuple of dataclasses."""

    numbers: tuple[int, ...]
    pairs: tuple[Pair, ...]


@dataclass(frozen=True)
class Pair:
    """One of several."""

    name: str
    value: float


def test_tuples_come_back_from_json() -> None:
    """Several of a kind, or none, are the same tuple again."""
    for whole in (Several((1, 2), (Pair("a", 1.5), Pair("b", 2.5))), Several((), ())):
        assert from_plain(Several, json.loads(json.dumps(to_plain(whole)))) == whole


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ('"ab"', r"Several\.pairs"),
        ("null", r"Several\.pairs"),
        ("[3]", r"\.pairs\[0\]"),
        ('[{"name": "a"}]', "must have"),
    ],
)
def test_what_is_no_tuple_is_refused(text: str, where: str) -> None:
    """Nor is one of another kind of thing; the text names which."""
    with pytest.raises(ValueError, match=where):
        from_plain(Several, {"numbers": [], "pairs": json.loads(text)})


@dataclass(frozen=True)
class Renamed:
    """A field that had another name when files were written."""

    jitter: float = field(metadata={"key": "stray"})
    rejected: tuple[str, ...] = field(default=(), metadata={"key": "hopeless"})


def test_a_renamed_field_keeps_its_key() -> None:
    """Issue 37: files have the key that they always had, and no other."""
    one = Renamed(jitter=0.5, rejected=("exponential",))
    assert to_plain(one) == {"stray": 0.5, "hopeless": ["exponential"]}
    assert from_plain(Renamed, {"stray": 0.5, "hopeless": ["exponential"]}) == one
    assert from_plain(Renamed, {"stray": 0.5}) == Renamed(jitter=0.5)
    with pytest.raises(ValueError, match="must have exactly hopeless, stray"):
        from_plain(Renamed, {"jitter": 0.5})
