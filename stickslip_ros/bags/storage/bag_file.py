# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A file of a bag, as a stream or as a plain file, whether it is compressed as a whole or not."""

from __future__ import annotations

import fcntl
import io
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from stickslip_ros.bags.storage.unpacking import Allowance, UnpackLimit, zstd_library
from stickslip_ros.files import in_nobodys_use
from stickslip_ros.regular_files import open_regular

_ZSTD = b"\x28\xb5\x2f\xfd"
_LONGEST_BEGIN = 16
_AT_ONCE = 1 << 20
_PREFIX = "stickslip_unpacked_"


class BagFile:
    """See the module.

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
