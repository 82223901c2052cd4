# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Build of the package, by ament_python (colcon) or by pip."""

import sys
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "stickslip_ros"
SHARE = Path("share") / PACKAGE
# colcon and bloom put executables into lib/, which is not on PATH; pip makes bin/stickslip by itself, into its wheel.
BY_PIP = any("wheel" in argument for argument in sys.argv)

# ROS 2 from wheels, for machines without ROS: Jazzy, and Kilted for the matrix.
ROS_WHEELS = ["ros-jazzy-rclpy[fastrtps]==7.1.6", "ros-jazzy-common-interfaces==5.3.6"]
KILTED_WHEELS = ["ros-kilted-rclpy[fastrtps]==9.1.2", "ros-kilted-common-interfaces==5.5.1"]
DASK = ["dask", "distributed"]
DOCS = ["furo", "latex2mathml", "myst-parser", "sphinx"]
TEST = [
    *DASK,
    *DOCS,
    "catkin-pkg",
    "colcon-common-extensions",
    "colcon-ros",
    "hypothesis",
    "interrogate",
    "mcap-ros2-support",
    "mypy==2.4.1",
    "pre-commit",
    "psutil",
    "pytest",
    "pytest-xdist",
    "ruff==0.17.5",
    "selenium",
    "types-PyYAML",
]


def shared(folder: str) -> list[tuple[str, list[str]]]:
    """Data files of a folder and the folders in it, installed under share/."""
    files: dict[str, list[str]] = {}
    for path in sorted(Path(folder).rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            files.setdefault(str(SHARE / path.parent), []).append(str(path))
    return sorted(files.items())


setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "analysis/report/static/*", "analysis/report/templates/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (str(SHARE), ["package.xml"]),
        *([] if BY_PIP else [("bin", ["bin/stickslip"])]),
        *shared("config"),
        *shared("launch"),
        *shared("policies"),
        *shared("examples"),
    ],
    python_requires=">=3.10",
    install_requires=[
        "bokeh",
        "contourpy",
        "jinja2",
        "lz4",
        "matplotlib",
        "mcap",
        "numba",
        "numpy",
        "pyarrow",
        "pyyaml",
        "rich",
        "rosbags",
        "scipy",
        "setuptools",
        "zstandard",
    ],
    extras_require={"ros": ROS_WHEELS, "kilted": KILTED_WHEELS, "dask": DASK, "docs": DOCS, "test": TEST},
    zip_safe=False,
    maintainer="The stickslip_ros developers",
    maintainer_email="stickslip-ros@example.org",
    description="Online stick-slip monitoring of robot joints: detection, margin, gains that cure it",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "monitor = stickslip_ros.nodes.__main__:monitor",
            "replay = stickslip_ros.nodes.__main__:replay",
            "simulated_joint = stickslip_ros.nodes.__main__:simulated_joint",
            "stickslip = stickslip_ros.cli.main:main",
        ],
    },
)
