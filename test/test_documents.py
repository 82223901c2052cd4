# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""README and docs: every command is run, every file example is read, every link leads somewhere.

Commands that need nothing of a shell run in this process, one after another, which loads what they share once.

A comment before a block of code says what is special about it:

    <!-- test: background -->      runs until the document ends
    <!-- test: status 1 -->        ends with this exit status
    <!-- test: shows TEXT -->      prints this text
    <!-- test: check, WHY -->      cannot be run here: options, launch arguments and names are checked
    <!-- test: skip, WHY -->       is run elsewhere, as the comment says
    <!-- test: file NAME -->       is a file that later commands use
    <!-- test: monitor NAME -->    is a parameter file of the monitor
    <!-- test: launch -->          is a launch file
"""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import LIMIT, ROOT, nightly

from stickslip_ros.cli.main import build_parser, main
from stickslip_ros.parent_death import die_with_parent
from stickslip_ros.settings.parameter_table import COMMON, OF_THE_NODE, PER_JOINT

pytestmark = pytest.mark.slow

FOLDERS = ("docs", "config", "examples")
# They take half of the time of all documents; by day their commands are read, not run.
AT_NIGHT = (
    "docs/tutorial_without_ros2.md", "docs/recordings.md", "docs/how_to/analyse_a_fleet.md",
    "docs/how_to/it_sticks_when_it_turns.md", "docs/how_to/record_a_good_bag.md",
)  # fmt: skip
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(path for name in FOLDERS for path in (ROOT / name).rglob("*.md"))])
BLOCK = re.compile(
    r"^(?P<indent> *)(?:<!-- test: (?P<how>.+?) -->\n\s*)?```(?P<language>\w+)\n(?P<code>.*?)\n *```$",
    re.MULTILINE | re.DOTALL,
)
LINK = re.compile(r"!?\[[^\]]*\]\((?P<target>[^)\s]+)\)")
HIDDEN = re.compile(r"^ {4,}(?:stickslip|ros2|make|pip|\.venv/bin/\w+) .*$", re.MULTILINE)
LOOP = re.compile(r"^for (\w+) in ([^;$*]+); do\n(.*?)\ndone$", re.MULTILINE | re.DOTALL)
OF_A_SHELL = re.compile(r"[|&;<>$`*?]")
INLINE = re.compile(r"(?<!`)`((?:stickslip|python|make|pytest) [^`]+)`(?!`)")


_LOOKS = 3


@dataclass(frozen=True)
class Block:
    language: str
    code: str
    how: str


def blocks(path: Path) -> list[Block]:
    """The blocks of code of a document, in order."""
    found = []
    for match in BLOCK.finditer(path.read_text(encoding="utf-8")):
        indent = len(match["indent"])
        code = "\n".join(line[indent:] for line in match["code"].splitlines())
        found.append(Block(match["language"], code, match["how"] or ""))
    return found


def named(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.fixture
def environment(tmp_path: Path, ros_domain: int) -> dict[str, str]:
    """What a user's shell would have: the package's commands and `ros2` on the PATH."""
    tools = tmp_path / "bin"
    tools.mkdir()
    stand_in = tools / "ros2"
    stand_in.write_text(f'#!/bin/sh\nexec {sys.executable} {ROOT}/test/ros2_stand_in.py "$@"\n')
    stand_in.chmod(0o755)
    path = f"{tools}:{Path(sys.executable).parent}:{os.environ['PATH']}"
    return {**os.environ, "PATH": path, "COLUMNS": "120"}


@pytest.mark.parametrize("name", AT_NIGHT)
def test_commands_of_the_night_are_understood(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, environment: dict[str, str]
) -> None:
    """Issue 35: a command of a document that is run at night alone has options that exist."""
    monkeypatch.chdir(tmp_path)
    code = "\n".join(block.code for block in blocks(ROOT / name) if block.language == "sh")
    for folder in " ".join(re.findall(r"^mkdir -p (.*)", code, re.MULTILINE)).split():
        Path(folder).mkdir(parents=True)
    commands = re.findall(r"^stickslip (?:.*\\\n)*.*$", code, re.MULTILINE)
    assert commands
    check_commands("\n".join(commands), environment)


@contextmanager
def background(code: str, folder: Path, environment: dict[str, str]) -> Iterator[None]:
    """A command that runs meanwhile, and must end well on Ctrl-C."""
    with (folder / "background.log").open("w+") as log:
        process = subprocess.Popen(
            ["bash", "-c", f"exec {code}"], cwd=folder, env=environment, stdout=log, stderr=log,
            start_new_session=True, preexec_fn=die_with_parent,
        )  # fmt: skip
        try:
            yield
            assert process.poll() is None, (folder / "background.log").read_text()
            process.send_signal(signal.SIGINT)
            assert process.wait(LIMIT) == 0, (folder / "background.log").read_text()
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)


@pytest.mark.parametrize(
    "path", [nightly(path) if named(path) in AT_NIGHT else path for path in DOCUMENTS if blocks(path)], ids=named
)
def test_examples(path: Path, tmp_path: Path, environment: dict[str, str]) -> None:
    """Issue 8: every command and example of a document works, in the order in which it stands there."""
    folder = tmp_path / "work"
    folder.mkdir()
    with ExitStack() as stack:
        for block in blocks(path):
            how, _, rest = block.how.partition(" ")
            if how in ("file", "monitor"):
                (folder / rest).write_text(block.code)
            if block.language == "sh":
                if how == "background":
                    stack.enter_context(background(block.code, folder, environment))
                elif how == "check,":
                    check_commands(block.code, environment)
                elif how != "skip,":
                    shown = run(block.code, folder, environment, int(rest) if how == "status" else 0)
                    # A reader looks again where the machine is slow.
                    for _ in range(_LOOKS if how == "shows" else 0):
                        if rest not in shown:
                            shown = run(block.code, folder, environment, 0)
                    assert how != "shows" or rest in shown, shown
            elif block.language == "python" and how == "launch":
                (folder / "own.launch.py").write_text(block.code)
                run_in_shell(f"{sys.executable} -c {shlex.quote(LAUNCH_CHECK)} own.launch.py", folder, environment, 0)
            elif block.language == "python":
                run_in_shell(f"{sys.executable} -c {shlex.quote(block.code)}", folder, environment, 0)
            elif block.language == "yaml":
                content = yaml.safe_load(block.code)
                if how == "monitor":
                    check_monitor_parameters(content["/**"]["ros__parameters"])


def run(code: str, folder: Path, environment: dict[str, str], status: int) -> str:
    """Run commands as a shell would that stops at the first that fails; returns what they print."""
    # A loop runs here as well, as the commands that it stands for.
    code = LOOP.sub(lambda loop: "\n".join(loop[3].replace(f"${loop[1]}", word) for word in loop[2].split()), code)
    if not OF_A_SHELL.search(re.sub(r"'[^']*'|#.*", "", code)):
        lines = [shlex.split(line, comments=True) for line in code.replace("\\\n", " ").splitlines()]
        if all(map(runs_here, lines)):
            return run_here(lines, folder, status)
    return run_in_shell(code, folder, environment, status)


def run_in_shell(code: str, folder: Path, environment: dict[str, str], status: int) -> str:
    """Run commands each of which is a process."""
    command = ["bash", "-e", "-c", code]
    done = subprocess.run(
        command, cwd=folder, env=environment, timeout=400, check=False, capture_output=True, text=True
    )  # fmt: skip
    assert done.returncode == status, f"{code}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def runs_here(words: list[str]) -> bool:
    """Whether it needs no process of its own: `watch` and `demo` take signals, `launch` and `run` start nodes."""
    own = {"stickslip": ("watch", "demo"), "ros2": ("launch", "run")}
    return words[0] == "mkdir" or (words[0] in own and words[1] not in own[words[0]])


def run_here(lines: list[list[str]], folder: Path, status: int) -> str:
    """Run commands of the package in this process, in a folder; returns what they print."""
    import ros2_stand_in

    programs = {"stickslip": main, "ros2": ros2_stand_in.main}
    shown, said = StringIO(), StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(shown), redirect_stderr(said):
        patch.chdir(folder)
        patch.setenv("COLUMNS", "120")
        found = [programs[name](rest) if name in programs else subprocess.call([name, *rest]) for name, *rest in lines]
    assert found == [*[0] * (len(lines) - 1), status], f"{lines}\n{shown.getvalue()}\n{said.getvalue()}"
    return shown.getvalue()


LAUNCH_CHECK = f"""
import sys
sys.path.insert(0, {str(ROOT / "test")!r})
from pathlib import Path
from ros2_stand_in import described, stand_in
stand_in()
nodes, _ = described(Path(sys.argv[1]), {{}})
assert [node.executable for node in nodes] == ["monitor"], nodes
"""


def check_commands(code: str, environment: dict[str, str]) -> None:
    """What can be said of commands without running them."""
    for line in code.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if words[:1] == ["stickslip"]:
            build_parser().parse_args(words[1:])
        elif words[:2] == ["ros2", "launch"]:
            done = subprocess.run(
                words,
                env={**environment, "CHECK_ONLY": "1"},
                timeout=LIMIT,
                check=False,
                capture_output=True,
                text=True,
            )
            assert done.returncode == 0, done.stderr
        elif words[:3] == ["ros2", "run", "stickslip_ros"]:
            assert Path(sys.executable).with_name(words[3]).exists(), line
        else:
            assert words[0] in ("ros2", "sudo"), line
            assert words[1] in ("apt", "bag", "param", "run", "service", "topic"), line


def check_monitor_parameters(parameters: dict[str, Any]) -> None:
    """Every parameter is one that the monitor has."""
    known = {spec.name for spec in (*OF_THE_NODE, *COMMON)}
    known |= {spec.name.format(joint=joint) for spec in PER_JOINT for joint in parameters["joints"]}
    unknown = set(flat(parameters)) - known
    assert not unknown, unknown


def flat(content: dict[str, Any], prefix: str = "") -> Iterator[str]:
    """Names as ROS has them, joined by dots."""
    for key, value in content.items():
        if isinstance(value, dict):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key


@pytest.mark.parametrize("path", DOCUMENTS, ids=named)
def test_links(path: Path) -> None:
    """Issue 8: links within the project lead to files, and to headings that exist; others are https."""
    text = path.read_text(encoding="utf-8")
    for target in (match["target"] for match in LINK.finditer(text)):
        if "://" in target:
            assert target.startswith("https://"), target
            continue
        name, _, anchor = target.partition("#")
        linked = (path.parent / name).resolve() if name else path
        assert linked.exists(), f"{named(path)}: {target}"
        assert ROOT in linked.parents, f"{named(path)}: {target} is outside"
        if anchor:
            headings = re.findall(r"^#+ (.+)$", linked.read_text(encoding="utf-8"), re.MULTILINE)
            slugs = {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
            assert anchor in slugs, f"{named(path)}: {target}"


@pytest.mark.parametrize("path", DOCUMENTS, ids=named)
def test_inline_commands(path: Path) -> None:
    """Issue 8: a command in the text names a command, module, file or target that exists."""
    for command in INLINE.findall(re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)):
        words = command.split()
        if words[0] == "stickslip":
            names = set(build_parser()._subparsers._group_actions[0].choices)
            assert words[1].rstrip(",") in {*names, "…"}, command
        elif words[:2] == ["python", "-m"]:
            spec = importlib.util.find_spec(words[2])
            assert spec is not None and spec.origin is not None, command  # noqa: PT018
            assert "__main__" in Path(spec.origin).read_text(encoding="utf-8"), command
        elif words[0] == "make":
            assert re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE), command
        else:
            files = [word for word in words[1:] if "/" in word]
            assert all((ROOT / word).exists() for word in files), command


@pytest.mark.parametrize("path", DOCUMENTS, ids=named)
def test_named_files_exist(path: Path) -> None:
    """Issue 8: source files that a document names are there, in the package or beside it."""
    for name in re.findall(r"`([\w/]+/[\w.]+\.(?:py|yaml|md|xml))`", path.read_text(encoding="utf-8")):
        assert (ROOT / name).exists() or (ROOT / "stickslip_ros" / name).exists(), name


NAMING_TESTS = [*DOCUMENTS, ROOT / "Makefile", *sorted((ROOT / "tools").glob("*.sh"))]


@pytest.mark.parametrize("path", NAMING_TESTS, ids=named)
def test_tests_that_are_named_exist(path: Path) -> None:
    """A test that a script or a page names is there; `make matrix` once ran none, for one of them had a new name."""
    for file, test in re.findall(r"\b(test/[\w/]+\.py)(?:::(\w+))?", path.read_text(encoding="utf-8")):
        assert (ROOT / file).exists(), file
        assert not test or f"def {test}(" in (ROOT / file).read_text(encoding="utf-8"), f"{file}::{test}"


@pytest.mark.parametrize("floor", ["model", "monitoring"])
def test_the_reference_has_every_public_module(floor: str) -> None:
    """Issue 8: the API reference is complete for model and monitoring."""
    named_there = re.findall(r"automodule:: (\S+)", (ROOT / "docs" / "api" / f"{floor}.md").read_text(encoding="utf-8"))
    files = (path.relative_to(ROOT).with_suffix("") for path in (ROOT / "stickslip_ros" / floor).rglob("[!_]*.py"))
    assert sorted(named_there) == sorted(".".join(path.parts) for path in files)


@pytest.mark.parametrize("path", DOCUMENTS, ids=named)
def test_commands_stand_in_blocks_that_are_run(path: Path) -> None:
    """Issue 8: no command hides in an indented block, which no test would see."""
    hidden = re.findall(
        r"^ {4,}(?:stickslip|ros2|make|pip|\.venv/bin/\w+) .*$", path.read_text(encoding="utf-8"), re.MULTILINE
    )
    inside = "\n".join(block.code for block in blocks(path))
    loose = [line.strip() for line in hidden if line.strip() not in inside]
    assert not loose
