# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What a bag says of joints, in the order of its recording: samples and references as arrays, and changes of gains.

The functions at the end read at once: all samples of one joint, stretches of several, or which joints there are.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.bags.decoding import Decoder, why_unreadable
from stickslip_ros.bags.storage.bag import Bag
from stickslip_ros.bags.storage.unpacking import UnpackLimit
from stickslip_ros.bags.table import RecordingError
from stickslip_ros.bags.topics import EVENTS_TYPE, TopicChoice, Topics, find_robots, find_topics, nearest_namespace
from stickslip_ros.messages import joint_states
from stickslip_ros.messages.gain_parameters import INTERFACES, HeardGains, gain_value, joint_and_kind, why_not_taken
from stickslip_ros.messages.joint_states import (
    WRAPS,
    Block,
    Channel,
    Integers,
    JointStateDecoder,
    MessageError,
    WholeTurns,
    rows_by_joint,
)
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.samples import Batch, FloatArray, ReferencePairing
from stickslip_ros.visible import full_name, visible

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

    Where there are several robots, a joint is named after its own: "left/joint1".
    """

    gains: dict[str, Gains] = field(default_factory=dict)
    samples: dict[str, FloatArray] = field(default_factory=dict)
    references: dict[str, FloatArray] = field(default_factory=dict)
    clock: float = np.nan


class GainEvents:
    """Puts gains together from events, which hold only what changed.

    Parameters
    ----------
    topics : of the robot that gains have to be of.
    controller : the node whose events count; None for every node, of which the first that has gains of a joint counts.

    ``refused`` counts what was left out, and why; ``nodes`` are those that have gains.
    """

    def __init__(self, topics: Topics, controller: str | None) -> None:
        self._topics, self._controller = topics, controller
        self._heard: dict[str, HeardGains] = {}
        self._owner: dict[str, str] = {}
        self.refused: Counter[str] = Counter()
        self.nodes: set[str] = set()

    def process(self, event: Any) -> dict[str, Gains]:
        """The gains of the joints that an event changes and whose stiffness is known by now."""
        node = str(event.node)
        parameters = {str(one.name): one.value for one in (*event.new_parameters, *event.changed_parameters)}
        if any(joint_and_kind(name) is not None for name in parameters):
            self.nodes.add(node)
        spaces = self._topics.namespaces
        space = nearest_namespace(node, spaces)
        if self._controller not in (None, node) or space not in (None, self._topics.namespace):
            return {}
        # One that was chosen is everybody's.
        of_no_robot = bool(spaces) and space is None and self._controller is None
        heard = self._heard.setdefault(node, HeardGains())
        if any(name in parameters for name in INTERFACES):
            heard.refusal = why_not_taken(parameters)
        changed = []
        for name, value in parameters.items():
            found = joint_and_kind(name)
            if found is None:
                continue
            if heard.refusal:
                self.refused[f"gains of {node}: {heard.refusal}"] += 1
                continue
            if of_no_robot:
                self.refused[f"gains of {node}: it is in no robot's namespace (choose with --controller)"] += 1
                continue
            joint, kind = found
            owner = self._owner.setdefault(joint, node)
            if owner != node:
                self.refused[f"{node} has gains of {joint} too; those of {owner} count (choose with --controller)"] += 1
                continue
            number = gain_value(value)
            if math.isfinite(number):
                heard.set(joint, kind, number)
                changed.append(joint)
        gains = {joint: heard.of(joint) for joint in dict.fromkeys(changed)}
        return {joint: known for joint, known in gains.items() if known is not None}


class BagReader:
    """Reads a bag from the topics found in it; ``refused`` counts what was left out, and why.

    Parameters
    ----------
    robots : topics of each; the name "" is of the only one, whose joints keep their names.
    controller : node whose gains count, where the parameter events of several are there.

    Attributes
    ----------
    replaced : what was not used of messages but for something else, and of how many.
    joints : the joints seen so far, by the names that pieces have: robot and name of its own.
    """

    def __init__(self, bag: Bag, robots: Mapping[str, Topics], controller: str | None = None) -> None:
        self._bag, self._robots = bag, dict(robots)
        every = list(robots.values())
        self._channels = set[Channel]().union(*(topics.all for topics in every))
        self._descriptions = {
            one
            for one in bag.channels()
            if one.type == joint_states.DESCRIPTION_TYPE and one.topic.endswith(joint_states.DESCRIPTION)
            if not why_unreadable(one)
        }
        self._channels |= self._descriptions
        self._fast = {
            channel: JointStateDecoder()
            for topics in every
            for channel in (topics.states, *topics.references)
            if channel.type == joint_states.TYPE
        }
        self._slow = {channel: Decoder(channel) for channel in self._channels if channel.type != joint_states.TYPE}
        self._events = {name: GainEvents(topics, controller) for name, topics in robots.items()}
        self._refused: Counter[str] = Counter()
        self._wholes, self._reference_wholes = WholeTurns(), WholeTurns()
        self.replaced: Counter[str] = Counter()
        self.joints: dict[str, tuple[str, str]] = {}
        self._prismatic: set[str] = set()

    @property
    def prismatic(self) -> list[str]:
        """The joints whose positions are in metres, as descriptions of robots in the bag say it."""
        return [name for name, (_, own) in self.joints.items() if own in self._prismatic]

    @property
    def refused(self) -> Counter[str]:
        """Reasons why messages were left out, and how many."""
        found = Counter(self._refused)
        for channel, decoder in self._fast.items():
            for reason, count in decoder.refused.items():
                found[f"{channel.topic}: {reason}"] += count
        return sum((events.refused for events in self._events.values()), found)

    @property
    def controllers(self) -> set[str]:
        """The nodes whose parameter events have gains, as far as the bag was read."""
        return set[str]().union(*(events.nodes for events in self._events.values()))

    @property
    def with_positions(self) -> bool:
        """Whether any joint state has positions, whatever they are worth, as far as the bag was read."""
        return any("position" in self._fast[topics.states].fields for topics in self._robots.values())

    @property
    def wrapped(self) -> list[str]:
        """What is to be said of joints whose positions wrap."""
        return [f"{joint}: {WRAPS} ({count} times)" for joint, count in self._wholes.counts.items()]

    def pieces(self, progress: Callable[[int], None] = lambda _: None) -> Iterator[Piece]:
        """Everything in the order of its recording."""
        for block in self._bag.blocks(self._channels, progress):
            # One channel may have several numbers: where files were merged, or several clients recorded.
            numbers: dict[Channel, list[int]] = {}
            for number, channel in block.channels.items():
                numbers.setdefault(channel, []).append(number)
            self._describe(block, numbers)
            gains_at = self._gains_in(block, numbers)
            edges = [0, *(number for number, _ in gains_at), len(block)]
            gains: list[dict[str, Gains]] = [{}, *(found for _, found in gains_at)]
            for begin, end, known in zip(edges[:-1], edges[1:], gains, strict=True):
                if known or end > begin:
                    yield self._piece(block, numbers, begin, end, known)

    def _decoded(
        self, channel: Channel, block: Block, chosen: Integers, read: Callable[[Any], Any]
    ) -> Iterator[tuple[int, Any]]:
        """Numbers of messages in a block, and what is read of them; what means nothing is counted, and left out."""
        for number in chosen.tolist():
            try:
                found = read(self._slow[channel].decode(block.message(number)))
            except MessageError as error:
                self._refused[f"{channel.topic}: {error}"] += 1
            else:
                yield number, found

    def _describe(self, block: Block, numbers: dict[Channel, list[int]]) -> None:
        for channel in self._descriptions:
            chosen = self._chosen(block, numbers, channel, 0, len(block))
            for _, text in self._decoded(channel, block, chosen, lambda message: str(message.data)):
                self._prismatic |= joint_states.prismatic_joints(text)

    def _gains_in(self, block: Block, numbers: dict[Channel, list[int]]) -> list[tuple[int, dict[str, Gains]]]:
        """At which messages of a block which gains change."""
        found: dict[int, dict[str, Gains]] = {}
        for channel in dict.fromkeys(
            one for topics in self._robots.values() for one in (*topics.gains, *topics.events)
        ):
            of_events = channel.type == EVENTS_TYPE
            chosen = self._chosen(block, numbers, channel, 0, len(block))
            read: Callable[[Any], Any] = (lambda event: event) if of_events else joint_states.gains_from_message
            for number, message in self._decoded(channel, block, chosen, read):
                for robot, topics in self._robots.items():
                    if channel in (*topics.gains, *topics.events):
                        new = self._events[robot].process(message) if of_events else message
                        for joint, value in new.items():
                            found.setdefault(number, {})[full_name(robot, joint)] = value
        return sorted(found.items())

    def _piece(
        self, block: Block, numbers: dict[Channel, list[int]], begin: int, end: int, gains: dict[str, Gains]
    ) -> Piece:
        samples: dict[str, FloatArray] = {}
        references: dict[str, FloatArray] = {}
        clock = np.nan
        # A leader's joint states are read once, and are its own samples and references of those that follow it.
        decoded: dict[Channel, tuple[dict[str, FloatArray], float]] = {}
        for robot, topics in self._robots.items():
            for channel in (topics.states, *topics.references):
                if channel in self._fast and channel not in decoded:
                    chosen = self._chosen(block, numbers, channel, begin, end)
                    decoded[channel] = self._joint_states(channel, block, chosen)
            own, first = decoded[topics.states]
            samples |= {name: rows for joint, rows in own.items() if (name := self._known(robot, joint)) is not None}
            clock = first if np.isnan(clock) else clock
            for channel in topics.references:
                if channel in decoded:
                    rows_of = {joint: rows[:, :3] for joint, rows in decoded[channel][0].items()}
                else:
                    chosen = self._chosen(block, numbers, channel, begin, end)
                    rows_of = self._controller_states(channel, block, chosen) if len(chosen) else {}
                for joint, values in rows_of.items():
                    name = full_name(robot, joint)
                    known = references.get(name)
                    references[name] = values if known is None else np.concatenate([known, values])
        samples = {name: self._wholes.removed(name, rows) for name, rows in samples.items()}
        references = {name: self._reference_wholes.removed(name, rows) for name, rows in references.items()}
        return Piece(gains=gains, samples=samples, references=references, clock=clock)

    def _known(self, robot: str, joint: str) -> str | None:
        """The name of a robot's joint in pieces; None if it is another one's already."""
        name, joint = full_name(robot, joint), visible(joint)
        if self.joints.setdefault(name, (robot, joint)) == (robot, joint):
            return name
        self._refused[f"{name} is the name of joints of two robots; only one is read"] += 1
        return None

    @staticmethod
    def _chosen(block: Block, numbers: dict[Channel, list[int]], channel: Channel, begin: int, end: int) -> Integers:
        chosen: Integers = begin + np.flatnonzero(np.isin(block.channel[begin:end], numbers.get(channel, [])))
        return chosen

    def _joint_states(self, channel: Channel, block: Block, chosen: Integers) -> tuple[dict[str, FloatArray], float]:
        """Rows of each joint, and time of recording less stamp of the first [s]."""
        found = self._fast[channel].decode(block, chosen) if len(chosen) else []
        times = [self._times(channel, rows.time, block.log_time[chosen[rows.index]]) for rows in found]
        clock = np.nan
        if found:
            clock = 1e-9 * float(block.log_time[chosen[found[0].index[0]]]) - float(times[0][0])
        return rows_by_joint(found, times), clock

    def _controller_states(self, channel: Channel, block: Block, chosen: Integers) -> dict[str, FloatArray]:
        listed: dict[str, list[tuple[float, float, float]]] = {}

        def read(message: Any) -> tuple[float, dict[str, tuple[float, float]]]:
            return joint_states.seconds(message.header.stamp), joint_states.reference_rows(message)

        decoded = list(self._decoded(channel, block, chosen, read))
        stamps = np.array([stamp for _, (stamp, _) in decoded])
        times = self._times(channel, stamps, block.log_time[[number for number, _ in decoded]])
        for time, (_, (_, rows_of)) in zip(times.tolist(), decoded, strict=True):
            for joint, (position, velocity) in rows_of.items():
                listed.setdefault(joint, []).append((time, position, velocity))
        return {joint: np.array(rows) for joint, rows in listed.items()}

    def _times(self, channel: Channel, stamps: FloatArray, recorded: Integers) -> FloatArray:
        """Stamps [s], or the times of recording [ns] where there are none."""

        def replace(reason: str, count: int) -> None:
            self.replaced[f"{channel.topic}: {reason}"] += count

        return joint_states.with_times(stamps, np.asarray(1e-9 * recorded), _INSTEAD, replace)


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
