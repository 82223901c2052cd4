# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The floors: imports only go down. The package: its parts agree with each other."""

from __future__ import annotations

import ast
import graphlib
import importlib
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path

import pytest
import yaml
from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.package import parse_package
from conftest import LIMIT, ROOT

import stickslip_ros
from stickslip_ros.errors import JointFileError, UnknownJointError
from stickslip_ros.settings.known_joints import known_joint_names, load_joint

PACKAGE = ROOT / "stickslip_ros"
ALLOWED = {
    "model": {"stickslip_ros.model", "stickslip_ros.errors", "stickslip_ros.compilation", "numpy", "numba", "scipy"},
    "monitoring": {
        "stickslip_ros.monitoring",
        "stickslip_ros.model",
        "stickslip_ros.errors",
        "stickslip_ros.compilation",
        "numpy",
        "numba",
        "scipy",
    },
}


def imports(path: Path) -> set[str]:
    """Names of the modules that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module or "")
    return found


@pytest.mark.parametrize("floor", ALLOWED)
def test_imports_only_go_down(floor: str) -> None:
    """Issue 2: model and monitoring import no ROS, no files, no terminal, nothing from above."""
    for path in (PACKAGE / floor).rglob("*.py"):
        for name in imports(path):
            allowed = name.split(".")[0] in sys.stdlib_module_names or any(
                name == part or name.startswith(part + ".") for part in ALLOWED[floor]
            )
            assert allowed, f"{path.relative_to(ROOT)} imports {name}"


# From the ground up, as docs/design.md has them.
ROOMS = (
    "visible", "errors", "interrupts", "files", "regular_files", "parent_death", "compilation", "model", "messages",
    "monitoring", "settings", "output", "bags", "analysis", "warm_up", "nodes", "cli",
)  # fmt: skip


@cache
def house() -> dict[str, set[str]]:
    """Every module of the package, and those of the package that it imports, by their names after the package's."""
    paths = {".".join(path.relative_to(PACKAGE).with_suffix("").parts): path for path in PACKAGE.rglob("*.py")}
    modules = {name.removesuffix(".__init__"): path for name, path in paths.items() if name != "__init__"}
    found: dict[str, set[str]] = {}
    for name, path in modules.items():
        found[name] = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("stickslip_ros."):
                base = str(node.module).removeprefix("stickslip_ros.")
                whole = {f"{base}.{alias.name}" for alias in node.names}
                # `from room import module` as well as `from module import name`.
                found[name] |= (whole & set(modules)) or {base}
    return found


def test_a_room_uses_only_those_below_it() -> None:
    """Issue 16: in the order of docs/design.md; every module is in a room."""
    for name, used in house().items():
        room = name.split(".")[0]
        assert room in ROOMS, f"{name} is in no room"
        for other in used:
            assert ROOMS.index(other.split(".")[0]) <= ROOMS.index(room), f"{name} imports {other}"


def test_no_modules_import_each_other() -> None:
    """Issue 16: no circles, within a room neither."""
    graphlib.TopologicalSorter(house()).prepare()


def test_the_rooms_are_those_of_the_design() -> None:
    """Issue 16: docs/design.md lists the rooms in their order."""
    text = (ROOT / "docs" / "design.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.*?) \|", text, re.MULTILINE)
    listed = [room for row in rows for room in re.findall(r"`(\w+)(?:/|\.py)`", row)]
    assert sorted(listed) == sorted(ROOMS)
    assert [room for room in listed if room in ROOMS[6:]] == list(ROOMS[6:])


