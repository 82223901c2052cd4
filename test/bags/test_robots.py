# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Bags of several robots: two arms, leaders and followers; each joint is judged as its own robot's."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import RECORDINGS
from support_bags import (
    JOINT_STATE,
    WITHOUT_LEARNING,
    joint_state,
    messages_of,
    read_joint,
    simulated_bag,
    write_mcap,
)

from stickslip_ros.analysis.analysis import AnalysisOptions, analyze
from stickslip_ros.analysis.analysis_json import bag_json
from stickslip_ros.analysis.fleet import BagTask, answer
from stickslip_ros.analysis.fleet_joints import rows_of
from stickslip_ros.bags.reading import BagReader, GainEvents
from stickslip_ros.bags.storage.bag import Bag
from stickslip_ros.bags.table import RecordingError
from stickslip_ros.bags.topics import TopicChoice, find_robots
from stickslip_ros.cli.main import main
from stickslip_ros.messages.joint_states import Channel
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.settings.parameter_file import Parameters

pytestmark = pytest.mark.slow

GAINS = "std_msgs/msg/Float64MultiArray"
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
Message = tuple[str, str, float, bytes | Any]


def motion(
    topic: str, position: Any, *, rate: float = 100.0, seconds: float = 10.0, names: Sequence[str] = ("joint1",)
) -> list[Message]:
    """Joint states of joints that all have one position, a function of time."""
    times = 1.0 + np.arange(0.0, seconds, 1.0 / rate)
    return [
        (topic, JOINT_STATE, time, joint_state(time, names, position=[float(position(time))] * len(names)))
        for time in times.tolist()
    ]


def in_order(path: Path, *parts: list[Message]) -> Path:
    """A bag of messages in the order of their recording."""
    return write_mcap(path, sorted((one for part in parts for one in part), key=lambda one: one[2]))


def moved(bag: Path, namespace: str) -> list[Message]:
    """The messages of a simulated bag, in a namespace."""
    return [
        (f"{namespace}{topic}", GAINS if topic == "/pd_gains" else JOINT_STATE, 1e-9 * time, data)
        for topic, time, data in messages_of(bag)
    ]


