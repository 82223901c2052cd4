# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the tests share: the paper's joint, the real recordings, a ROS domain of one's own."""

from __future__ import annotations

import ast
import functools
import gc
import importlib.util
import itertools
import os
import signal
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from slider import slider

from stickslip_ros.bags.table import load_recording
from stickslip_ros.cli.processes import free_domains
from stickslip_ros.model.friction import Joint
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.output import stability_map
from stickslip_ros.parent_death import die_with_parent
from stickslip_ros.settings.known_joints import load_joint

ROOT = Path(__file__).resolve().parents[1]
LIMIT = 120.0  # [s]: no claim, as what a test waits for comes; a slow machine compiles first, and runs other tests
RECORDINGS = Path(os.environ.get("STICKSLIP_RECORDINGS", ROOT.parent / "shared" / "data"))

# A suite that a script starts in the background has Ctrl-C ignored, and so would the commands that tests interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples every time; others are found with: pytest --hypothesis-profile=default --hypothesis-seed=N
_BY_DAY = 30
for _profile, _examples in (("fixed", _BY_DAY), ("nightly", 100)):
    settings.register_profile(_profile, max_examples=_examples, derandomize=True, database=None, deadline=None)
settings.load_profile("fixed")

# physics.md, section 4, joint 1: k_p/M [1/s²], ξ˙_d, damping ratio at which the cycle dies.
EXACT_CRITICAL_DAMPING = [
    (100, 0.2, 0.6675),
    (100, 1.5, 0.4008),
    (200, 0.5, 0.5621),
    (320, 0.85, 0.1628),
    (500, 0.2, 0.1602),
    (500, 0.85, 0.0416),
]

# Packages that have no rosdep key, or that only tests need: a ROS machine has none of them, and `colcon test` runs what
# can be run without.
OPTIONAL = ("bokeh", "catkin_pkg", "dask", "distributed", "lz4", "mcap", "mcap_ros2", "pyarrow", "rosbags", "selenium")

# Of the tests that run side by side (make test), each takes every WORKERS-th domain, and so never another's.
WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_tests = itertools.count(os.getpid() * 13)
_LONG = ("nodes", "test_documents", "test_warm_up", "test_demo", "test_identify_experiment", "test_fleet.py")
DOMAINS = {"ros_domain", "ros_domain_of_the_file"}  # fixtures of what starts processes
_SLOW_FILE = "\npytestmark = pytest.mark.slow\n"
_OF_A_REPORT, _FEW = 900, 64  # points of a map, 1
_BEGUN_BY = 0.6  # share of the other files after which they have begun


def imported(path: Path) -> set[str]:
    """Names of the packages that a test imports when it is loaded, by itself or through modules beside it."""
    found: set[str] = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        for name in names:
            beside = (path.parent / f"{name}.py", ROOT / "test" / f"{name.replace('.', '/')}.py")
            helper = next((one for one in beside if one.exists() and one != path), None)
            found |= {name.partition(".")[0]} if helper is None else imported(helper)
    return found


class _Lacking(pytest.Module):
    """A file of tests that needs what is not installed."""

    def collect(self) -> list[pytest.Item]:
        pytest.skip(f"{self.path.name} needs {', '.join(lacking(self.path))}", allow_module_level=True)


def lacking(path: Path) -> list[str]:
    """Optional packages that a test needs and this machine has not."""
    missing = _missing()
    return sorted(imported(path) & missing) if missing else []