# Modules of monitoring/friction that tests may import, and the public names of those which have inner ones beside.
PUBLIC_OF_FRICTION: dict[str, set[str]] = {
    "change": set(), "dry_friction": set(), "estimate": set(), "estimation": {"StudyQuestion", "estimate_friction"},
    "friction_factor": set(), "kept_slips": set(), "late_controller": {"DelayEstimate"}, "learner": set(),
    "presliding": set(), "ripple": set(),
    "sliding": set(), "slip_windows": {"ForceSource", "SlipWindow", "slip_window"},
}  # fmt: skip
# Mathematical functions with tests of their own: the laws of friction, and a quantile. `compilation` finds files with
# compiled functions by the underscore.
OWN_TESTS = {"test_friction_law.py": {"_friction_law"}, "test_quantile.py": {"_quantile_kernel"}}


def test_tests_use_what_is_public() -> None:
    """Issue 35: tests import no underscore module of the package, and nothing from inside of monitoring/friction."""
    underscored = {path.stem for path in PACKAGE.rglob("_*.py")} - {"__init__", "__main__"}
    room = "stickslip_ros.monitoring.friction"
    for path in sorted((ROOT / "test").rglob("*.py")):
        found = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                found |= {f"{node.module}.{alias.name}" for alias in node.names}
        for name in sorted(name for name in found if name.startswith("stickslip_ros.")):
            where = f"{path.relative_to(ROOT)} imports {name}"
            assert not underscored & (set(name.split(".")) - OWN_TESTS.get(path.name, set())), where
            if name.startswith(room):
                module, _, inside = name.removeprefix(room).removeprefix(".").partition(".")
                assert module in PUBLIC_OF_FRICTION, where
                assert not inside or inside in (PUBLIC_OF_FRICTION[module] or {inside}), where


