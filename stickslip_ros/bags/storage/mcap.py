# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""MCAP files, whole or damaged, as blocks of messages.

With a sound index at its end a file is read chunk by chunk, and chunks without a wanted channel are passed over.
Without one (a recorder that was killed, a file without chunks, a compressed stream) it is read from the start as far
as it makes sense. What is lost is said.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from enum import IntEnum
from typing import IO, NamedTuple

import numpy as np

from stickslip_ros.bags.storage import _record_kernel as kernel
from stickslip_ros.bags.storage.formats import BagFile
from stickslip_ros.bags.storage.unpacking import OPTION, Allowance
from stickslip_ros.messages.joint_states import Block, Bytes, Channel, Integers, Warn, counts_by_channel

MAGIC = b"\x89MCAP0\r\n"
_FOOTER = 9 + 20
_TABLE_ROWS = 1 << 16
_WINDOW = 1 << 20
_LARGEST_RECORD = 1 << 30
_MOST_REPORTED = 3  # of what makes a file useless
_BY_CHANNEL = np.dtype([("channel", "<u2"), ("value", "<u8")])
# What a damaged record makes its parser raise.
_DAMAGE = (ValueError, EOFError, OverflowError, MemoryError)


class _Opcode(IntEnum):
    """Kinds of records."""

    FOOTER = 0x02
    SCHEMA = 0x03
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = 0x06
    CHUNK_INDEX = 0x08
    STATISTICS = 0x0B
    DATA_END = 0x0F


_OF_USE = (_Opcode.MESSAGE, _Opcode.CHUNK, _Opcode.SCHEMA, _Opcode.CHANNEL)


class _Chunk(NamedTuple):
    """Where a chunk is [bytes], and what channels have messages in it."""

    begin: int
    length: int
    channels: frozenset[int]


