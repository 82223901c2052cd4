# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the node was given or is sent and cannot use, in words: for its own status, and as the reason in a joint's."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from rclpy.node import Node

from stickslip_ros.errors import reason
from stickslip_ros.messages.gain_parameters import gains_elsewhere
from stickslip_ros.messages.joint_states import TYPE
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.nodes.gains.gain_intake import PD_GAINS, GainIntake
from stickslip_ros.nodes.intake.arrivals import (
    REFERENCE_TYPES,
    REFERENCES,
    STATES,
    JointStateTopic,
    reference_type_name,
)
from stickslip_ros.nodes.intake.publishers import NAMED, SCAN_EVERY, is_named, names_of, publishers_by_topic
from stickslip_ros.nodes.watched_joints import WatchedJoint, WatchedJoints
from stickslip_ros.output.wording import references_off_text
from stickslip_ros.regular_files import read_yaml
from stickslip_ros.settings.parameter_names import (
    FileSection,
    UnknownName,
    did_you_mean,
    misnamed_sections,
    nearest_name,
    sections_of,
    unknown_name,
)
from stickslip_ros.visible import listed

_FILE = "--params-file"
_HEARD_WITHIN = 5.0  # time until a joint is heard for the first time, s: its parameters are unknown only after it
_QOS = "qos_overrides."
_NEARLY = 0.85  # similarity of a name in a section of all nodes, 1: a less similar name is another node's
_LEAST_LETTERS = 6  # length of such a name, letters: shorter names are similar by chance
_PATIENCE = 10.0  # time without a message, s: drivers start within it
_CLOCK_PATIENCE = 5.0  # time until the first message on /clock, s: a simulation that runs publishes within it
_INACTIVE = 2.0  # time between two polls, s: the node was inactive meanwhile, and could hear nothing
_WORD = TYPE.rpartition("/")[2]


class UnknownParameters:
    """Unknown parameters of the node.

    Parameters
    ----------
    arguments : arguments of the process, as ROS has them; None for its own.

    ``texts`` has a sentence for every parameter that is unknown now.
    """

    def __init__(self, node: Node, arguments: Sequence[str] | None = None) -> None:
        self._node = node
        given = sys.argv if arguments is None else arguments
        self._sections, duplicate_keys = _given_sections(given)
        self._in_files = [*misnamed_sections(self._sections, node.get_fully_qualified_name()), *duplicate_keys]
        self._logged: set[str] = set()
        self._unheard: set[str] = set()  # joints of unknown parameters, "" for none
        self._began = math.nan
        self._seen: object = None
        self.texts: list[str] = []

    def poll(self, joints: Collection[str], now: float, *, others_may_come: bool) -> None:
        """Compare the given parameters with the known ones; ``now`` is a steady time [s].

        Parameters
        ----------
        joints : watched joints. others_may_come : whether more joints are watched once they are heard.
        """
        if math.isnan(self._began):
            self._began = now
        waiting = others_may_come and now - self._began < _HEARD_WITHIN
        seen = (frozenset(joints), waiting)
        if seen == self._seen:
            return
        self._seen = seen
        where = "which has not been heard of yet" if others_may_come else "which is not watched"
        unknown = [one for one in self._unknown(joints, where) if not (waiting and one.joint)]
        self.texts = [*self._in_files, *(one.text for one in unknown)]
        for text in self.texts:
            if text not in self._logged:
                self._logged.add(text)
                self._node.get_logger().warning(text)
        for joint in sorted(self._unheard.intersection(joints)):
            self._node.get_logger().info(f"the joint {joint!r} is heard now, and its parameters count")
        self._unheard = self._unheard.difference(joints) | {one.joint for one in unknown}

    def _unknown(self, joints: Collection[str], where: str) -> Iterator[UnknownName]:
        for name in sorted(self._node._parameter_overrides):
            if name.startswith(_QOS):
                known = [f"{_QOS}{key}" for key in self._node.get_parameters_by_prefix(_QOS.rstrip("."))]
                found = None if name in known else UnknownName(
                    name, f"parameter {name!r} is not known{did_you_mean(nearest_name(name, known))}"
                )  # fmt: skip
            elif self._node.has_parameter(name) and not name.startswith("recommended."):
                found = None
            else:
                found = unknown_name(name, joints, where)
            if found is not None and self._meant_for_this_node(found):
                yield found

    def _meant_for_this_node(self, found: UnknownName) -> bool:
        """Whether a name is meant for the monitor: a section of all nodes may be about others."""
        own = self._node.get_fully_qualified_name()
        homes = [one for one in self._sections if found.name in one.parameters and one.is_for(own)]
        if not homes or any(not one.of_any_node or one.about_monitors for one in homes):
            return True
        known = list(self._node._parameters)
        if gains_elsewhere([found.name]):
            return True
        return len(found.name) >= _LEAST_LETTERS and bool(nearest_name(found.name, known, _NEARLY))


