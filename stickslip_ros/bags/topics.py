# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Which topics of a bag hold states, references and gains: found by type, and by options where they could be many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from stickslip_ros.bags.decoding import Decoder
from stickslip_ros.bags.table import RecordingError
from stickslip_ros.messages import joint_states
from stickslip_ros.messages.blocks import Channel
from stickslip_ros.messages.content import MessageError

REFERENCE_TYPES = ("control_msgs/msg/JointTrajectoryControllerState", "control_msgs/msg/MultiDOFStateStamped")
GAINS_TYPE = "std_msgs/msg/Float64MultiArray"
EVENTS_TYPE = "rcl_interfaces/msg/ParameterEvent"
_STATES = "joint_states"
_REFERENCES = ("joint_references", "joint_reference", "references", "reference", "desired", "command", "commands")
_GAINS = "pd_gains"


@dataclass(frozen=True, kw_only=True)
class TopicChoice:
    """Topics named by the user; None where they are to be found.

    Attributes
    ----------
    states, gains : one topic; references : one or several, () for none at all.
    controller : node whose gains count, where the parameter events of several are there.
    """

    states: str | None = None
    references: tuple[str, ...] | None = None
    gains: str | None = None
    controller: str | None = None


@dataclass(frozen=True, kw_only=True)
class Topics:
    """What a bag is read from.

    Attributes
    ----------
    states : channel of the joint states. references : JointStates, or controller states. gains : of `pd_gains`.
    events : of parameters.
    """

    states: Channel
    references: tuple[Channel, ...] = ()
    gains: tuple[Channel, ...] = ()
    events: tuple[Channel, ...] = ()
    notes: tuple[str, ...] = field(default=())

    @property
    def all(self) -> set[Channel]:
        """Every channel that is read."""
        return {self.states, *self.references, *self.gains, *self.events}


def find_topics(channels: Mapping[Channel, int], choice: TopicChoice) -> Topics:
    """Find the topics by their types and names.

    Raises
    ------
    RecordingError
        If there are no joint states, or they or something else could be several topics; the message lists them with
        the option that settles it.
    """
    there = {channel: count for channel, count in channels.items() if count != 0}
    notes: list[str] = []
    known = [channel for channel in there if channel.type == joint_states.TYPE]
    usable = [channel for channel in known if not _why_no_joint_state(channel, notes)]
    named = [channel for channel in usable if _last(channel) in _REFERENCES]
    others = [channel for channel in usable if channel not in named]
    if choice.states is not None:
        states = _named(choice.states, usable, there, "--states")
    else:
        preferred = [channel for channel in others if _last(channel) == _STATES] or others
        states = _only(preferred, "joint states", "--states", there, notes)
    if choice.references is not None:
        fit = [*usable, *(channel for channel in there if channel.type in REFERENCE_TYPES)]
        references = [_named(name, fit, there, "--references") for name in choice.references]
    else:
        near = [channel for channel in named if _folder(channel) == _folder(states)] or named
        if len(near) > 1:
            _only(near, "references", "--references", there, notes)
        references = near or [channel for channel in there if _usable_reference(channel, notes)]
    gains = [channel for channel in there if channel.type == GAINS_TYPE]
    if choice.gains is not None:
        gains = [_named(choice.gains, gains, there, "--gains-topic")]
    else:
        gains = [channel for channel in gains if _last(channel) == _GAINS]
        gains = [channel for channel in gains if _folder(channel) == _folder(states)] or gains
        if len(gains) > 1:
            _only(gains, "gains", "--gains-topic", there, notes)
    events = [channel for channel in there if channel.type == EVENTS_TYPE]
    return Topics(
        states=states, references=tuple(references), gains=tuple(gains), events=tuple(events), notes=tuple(notes)
    )


def _last(channel: Channel) -> str:
    return channel.topic.rpartition("/")[2]


def _folder(channel: Channel) -> str:
    return channel.topic.rpartition("/")[0]


def _only(
    candidates: Sequence[Channel], what: str, option: str, there: Mapping[Channel, int], notes: Sequence[str]
) -> Channel:
    if len(candidates) == 1:
        return candidates[0]
    if not candidates:
        listed = ", ".join(sorted(f"{channel.topic} ({channel.type or 'unknown type'})" for channel in there)) or "none"
        problem = "; ".join([f"no topic of {joint_states.TYPE} with messages", *notes])
        raise RecordingError(f"{problem}; topics there: {_shortened(listed)}")
    raise RecordingError(f"{what} could be {_listed(candidates, there)}: choose one with {option}")


def _named(topic: str, candidates: Sequence[Channel], there: Mapping[Channel, int], option: str) -> Channel:
    found = [channel for channel in candidates if channel.topic == topic]
    if found:
        return found[0]
    raise RecordingError(f"{option} {topic}: no such topic of a type that fits; there are {_listed(candidates, there)}")


def _listed(candidates: Sequence[Channel], there: Mapping[Channel, int]) -> str:
    return (
        ", ".join(sorted(f"{one.topic} ({there[one]} messages)" if there[one] > 0 else one.topic for one in candidates))
        or "none"
    )


def _shortened(text: str, longest: int = 400) -> str:
    return text if len(text) <= longest else f"{text[:longest]} …"


def _why_no_joint_state(channel: Channel, notes: list[str]) -> bool:
    """Whether a topic that says so holds no JointStates; the reason goes to the notes."""
    try:
        decoder = _decoder(channel)
        if decoder is not None and decoder.fields() != ["header", "name", *joint_states.FIELDS]:
            raise MessageError(f"its definition of {channel.type} has the fields {', '.join(decoder.fields())}")
        if channel.encoding != "cdr":
            raise MessageError(f"its encoding is {channel.encoding!r}, not 'cdr'")
    except MessageError as error:
        notes.append(f"{channel.topic}: {error}")
        return True
    return False


def _usable_reference(channel: Channel, notes: list[str]) -> bool:
    if channel.type not in REFERENCE_TYPES:
        return False
    try:
        Decoder(channel)
    except MessageError as error:
        notes.append(f"{channel.topic}: {error}")
        return False
    return True


def _decoder(channel: Channel) -> Decoder | None:
    return Decoder(channel) if channel.schema.strip() else None
