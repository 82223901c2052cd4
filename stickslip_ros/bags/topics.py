# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Which topics of a bag hold states, references and gains: found by type, and by options where they could be many.

A bag with several topics of joint states is one of several robots, each named by its namespace.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from stickslip_ros.bags.decoding import Decoder, why_unreadable
from stickslip_ros.bags.table import RecordingError
from stickslip_ros.messages import joint_states
from stickslip_ros.messages.joint_states import Channel

REFERENCE_TYPES = ("control_msgs/msg/JointTrajectoryControllerState", "control_msgs/msg/MultiDOFStateStamped")
GAINS_TYPE = "std_msgs/msg/Float64MultiArray"
EVENTS_TYPE = "rcl_interfaces/msg/ParameterEvent"
_STATES = "joint_states"
_REFERENCES = ("joint_references", "joint_reference", "references", "reference", "desired", "command", "commands")
_GAINS = "pd_gains"
_FIELDS = ["header", "name", *joint_states.FIELDS]  # of a JointState
_LEADS = frozenset({"leader", "lead", "master"})
_FOLLOWS = frozenset({"follower", "follow", "slave", "puppet"})
READ_TYPES = frozenset({joint_states.TYPE, *REFERENCE_TYPES, GAINS_TYPE, EVENTS_TYPE})
_MOST_DEFINITIONS = 200  # of one type there are as many as its package had versions
_MOST_TOPICS = 1000  # of those types
_MOST_ROBOTS = 100  # of a bag; what is whose is found by comparing all with all
_LONGEST_LIST = 400  # characters of the topics that an error lists
_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+|[0-9]+")


@dataclass(frozen=True, kw_only=True)
class TopicChoice:
    """Topics named by the user; None where they are to be found.

    Attributes
    ----------
    states : one topic. gains : likewise, "" for none at all.
    references : one or several, () for none at all; "robot=topic" for those of one robot.
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
    events : of parameters. leader : whose joint states are among the references; None if nobody leads.
    namespaces : of all robots of the bag; () where there is one only.
    """

    states: Channel
    references: tuple[Channel, ...] = ()
    gains: tuple[Channel, ...] = ()
    events: tuple[Channel, ...] = ()
    notes: tuple[str, ...] = ()
    leader: Channel | None = None
    namespaces: tuple[str, ...] = ()

    @property
    def namespace(self) -> str:
        """Of the joint states, without the slash at its end."""
        return _folder(self.states)

    @property
    def all(self) -> set[Channel]:
        """Every channel that is read."""
        return {self.states, *self.references, *self.gains, *self.events}


def find_topics(channels: Mapping[Channel, int], choice: TopicChoice) -> Topics:
    """Find the topics of the one robot of a bag, by their types and names.

    Raises
    ------
    RecordingError
        If there are no joint states, or they or something else could be several topics; the message lists them with
        the option that settles it.
    """
    candidates = _Candidates.of(channels)
    states = candidates.only(candidates.states(choice), "joint states", "--states")
    return _topics_of_one(candidates, states, choice)


def find_robots(channels: Mapping[Channel, int], choice: TopicChoice) -> dict[str, Topics]:
    """Find the topics of every robot of a bag; a bag with one topic of joint states has one robot, named "".

    Of several, each has what lies in its namespace. A robot that follows another one by its name has the joint states
    of its leader as references, unless it has others in its own namespace.

    Raises
    ------
    RecordingError
        As :func:`find_topics`, and if topics that were named could be of several robots.
    """
    candidates = _Candidates.of(channels)
    states = candidates.states(choice)
    if len(states) > _MOST_ROBOTS:
        raise RecordingError(
            f"it has {len(states)} topics of joint states, at most {_MOST_ROBOTS} are read: choose one with --states"
        )
    if len({channel.topic for channel in states}) < max(len(states), 2):
        return {"": find_topics(channels, choice)}
    return _topics_of_several(candidates, sorted(states, key=lambda one: one.topic), choice)


