# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Samples of joints in a bag, at once: all of one, or stretches of several; and which joints it has."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from stickslip_ros.bags.reading import BagReader
from stickslip_ros.bags.storage.bag import Bag
from stickslip_ros.bags.storage.unpacking import UnpackLimit
from stickslip_ros.bags.table import RecordingError
from stickslip_ros.bags.topics import TopicChoice, find_robots, find_topics
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.reference_pairing import ReferencePairing
from stickslip_ros.monitoring.samples import Batch, FloatArray


def read_joint_with_gains(
    path: Path, joint: str, choice: TopicChoice, limit: UnpackLimit | None = None
) -> tuple[Batch, tuple[Gains, ...], float]:
    """Everything recorded of one joint, with its reference; its gains, one after the other; and by how much the stamps
    of its references are off, where these are not used for it [s], else NaN.

    Parameters
    ----------
    choice : of topics. limit : of what is unpacked.

    Raises
    ------
    RecordingError
        If the bag cannot be read, or has nothing of the joint; the message lists the joints that are there.
    """
    pairing = ReferencePairing()
    there: set[str] = set()
    gains: list[Gains] = []
    with Bag(path, limit) as bag:
        try:
            topics = find_topics(bag.channels(), choice)
        except RecordingError as error:
            raise RecordingError(f"bag {path}: {error}") from error
        for piece in BagReader(bag, {"": topics}, choice.controller).pieces():
            if joint in piece.gains and piece.gains[joint] not in gains[-1:]:
                gains.append(piece.gains[joint])
            there |= set(piece.samples)
            if joint in piece.samples:
                pairing.add_samples(piece.samples[joint])
            if joint in piece.references:
                pairing.add_references(piece.references[joint])
    batch = pairing.next_batch(all_of_them=True)
    if batch is None:
        names = ", ".join(sorted(there)) or "none"
        raise RecordingError(
            f"bag {path}: no samples of joint {joint!r}; joints there: {names} (choose one with --joint)"
        )
    return batch, tuple(gains), pairing.offset


def joint_names(
    path: Path, choice: TopicChoice, limit: UnpackLimit | None = None
) -> Iterator[tuple[set[str], set[str]]]:
    """Names of a bag's joints, those of all robots, as they turn up; with the robot's and without it. Then the same of
    those that have no gains by their first sample.

    Raises
    ------
    RecordingError
        If the bag cannot be read.
    """
    with Bag(path, limit) as bag:
        reader = BagReader(bag, find_robots(bag.channels(), choice), choice.controller)
        known, gained, without = 0, set[str](), set[str]()
        for piece in reader.pieces():
            gained |= set(piece.gains)
            if len(reader.joints) > known:
                new = list(reader.joints)[known:]
                known = len(reader.joints)
                without |= {one for name in new if name not in gained for one in (name, reader.joints[name][1])}
                yield {*reader.joints, *(joint for _, joint in reader.joints.values())}, without


def read_windows(
    path: Path, windows: Mapping[str, tuple[float, float]], choice: TopicChoice, limit: UnpackLimit | None = None
) -> dict[str, FloatArray]:
    """Stamps and positions of joints, each from a stamp to another [s]: of each that was recorded, of shape (n, 2).

    Parameters
    ----------
    windows : by the joints' names, with the robot's where there are several.

    Raises
    ------
    RecordingError
        If the bag cannot be read.
    """
    found: dict[str, list[FloatArray]] = {}
    with Bag(path, limit) as bag:
        for piece in BagReader(bag, find_robots(bag.channels(), choice), choice.controller).pieces():
            for name, (begin, end) in windows.items():
                if name in piece.samples:
                    rows = piece.samples[name][:, :2]
                    found.setdefault(name, []).append(rows[(rows[:, 0] >= begin) & (rows[:, 0] <= end)])
    return {name: np.concatenate(parts) for name, parts in found.items()}
