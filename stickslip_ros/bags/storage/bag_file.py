# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A file of a bag, as a stream or as a plain file, whether it is compressed as a whole or not."""

from __future__ import annotations

import io
import shutil
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

_ZSTD = b"\x28\xb5\x2f\xfd"
_LONGEST_BEGIN = 16


class BagFile:
    """See the module.

    Parameters
    ----------
    path : of the file. stack : closed when the bag is; what is unpacked is gone by then.
    """

    def __init__(self, path: Path, stack: ExitStack) -> None:
        self.path, self._stack = path, stack
        with path.open("rb") as stream:
            self._begin = stream.read(_LONGEST_BEGIN)

    @property
    def name(self) -> str:
        """For warnings."""
        return self.path.name

    @property
    def size(self) -> int:
        """As it lies there [bytes]."""
        return self.path.stat().st_size

    @property
    def packed(self) -> bool:
        """Whether the whole of it is compressed: it can be read from the start alone."""
        return self._begin.startswith(_ZSTD)

    def begin(self) -> bytes:
        """Its first bytes, as they lie there."""
        return self._begin

    def open(self) -> IO[bytes]:
        """What is in it, from the start."""
        return io.BufferedReader(_ZstdStream(self.path), 1 << 20) if self.packed else self.path.open("rb")

    def named(self, suffix: str) -> Path:
        """A plain file of what is in it, whose name ends so: some libraries go by the name."""
        if not self.packed and self.path.suffix == suffix:
            return self.path
        folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="stickslip_")))
        target = folder / f"bag{suffix}"
        if self.packed:
            with self.open() as stream, target.open("wb") as out:
                shutil.copyfileobj(stream, out)
        else:
            target.symlink_to(self.path.resolve())
        return target


class _ZstdStream(io.RawIOBase):
    """A compressed file as a stream; damage is an OSError."""

    def __init__(self, path: Path) -> None:
        import zstandard

        super().__init__()
        self._damage = zstandard.ZstdError
        self._reader = zstandard.ZstdDecompressor().stream_reader(path.open("rb"), read_across_frames=True)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        try:
            return int(self._reader.readinto(buffer))
        except self._damage as error:
            raise OSError(f"its compression is damaged: {error}") from error

    def close(self) -> None:
        if not self.closed:
            self._reader.close()  # type: ignore[no-untyped-call]
        super().close()