@functools.cache
def _missing() -> set[str]:
    return {name for name in OPTIONAL if importlib.util.find_spec(name) is None}


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Module | None:
    """Skip files whose optional packages are missing, instead of ending the whole run with an error."""
    return _Lacking.from_parent(parent, path=module_path) if lacking(module_path) else None


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of `make quick` and `make nightly`."""
    parser.addoption("--quick", action="store_true", help="leave out what starts processes, and what is marked slow")
    parser.addoption("--nightly", action="store_true", help="also run what is marked nightly")


def pytest_configure(config: pytest.Config) -> None:
    """Draw more examples at night."""
    if config.getoption("--nightly"):
        settings.load_profile("nightly")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Do not even import what is slow as a whole, where that is left out."""
    slow = config.getoption("--quick") and collection_path.suffix == ".py"
    return True if slow and _SLOW_FILE in collection_path.read_text(encoding="utf-8") else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what takes long, where that is asked for; put files that wait for processes among those that compute.

    None of the first are left for the end, when others have no more to do.
    """
    files = list(dict.fromkeys(item.path for item in items))
    waiting = [path for path in files[::-1] if any(one in path.parts or one in path.name for one in _LONG)]
    computing = [path for path in files if path not in waiting]
    place = {path: _BEGUN_BY * index / len(waiting) for index, path in enumerate(waiting)}
    place |= {path: index / len(computing) for index, path in enumerate(computing)}
    items.sort(key=lambda item: place[item.path])
    if not config.getoption("--nightly"):
        items[:] = [item for item in items if item.get_closest_marker("nightly") is None]
    if config.getoption("--quick"):
        items[:] = [item for item in items if not DOMAINS & set(item.fixturenames) and not _is_slow(item)]  # type: ignore[attr-defined]


def pytest_collection_finish() -> None:
    """Let the garbage collector pass over what thousands of tests and all modules are made of, which stays."""
    gc.collect()
    gc.freeze()


def nightly(*values: object) -> Any:
    """Arguments of a parametrised test that `make nightly` runs: more seeds, more cases of a claim."""
    return pytest.param(*values, marks=pytest.mark.nightly)


def examples(by_day: int, at_night: int) -> settings:
    """How many examples hypothesis draws, a decorator: where one takes long, more of them by `make nightly`."""
    return settings(max_examples=at_night if settings.default.max_examples > _BY_DAY else by_day)


def _is_slow(item: pytest.Item) -> bool:
    return item.get_closest_marker("slow") is not None


@pytest.fixture
def puma() -> Joint:
    """The paper's robot, joint 1."""
    return load_joint("puma560_joint1").joint


@pytest.fixture(autouse=True)
def coarse_maps_in_reports(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Most of a report's time is its maps. Those of test_report.py are as users have them; others have few points."""
    if request.path.name != "test_report.py":
        axes = functools.partial(_coarse_axes, stability_map.map_axes)
        monkeypatch.setattr(stability_map, "map_axes", axes)


def _coarse_axes(axes: Callable[..., Any], *arguments: Any, points: int, **more: Any) -> Any:
    return axes(*arguments, points=_FEW if points == _OF_A_REPORT else points, **more)


@contextmanager
def own_domain(home: Path) -> Iterator[int]:
    """A ROS domain and a ROS_HOME of one's own, on this machine only."""
    # Others on this machine may run tests or a demo too; a domain is not taken again while the last test's may end.
    free = [domain for domain in free_domains() if domain % WORKERS == WORKER]
    domain = free[next(_tests) % len(free)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_HOME", str(home))
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        yield domain


@pytest.fixture
def ros_domain(tmp_path: Path) -> Iterator[int]:
    """Of this test alone."""
    with own_domain(tmp_path / "ros_home") as domain:
        yield domain


@pytest.fixture(scope="module")
def ros_domain_of_the_file(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Of the tests of a file that share nodes: each process costs a second or two of a core before it does anything."""
    with own_domain(tmp_path_factory.mktemp("ros_home")) as domain:
        yield domain


@pytest.fixture
def without_shared_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """For a test that kills a node: Fast DDS may then never again reach a node that takes the dead one's place.

    Who begins anew removes the dead one's segment, to which others go on writing (Fast DDS issue 5053; 2.14.5).
    """
    monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")


@contextmanager
def begun(command: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """A process that ends with the block and with this process, however they end: a failed test waits for nothing."""
    with subprocess.Popen(command, **{"preexec_fn": die_with_parent, **options}) as process:
        try:
            yield process
        finally:
            process.kill()


def recording(name: str) -> Batch:
    """A real recording; the test is skipped where the recordings are not at hand."""
    files = [path for path in RECORDINGS.glob(f"{name}*") if path.suffix in (".csv", ".npz")]
    if not files:
        pytest.skip(f"recording {name} is not in {RECORDINGS} (set STICKSLIP_RECORDINGS)")
    if files[0].stem.startswith("enslyon_slider"):
        return slider(files[0])
    if files[0].suffix == ".csv":
        pytest.importorskip("pyarrow")
    return load_recording(files[0]).batch
