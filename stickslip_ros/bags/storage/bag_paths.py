# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What is a bag: decided here for every command and node."""

from __future__ import annotations

from pathlib import Path

from stickslip_ros.bags.lerobot import episode_of, files_of_episode
from stickslip_ros.bags.storage.formats import SUFFIXES

METADATA = "metadata.yaml"


def is_bag_file(path: Path) -> bool:
    """Whether a file is named as one of rosbag2's."""
    return path.name.endswith(SUFFIXES)


def is_bag_folder(folder: Path) -> bool:
    """Whether a folder is one bag: it has metadata, or its files are named as those of one are.

    Raises
    ------
    OSError
        If it cannot be read.
    """
    if (folder / METADATA).exists():
        return True
    files = [file.name for file in folder.iterdir() if is_bag_file(file)]
    return bool(files) and all(name.startswith(f"{folder.resolve().name}_") for name in files)


def is_read_as_bag(path: Path) -> bool:
    """Whether the one recording that a path names is a bag, not a table: any folder is, however its files are named."""
    return path.is_dir() or is_bag_file(path) or episode_of(path) is not None


def files_of(path: Path) -> list[Path]:
    """The files that a bag, a folder of one, or an episode is read from.

    Raises
    ------
    OSError, ValueError
        If they cannot be found.
    """
    if episode_of(path) is not None:
        return files_of_episode(path)
    return sorted(path.iterdir()) if path.is_dir() else [path]
