# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Launch files, read as text: launch itself is no wheel. What they start exists, what they take is described."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest
from conftest import ROOT

pytestmark = pytest.mark.slow

LAUNCH_FILES = sorted((ROOT / "launch").glob("*.launch.py"))
EXECUTABLES = set(re.findall(r'"(\w+) = stickslip_ros', (ROOT / "setup.py").read_text(encoding="utf-8")))
OF_OTHERS = {"ros2_control_demo.launch.py"}  # which start nodes of other packages too


def calls(path: Path, name: str) -> list[ast.Call]:
    """Calls of a name in a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [n for n in ast.walk(tree) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name) and n.func.id == name]


def keyword(call: ast.Call, name: str) -> object:
    """The literal value of a keyword, None if it has none."""
    found = [part.value for part in call.keywords if part.arg == name]
    return found[0].value if found and isinstance(found[0], ast.Constant) else None


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_what_is_launched_exists(path: Path) -> None:
    """Issue 8: every node of this package that a launch file starts is an executable of it."""
    nodes = calls(path, "Node")
    assert nodes or calls(path, "IncludeLaunchDescription")
    for node in nodes:
        package = keyword(node, "package")
        assert package == "stickslip_ros" or path.name in OF_OTHERS
        if package == "stickslip_ros":
            assert keyword(node, "executable") in EXECUTABLES


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_every_argument_is_described_and_used(path: Path) -> None:
    """Issue 8: arguments are described; each is used, and no other is asked for."""
    declared = calls(path, "DeclareLaunchArgument")
    for argument in declared:
        assert len(str(keyword(argument, "description"))) > 10
    names = {argument.args[0].value for argument in declared if isinstance(argument.args[0], ast.Constant)}
    text = path.read_text(encoding="utf-8")
    for name in names:
        assert len(re.findall(rf'"{name}"', text)) > 1, f"{name} is declared, and not used"
    asked = {c.args[0].value for c in calls(path, "LaunchConfiguration") if isinstance(c.args[0], ast.Constant)}
    assert asked <= names
