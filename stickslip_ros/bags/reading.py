# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What a bag says of joints, in the order of its recording: samples and references as arrays, and changes of gains."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.bags.decoding import Decoder
from stickslip_ros.bags.parameter_events import GainEvents
from stickslip_ros.bags.storage.bag import Bag
from stickslip_ros.bags.topics import EVENTS_TYPE, Topics
from stickslip_ros.messages import joint_states
from stickslip_ros.messages.blocks import Block, Channel, Integers
from stickslip_ros.messages.content import MessageError, gains_from_message, reference_rows, seconds
from stickslip_ros.messages.joint_states import JointRows, JointStateDecoder, rows_by_joint
from stickslip_ros.messages.stamps import with_time, with_times
from stickslip_ros.model.friction import Gains

FloatArray = NDArray[np.float64]
_INSTEAD = "recording"  # whose time stands for a stamp that is not set


@dataclass(frozen=True, kw_only=True)
class Piece:
    """What came in between two changes of gains, at most a block.

    Attributes
    ----------
    gains : those that changed, in force from the beginning of the piece on, in the controller's units.
    samples : of each joint, rows of time, position, velocity and effort, of shape (n, 4).
    references : of each joint, rows of time, position and velocity, of shape (n, 3).
    clock : time of recording less stamp at the piece's first sample [s], NaN if it has none.
    """

    gains: dict[str, Gains] = field(default_factory=dict)
    samples: dict[str, FloatArray] = field(default_factory=dict)
    references: dict[str, FloatArray] = field(default_factory=dict)
    clock: float = np.nan


class BagReader:
    """Reads a bag from the topics found in it; ``refused`` counts what was left out, and why."""

    def __init__(self, bag: Bag, topics: Topics, controller: str | None = None) -> None:
        self._bag, self._topics = bag, topics
        self._fast = {
            channel: JointStateDecoder()
            for channel in (topics.states, *topics.references)
            if channel.type == joint_states.TYPE
        }
        slow = (*topics.references, *topics.gains, *topics.events)
        self._slow = {channel: Decoder(channel) for channel in slow if channel.type != joint_states.TYPE}
        self._events = GainEvents(controller)
        self._refused: Counter[str] = Counter()

    @property
    def refused(self) -> Counter[str]:
        """Reasons why messages were left out, and how many."""
        found = Counter(self._refused)
        for channel, decoder in self._fast.items():
            for reason, count in decoder.refused.items():
                found[f"{channel.topic}: {reason}"] += count
        return found + self._events.refused

    def pieces(self, progress: Callable[[int], None] = lambda _: None) -> Iterator[Piece]:
        """Everything in the order of its recording."""
        for block in self._bag.blocks(self._topics.all, progress):
            numbers = {channel: number for number, channel in block.channels.items()}
            gains_at = self._gains_in(block, numbers)
            edges = [0, *(number for number, _ in gains_at), len(block)]
            gains: list[dict[str, Gains]] = [{}, *(found for _, found in gains_at)]
            for begin, end, known in zip(edges[:-1], edges[1:], gains, strict=True):
                if known or end > begin:
                    yield self._piece(block, numbers, begin, end, known)

    def _gains_in(self, block: Block, numbers: dict[Channel, int]) -> list[tuple[int, dict[str, Gains]]]:
        """At which messages of a block which gains change."""
        found = []
        for channel in (*self._topics.gains, *self._topics.events):
            for number in np.flatnonzero(block.channel == numbers.get(channel, -1)).tolist():
                try:
                    message = self._slow[channel].decode(block.message(number))
                    gains = self._events.take(message) if channel.type == EVENTS_TYPE else gains_from_message(message)
                except MessageError as error:
                    self._refused[f"{channel.topic}: {error}"] += 1
                    continue
                if gains:
                    found.append((number, gains))
        return sorted(found, key=lambda one: one[0])

    def _piece(self, block: Block, numbers: dict[Channel, int], begin: int, end: int, gains: dict[str, Gains]) -> Piece:
        samples, clock = self._states(block, self._chosen(block, numbers, self._topics.states, begin, end))
        references: dict[str, FloatArray] = {}
        for channel in self._topics.references:
            chosen = self._chosen(block, numbers, channel, begin, end)
            rows = self._references(channel, block, chosen) if len(chosen) else {}
            for joint, values in rows.items():
                known = references.get(joint)
                references[joint] = values if known is None else np.concatenate([known, values])
        return Piece(gains=gains, samples=samples, references=references, clock=clock)

    @staticmethod
    def _chosen(block: Block, numbers: dict[Channel, int], channel: Channel, begin: int, end: int) -> Integers:
        chosen: Integers = begin + np.flatnonzero(block.channel[begin:end] == numbers.get(channel, -1))
        return chosen

    def _states(self, block: Block, chosen: Integers) -> tuple[dict[str, FloatArray], float]:
        found = self._fast[self._topics.states].decode(block, chosen) if len(chosen) else []
        times = [self._times(self._topics.states, rows, block, chosen) for rows in found]
        clock = np.nan
        if found:
            clock = 1e-9 * float(block.log_time[chosen[found[0].index[0]]]) - float(times[0][0])
        return rows_by_joint(found, times), clock

    def _references(self, channel: Channel, block: Block, chosen: Integers) -> dict[str, FloatArray]:
        if channel in self._fast:
            found = self._fast[channel].decode(block, chosen)
            times = [self._times(channel, rows, block, chosen) for rows in found]
            return {joint: rows[:, :3] for joint, rows in rows_by_joint(found, times).items()}
        listed: dict[str, list[tuple[float, float, float]]] = {}
        for number in chosen.tolist():
            try:
                message = self._slow[channel].decode(block.message(number))
                rows_of = reference_rows(message)
            except MessageError as error:
                self._refused[f"{channel.topic}: {error}"] += 1
                continue
            recorded = 1e-9 * float(block.log_time[number])
            time = with_time(seconds(message.header.stamp), recorded, _INSTEAD, self._refusing(channel))
            for joint, (position, velocity) in rows_of.items():
                listed.setdefault(joint, []).append((time, position, velocity))
        return {joint: np.array(rows) for joint, rows in listed.items()}

    def _times(self, channel: Channel, rows: JointRows, block: Block, chosen: Integers) -> FloatArray:
        """Stamps, or the times of recording where there are none."""
        recorded = partial(self._recorded, block, chosen, rows)
        return with_times(rows.time, recorded, _INSTEAD, self._refusing(channel))

    @staticmethod
    def _recorded(block: Block, chosen: Integers, rows: JointRows) -> FloatArray:
        return np.asarray(1e-9 * block.log_time[chosen[rows.index]])

    def _refusing(self, channel: Channel) -> Callable[[str, int], None]:
        def refuse(reason: str, count: int) -> None:
            self._refused[f"{channel.topic}: {reason}"] += count

        return refuse