@pytest.fixture(scope="module")
def two_arms(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two arms with joints of the same names, all sticking; the left one is twice as slow."""
    folder = tmp_path_factory.mktemp("two")
    left = simulated_bag(folder / "left.mcap", names=("joint1", "joint2"))
    right = simulated_bag(folder / "right.mcap", names=("other", "joint1"), with_gains=False)
    return in_order(folder / "arms.mcap", moved(left, "/left"), moved(right, "/right"))


def test_every_robot_is_analysed(two_arms: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 17, item 10: several topics of joint states are several robots, and nobody confuses their joints."""
    table, cycles, page = tmp_path / "table.csv", tmp_path / "cycles.csv", tmp_path / "report.html"
    arguments = ["analyze", str(two_arms), "--no-learning", "--model", "puma560_joint1"]
    outputs = ["--csv", str(cycles), "--table", str(table), "--html", str(page)]
    assert main([*arguments, *outputs, "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)["bags"]
    assert found["warnings"] == []
    assert set(found["joints"]) == {"left/joint1", "left/joint2", "right/joint1", "right/other"}
    assert "topics" not in found
    assert found["robots"] == {
        "left": {
            "joint_states": "/left/joint_states",
            "references": ["/left/joint_references"],
            "gains": ["/left/pd_gains"],
        },
        "right": {"joint_states": "/right/joint_states", "references": ["/right/joint_references"], "gains": []},
    }
    left, right = found["joints"]["left/joint1"], found["joints"]["right/joint1"]
    assert (left["robot"], left["joint"], right["robot"], right["joint"]) == ("left", "joint1", "right", "joint1")
    assert left["velocity"] == pytest.approx(0.008, rel=0.05)
    assert right["velocity"] == pytest.approx(0.016, rel=0.05)
    assert left["gains"]["stiffness"] == 630.0
    assert right["gains"] is None
    with cycles.open(newline="", encoding="utf-8") as file:
        names = [row["joint"] for row in csv.DictReader(file)]
    assert names.count("left/joint1") == len(left["cycles"]) > 2
    with table.open(newline="", encoding="utf-8") as file:
        assert {(row["robot"], row["joint"]) for row in csv.DictReader(file)} == {
            ("left", "joint1"),
            ("left", "joint2"),
            ("right", "joint1"),
            ("right", "other"),
        }
    text = page.read_text(encoding="utf-8")
    assert "left/joint1" in text
    assert "right: states from /right/joint_states, references from /right/joint_references" in text
    assert main(arguments) == 0
    out = capsys.readouterr().out
    assert "left/joint1 sticks and slips at 0.00" in out
    assert "left: states from /left/joint_states, references from" in out


def test_robots_do_not_disturb_each_other(two_arms: Path) -> None:
    """Issue 17, item 10: each robot's joints are judged as if its topics were alone in the bag."""
    both = analyze(two_arms, WITHOUT_LEARNING)
    for robot in ("left", "right"):
        options = AnalysisOptions(
            topics=TopicChoice(states=f"/{robot}/joint_states"), parameters=WITHOUT_LEARNING.parameters
        )
        alone = bag_json(analyze(two_arms, options))
        assert alone["topics"]["joint_states"] == f"/{robot}/joint_states"
        for name, joint in alone["joints"].items():
            found = bag_json(both)["joints"][f"{robot}/{name}"]
            assert found["cycles"] == joint["cycles"]
            assert found["segments"] == joint["segments"]


def test_joints_are_chosen_and_described_by_either_name(two_arms: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 17, item 10: options name a joint of one robot, or that of every robot."""
    given = Parameters({"learn": False, "gains.joint1.p": 100.0, "gains.right/joint1.p": 200.0})
    found = analyze(two_arms, AnalysisOptions(joints=("joint1",), parameters=given))
    assert set(found.joints) == {"left/joint1", "right/joint1"}
    # Those that are recorded come later than those given.
    assert float(found.joints["left/joint1"].assessment.gains.stiffness) == 630.0
    assert float(found.joints["right/joint1"].assessment.gains.stiffness) == 200.0
    found = analyze(two_arms, AnalysisOptions(joints=("right/other",), parameters=given))
    assert set(found.joints) == {"right/other"}
    assert main(["analyze", str(two_arms), "--joint", "joint7"]) == 2
    assert "joints there: left/joint1, left/joint2, right/joint1, right/other" in capsys.readouterr().err


def test_a_fleet_knows_the_robots(two_arms: Path) -> None:
    """Issue 17, item 10: in a fleet's table a joint is its robot's."""
    rows = rows_of([answer(BagTask(two_arms, WITHOUT_LEARNING)).answer])
    assert {(row["robot"], row["joint"]) for row in rows} >= {("left", "joint1"), ("right", "joint1")}


def test_annotations_name_the_robots(two_arms: Path, tmp_path: Path) -> None:
    """Issue 17, item 10: what is written beside the recording names the robot too, in the order of time."""
    out = tmp_path / "annotated.mcap"
    assert main(["analyze", str(two_arms), "--no-learning", "--out", str(out), "--json"]) == 0
    times = [time for topic, time, _ in messages_of(out) if topic == "/diagnostics"]
    assert times == sorted(times)
    assert len(times) >= 12
    assert any(b"right/joint1" in data for topic, _, data in messages_of(out) if topic == "/diagnostics")


def robots(*topics: str, **choice: Any) -> Mapping[str, Any]:
    """The robots of a bag with these topics; those that are named after the reference are of a controller."""
    kinds = {"controller_state": CONTROLLER_STATE, "pd_gains": GAINS}
    channels = {
        Channel(topic=topic, type=kinds.get(topic.rpartition("/")[2], JOINT_STATE)): number + 1
        for number, topic in enumerate(topics)
    }
    return find_robots(channels, TopicChoice(**choice))


@pytest.mark.parametrize(
    ("leader", "follower"),
    [
        ("/leader/joint_states", "/follower/joint_states"),
        ("/left_leader/joint_states", "/left_follower/joint_states"),
        ("/arm_left_lead/joint_states", "/arm_left_follow/joint_states"),
        ("/master/joint_left", "/puppet/joint_left"),
        ("/leader1/joint_states", "/follower1/joint_states"),
        ("/leaderArm/joint_states", "/followerArm/joint_states"),
        ("/joint_states_leader", "/joint_states_follower"),
    ],
)
def test_leaders_are_plain_from_the_names(leader: str, follower: str) -> None:
    """Issue 17, item 10: the leader's joint states are the reference of the robot that follows it by its name."""
    found = {topics.states.topic: topics for topics in robots(leader, follower).values()}
    assert [one.topic for one in found[follower].references] == [leader]
    assert found[follower].leader.topic == leader
    assert found[leader].references == ()


def test_names_that_do_not_pair() -> None:
    """Issue 17, item 10: a leader of another arm is nobody's; where two could be meant, it is said."""
    found = robots("/left_leader/joint_states", "/right_follower/joint_states")
    assert all(not topics.references for topics in found.values())
    found = robots("/leader/joint_states", "/master/joint_states", "/follower/joint_states")
    assert not found["follower"].references
    (note,) = next(iter(found.values())).notes
    assert "leader of follower could be /leader/joint_states, /master/joint_states" in note
    assert "--references follower=TOPIC" in note
    both = robots(*(f"/{role}/joint_{side}" for role in ("master", "puppet") for side in ("left", "right")))
    assert {name: [one.topic for one in topics.references] for name, topics in both.items()} == {
        "master/joint_left": [],
        "master/joint_right": [],
        "puppet/joint_left": ["/master/joint_left"],
        "puppet/joint_right": ["/master/joint_right"],
    }


def test_what_lies_in_a_namespace_is_its_robots() -> None:
    """Issue 17, item 10: references and gains belong to the robot in whose namespace they are; others are named."""
    found = robots(
        "/left/joint_states", "/right/joint_states", "/left/command", "/left/pd_gains", "/right/pd_gains", "/pd_gains",
        "/desired",
    )  # fmt: skip
    assert [one.topic for one in found["left"].references] == ["/left/command"]
    assert found["right"].references == ()
    assert [[one.topic for one in found[name].gains] for name in found] == [["/left/pd_gains"], ["/right/pd_gains"]]
    notes = " ".join(found["left"].notes)
    assert "/pd_gains is in no robot's namespace: left out (choose with --gains-topic)" in notes
    assert "/desired is in no robot's namespace: left out (choose with --references ROBOT=TOPIC)" in notes
    root = robots("/joint_states", "/arm/joint_states", "/joint_references", "/arm/pd_gains")
    assert list(root) == ["arm", "joint_states"]
    assert [one.topic for one in root["joint_states"].references] == ["/joint_references"]
    assert root["arm"].references == ()
    # A robot that is told what to do knows it better than its leader.
    told = robots("/leader/joint_states", "/follower/joint_states", "/follower/joint_references")
    assert [one.topic for one in told["follower"].references] == ["/follower/joint_references"]
    assert told["follower"].leader is None


def test_references_as_asked_for() -> None:
    """Issue 17, item 10: --references names the leader of all others, or of one; '' is none."""
    states = ("/a/joint_states", "/b/joint_states", "/c/joint_states")
    all_of_them = robots(*states, references=("/a/joint_states",))
    assert {name: [one.topic for one in topics.references] for name, topics in all_of_them.items()} == {
        "a": [],
        "b": ["/a/joint_states"],
        "c": ["/a/joint_states"],
    }
    assert all_of_them["b"].leader.topic == "/a/joint_states"
    one = robots(*states, references=("c=/a/joint_states",))
    assert [bool(topics.references) for topics in one.values()] == [False, False, True]
    none = robots("/leader/joint_states", "/follower/joint_states", references=())
    assert not any(topics.references for topics in none.values())
    with pytest.raises(RecordingError, match=r"references of c could be /a/.*, /b/.*--references ROBOT=TOPIC"):
        robots(*states, references=("/a/joint_states", "/b/joint_states"))
    with pytest.raises(RecordingError, match=r"no robot 'd'; there are a, b, c"):
        robots(*states, references=("d=/a/joint_states",))


def test_one_topic_is_one_robot() -> None:
    """Issue 17, item 10: a bag with one topic of joint states stays what it was, whatever its namespace."""
    assert list(robots("/left/joint_states", "/other", "/left/command")) == [""]
    assert list(robots("/left/joint_states", "/right/joint_states", states="/left/joint_states")) == [""]


def test_gains_of_controllers_are_their_robots() -> None:
    """Issue 17, item 10: a controller's parameters are about the robot in whose namespace it is."""
    found = robots("/left/joint_states", "/right/joint_states")
    value = SimpleNamespace(type=3, double_value=5.0)
    parameter = SimpleNamespace(name="gains.joint1.p", value=value)

    def heard(robot: str, node: str, controller: str | None = None) -> tuple[float, list[str]]:
        events = GainEvents(found[robot], controller)
        gains = events.process(SimpleNamespace(node=node, new_parameters=[parameter], changed_parameters=[]))
        return (float(gains["joint1"].stiffness) if gains else 0.0), list(events.refused)

    assert heard("left", "/left/controller") == (5.0, [])
    assert heard("right", "/left/controller") == (0.0, [])
    stiffness, (said,) = heard("right", "/controller")
    assert stiffness == 0.0
    assert "it is in no robot's namespace (choose with --controller)" in said
    assert heard("right", "/controller", "/controller") == (5.0, [])


def test_a_follower_that_is_left_behind(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 17, item 10: the leader's motion, of another rate and other stamps, is what the follower should do."""
    path = in_order(
        tmp_path / "bag.mcap",
        motion("/leader/joint_states", lambda time: 0.1 * time, rate=30.0, names=("joint1", "gripper")),
        motion("/follower/joint_states", lambda time: 0.3, rate=100.0, names=("joint1", "wrist")),
    )
    found = analyze(path, AnalysisOptions(parameters=Parameters({"learn": False})))
    assert "stuck for" in found.joints["follower/joint1"].reason
    assert found.joints["follower/wrist"].reason == ""
    assert found.joints["leader/joint1"].status is Status.SMOOTH
    (warning,) = found.warnings
    assert "follower: no joint of its leader /leader/joint_states is named wrist (there are joint1, gripper)" in warning
    with Bag(path) as bag:
        names = find_robots(bag.channels(), TopicChoice())
        pieces = list(BagReader(bag, names).pieces())
    rows = np.concatenate([piece.references["follower/joint1"] for piece in pieces if piece.references])
    np.testing.assert_allclose(rows[:, 1], 0.1 * rows[:, 0], atol=1e-6)
    assert main(["analyze", str(path), "--no-learning", "--json", "--references", ""]) == 0
    (plain,) = json.loads(capsys.readouterr().out)["bags"]
    assert plain["joints"]["follower/joint1"]["reason"] == ""


def test_a_leader_by_another_clock(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 17, item 10: stamps that never meet give no reference, which is said, with how far they are off."""
    follower = motion("/follower/joint_states", lambda time: 0.1 * time)
    leader = motion("/leader/joint_states", lambda time: 0.1 * time)
    later = [(*one[:3], joint_state(one[2] + 100.0, ["joint1"], position=[0.1 * one[2]])) for one in leader]
    path = in_order(tmp_path / "bag.mcap", follower, later)
    found = analyze(path, AnalysisOptions(parameters=Parameters({})))
    said = "the stamps of its references are 100.0 s ahead of those of its joint states (do the clocks agree?)"
    assert found.warnings == (f"follower/joint1: {said}, so they are not used",)
    assert math.isnan(found.joints["follower/joint1"].assessment.tracking_error)
    main(["identify", str(path), "--states", "/follower/joint_states", "--references", "/leader/joint_states"])
    assert said in " ".join(capsys.readouterr().out.split())


def test_commands_that_need_one_robot_name_the_option(two_arms: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 17, item 10: what takes one robot lists them, with the option that chooses."""
    assert main(["identify", str(two_arms), "--on", "joint1"]) == 2
    said = capsys.readouterr().err
    assert "/left/joint_states (2400 messages), /right/joint_states (2400 messages): choose one with --states" in said
    batch = read_joint(two_arms, "joint1", TopicChoice(states="/right/joint_states"))
    assert batch.velocity.mean() == pytest.approx(0.016, rel=0.2)
    assert main(["identify", str(two_arms), "--states", "/left/joint_states", "--on", "no"]) == 2
    assert "joints there: joint1, joint2" in capsys.readouterr().err


def test_joints_of_two_robots_with_one_name(tmp_path: Path) -> None:
    """Issue 17, item 10: even names that contradict each other are not mixed; it is said."""
    path = in_order(
        tmp_path / "bag.mcap",
        motion("/a/joint_states", lambda time: time, names=("b/c",)),
        motion("/a/b/joint_states", lambda time: -time, names=("c",)),
    )
    found = analyze(path, AnalysisOptions(parameters=Parameters({"learn": False})))
    (joint,) = found.joints.values()
    assert joint.samples == 1000
    assert any("a/b/c is the name of joints of two robots" in warning for warning in found.warnings)


def test_a_leader_and_its_follower_of_a_real_arm(tmp_path: Path) -> None:
    """Issue 17, item 10: a teleoperated arm, recorded at two rates: the follower is judged by its leader's motion."""
    parts = []
    for role in ("lead", "follow"):
        files = list(RECORDINGS.glob(f"prismax_0_arm_left_{role}.npz"))
        if not files:
            pytest.skip(f"prismax_0_arm_left_{role}.npz is not in {RECORDINGS} (set STICKSLIP_RECORDINGS)")
        with np.load(files[0]) as archive:
            times, positions = archive["time_s"], archive["position_rad"].astype(float)
            names = [str(name) for name in archive["joints"]]
        topic = f"/arm_left_{role}/joint_states"
        offset = 1.0 if times[0] < 1.0 else 0.0
        parts.append(
            [
                (topic, JOINT_STATE, offset + time, joint_state(offset + time, names, position=row))
                for time, row in zip(times.tolist(), positions, strict=True)
            ]
        )
    path = in_order(tmp_path / "arm.mcap", *parts)
    found = analyze(path, AnalysisOptions(parameters=Parameters({"learn": False})))
    assert found.robots["arm_left_follow"].leader is not None
    assert not found.warnings
    assert len(found.joints) == 2 * len(names)
    followers = [joint for name, joint in found.joints.items() if name.startswith("arm_left_follow/")]
    assert all(np.isfinite(joint.assessment.tracking_error) for joint in followers)
    leaders = [joint for name, joint in found.joints.items() if name.startswith("arm_left_lead/")]
    assert all(np.isnan(joint.assessment.tracking_error) for joint in leaders)


def test_a_person_moves_an_arm(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 17, item 2: joints that stop and go without a reference are named together, with what would help."""

    def by_hand(time: float) -> float:
        moves, share = divmod(time, 0.9)
        share = min(share / 0.4, 1.0)
        size = 0.05 * (1.0 + math.sin(1.7 * moves))
        return float(0.3 * math.sin(moves) + size * share**3 * (10.0 - 15.0 * share + 6.0 * share**2))

    path = in_order(tmp_path / "bag.mcap", motion("/joint_states", by_hand, seconds=60.0, names=("joint1", "joint2")))
    main(["analyze", str(path), "--no-learning"])
    out = capsys.readouterr().out
    assert "not judged, stops and goes while no reference moves; publish" in out
    assert "sticking: joint1, joint2" in out
    assert "stick_slip" not in out