def _given(arguments: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Options among ROS's arguments, each with the word that follows."""
    ours, words = False, list(arguments)
    for word, behind in zip(words, [*words[1:], ""], strict=True):
        if word == "--ros-args":
            ours = True
        elif word == "--":
            ours = False
        elif ours and behind:
            yield word, behind


def _given_sections(arguments: Sequence[str]) -> tuple[list[FileSection], list[str]]:
    """Sections of --params-file and -p node:name:=value among ROS's arguments, and a sentence on each key that occurs
    twice in a file: one value counts, and the other is lost.
    """
    sections: list[FileSection] = []
    duplicate_keys = []
    for option, value in _given(arguments):
        node, colon, parameter = value.partition(":=")[0].rpartition(":")
        if option in ("-p", "--param") and colon:
            sections.append(FileSection(f"/{node.lstrip('/')}", {parameter: None}))
        elif option == _FILE:
            # Of a file that cannot be read rcl reports what is wrong with it.
            with suppress(OSError, ValueError, RecursionError):
                sections += sections_of(read_yaml(Path(value)))
                try:
                    read_yaml(Path(value), unique=True)
                except ValueError as error:
                    duplicate_keys.append(f"parameter file {value}: {reason(error)}")
    return sections, duplicate_keys


class PublishedTypes:
    """Types published on the node's topics: messages of another type than the subscription's never arrive.

    Parameters
    ----------
    wanted : type of the subscription, as in sensor_msgs/msg/JointState, by topic.

    ``troubles`` has a sentence for every topic on which another type is published.
    """

    def __init__(self, node: Node, wanted: Mapping[str, str]) -> None:
        self._node, self._wanted = node, wanted
        self._next_scan = -math.inf
        self._unnamed: set[str] = set()
        self.troubles: dict[str, str] = {}

    def poll(self, now: float) -> None:
        """Scan the graph if it is time; ``now`` is a steady time [s]."""
        if now < self._next_scan:
            return
        self._next_scan = now + SCAN_EVERY
        found = {topic: self._trouble(topic, wanted) for topic, wanted in self._wanted.items()}
        for topic, text in found.items():
            if text and topic not in self.troubles:
                self._node.get_logger().warning(text)
        self.troubles = {topic: text for topic, text in found.items() if text}

    def _trouble(self, topic: str, wanted: str) -> str:
        name = self._node.resolve_topic_name(topic)
        others = [one for one in self._node.get_publishers_info_by_topic(name) if one.topic_type != wanted]
        # A publisher can be in the graph before the name of its node; by the next scan the name is there, if ever.
        unnamed = not all(map(is_named, others))
        if unnamed and topic not in self._unnamed:
            self._unnamed.add(topic)
            return self.troubles.get(topic, "")
        if not unnamed:
            self._unnamed.discard(topic)
        if not others:
            return ""
        kinds = sorted({one.topic_type for one in others})
        nodes = listed(names_of(others), NAMED)
        return f"{name} carries {', '.join(kinds)} from {nodes}, and {_advice(topic, wanted, kinds)}"


def _advice(topic: str, wanted: str, kinds: list[str]) -> str:
    if topic != REFERENCES:
        return f"{wanted} is listened to: remap {topic}"
    word = wanted.rpartition("/")[2]
    fitting = next((REFERENCE_TYPES[kind] for kind in kinds if kind in REFERENCE_TYPES), "")
    what = f"set it to {fitting}" if fitting else f"remap {topic}, as no reference_type reads that"
    return f"reference_type is {word}: {what}"


class SilentStates:
    """Scan for publishers of joint states while no message comes; the log has one line for each silence.

    Parameters
    ----------
    topic : name of the topic in the node, before remapping.

    ``text`` names the topic and those with publishers, "" while messages come.
    """

    def __init__(self, node: Node, topic: str) -> None:
        self._node, self._topic = node, topic
        self._messages = 0
        self._heard_at = self._polled_at = -math.inf
        self._next_scan = -math.inf
        self.text = ""

    def poll(self, now: float, messages: int) -> None:
        """Compare the number of messages since the node was activated with that of the last poll.

        Parameters
        ----------
        now : a steady time [s].
        """
        anew = now - self._polled_at > _INACTIVE or messages < self._messages
        self._polled_at = now
        if anew or messages > self._messages:
            if self.text and not anew:
                self._node.get_logger().info(f"{self._node.resolve_topic_name(self._topic)} is heard")
            self._messages, self._heard_at, self.text = messages, now, ""
        elif now - self._heard_at >= _PATIENCE and now >= self._next_scan:
            self._next_scan = now + SCAN_EVERY
            first, self.text = not self.text, self._sentence()
            if first:
                self._node.get_logger().warning(self.text)

    def _sentence(self) -> str:
        own = self._node.resolve_topic_name(self._topic)
        found = publishers_by_topic(self._node, TYPE)
        here = found.pop(own, [])
        others = [f"{topic} (by {listed(names, NAMED)})" for topic, names in sorted(found.items())]
        # A publisher on this topic is silent; without a publisher another topic was meant.
        who = f"{listed(here, NAMED)} publishes there and sends nothing" if here else f"no node publishes {_WORD} there"
        if others:
            what = f"; {_WORD} is published on {listed(others, NAMED)}" + ("" if here else f": remap {self._topic}")
        else:
            domain = os.environ.get("ROS_DOMAIN_ID", "0")
            what = "" if here else f", and {_WORD} is on no other topic in ROS_DOMAIN_ID {domain}"
        since = "any more" if self._messages else "yet"
        return f"nothing is heard on {own} ({TYPE}) {since}, for {_PATIENCE:g} s: {who}{what}"


class SilentClock:
    """Detection of simulated time that is requested and never comes.

    ``text`` has the sentence, "" while there is time.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._clock = node, node.get_clock()
        self._began = math.nan
        self._logged = False
        self.text = ""

    def poll(self, now: float) -> None:
        """Read the clock; ``now`` is a steady time [s]."""
        self.text = ""
        if not self._clock.ros_time_is_active or self._clock.now().nanoseconds:
            self._began = math.nan
            return
        self._began = now if math.isnan(self._began) else self._began
        if now - self._began < _CLOCK_PATIENCE:
            return
        self.text = "use_sim_time is true and nothing is heard on /clock: what is published has the stamp zero"
        if not self._logged:
            self._logged = True
            self._node.get_logger().warning(self.text)


class Inputs:
    """Troubles with the inputs of the node, in words; :meth:`poll` is called now and then."""

    def __init__(self, node: Node, joints: WatchedJoints, gains: GainIntake, reference_type: str) -> None:
        self._joints, self._gains = joints, gains
        self._types = PublishedTypes(
            node,
            {
                STATES: "sensor_msgs/msg/JointState",
                REFERENCES: reference_type_name(reference_type),
                PD_GAINS: "std_msgs/msg/Float64MultiArray",
            },
        )
        self._unknown_parameters = UnknownParameters(node)
        self._silent_states, self._silent_clock = SilentStates(node, STATES), SilentClock(node)

    def poll(self, now: float, states: JointStateTopic) -> None:
        """Scan the graph and the given parameters; ``now`` is a steady time [s]."""
        self._types.poll(now)
        self._silent_clock.poll(now)
        self._silent_states.poll(now, states.messages)
        self._unknown_parameters.poll(list(self._joints), now, others_may_come=self._joints.welcomes_others)

    @property
    def troubles(self) -> list[str]:
        """Sentences for the status of the node itself."""
        silences = [text for text in (self._silent_states.text, self._silent_clock.text) if text]
        return [*self._types.troubles.values(), *silences, *self._unknown_parameters.texts]

    def values(self) -> list[tuple[str, object]]:
        """The same sentences as keys and values."""
        return [
            ("topics of another type", "; ".join(self._types.troubles.values())),
            ("parameters not understood", "; ".join(self._unknown_parameters.texts)),
        ]

    def missing(self, joint: WatchedJoint, assessment: Assessment) -> str:
        """Why states, gains or references of a joint are missing, "" if none are."""
        reasons = []
        if math.isinf(joint.heard):
            reasons += [text for text in (self._types.troubles.get(STATES, ""), self._silent_states.text) if text]
        if assessment.gains is None:
            why = self._gains.why_unknown(joint.name) or self._types.troubles.get(PD_GAINS, "")
            reasons += [f"gains not known: {why}"] if why else []
        if REFERENCES in self._types.troubles and assessment.velocity_source != "reference":
            reasons.append(f"no reference: {self._types.troubles[REFERENCES]}")
        if math.isfinite(joint.pairing.offset):
            reasons.append(f"no reference: {references_off_text(joint.pairing.offset)}")
        if assessment.reference_follows:
            reasons.append("no reference: what is published only repeats what is measured")
        return "; ".join(reasons)
