# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""All samples of one joint in a bag, at once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from stickslip_ros.bags.reading import BagReader
from stickslip_ros.bags.storage.bag import Bag
from stickslip_ros.bags.storage.unpacking import UnpackLimit
from stickslip_ros.bags.table import RecordingError
from stickslip_ros.bags.topics import TopicChoice, find_topics
from stickslip_ros.monitoring.reference_pairing import ReferencePairing
from stickslip_ros.monitoring.samples import Batch


def read_joint(path: Path, joint: str, choice: TopicChoice | None = None, limit: UnpackLimit | None = None) -> Batch:
    """Everything recorded of one joint, with its reference.

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
    with Bag(path, limit) as bag:
        try:
            # Gains are not read here, so that it is no matter which they would be.
            topics = find_topics(bag.channels(), replace(choice or TopicChoice(), gains=""))
        except RecordingError as error:
            raise RecordingError(f"bag {path}: {error}") from error
        for piece in BagReader(bag, {"": topics}).pieces():
            there |= set(piece.samples)
            if joint in piece.samples:
                pairing.add_samples(piece.samples[joint])
            if joint in piece.references:
                pairing.add_references(piece.references[joint])
    batch = pairing.take(all_of_them=True)
    if batch is None:
        names = ", ".join(sorted(there)) or "none"
        raise RecordingError(f"bag {path}: no samples of joint {joint!r}; joints there: {names} (choose one with --on)")
    return batch