class McapStorage:
    """One MCAP file.

    Parameters
    ----------
    file : the file. warn : told what is lost.
    """

    def __init__(self, file: BagFile, warn: Warn) -> None:
        self._file, self._warn = file, warn
        self._channels: dict[int, Channel] = {}
        self._counts: dict[int, int] = {}  # of messages, by the index
        self._chunks: list[_Chunk] = []  # by the index; without a sound one the file is read from the start
        self._schemas: dict[int, tuple[str, str, str]] = {}  # name, encoding and definition of each
        self._unknown = 0

    def channels(self) -> dict[Channel, int]:
        """See :class:`~stickslip_ros.messages.joint_states.Storage`.

        Raises
        ------
        ValueError
            If this is no MCAP file.
        """
        with self._file.open() as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise ValueError("not an MCAP file: it does not begin with its magic bytes")
        if not self._file.packed:
            self._read_index()
        if self._chunks:
            return counts_by_channel(self._channels, self._counts)
        counts: dict[Channel, int] = {}
        problems: list[str] = []
        warn, self._warn = self._warn, problems.append
        try:
            for block in self._from_start(lambda _: None):
                for number, count in Counter(block.channel.tolist()).items():
                    channel = block.channels[number]
                    counts[channel] = counts.get(channel, 0) + count
        finally:
            # Problems are reported when the messages are read, unless there are none.
            self._warn = warn
        if not counts:
            for text in problems[:_MOST_REPORTED]:
                warn(text)
        return {**dict.fromkeys(self._channels.values(), 0), **counts}

    def blocks(self, wanted: set[Channel], progress: Callable[[int], None]) -> Iterator[Block]:
        """See :class:`~stickslip_ros.messages.joint_states.Storage`."""
        self._unknown = 0
        yield from self._by_index(wanted, progress) if self._chunks else self._from_start(progress)
        if self._unknown:
            self._warn(f"{self._file.name}: {self._unknown} messages belong to no channel that is described")

    # The index at the end.

    def _read_index(self) -> None:
        """Read the summary section, if it is there and sound."""
        size, tail = self._file.size, _FOOTER + len(MAGIC)
        if size < len(MAGIC) + tail:
            return
        with self._file.open() as file:
            file.seek(size - tail)
            end = file.read(tail)
            if end[:9] != struct.pack("<BQ", _Opcode.FOOTER, 20) or end[_FOOTER:] != MAGIC:
                self._warn(f"{self._file.name}: not closed or cut off: it has no index; read as far as it goes")
                return
            begin, _, checksum = struct.unpack_from("<QQI", end, 9)
            if begin == 0:
                return
            try:
                if not len(MAGIC) <= begin <= size - tail:
                    raise ValueError("it is elsewhere")
                file.seek(begin)
                content = file.read(size - tail - begin)
                # Without a checksum the index may say anything; the data speak for themselves.
                if checksum == 0:
                    return
                if zlib.crc32(end[: 9 + 16], zlib.crc32(content)) != checksum:
                    raise ValueError("its checksum is wrong")
                chunks = sorted(self._chunks_of(content))
                for chunk in chunks:
                    file.seek(chunk.begin)
                    if file.read(1) != bytes([_Opcode.CHUNK]):
                        raise ValueError("there is no chunk where it names one")
            except _DAMAGE:
                self._warn(f"{self._file.name}: its index is damaged; read from the start as far as it goes")
                return
            # What only the data describe, chunks that do not say what they hold, and messages that nothing has counted
            # are found by reading it all.
            if self._counts and all(chunk.channels and chunk.channels <= set(self._channels) for chunk in chunks):
                self._chunks = chunks

    def _chunks_of(self, content: bytes) -> Iterator[_Chunk]:
        """The chunks that a summary section lists; its channels and counts are noted."""
        buffer = np.frombuffer(content, dtype=np.uint8)
        tables, at, _, sound = _walk(buffer)
        if not sound or at != len(buffer):
            raise ValueError("damaged records")
        for opcode, offset, length, _, _ in (row for table in tables for row in table.tolist()):
            fields = _Fields(_content(buffer, offset, length))
            if opcode == _Opcode.CHUNK_INDEX:
                fields.data(16)  # first and last time
                yield _Chunk(fields.number(8), fields.number(8), frozenset(fields.by_channel()))
            elif opcode == _Opcode.STATISTICS:
                fields.data(42)  # totals, first and last time
                self._counts = fields.by_channel()
            else:
                self._note(opcode, buffer, offset, length)

    def _by_index(self, wanted: set[Channel], progress: Callable[[int], None]) -> Iterator[Block]:
        numbers = {number for number, channel in self._channels.items() if channel in wanted}
        found = 0
        with self._file.open() as file:
            at = 0
            for index in self._chunks:
                progress(index.begin + index.length - at)
                at = index.begin + index.length
                if numbers.isdisjoint(index.channels):
                    continue
                file.seek(index.begin)
                record = file.read(index.length)
                if len(record) < 9 or len(record) - 9 != struct.unpack_from("<Q", record, 1)[0]:
                    self._warn(self._lost(index.begin, "its length is damaged"))
                    continue
                for block in self._chunk(record[9:], index.begin):
                    found += int(np.isin(block.channel, list(numbers)).sum())
                    yield block
            expected = sum(self._counts.get(number, 0) for number in numbers)
        progress(self._file.size - at)
        if found < expected:
            self._warn(f"{self._file.name}: {expected - found} of {expected} messages could not be read")

    def _lost(self, offset: int, why: str) -> str:
        return f"{self._file.name}: the chunk at byte {offset} is lost: {why}"

    # From the start.

    def _from_start(self, progress: Callable[[int], None]) -> Iterator[Block]:
        try:
            with self._file.open() as stream:
                yield from self._windows(stream, progress)
        except (OSError, EOFError) as error:
            self._warn(f"{self._file.name}: reading stopped: {' '.join(str(error).split())}")

    def _windows(self, stream: IO[bytes], progress: Callable[[int], None]) -> Iterator[Block]:
        """Walk through the file in windows that hold whole records."""
        stream.read(len(MAGIC))
        position, rest, needed = len(MAGIC), b"", _WINDOW
        checksum = zlib.crc32(MAGIC)
        while True:
            if needed > self._file.allowance.limit.at_once:
                self._warn(
                    f"{self._file.name}: a record of {needed} bytes at byte {position} is left out; "
                    f"{OPTION} MB allows larger ones"
                )
                missing, checksum = _skip(stream, needed - len(rest), zlib.crc32(rest, checksum), progress)
                position, rest, needed = position + needed - missing, b"", _WINDOW
            read = stream.read(max(needed - len(rest), _WINDOW))
            progress(len(read))
            window = rest + read
            buffer = np.frombuffer(window, dtype=np.uint8)
            tables, at, needed, sound = _walk(buffer)
            for table in tables:
                end = table[np.isin(table[:, kernel.OPCODE], (_Opcode.DATA_END, _Opcode.FOOTER))]
                if len(end):
                    stop = int(end[0, kernel.OFFSET]) - 9
                    yield from self._records(buffer, table[table[:, kernel.OFFSET] < stop], position)
                    self._check_data(buffer, end[0], zlib.crc32(window[:stop], checksum))
                    return
                yield from self._records(buffer, table, position)
            checksum = zlib.crc32(window[:at], checksum)
            position += at
            rest = window[at:]
            if not sound:
                self._warn(f"{self._file.name}: damaged at byte {position}; what comes after it is lost")
                return
            if not read:
                if rest:
                    self._warn(f"{self._file.name}: cut off at byte {position + len(rest)}, in the midst of a record")
                else:
                    self._warn(f"{self._file.name}: cut off at byte {position}; what came after it is lost")
                return

    def _check_data(self, buffer: Bytes, end: Integers, checksum: int) -> None:
        if end[kernel.OPCODE] == _Opcode.DATA_END and end[kernel.LENGTH] >= 4:
            expected = int.from_bytes(_content(buffer, int(end[kernel.OFFSET]), 4), "little")
            if expected not in (0, checksum):
                self._warn(f"{self._file.name}: its checksum is wrong: some data are damaged, and results with them")

    def _records(self, buffer: Bytes, table: Integers, position: int) -> Iterator[Block]:
        """Blocks of records that follow each other; chunks are opened."""
        # Of records that say nothing here a file may have millions.
        table = table[np.isin(table[:, kernel.OPCODE], _OF_USE)]
        opcodes = table[:, kernel.OPCODE]
        others = np.flatnonzero(opcodes != _Opcode.MESSAGE)
        begin = 0
        for number in [*others.tolist(), len(table)]:
            if number > begin:
                yield self._block(buffer, table[begin:number])
            begin = number + 1
            if number < len(table):
                opcode, offset, length, _, _ = table[number].tolist()
                if opcode == _Opcode.CHUNK:
                    yield from self._chunk(buffer[offset : offset + length].tobytes(), position + offset - 9)
                else:
                    try:
                        self._note(opcode, buffer, offset, length)
                    except _DAMAGE as error:
                        self._warn(f"{self._file.name}: a record at byte {position + offset} is damaged: {error}")

    # Both ways.

    def _chunk(self, content: bytes, offset: int) -> Iterator[Block]:
        try:
            unpacked = _unpacked(content, self._file.allowance)
        except ImportError:
            raise
        except Exception as error:
            # Whatever the libraries of compressions raise for bytes that make no sense.
            self._warn(self._lost(offset, " ".join(str(error).split()) or type(error).__name__))
            return
        buffer = np.frombuffer(unpacked, dtype=np.uint8)
        tables, at, _, sound = _walk(buffer)
        for table in tables:
            yield from self._records(buffer, table[table[:, kernel.OPCODE] != _Opcode.CHUNK], offset)
        if not sound or at != len(buffer):
            self._warn(f"{self._file.name}: the chunk at byte {offset} is damaged; the end of it is lost")

    def _note(self, opcode: int, buffer: Bytes, offset: int, length: int) -> None:
        """Remember schemas and channels."""
        if opcode not in (_Opcode.SCHEMA, _Opcode.CHANNEL):
            return
        fields = _Fields(_content(buffer, offset, length))
        number = fields.number(2)
        if opcode == _Opcode.SCHEMA:
            name, encoding = fields.text(), fields.text()
            definition = fields.data(fields.number(4)).decode("utf-8", errors="replace")
            self._schemas[number] = name, encoding, definition
            return
        kind, schema_encoding, schema = self._schemas.get(fields.number(2), ("", "", ""))
        topic, encoding = fields.text(), fields.text()
        self._channels[number] = Channel(
            topic=topic, type=kind, encoding=encoding, schema_encoding=schema_encoding, schema=schema
        )

    def _block(self, buffer: Bytes, table: Integers) -> Block:
        # Only its own channels: a file may have as many as messages, and describe one anew further on.
        numbers = set(table[:, kernel.CHANNEL].tolist())
        channels = {number: self._channels[number] for number in numbers & self._channels.keys()}
        if len(channels) < len(numbers):
            known = np.isin(table[:, kernel.CHANNEL], list(channels))
            self._unknown += int((~known).sum())
            table = table[known]
        return Block(
            buffer=buffer,
            channels=channels,
            channel=table[:, kernel.CHANNEL],
            offset=np.ascontiguousarray(table[:, kernel.OFFSET]),
            length=np.ascontiguousarray(table[:, kernel.LENGTH]),
            log_time=table[:, kernel.LOG_TIME],
        )


