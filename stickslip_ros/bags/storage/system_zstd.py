# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Decompression by the system's libzstd, with the names of the package zstandard, as far as they are used here.

Debian and Ubuntu always have the library: dpkg needs it.
"""

from __future__ import annotations

import ctypes
import io
from typing import IO, Any

_AT_ONCE = 1 << 20  # size of what is read of a compressed stream, bytes
_UNKNOWN, _DAMAGED = (1 << 64) - 1, (1 << 64) - 2  # answers of ZSTD_getFrameContentSize

try:
    _library = ctypes.CDLL("libzstd.so.1")
except OSError as _error:
    raise ImportError(str(_error), name="zstandard") from _error
for _name, _result in {
    "ZSTD_createDStream": ctypes.c_void_p,
    "ZSTD_decompress": ctypes.c_size_t,
    "ZSTD_decompressStream": ctypes.c_size_t,
    "ZSTD_getErrorName": ctypes.c_char_p,
    "ZSTD_getFrameContentSize": ctypes.c_ulonglong,
}.items():
    getattr(_library, _name).restype = _result


class ZstdError(Exception):
    """Data that are damaged."""


class _Buffer(ctypes.Structure):
    _fields_ = (("place", ctypes.c_void_p), ("size", ctypes.c_size_t), ("at", ctypes.c_size_t))


def frame_content_size(data: bytes) -> int:
    """Size that a frame declares [bytes], -1 if it declares none."""
    size = int(_library.ZSTD_getFrameContentSize(data, ctypes.c_size_t(len(data))))
    if size == _DAMAGED:
        raise ZstdError("it does not begin as a frame does")
    return -1 if size == _UNKNOWN else size


class ZstdDecompressor:
    """See zstandard's."""

    def decompress(self, data: bytes) -> bytes:
        """A frame that declares its size."""
        target = ctypes.create_string_buffer(frame_content_size(data))
        size = ctypes.c_size_t(len(target))
        found = _checked(_library.ZSTD_decompress(target, size, data, ctypes.c_size_t(len(data))))
        return target.raw[:found]

    def stream_reader(self, source: bytes | IO[bytes], read_across_frames: bool = True) -> io.RawIOBase:
        """A stream of what is in bytes or in a file."""
        return _Stream(io.BytesIO(source) if isinstance(source, bytes) else source)


class _Stream(io.RawIOBase):
    def __init__(self, source: IO[bytes]) -> None:
        super().__init__()
        self._source, self._piece, self._given = source, b"", _Buffer()
        self._state = ctypes.c_void_p(_library.ZSTD_createDStream())

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        size = len(buffer)
        target = (ctypes.c_char * size).from_buffer(buffer)
        out = _Buffer(ctypes.addressof(target), size, 0)
        while out.at < size:
            if self._given.at == self._given.size:
                self._piece = self._source.read(_AT_ONCE)
                place = ctypes.cast(ctypes.c_char_p(self._piece), ctypes.c_void_p)
                self._given = _Buffer(place, len(self._piece), 0)
            before = out.at
            _checked(_library.ZSTD_decompressStream(self._state, ctypes.byref(out), ctypes.byref(self._given)))
            if out.at == before and not self._piece:
                break
        return int(out.at)

    def close(self) -> None:
        if not self.closed:
            _library.ZSTD_freeDStream(self._state)
        super().close()


def _checked(result: int) -> int:
    if _library.ZSTD_isError(ctypes.c_size_t(result)):
        raise ZstdError(_library.ZSTD_getErrorName(ctypes.c_size_t(result)).decode())
    return result