@dataclass(frozen=True, kw_only=True)
class _Candidates:
    """Channels with messages: `usable` are JointStates, of which `named` have a name of references."""

    there: dict[Channel, int]
    usable: list[Channel]
    named: list[Channel]
    notes: list[str]

    @staticmethod
    def of(channels: Mapping[Channel, int]) -> _Candidates:
        there = {channel: count for channel, count in channels.items() if count > 0}
        notes: list[str] = []
        known = [channel for channel in there if channel.type == joint_states.TYPE]
        read = [channel for channel in there if channel.type in READ_TYPES]
        if len(read) > _MOST_TOPICS:
            raise RecordingError(f"it has {len(read)} topics of the types that are read; at most {_MOST_TOPICS} can be")
        definitions = {channel.schema for channel in read}
        if len(definitions) > _MOST_DEFINITIONS:
            raise RecordingError(
                f"it has {len(definitions)} definitions of the types that are read; "
                f"at most {_MOST_DEFINITIONS} can be: a recorder writes one for each type"
            )
        usable = [channel for channel in known if _usable(channel, notes)]
        named = [channel for channel in usable if _last(channel) in _REFERENCES]
        return _Candidates(there=there, usable=usable, named=named, notes=notes)

    def states(self, choice: TopicChoice) -> list[Channel]:
        """Those that could hold joint states: the one that was chosen, else those of that name, else all."""
        if choice.states is not None:
            return [self.chosen(choice.states, self.usable, "--states")]
        others = [channel for channel in self.usable if channel not in self.named]
        return [channel for channel in others if _last(channel) == _STATES] or others

    def reference(self, topic: str) -> Channel:
        """A topic of references by its name."""
        return self.chosen(topic, [*self.usable, *self.controller_states()], "--references")

    def controller_states(self) -> list[Channel]:
        return self.of_type(*REFERENCE_TYPES)

    def usable_controller_states(self) -> list[Channel]:
        return [channel for channel in self.controller_states() if _usable(channel, self.notes)]

    def gains(self, choice: TopicChoice) -> list[Channel]:
        """Those of gains: the one that was chosen, else those of the usual name."""
        gains = self.of_type(GAINS_TYPE)
        if choice.gains is not None:
            return [self.chosen(choice.gains, gains, "--gains-topic")] if choice.gains else []
        return [channel for channel in gains if _last(channel) == _GAINS]

    def of_type(self, *kinds: str) -> list[Channel]:
        return [channel for channel in self.there if channel.type in kinds]

    def only(self, some: Sequence[Channel], what: str, option: str) -> Channel:
        if len(some) == 1:
            return some[0]
        if some:
            raise RecordingError(f"{what} could be {self.listed(some)}: choose one with {option}")
        listed = ", ".join(sorted(f"{one.topic} ({one.type or 'unknown type'})" for one in self.there)) or "none"
        listed = listed if len(listed) <= _LONGEST_LIST else f"{listed[:_LONGEST_LIST]} …"
        problem = "; ".join([f"no topic of {joint_states.TYPE} with messages", *self.notes])
        raise RecordingError(f"{problem}; topics there: {listed}")

    def chosen(self, topic: str, some: Sequence[Channel], option: str) -> Channel:
        for channel in some:
            if channel.topic == topic:
                return channel
        there = self.listed(some)
        raise RecordingError(f"{option} {topic}: no such topic of a type that fits; there are {there}")

    def listed(self, some: Sequence[Channel]) -> str:
        return ", ".join(sorted(f"{one.topic} ({self.there[one]} messages)" for one in some)) or "none"


