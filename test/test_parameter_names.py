# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Parameter files: what is not understood is named, with what was meant."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from conftest import ROOT

from stickslip_ros.settings.parameter_file import ParameterFileError, Parameters
from stickslip_ros.settings.parameter_names import misnamed_sections, sections_of, unknown_name
from stickslip_ros.settings.parameter_table import COMMON, OF_THE_NODE, PER_JOINT, ParameterSpec

CONFIG = ROOT / "config" / "monitor.yaml"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("alow_apply", "parameter 'alow_apply' is not known; did you mean 'allow_apply'?"),
        ("limits.jiont1.p_max", "'limits.jiont1.p_max' names the joint 'jiont1', which is not watched; "
                                "did you mean 'joint1'?"),
        ("limits.joint1.pmax", "parameter 'limits.joint1.pmax' is not known; did you mean 'limits.joint1.p_max'?"),
        ("limts.joint1.p_max", "parameter 'limts.joint1.p_max' is not known; did you mean 'limits.joint1.p_max'?"),
        ("limits.joint7.p_max", "'limits.joint7.p_max' names the joint 'joint7', which is not watched"),
        ("colour", "parameter 'colour' is not known"),
        ("limits.joint1", "parameter 'limits.joint1' is not known"),
        ("recommended.joint1.p", "'recommended.joint1.p' is the monitor's advice and cannot be set"),
    ],
)  # fmt: skip
def test_what_a_name_was_meant_to_be(name: str, text: str) -> None:
    """Issue 15: a slip of the pen is named, and the nearest name."""
    found = unknown_name(name, ["joint1", "wrist"])
    assert found is not None
    assert found.text == text or (text.endswith("not known") and found.text.startswith(text))


def test_every_name_of_the_example_is_known() -> None:
    """Issue 15: config/monitor.yaml has every parameter; none is called a typo."""
    (section,) = sections_of(yaml.safe_load(CONFIG.read_text()))
    assert section.about_monitors
    assert [unknown_name(name, ["joint1"]) for name in section.parameters] == [None] * len(section.parameters)
    Parameters.of_files([CONFIG])


def test_the_example_holds_the_table() -> None:
    """The example file, config/monitor.yaml, has every parameter of the table and no other, each with its default."""
    (section,) = sections_of(yaml.safe_load(CONFIG.read_text()))
    table = {spec.name.format(joint="joint1"): spec.default for spec in (*OF_THE_NODE, *COMMON, *PER_JOINT)}
    shown = {"joints": ["joint1"], "model.joint1": "puma560_joint1"}  # an example is of some joint
    assert repr(sorted(section.parameters.items())) == repr(sorted((table | shown).items()))


@pytest.mark.parametrize("spec", [*OF_THE_NODE, *COMMON, *PER_JOINT], ids=lambda spec: spec.name)
def test_a_valid_file_is_read_by_the_commands(spec: ParameterSpec, tmp_path: Path) -> None:
    """`--parameters` takes every parameter of the table, those of the node itself too, and judges joints by it."""
    path = tmp_path / "p.yaml"
    name = spec.name.format(joint="joint1")
    path.write_text(yaml.safe_dump({"stickslip_monitor": {"ros__parameters": {name: spec.default}}}))
    Parameters.of_files([path]).settings_of("joint1")


@pytest.mark.parametrize(
    ("section", "is_for"),
    [
        ("/**", True), ("/**/stickslip_monitor", True), ("/left/stickslip_monitor", True), ("/left/*", True),
        ("/*", False), ("/*/stickslip_monitor", True), ("stickslip_monitor", False), ("/**/other", False),
        ("/left", False), ("/left/**", True),
    ],
)  # fmt: skip
def test_the_rules_of_ros_for_sections(section: str, is_for: bool) -> None:
    """Issue 15: which sections of a file a node gets."""
    (found,) = sections_of({section: {"ros__parameters": {"learn": True}}})
    assert found.is_for("/left/stickslip_monitor") is is_for


@pytest.mark.parametrize(
    ("names", "text"),
    [
        (["stickslip_monitr"], "section 'stickslip_monitr' is of no node that is known; did you mean "
                               "'stickslip_monitor'?"),
        (["/robot/sticksllip_monitor", "/**"], "section 'robot/sticksllip_monitor' is of no node"),
        (["monitor"], "section 'monitor' is of no node"),
        (["/left/stickslip_monitor"], "section '/left/stickslip_monitor' is not for this node, which is "
                                      "'/stickslip_monitor'"),
        (["controller_manager", "stickslip_monitor", "simulated_joint", "joint_state_broadcaster", "replay"], ""),
        (["/left/stickslip_monitor", "/stickslip_monitor"], ""),
        (["/stickslip_monitor_2", "/stickslip_monitor"], ""),
        (["/monitor", "/**"], ""),
    ],
)  # fmt: skip
def test_sections_that_were_meant_for_the_monitor(names: list[str], text: str) -> None:
    """Issue 15: a section of a node that is nearly this one is named; those of others are not."""
    sections = sections_of({name: {"ros__parameters": {"update_rate": 100}} for name in names})
    found = misnamed_sections(sections, "/stickslip_monitor")
    assert len(found) == bool(text)
    assert not text or found[0].startswith(text)


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("stickslip_monitr: {ros__parameters: {learn: false}}", "section 'stickslip_monitr' is of no node"),
        ("/**: {ros__parameters: {learn: false, alow_apply: true}}", "'alow_apply' is not known; did you mean"),
        ("stickslip_monitor: {ros__parameters: {limits: {joint1: {p_mx: 1.0}}}}", "did you mean 'limits.joint1.p_max'"),
        ("stickslip_monitor: {ros__parameters: {autostart: true, state_file: none}}", ""),
        ("/**: {ros__parameters: {gains: {joint1: {p: 1.0}}, dof_names: [joint1]}}", ""),
        ("pid: {ros__parameters: {gains: {joint1: {p: 1.0}}, dof_names: [joint1]}}", ""),
    ],
)
def test_files_given_to_the_commands(tmp_path: Path, content: str, text: str) -> None:
    """Issue 15: `--parameters` refuses what it does not understand, by the same rules."""
    path = tmp_path / "p.yaml"
    path.write_text(content)
    if not text:
        Parameters.of_files([path])
        return
    with pytest.raises(ParameterFileError) as refused:
        Parameters.of_files([path])
    assert str(refused.value).startswith(f"parameter file {path}: ")
    assert text in str(refused.value)


def test_joints_that_a_recording_has_not() -> None:
    """Issue 15: a joint's name that is nearly a recorded one is named; those of other robots are not."""
    given = Parameters({"limits.jiont1.p_max": 1.0, "limits.*.d_max": 1.0, "load.joint9": 1.0, "load.joint1": 0.0})
    (text,) = given.misnamed_joints(["joint1", "joint2"])
    assert text == ("'limits.jiont1.p_max' names the joint 'jiont1', which was not recorded; did you mean 'joint1'?")
