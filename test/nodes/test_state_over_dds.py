# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What was learnt outlasts the process: real files, real ends, a disk that is full."""

from __future__ import annotations

import json
import math
import os
import resource
import time
from pathlib import Path

import pytest
from conftest import LIMIT
from hypothesis import given
from hypothesis import strategies as st
from nodes.forked_nodes import NodeProcess
from support_ros import Probe, play, probe, sticking_motion

from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.nodes.kept_state import (
    StateFileError,
    StateKeeper,
    as_text,
    default_path,
    read_state,
    sealed,
    unsealed,
    write_state,
)
from stickslip_ros.nodes.watched_joints import GainBounds, WatchedJoint
from stickslip_ros.settings.known_joints import load_joint
from stickslip_ros.settings.parameter_table import COMMON, PER_JOINT
from stickslip_ros.settings.parameters import settings_of

KNOWS_GAINS = {"joints": "[joint1]", "gains.joint1.p": 630.0}
LEARNT = "stribeck [N*m]"
_SETTLED = 1.5  # [s] without a study, after which no more is learnt


class Log:
    """Remembers warnings."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def warning(self, text: str) -> None:
        """Remember a line."""
        self.lines.append(text)

    info = warning


@pytest.fixture(scope="module")
def learnt() -> JointMonitor:
    """A monitor that has learnt something."""
    monitor = JointMonitor(gains=Gains(stiffness=630.0), studies_at_once=True)
    monitor.process(sticking_motion(30.0))
    assert monitor.learner.estimate is not None
    return monitor


def watched(monitor: JointMonitor) -> WatchedJoint:
    """A joint as the node has it."""
    defaults = {spec.name.format(joint="joint1"): spec.default for spec in (*COMMON, *PER_JOINT)}
    return WatchedJoint("joint1", monitor, settings_of("joint1", defaults.__getitem__), GainBounds())


def learn(one: Probe) -> dict[str, str]:
    """Let the monitor learn; returns what it says then."""
    one.wait_for_monitor()
    motion = sticking_motion(30.0)
    play(one, "joint1", motion.time, motion.position, motion.reference_position, begin=100.0)
    one.wait(lambda: LEARNT in one.diagnostics["joint1"][2], "something learnt")
    # Slips that come during a study are learnt from after it; between two studies none is under way.
    last, since = "", math.nan

    def settled() -> bool:
        nonlocal last, since
        busy = one.diagnostics["stickslip_monitor"][2]["questions under way [1]"] != "0"
        learnt = one.diagnostics["joint1"][2].get(LEARNT, "")
        if busy or learnt != last:
            last, since = learnt, time.monotonic()
        return time.monotonic() - since > _SETTLED

    one.wait(settled, "the last study")
    return one.diagnostics["joint1"][2]


def test_what_was_learnt_is_there_after_a_restart(ros_domain: int) -> None:
    """Issue 7: friction, its errors and the cycles are saved at the end, and loaded at the start; reset forgets."""
    path = default_path("/stickslip_monitor")
    with NodeProcess("monitor", KNOWS_GAINS) as monitor, probe() as one:
        before = learn(one)
        assert monitor.stop() == 0
    # On a busy machine a save of every minute may have come before; the end saves what came since.
    assert read_state(path)["joint1"].cycles == int(before["cycles [1]"])
    with NodeProcess("monitor", KNOWS_GAINS) as monitor, probe() as one:
        one.wait_for_monitor()
        one.wait(lambda: LEARNT in one.diagnostics.get("joint1", (b"", "", {}))[2], "what was learnt")
        after = one.diagnostics["joint1"][2]
        same = [key for key in before if key.startswith(("stribeck", "lag", "inertia", "coulomb", "viscous", "cycles"))]
        assert len(same) >= 10
        assert {key: after[key] for key in same} == {key: before[key] for key in same}
        assert "going on from the friction learnt before" in monitor.output()
        # The motion of another day has no say in what is found now.
        assert after["status"] == "unknown"
        assert one.answer("reset").success
        assert monitor.stop() == 0
    assert "joint1" not in read_state(path)


def test_a_joint_that_is_heard_of_later_goes_on_too(ros_domain: int, learnt: JointMonitor) -> None:
    """Without configured joints what was learnt of one is there with its first samples."""
    write_state(default_path("/stickslip_monitor"), as_text({"joint1": learnt.memory()}))
    with NodeProcess("monitor", {}) as monitor, probe() as one:
        one.wait_for_monitor()
        motion = sticking_motion(1.0)
        play(one, "joint1", motion.time, motion.position, motion.reference_position, begin=100.0)
        one.wait(lambda: LEARNT in one.diagnostics.get("joint1", (b"", "", {}))[2], "what was learnt")
        assert "joint1: going on from the friction learnt before" in monitor.output()


def test_a_damaged_file_is_set_aside(ros_domain: int, learnt: JointMonitor) -> None:
    """Issue 7: with a warning, and the node begins anew."""
    path = default_path("/stickslip_monitor")
    text = bytearray(as_text({"joint1": learnt.memory()}))
    text[len(text) // 2] ^= 1
    write_state(path, bytes(text))
    with NodeProcess("monitor", KNOWS_GAINS) as monitor, probe() as one:
        one.wait_for_monitor()
        assert "is damaged (its checksum is wrong)" in monitor.output()
        assert monitor.stop() == 0
    assert path.with_name(f"{path.name}.damaged").read_bytes() == bytes(text)


def test_a_newer_file_is_left_alone(learnt: JointMonitor, tmp_path: Path) -> None:
    """Issue 20: it is called newer, and neither set aside nor written over."""
    path = tmp_path / "state.json"
    header, _, body = as_text({"joint1": learnt.memory()}).partition(b"\n")
    newer = header.replace(b'"version": 3', b'"version": 4') + b"\n" + body
    path.write_bytes(newer)
    keeper = StateKeeper(path, Log())  # type: ignore[arg-type]
    assert "is newer than this release" in keeper.trouble
    assert "damaged" not in keeper.trouble
    keeper.save({"joint1": watched(learnt)})
    assert path.read_bytes() == newer
    assert list(tmp_path.iterdir()) == [path]


def test_what_version_2_learnt_is_kept(learnt: JointMonitor, tmp_path: Path) -> None:
    """Issue 38, item 6: without what updates by single slips started from."""
    path = tmp_path / "state.json"
    _, body = unsealed(as_text({"joint1": learnt.memory()}), "stickslip_ros state", 3)
    joints = json.loads(body)
    of_updates = {"information": [[1.0]], "prior": {"mean": [0.0]}, "spread": [1.0], "widening": [1.0]}
    joints["joint1"]["friction"]["learnt"] |= of_updates
    path.write_bytes(sealed("stickslip_ros state", 2, json.dumps(joints)))
    write_state(path, as_text(read_state(path)))
    assert path.read_bytes() == as_text({"joint1": learnt.memory()})


def test_a_linked_file_is_followed(learnt: JointMonitor, tmp_path: Path) -> None:
    """Issue 20: written and set aside beside what the link leads to; what killed processes left there is removed."""
    (tmp_path / "there").mkdir()
    link, target = tmp_path / "state.json", tmp_path / "there" / "kept.json"
    link.symlink_to(target)
    target.write_text("none of ours")
    (target.parent / ".kept.json.99999999.1.part").write_text("half")
    keeper = StateKeeper(link, Log())  # type: ignore[arg-type]
    keeper.save({"joint1": watched(learnt)})
    assert not keeper.trouble
    assert link.readlink() == target
    assert "joint1" in read_state(target)
    assert sorted(path.name for path in target.parent.iterdir()) == ["kept.json", "kept.json.damaged"]


def test_a_folder_is_no_file(ros_domain: int, tmp_path: Path) -> None:
    """Issue 7: refused at the start, and left as it is."""
    with NodeProcess("monitor", {"state_file": str(tmp_path)}) as monitor:
        assert monitor.wait(LIMIT) == 2
        assert "'state_file' must be the name of a regular file, not of a folder or a device" in monitor.output()
    assert tmp_path.is_dir()


def test_a_full_disk_is_said_and_costs_nothing_else(ros_domain: int, learnt: JointMonitor, tmp_path: Path) -> None:
    """Issue 7: what was saved before stays, the next save that finds room succeeds; nothing is left lying about."""
    path = tmp_path / "disk" / "state.json"
    write_state(path, as_text({"joint1": learnt.memory()}))
    saved, log = path.read_bytes(), Log()
    keeper, joint = StateKeeper(path, log), watched(learnt)  # type: ignore[arg-type]
    learnt.cycle_count += 1
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        keeper.save({"joint1": joint})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert "cannot be saved" in keeper.trouble
    assert path.read_bytes() == saved
    assert [file.name for file in path.parent.iterdir()] == ["state.json"]
    keeper.save({"joint1": joint})
    assert keeper.trouble == ""
    assert read_state(path)["joint1"].cycles == learnt.cycle_count


def test_a_full_disk_under_a_running_node(ros_domain: int, tmp_path: Path) -> None:
    """Issue 7: a file system without room (tmpfs): the node ends in order, its log says why."""
    disk = tmp_path / "disk"
    disk.mkdir()
    if os.geteuid() != 0 or os.system(f"mount -t tmpfs -o size=16k tmpfs {disk} 2>/dev/null") != 0:
        pytest.skip("mounting a small file system needs root")
    try:
        (disk / "full").write_bytes(bytes(12_000))
        with NodeProcess("monitor", {**KNOWS_GAINS, "state_file": str(disk / "state.json")}) as monitor, probe() as one:
            learn(one)
            assert monitor.stop() == 0
            assert "cannot be saved: [Errno 28]" in monitor.output()
    finally:
        os.system(f"umount {disk}")


def test_it_is_saved_every_minute(learnt: JointMonitor, tmp_path: Path) -> None:
    """Issue 7: kill -9 loses at most a minute."""
    path, log = tmp_path / "state.json", Log()
    keeper, joints = StateKeeper(path, log), {"joint1": watched(learnt)}  # type: ignore[arg-type]
    for now in (0.0, 30.0, 59.9):
        keeper.tick(joints, now)
        assert not path.exists()
    keeper.tick(joints, 60.0)
    keeper.save({})  # waits for what is under way
    assert set(read_state(path)) == {"joint1"}
    assert log.lines == []


def test_what_is_read_is_what_was_written(learnt: JointMonitor, tmp_path: Path) -> None:
    """Issue 7: to the last digit; a joint that is configured otherwise than it was does not go on from it."""
    path = tmp_path / "state.json"
    write_state(path, as_text({"joint1": learnt.memory()}))
    memory = read_state(path)["joint1"]
    assert as_text({"joint1": memory}) == path.read_bytes()
    other = JointMonitor(gains=Gains(stiffness=630.0))
    assert other.restore(memory)
    assert other.learner.estimate is not None
    assert other.learner.estimate["stribeck"] == learnt.learner.estimate["stribeck"]
    other.process(sticking_motion(12.0))
    assert other.learner.estimate["stribeck"].value == pytest.approx(1.6, rel=0.05)
    assert not JointMonitor(load_joint("puma560_joint1").joint).restore(memory)
    with_prior = JointMonitor(load_joint("puma560_joint1").joint, Gains(stiffness=630.0), studies_at_once=True)
    with_prior.process(sticking_motion(12.0))
    write_state(path, as_text({"joint1": with_prior.memory()}))
    assert JointMonitor(load_joint("puma560_joint1").joint).restore(read_state(path)["joint1"])


@given(st.data())
def test_any_damage_is_seen(
    tmp_path_factory: pytest.TempPathFactory, learnt: JointMonitor, data: st.DataObject
) -> None:
    """Issue 7: whatever bytes are changed, cut off or put in their place, it is the state or an error, and no other."""
    text = as_text({"joint1": learnt.memory()})
    path = tmp_path_factory.getbasetemp() / "damaged.json"
    kind = data.draw(st.sampled_from(["cut", "flip", "other", "json"]))
    if kind == "cut":
        changed = text[: data.draw(st.integers(0, len(text) - 1))]
    elif kind == "flip":
        at = data.draw(st.integers(0, len(text) - 1))
        changed = text[:at] + bytes([text[at] ^ (1 << data.draw(st.integers(0, 7)))]) + text[at + 1 :]
    elif kind == "other":
        changed = data.draw(st.binary(max_size=300))
    else:
        header = {"format": "stickslip_ros state", "version": data.draw(st.sampled_from([1, 2, None])), "crc32": 0}
        changed = json.dumps(header).encode() + b"\n" + data.draw(st.binary(max_size=50))
    path.write_bytes(changed)
    with pytest.raises(StateFileError):
        read_state(path)


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("/stickslip_monitor", "stickslip_monitor.json"),
        ("/robot1/stickslip_monitor", "robot1.stickslip_monitor.json"),
        ("/../../etc/passwd", "etc.passwd.json"),
        ("/a b/%s", "ab.s.json"),
    ],
)
def test_names_make_no_paths(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str, file: str) -> None:
    """Issue 7: whatever a node is called, its file is in its own folder."""
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    assert default_path(name) == tmp_path / "stickslip_ros" / file