def _skip(stream: IO[bytes], count: int, checksum: int, progress: Callable[[int], None]) -> tuple[int, int]:
    """Pass over so many bytes; returns how many of them were missing, and the checksum with them."""
    while count > 0 and (piece := stream.read(min(count, _WINDOW))):
        progress(len(piece))
        checksum = zlib.crc32(piece, checksum)
        count -= len(piece)
    return count, checksum


def _content(buffer: Bytes, offset: int, length: int) -> bytes:
    return buffer[offset : offset + length].tobytes()


def _walk(buffer: Bytes) -> tuple[list[Integers], int, int, bool]:
    """Tables of the whole records in a buffer; where they end, what the next one needs, whether all is sound."""
    tables, at = [], 0
    while True:
        table = np.empty((_TABLE_ROWS, kernel.COLUMNS), dtype=np.int64)
        count, at, needed, sound = kernel.walk(buffer, at, _LARGEST_RECORD, table)
        if count:
            tables.append(table[:count])
        if count < _TABLE_ROWS or not sound:
            return tables, int(at), int(needed), bool(sound)


def _unpacked(content: bytes, allowance: Allowance) -> bytes:
    """The records that a chunk holds.

    Raises
    ------
    ValueError
        If they are not what their length and checksum say.
    """
    fields = _Fields(content)
    fields.data(16)  # first and last time
    size, checksum, compression = fields.number(8), fields.number(4), fields.text()
    data = fields.data(fields.number(8))
    unpackers: dict[str, Callable[[bytes], bytes]] = {"": bytes, "zstd": allowance.zstd, "lz4": allowance.lz4}
    if compression not in unpackers:
        raise ValueError(f"its compression {compression[:32]!r} is none of zstd, lz4")
    unpacked = unpackers[compression](data)
    if len(unpacked) != size:
        raise ValueError(f"it holds {len(unpacked)} bytes instead of {size}")
    if checksum and zlib.crc32(unpacked) != checksum:
        raise ValueError("its checksum is wrong")
    return unpacked


class _Fields:
    """The fields of a record, in their order.

    Raises
    ------
    ValueError
        From every method, if the record ends before the field does.
    """

    def __init__(self, content: bytes) -> None:
        self._content, self._at = content, 0

    def data(self, size: int) -> bytes:
        """The next bytes."""
        begin, self._at = self._at, self._at + size
        if self._at > len(self._content):
            raise ValueError("it ends in the midst of a field")
        return self._content[begin : self._at]

    def number(self, size: int) -> int:
        """An integer of so many bytes."""
        return int.from_bytes(self.data(size), "little")

    def text(self) -> str:
        """A text, after its length."""
        return self.data(self.number(4)).decode()

    def by_channel(self) -> dict[int, int]:
        """A number for each channel."""
        table = np.frombuffer(self.data(self.number(4)), dtype=_BY_CHANNEL)
        return dict(zip(table["channel"].tolist(), table["value"].tolist(), strict=True))
