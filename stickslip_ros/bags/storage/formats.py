# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What a bag is, for every command and node: formats of bag files (a line each: suffix, first bytes, reader), folders,
episodes; and a file of one, as a stream or as a plain file, whether it is compressed as a whole or not.
"""

from __future__ import annotations

import fcntl
import io
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import IO, Any

from stickslip_ros.bags.lerobot import episode_of, files_of_episode
from stickslip_ros.bags.storage.unpacking import Allowance, UnpackLimit, zstd_library
from stickslip_ros.files import in_nobodys_use
from stickslip_ros.messages.joint_states import Storage, Warn
from stickslip_ros.regular_files import open_regular

METADATA = "metadata.yaml"
_ZSTD = b"\x28\xb5\x2f\xfd"
_LONGEST_BEGIN = 16
_AT_ONCE = 1 << 20
_PREFIX = "stickslip_unpacked_"
_PACKED = ".zstd"  # on top of a format's own suffix


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes
    ----------
    called : for people. suffix, begins_with : of its files.
    storage : module beside this one, and the class in it that reads a
        :class:`BagFile`; loaded with the first file, for what it needs may be
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


class BagFile:
    """A file of a bag, as a stream or as a plain file, whether it is compressed as a whole or not.

    Parameters
    ----------
    path : of the file. stack : closed when the bag is; what is unpacked is gone by then.
    limit : of what is unpacked.

    Attributes
    ----------
    name : for warnings. begin : its first bytes, as they lie there.

    Raises
    ------
    OSError
        If it is no regular file, or cannot be read.
    """

    def __init__(self, path: Path, stack: ExitStack, limit: UnpackLimit) -> None:
        self.path, self.name, self._stack = path, path.name, stack
        with open_regular(path) as stream:
            self.begin = stream.read(_LONGEST_BEGIN)
        self.allowance = Allowance(limit, self.size)

    @property
    def size(self) -> int:
        """As it lies there [bytes]."""
        return self.path.stat().st_size

    @property
    def packed(self) -> bool:
        """Whether the whole of it is compressed: it can be read from the start alone."""
        return self.begin.startswith(_ZSTD)

    def at_close(self, callback: Callable[[], object]) -> None:
        """Have something called when the bag is closed."""
        self._stack.callback(callback)

    def open(self) -> IO[bytes]:
        """What is in it, from the start; what is unpacked of it counts anew."""
        self.allowance.restart()
        if not self.packed:
            return open_regular(self.path)
        return io.BufferedReader(_ZstdStream(open_regular(self.path), self.allowance), _AT_ONCE)

    def plain(self) -> Path:
        """A plain file of what is in it: itself, or one that is unpacked until the bag is closed.

        Raises
        ------
        OSError
            If it is damaged, becomes too large, or there is no room for it.
        """
        if not self.packed:
            return self.path
        folder = self._stack.enter_context(_own_folder())
        target = folder / "bag"
        # Half of what is free stays for others.
        room = shutil.disk_usage(folder).free // 2
        with self.open() as stream, target.open("wb") as out:
            while piece := stream.read(_AT_ONCE):
                room -= len(piece)
                if room < 0:
                    raise OSError(f"unpacked, it would take more than half of the room in {folder.parent} (TMPDIR)")
                out.write(piece)
        return target


class _ZstdStream(io.RawIOBase):
    """A compressed file as a stream; damage and too much of it are OSErrors."""

    def __init__(self, file: IO[bytes], allowance: Allowance) -> None:
        zstandard = zstd_library()
        super().__init__()
        self._damage, self._allowance = zstandard.ZstdError, allowance
        self._reader = zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        try:
            count = int(self._reader.readinto(buffer))
            self._allowance.spend(count)
        except self._damage as error:
            raise OSError(f"its compression is damaged: {error}") from error
        except ValueError as error:
            raise OSError(str(error)) from error
        return count

    def close(self) -> None:
        if not self.closed:
            self._reader.close()
        super().close()


@contextmanager
def _own_folder() -> Iterator[Path]:
    """A folder of one's own, which is removed with all that is in it when the context ends.

    Raises
    ------
    OSError
        If there is no room for it.
    """
    _remove_abandoned(Path(tempfile.gettempdir()))
    with tempfile.TemporaryDirectory(prefix=_PREFIX, ignore_cleanup_errors=True) as name:
        handle = os.open(name, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            # The lock goes with the process, however it ends: so others know that the folder is in use.
            fcntl.flock(handle, fcntl.LOCK_EX)
            yield Path(name)
        finally:
            os.close(handle)


def _remove_abandoned(parent: Path) -> None:
    """Remove such folders of this user whose processes are gone."""
    for folder in parent.glob(f"{_PREFIX}*"):
        # One that is empty may be about to be locked; who locks it waits as long as it is held here.
        with suppress(OSError), in_nobodys_use(folder):
            if any(folder.iterdir()):
                shutil.rmtree(folder, ignore_errors=True)
