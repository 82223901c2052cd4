# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Decompression with bounds: a few bytes can stand for more than any memory or disk holds.

What is unpacked at once, a chunk or a message, is at most :attr:`UnpackLimit.at_once`; what is unpacked of one file
in all is that, or a thousand times its size. Recordings of joints that stand still shrink to a sixtieth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from stickslip_ros.model._validation import require_positive

_MEGABYTE = 1_000_000
_TIMES = 1000
_TIMES_IN_A_TABLE = 20
OPTION = "--largest-unpacked"


@dataclass(frozen=True, kw_only=True)
class UnpackLimit:
    """How much compressed data may become.

    Attributes
    ----------
    largest_unpacked : a chunk or a message [MB]; a whole file may become that, or a thousand times its size.

    Raises
    ------
    InvalidParameterError
        If it is not positive and finite.
    """

    largest_unpacked: float = 64.0

    def __post_init__(self) -> None:
        require_positive("largest_unpacked", self.largest_unpacked)

    @property
    def at_once(self) -> int:
        """Of a chunk or a message [bytes]."""
        return int(self.largest_unpacked * _MEGABYTE)

    def of_table(self, size: int) -> int:
        """Of a table of so many bytes, which is in memory as a whole [bytes]."""
        return max(self.at_once, _TIMES_IN_A_TABLE * size)

    def of_file(self, size: int) -> int:
        """Of a file of so many bytes in all [bytes]."""
        return max(self.at_once, _TIMES * size)


class TooMuchUnpackedError(ValueError):
    """Compressed data that would become more than they may; the text names the bound and the option that raises it."""

    def __init__(self, what: str, largest: int) -> None:
        super().__init__(f"{what} unpacks to more than {largest / _MEGABYTE:.4g} MB; {OPTION} MB allows more")


def zstd_library() -> Any:
    """The package zstandard; where it is missing the same by the library of the system, as zstandard has no rosdep key.

    Raises
    ------
    ImportError
        If the library is missing too.
    """
    try:
        import zstandard
    except ImportError:
        from stickslip_ros.bags.storage import system_zstd

        return system_zstd
    return zstandard


class Allowance:
    """What may still be unpacked of one file.

    Parameters
    ----------
    size : of the file [bytes].
    """

    def __init__(self, limit: UnpackLimit, size: int) -> None:
        self.limit = limit
        self._whole = self._left = limit.of_file(size)
        self._decompressor: Any = None

    def restart(self) -> None:
        """The file is read once more, from the start."""
        self._left = self._whole

    def spend(self, count: int) -> None:
        """So many bytes were unpacked.

        Raises
        ------
        TooMuchUnpackedError
            If they are too many, with those before.
        """
        self._left -= count
        if self._left < 0:
            raise TooMuchUnpackedError("the file", self._whole)

    def zstd(self, data: bytes) -> bytes:
        """One frame, decompressed; raises as :meth:`_unpacked`."""
        zstandard = zstd_library()
        # Making one takes longer than most messages do.
        self._decompressor = self._decompressor or zstandard.ZstdDecompressor()

        def unpack(largest: int) -> bytes:
            declared = zstandard.frame_content_size(data)
            if declared > largest:
                raise self._too_much(largest)
            if declared >= 0:
                whole: bytes = self._decompressor.decompress(data)
                return whole
            with self._decompressor.stream_reader(data) as stream:
                return bytes(stream.read(largest + 1))

        return self._unpacked(unpack, zstandard.ZstdError)

    def lz4(self, data: bytes) -> bytes:
        """One frame, decompressed; raises as :meth:`_unpacked`."""
        import lz4.frame

        decompressor = lz4.frame.LZ4FrameDecompressor()
        return self._unpacked(lambda largest: decompressor.decompress(data, max_length=largest + 1), RuntimeError)

    def bz2(self, data: bytes) -> bytes:
        """One stream, decompressed; raises as :meth:`_unpacked`."""
        import bz2

        decompressor = bz2.BZ2Decompressor()
        return self._unpacked(lambda largest: decompressor.decompress(data, largest + 1), OSError)

    def _unpacked(self, unpack: Callable[[int], bytes], damage: type[Exception]) -> bytes:
        """What a library makes of a frame, and no more of it than may be.

        Parameters
        ----------
        unpack : called with the largest size; it may return one byte more, to show that there is more.
        damage : what it raises of damaged frames.

        Raises
        ------
        TooMuchUnpackedError
            If it becomes too large.
        ValueError
            If it is damaged.
        """
        largest = min(self.limit.at_once, self._left)
        try:
            found = unpack(largest)
        except damage as error:
            raise ValueError(f"its compression is damaged: {error}") from error
        if len(found) > largest:
            raise self._too_much(largest)
        self.spend(len(found))
        return found

    def _too_much(self, largest: int) -> TooMuchUnpackedError:
        # What is left of the file's allowance says nothing to people.
        if largest < self.limit.at_once:
            return TooMuchUnpackedError("the file", self._whole)
        return TooMuchUnpackedError("it", largest)