def _topics_of_one(candidates: _Candidates, states: Channel, choice: TopicChoice) -> Topics:
    named = candidates.named
    if choice.references is not None:
        references = [candidates.reference(one.rpartition("=")[2]) for one in choice.references]
    else:
        near = [channel for channel in named if _folder(channel) == _folder(states)] or named
        if near:
            candidates.only(near, "references", "--references")
        references = near or candidates.usable_controller_states()
    gains = candidates.gains(choice)
    gains = [channel for channel in gains if _folder(channel) == _folder(states)] or gains
    if gains:
        candidates.only(gains, "gains", "--gains-topic")
    return Topics(
        states=states,
        references=tuple(references),
        gains=tuple(gains),
        events=tuple(candidates.of_type(EVENTS_TYPE)),
        notes=tuple(candidates.notes),
    )


def _topics_of_several(candidates: _Candidates, states: Sequence[Channel], choice: TopicChoice) -> dict[str, Topics]:
    robots = dict(zip(_robot_names(states), states, strict=True))
    namespaces = tuple(dict.fromkeys(_folder(channel) for channel in states))
    references, leaders = _chosen_references(candidates, robots, choice), dict[str, Channel]()
    if references is None:
        references = _references_by_namespace(candidates, robots, namespaces)
        leaders = {name: one for name, one in _leaders(robots, candidates.notes).items() if not references[name]}
        references |= {name: [one] for name, one in leaders.items()}
    else:
        leads = set(states)
        leaders = {name: one for name, some in references.items() for one in some if one in leads}
    gains = _gains_by_namespace(candidates, robots, namespaces, choice)
    # What was noted of the bag as a whole stands with the first.
    return {
        name: Topics(
            states=channel,
            references=tuple(references[name]),
            gains=tuple(gains[name]),
            events=tuple(candidates.of_type(EVENTS_TYPE)),
            notes=tuple(candidates.notes) if number == 0 else (),
            leader=leaders.get(name),
            namespaces=namespaces,
        )
        for number, (name, channel) in enumerate(robots.items())
    }


def _robot_names(states: Sequence[Channel]) -> list[str]:
    """Namespaces, or whole topics where there is none or several have the same; no two are alike."""
    whole = [channel.topic.strip("/") for channel in states]
    spaces = [_folder(channel).strip("/") for channel in states]
    counts = Counter(spaces)
    names = [space if space and counts[space] == 1 else topic for space, topic in zip(spaces, whole, strict=True)]
    return names if len(set(names)) == len(names) else whole


def nearest_namespace(name: str, namespaces: Sequence[str]) -> str | None:
    """The innermost of these namespaces that a topic or a node lies in; None if it lies in none.

    The root is one of them if a robot has its joint states there.
    """
    within = [space for space in namespaces if name.startswith(f"{space}/")]
    return max(within, key=len, default=None)


def _chosen_references(
    candidates: _Candidates, robots: Mapping[str, Channel], choice: TopicChoice
) -> dict[str, list[Channel]] | None:
    """Those that were named, of each robot; None if none were. One that is a reference of others has none."""
    if choice.references is None:
        return None
    own: dict[str, list[Channel]] = {name: [] for name in robots}
    common: list[Channel] = []
    for text in choice.references:
        robot, equals, topic = text.rpartition("=")
        if equals and robot not in robots:
            raise RecordingError(f"--references {text}: no robot {robot!r}; there are {', '.join(robots)}")
        (own[robot] if equals else common).append(candidates.reference(topic))
    namespaces = [_folder(channel) for channel in robots.values()]
    below_the_root = [space for space in namespaces if space]
    for name, states in robots.items():
        if own[name] or states in common:
            continue
        near = [one for one in common if nearest_namespace(one.topic, namespaces) == _folder(states)]
        near = [one for one in near if one not in robots.values()]
        fit = near or [
            one for one in common if one in robots.values() or nearest_namespace(one.topic, below_the_root) is None
        ]
        if len(fit) > 1 and not near:
            listed = candidates.listed(fit)
            raise RecordingError(f"references of {name} could be {listed}: say whose with --references ROBOT=TOPIC")
        own[name] = fit
    return own