@pytest.mark.parametrize("folder", ["benchmarks", "tools", "docs", "launch"])
def test_what_is_imported_from_the_package_is_there(folder: str) -> None:
    """`make bench` once ended at a name that had moved: of the scripts no test starts, types are not checked either."""
    for path in sorted((ROOT / folder).glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("stickslip_ros"):
                module = importlib.import_module(node.module or "")
                missing = [alias.name for alias in node.names if not hasattr(module, alias.name)]
                assert not missing, f"{path.relative_to(ROOT)}: {missing} of {node.module}"


@pytest.mark.slow
def test_the_command_line_starts_without_ros() -> None:
    """Issue 2: `stickslip margin` needs no ROS."""
    code = (
        "import sys; sys.modules['rclpy'] = None; from stickslip_ros.cli.main import main; "
        "sys.exit(main(['margin', '--model', 'puma560_joint1', '--json']))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, timeout=LIMIT).returncode == 0


@pytest.mark.slow
def test_what_only_bags_need_is_loaded_for_bags() -> None:
    """Issue 6: a ROS machine without the bags' packages has every command but theirs, and every node."""
    code = (
        "import sys\n"
        "for name in ('bokeh', 'contourpy', 'lz4', 'mcap', 'rosbags', 'zstandard'): sys.modules[name] = None\n"
        "import stickslip_ros.nodes.monitor, stickslip_ros.nodes.replay\n"
        "from stickslip_ros.cli.main import main\n"
        "assert main(['margin', '--model', 'puma560_joint1', '--json']) == 0\n"
        "sys.exit(main(['simulate', '--out', 'x.mcap']))"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True, timeout=LIMIT)
    assert done.returncode == 2
    assert "writing it needs the package" in done.stderr


def test_versions_agree() -> None:
    """Issue 2: setup.py, package.xml, the package and the changelog have one version."""
    in_setup = re.search(r'version="([^"]+)"', (ROOT / "setup.py").read_text()).group(1)
    in_manifest = ET.parse(ROOT / "package.xml").getroot().findtext("version")
    in_changelog = re.search(r"^(\d+\.\d+\.\d+)", (ROOT / "CHANGELOG.rst").read_text(), re.MULTILINE).group(1)
    assert in_setup == in_manifest == stickslip_ros.__version__ == in_changelog


def test_a_release_tool_reads_manifest_and_changelog() -> None:
    """Issue 8: package.xml is valid without a warning; bloom finds this version's date and notes in the changelog."""
    warnings: list[str] = []
    parse_package(str(ROOT / "package.xml")).validate(warnings=warnings)
    assert not warnings
    version, date, notes = next(iter(get_changelog_from_path(str(ROOT)).foreach_version()))
    assert version == stickslip_ros.__version__
    assert date is not None
    assert notes


def test_no_address_is_made_up() -> None:
    """Issue 22, item 10: how to get the package has no placeholder; why it has no public address is said once."""
    install = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    assert "REPOSITORY" not in install
    assert "no public address yet" in install
    manifest = (ROOT / "package.xml").read_text(encoding="utf-8")
    in_setup = re.search(r'maintainer_email="([^"]+)"', (ROOT / "setup.py").read_text(encoding="utf-8"))
    assert in_setup is not None
    assert f'<maintainer email="{in_setup.group(1)}">' in manifest
    assert "docs/install.md says why" in manifest


def test_every_source_file_names_its_licence() -> None:
    """Issue 2: Apache-2.0, in two lines on top of every file."""
    for path in [
        *ROOT.glob("*.py"),
        *(p for folder in ("stickslip_ros", "test", "launch", "benchmarks") for p in (ROOT / folder).rglob("*.py")),
        *(ROOT / "tools").glob("*.py"),
    ]:
        assert path.read_text(encoding="utf-8").startswith("# SPDX-License-Identifier: Apache-2.0\n# Copyright"), path


def test_known_joints_load_and_the_unknown_is_refused() -> None:
    """Issue 2: joint files are found by name; an unknown name lists the known ones."""
    for name in known_joint_names():
        assert load_joint(name).name == name
    with pytest.raises(UnknownJointError, match=r"unknown joint 'puma'; known joints: .*puma560_joint1"):
        load_joint("puma")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"inertia": -1.0}, "'inertia' must be finite and > 0: -1.0"),
        ({"frction": {}}, "unknown key frction"),
        ({"friction": None}, "expected a mapping"),
        ({"gains": {"p": 1.0}}, "unknown key p"),
        ({"velocity": "fast"}, "could not convert string to float"),
    ],
)
def test_bad_joint_files_are_refused(tmp_path: Path, change: dict[str, object], message: str) -> None:
    """Issue 2: what is wrong in a joint file is named, with the file."""
    content = yaml.safe_load((ROOT / "config" / "joints" / "puma560_joint1.yaml").read_text())
    path = tmp_path / "joint.yaml"
    path.write_text(yaml.safe_dump({**content, **change}))
    with pytest.raises(JointFileError, match=re.escape(message)):
        load_joint(str(path))
    with pytest.raises(JointFileError, match="no such file"):
        load_joint(str(tmp_path / "other.yaml"))


@pytest.mark.parametrize("path", sorted((ROOT / "config" / "joints").glob("*.yaml")), ids=lambda path: path.stem)
def test_known_joints_name_their_sources(path: Path) -> None:
    """Issue 8: every joint file names its source; what has none is among the assumed."""
    text = path.read_text(encoding="utf-8")
    assert re.search(r"^# Source: .{40,}", text, re.MULTILINE)
    content = yaml.safe_load(text)
    values = {**content, **content["friction"]}
    assert set(content["assumed"]) <= set(values)
    without = {line.split(":")[0].strip() for line in text.splitlines() if "no source" in line and ":" in line}
    assert without <= set(content["assumed"])


def test_the_forms_for_contributors_are_sound() -> None:
    """Issue 8: pre-commit takes its configuration; every issue form says what it is, and what it asks for."""
    command = [sys.executable, "-m", "pre_commit", "validate-config", ROOT / ".pre-commit-config.yaml"]
    subprocess.run(command, check=True, timeout=LIMIT)
    forms = [path for path in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml") if path.stem != "config"]
    assert len(forms) >= 3
    for path in forms:
        form = yaml.safe_load(path.read_text(encoding="utf-8"))
        assert {"name", "description", "body"} <= set(form)
        assert len({part["id"] for part in form["body"]}) == len(form["body"])
