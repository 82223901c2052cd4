# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What a bag is, for every command and node: formats of bag files (a line each: suffix, first bytes, reader), folders,
episodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from stickslip_ros.bags.lerobot import episode_of, files_of_episode
from stickslip_ros.bags.storage.bag_file import BagFile
from stickslip_ros.messages.joint_states import Storage, Warn

METADATA = "metadata.yaml"
_PACKED = ".zstd"  # on top of a format's own suffix


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes
    ----------
    called : for people. suffix, begins_with : of its files.
    storage : module beside this one, and the class in it that reads a
        :class:`~stickslip_ros.bags.storage.bag_file.BagFile`; loaded with the first file, for what it needs may be
        missing where nobody reads one.
    """

    called: str
    suffix: str
    begins_with: bytes
    storage: tuple[str, str]

    def open(self, file: BagFile, warn: Warn) -> Storage:
        """The messages of a file."""
        module, name = self.storage
        opened: Storage = getattr(import_module(f"{__package__}.{module}"), name)(file, warn)
        return opened


FORMATS = (
    Format("an MCAP file", ".mcap", b"\x89MCAP", ("mcap", "McapStorage")),
    Format("a rosbag2 database", ".db3", b"SQLite format 3\0", ("sqlite", "SqliteStorage")),
    Format("a bag of ROS 1", ".bag", b"#ROSBAG V", ("ros1", "Ros1Storage")),
)
SUFFIXES = tuple(one.suffix + packed for one in FORMATS for packed in ("", _PACKED))


def format_of(file: BagFile) -> Format:
    """The format of a file, by how it begins, whatever its name.

    Raises
    ------
    ValueError
        If it is empty, or of none.
    OSError
        If it cannot be read.
    """
    if not file.begin:
        raise ValueError("the file is empty")
    if file.packed:
        # Only the name tells what is inside; the first format is what rosbag2 writes.
        return next((one for one in FORMATS if one.suffix in Path(file.name).suffixes), FORMATS[0])
    found = next((one for one in FORMATS if file.begin.startswith(one.begins_with)), None)
    if found is None:
        raise ValueError(f"neither {' nor '.join(one.called for one in FORMATS)}")
    return found


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