def _references_by_namespace(
    candidates: _Candidates, robots: Mapping[str, Channel], namespaces: Sequence[str]
) -> dict[str, list[Channel]]:
    found: dict[str, list[Channel]] = {name: [] for name in robots}
    usable = candidates.usable_controller_states()
    for name, states in robots.items():
        named = [one for one in candidates.named if nearest_namespace(one.topic, namespaces) == _folder(states)]
        named = [one for one in named if _folder(one) == _folder(states)] or named
        # Robots whose topics lie side by side in one namespace cannot be told apart by it.
        if len(named) > 1 or (named and _shared(states, robots)):
            listed = candidates.listed(named)
            candidates.notes.append(f"references of {name} could be {listed}: choose with --references {name}=TOPIC")
            continue
        found[name] = named or [
            one
            for one in usable
            if nearest_namespace(one.topic, namespaces) == _folder(states) and not _shared(states, robots)
        ]
    for one in (*candidates.named, *usable):
        if nearest_namespace(one.topic, namespaces) is None:
            left_out = f"{one.topic} is in no robot's namespace: left out (choose with --references ROBOT=TOPIC)"
            candidates.notes.append(left_out)
    return found


def _shared(states: Channel, robots: Mapping[str, Channel]) -> bool:
    return sum(_folder(other) == _folder(states) for other in robots.values()) > 1


def _gains_by_namespace(
    candidates: _Candidates, robots: Mapping[str, Channel], namespaces: Sequence[str], choice: TopicChoice
) -> dict[str, list[Channel]]:
    found: dict[str, list[Channel]] = {name: [] for name in robots}
    for one in candidates.gains(choice):
        space = nearest_namespace(one.topic, namespaces)
        owners = [name for name, states in robots.items() if _folder(states) == space]
        if not owners and choice.gains is None:
            left_out = f"{one.topic} is in no robot's namespace: left out (choose with --gains-topic)"
            candidates.notes.append(left_out)
        # What was chosen although it is in no namespace is everybody's.
        for name in owners or (robots if choice.gains is not None else ()):
            found[name].append(one)
    for name, some in found.items():
        if some:
            candidates.only(some, f"gains of {name}", "--gains-topic")
    return found


def _leaders(robots: Mapping[str, Channel], notes: list[str]) -> dict[str, Channel]:
    """The leader of each robot that follows one, where it is plain from the names of their topics."""
    roles = {name: _role(channel.topic) for name, channel in robots.items()}
    found = {}
    for name, (follows, stem) in roles.items():
        if follows is not True:
            continue
        leads = [other for other, role in roles.items() if role == (False, stem)]
        if len(leads) == 1:
            found[name] = robots[leads[0]]
        elif leads:
            listed = ", ".join(robots[one].topic for one in leads)
            notes.append(f"leader of {name} could be {listed}: choose with --references {name}=TOPIC")
    return found


def _role(topic: str) -> tuple[bool | None, tuple[str, ...]]:
    """Whether a topic's words say that it follows (True) or leads (False), and its other words."""
    words = [word.lower() for word in _WORD.findall(topic)]
    roles = {word in _FOLLOWS for word in words if word in _FOLLOWS | _LEADS}
    stem = tuple("" if word in _FOLLOWS | _LEADS else word for word in words)
    return (roles.pop() if len(roles) == 1 else None), stem


def _last(channel: Channel) -> str:
    return channel.topic.rpartition("/")[2]


def _folder(channel: Channel) -> str:
    return channel.topic.rpartition("/")[0]


def _usable(channel: Channel, notes: list[str]) -> bool:
    """Whether a topic's messages can be read; the reason why not goes to the notes."""
    if channel.type == joint_states.TYPE and channel.encoding == "cdr" and not channel.schema.strip():
        return True
    problem = why_unreadable(channel)
    if not problem and channel.type == joint_states.TYPE and (fields := Decoder(channel).fields()) != _FIELDS:
        problem = f"its definition of {channel.type} has the fields {', '.join(fields)}"
    if problem:
        notes.append(f"{channel.topic}: {problem}")
    return not problem
