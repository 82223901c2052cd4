# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Files that mean harm: each entry of `CORPUS` makes some in a folder, and says with which arguments they are met."""

from __future__ import annotations

import io
import json
import os
import socket
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable
from contextlib import closing
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from support_bags import JOINT_STATE, STORE, definition, joint_state, write_mcap

MAGIC = b"\x89MCAP0\r\n"
CHUNK, SCHEMA, CHANNEL, MESSAGE, ATTACHMENT = 0x06, 0x03, 0x04, 0x05, 0x09
_MEGABYTE = bytes(1 << 20)
METADATA = "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: sqlite3\n"


def record(opcode: int, content: bytes) -> bytes:
    """An MCAP record."""
    return struct.pack("<BQ", opcode, len(content)) + content


def _string(text: str) -> bytes:
    return struct.pack("<I", len(text.encode())) + text.encode()


def schema(number: int, text: str = "", name: str = JOINT_STATE) -> bytes:
    """A schema record."""
    data = (text or definition(JOINT_STATE)).encode()
    return record(
        SCHEMA, struct.pack("<H", number) + _string(name) + _string("ros2msg") + struct.pack("<I", len(data)) + data
    )


def channel(number: int, of_schema: int, topic: str) -> bytes:
    """A channel record."""
    return record(CHANNEL, struct.pack("<HH", number, of_schema) + _string(topic) + _string("cdr") + bytes(4))


def message(number: int, data: bytes, time: int = 1_000_000_000) -> bytes:
    """A message record."""
    return record(MESSAGE, struct.pack("<HIQQ", number, 0, time, time) + data)


def chunk(compression: str, data: bytes, size: int) -> bytes:
    """A chunk record that says it holds so many bytes."""
    head = struct.pack("<QQQI", 0, 0, size, 0) + _string(compression) + struct.pack("<Q", len(data))
    return record(CHUNK, head + data)


def zeros(megabytes: int, *, told: bool) -> bytes:
    """One zstd frame of so much; it tells its size, or does not."""
    size = megabytes << 20 if told else -1
    packing = zstandard.ZstdCompressor(level=1).compressobj(size=size)
    return b"".join(packing.compress(_MEGABYTE) for _ in range(megabytes)) + packing.flush()


def zeros_lz4(megabytes: int) -> bytes:
    """One lz4 frame of so much."""
    packing = lz4.frame.LZ4FrameCompressor()
    return packing.begin() + b"".join(packing.compress(_MEGABYTE) for _ in range(megabytes)) + packing.flush()


def _sample() -> bytes:
    return bytes(STORE.serialize_cdr(joint_state(1.0, ("a",), position=[0.0]), JOINT_STATE))


def _mcap(path: Path, *records: bytes) -> list[str]:
    path.write_bytes(MAGIC + b"".join(records))
    return ["analyze", str(path)]


def chunk_that_tells(folder: Path) -> list[str]:
    """Its frame tells a size that is allocated at once."""
    return _mcap(folder / "a.mcap", chunk("zstd", zeros(3000, told=True), 1000))


def chunk_of_a_true_size(folder: Path) -> list[str]:
    """The chunk says what it becomes."""
    return _mcap(folder / "a.mcap", chunk("zstd", zeros(2000, told=False), 2000 << 20))


def chunk_of_lz4(folder: Path) -> list[str]:
    """The same by the other compression."""
    return _mcap(folder / "a.mcap", chunk("lz4", zeros_lz4(1500), 1500 << 20))


def chunks_without_end(folder: Path) -> list[str]:
    """None is too large, but there are hundreds: 42 GB in all."""
    content = record(ATTACHMENT, bytes(60_000_000))
    one = chunk("zstd", zstandard.ZstdCompressor().compress(content), len(content))
    return _mcap(folder / "a.mcap", *[one] * 700)


def record_that_claims_much(folder: Path) -> list[str]:
    """A sparse file, one record of which is said to fill it."""
    path = folder / "a.mcap"
    _mcap(path, struct.pack("<BQ", ATTACHMENT, 8_000_000_000))
    os.truncate(path, 8_000_000_100)
    return ["analyze", str(path)]


def small_records(folder: Path) -> list[str]:
    """A chunk of millions of records without content, each with a row in a table."""
    content = record(ATTACHMENT, b"") * 7_000_000
    return _mcap(folder / "a.mcap", chunk("zstd", zstandard.ZstdCompressor().compress(content), len(content)))


def _folder(folder: Path, metadata: str) -> Path:
    bag = folder / "bag"
    bag.mkdir()
    (bag / "metadata.yaml").write_text(metadata)
    return bag


def _database(path: Path, *statements: str, rows: Iterable[tuple[int, int, bytes]] = ()) -> None:
    kept = "id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, offered_qos_profiles TEXT"
    with closing(sqlite3.connect(path)) as database, database:
        for statement in statements or (
            f"CREATE TABLE topics({kept})",
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)",
        ):
            database.execute(statement)
        database.execute(
            "INSERT INTO topics VALUES(1, '/joint_states', ?, 'cdr', ?)", (JOINT_STATE, _aliases("- history: "))
        )
        if rows:
            database.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", rows)


def messages_packed_one_by_one(folder: Path) -> list[str]:
    """Each becomes a gigabyte; the metadata say that they are compressed."""
    bag = _folder(folder, METADATA + "  compression_mode: MESSAGE\n  relative_file_paths: [a.db3]\n")
    told, untold = zeros(1000, told=True), zeros(1000, told=False)
    _database(bag / "a.db3", rows=[(1, number, told if number % 2 else untold) for number in range(60)])
    return ["analyze", str(bag)]


def messages_that_add_up(folder: Path) -> list[str]:
    """Each may be, but not all of them at once: 2 GB in a block."""
    bag = _folder(folder, METADATA + "  compression_mode: MESSAGE\n  relative_file_paths: [a.db3]\n")
    packed = zstandard.ZstdCompressor().compress(bytes(500_000))
    _database(bag / "a.db3", rows=[(1, number, packed) for number in range(4000)])
    return ["analyze", str(bag), "--largest-unpacked", "4000"]


def packed_database(folder: Path) -> list[str]:
    """A few kB that would fill the temporary folder."""
    path = folder / "a.db3.zstd"
    path.write_bytes(zeros(3000, told=False))
    return ["analyze", str(path)]


def packed_mcap(folder: Path) -> list[str]:
    """A stream of which no end comes: an attachment of many gigabytes."""
    path = folder / "a.mcap.zstd"
    packing = zstandard.ZstdCompressor().compressobj()
    begin = packing.compress(MAGIC + struct.pack("<BQ", ATTACHMENT, 900_000_000)) + packing.flush()
    path.write_bytes(begin + zeros(1000, told=True) * 20)
    return ["analyze", str(path)]


def view_instead_of_a_table(folder: Path) -> list[str]:
    """A query that ends never in place of the messages."""
    path = folder / "a.db3"
    endless = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n)"
    _database(
        path,
        "CREATE TABLE topics(id, name, type, serialization_format, qos)",
        f"CREATE VIEW messages AS {endless} SELECT x AS id, 1 AS topic_id, x AS timestamp, x AS data FROM n",
    )
    return ["analyze", str(path)]


def computed_column(folder: Path) -> list[str]:
    """Half a gigabyte that stands nowhere, in each row."""
    path = folder / "a.db3"
    _database(
        path,
        "CREATE TABLE topics(id, name, type, serialization_format, qos)",
        "CREATE TABLE messages(id, topic_id, timestamp, data AS (zeroblob(500000000)))",
        "INSERT INTO messages(id, topic_id, timestamp) VALUES(1, 1, 1), (2, 1, 2), (3, 1, 3)",
    )
    return ["analyze", str(path)]


def _aliases(key: str, levels: int = 40) -> str:
    lines = ["&a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"&a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, levels)]
    return "\n".join([f"{key.strip().rstrip(':')}{n}: {line}" for n, line in enumerate(lines)]) + "\n"


def aliases_in_metadata(folder: Path) -> list[str]:
    """Under 4 kB of YAML that stand for 9^40 words."""
    bombs = "".join(f"  {line}\n" for line in _aliases("k").splitlines())
    bag = _folder(folder, METADATA + bombs + "  relative_file_paths: [*a39]\n")
    write_mcap(bag / "a.mcap", _rows())
    return ["analyze", str(bag)]


def metadata_of_itself(folder: Path) -> list[str]:
    """A list that is an item of itself, and one that is nested without end."""
    bag = _folder(folder, METADATA + "  relative_file_paths: &a [*a]\n  custom: " + "[" * 100_000)
    write_mcap(bag / "a.mcap", _rows())
    return ["analyze", str(bag)]


def large_metadata(folder: Path) -> list[str]:
    """YAML that takes minutes to parse."""
    bag = _folder(folder, METADATA + "  a: {b: c}\n" * 3_000_000)
    write_mcap(bag / "a.mcap", _rows())
    return ["analyze", str(bag)]


def _rows() -> list[tuple[str, str, float, bytes]]:
    times = np.arange(1.0, 3.0, 0.01)
    return [
        ("/joint_states", JOINT_STATE, time, joint_state(time, ("a",), position=[0.1 * time]))
        for time in times.tolist()
    ]


def _with_parameters(folder: Path, path: Path | str) -> list[str]:
    return ["analyze", str(write_mcap(folder / "a.mcap", _rows())), "--no-learning", "--parameters", str(path)]


def aliases_in_parameters(folder: Path) -> list[str]:
    """The same in a file of parameters."""
    path = folder / "a.yaml"
    path.write_text("/**:\n  ros__parameters:\n" + "".join(f"    {one}\n" for one in _aliases("k").splitlines()))
    return _with_parameters(folder, path)


def aliases_in_a_joint_file(folder: Path) -> list[str]:
    """The same in a joint file."""
    path = folder / "a.yaml"
    path.write_text(_aliases("k") + "name: *a39\n")
    return ["margin", "--model", str(path)]


def deep_parameters(folder: Path) -> list[str]:
    """Nesting by which a parser's stack overflows."""
    path = folder / "a.yaml"
    path.write_text("a: " + "{a: " * 50_000)
    return _with_parameters(folder, path)


def fifo_as_parameters(folder: Path) -> list[str]:
    """Nobody writes to it."""
    os.mkfifo(folder / "a.yaml")
    return _with_parameters(folder, folder / "a.yaml")


def fifo_as_bag(folder: Path) -> list[str]:
    """Nobody writes to it."""
    os.mkfifo(folder / "a.mcap")
    return ["analyze", str(folder / "a.mcap")]


def fifo_in_a_bag(folder: Path) -> list[str]:
    """Nobody writes to it, nor to its metadata."""
    (folder / "bag").mkdir()
    os.mkfifo(folder / "bag" / "metadata.yaml")
    os.mkfifo(folder / "bag" / "bag_0.db3")
    return ["analyze", str(folder / "bag")]


def fifo_as_table(folder: Path) -> list[str]:
    """Nobody writes to it."""
    os.mkfifo(folder / "a.csv")
    return ["identify", str(folder / "a.csv")]


def socket_as_bag(folder: Path) -> list[str]:
    """Nobody listens."""
    # The names of sockets are short.
    at = os.open(folder, os.O_RDONLY)
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(f"/proc/self/fd/{at}/a.mcap")
    os.close(at)
    return ["analyze", str(folder / "a.mcap")]


def device_as_bag(folder: Path) -> list[str]:
    """It has no end."""
    (folder / "a.mcap").symlink_to("/dev/full")
    return ["analyze", str(folder / "a.mcap")]


def device_as_parameters(folder: Path) -> list[str]:
    """It has no end."""
    return _with_parameters(folder, "/dev/zero")


def folder_as_parameters(folder: Path) -> list[str]:
    """It cannot be read."""
    return _with_parameters(folder, folder)


def topics_of_one_definition(folder: Path) -> list[str]:
    """60,000, each with a message."""
    data = _sample()
    records = [schema(1)]
    for number in range(60_000):
        records += [channel(number, 1, f"/r{number}/joint_states"), message(number, data)]
    return _mcap(folder / "a.mcap", *records)


def references_of_one_definition(folder: Path) -> list[str]:
    """60,000 beside one robot: each could be its reference."""
    data = _sample()
    records = [schema(1), schema(2, name="control_msgs/msg/MultiDOFStateStamped"), channel(0, 1, "/joint_states")]
    for number in range(1, 60_000):
        records += [message(0, data), channel(number, 2, f"/r{number}"), message(number, data)]
    return _mcap(folder / "a.mcap", *records)


def definitions_of_one_type(folder: Path) -> list[str]:
    """20,000 topics, each with a definition of its own."""
    data, text = _sample(), definition(JOINT_STATE)
    records = []
    for number in range(1, 20_000):
        records += [schema(number, f"# {number}\n{text}"), channel(number, number, f"/r{number}/joint_states")]
        records.append(message(number, data))
    return _mcap(folder / "a.mcap", *records)


def long_definition(folder: Path) -> list[str]:
    """Text of many megabytes for a parser of definitions."""
    text = "float64 a\n" * 3_000_000
    return _mcap(folder / "a.mcap", schema(1, text), channel(1, 1, "/joint_states"), message(1, b"\0\1\0\0"))


def packed_table(folder: Path) -> list[str]:
    """A .npz of 200 kB whose column would be 200 MB, or 3 GB by its header."""
    path = folder / "a.npz"
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (375_000_000,)})
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("time_s.npy", "w", force_zip64=True) as column,
    ):
        column.write(header.getvalue())
        for _ in range(200):
            column.write(_MEGABYTE)
    return ["identify", str(path)]


def table_that_claims_much(folder: Path) -> list[str]:
    """A column of a trillion numbers, by its header."""
    path = folder / "a.npz"
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("time_s.npy", header.getvalue() + bytes(80))
    return ["identify", str(path)]


def endless_simulation(folder: Path) -> list[str]:
    """Thirty years of samples."""
    return ["simulate", "--out", str(folder / "a.mcap"), "--duration", "1e9"]


CORPUS: tuple[Callable[[Path], list[str]], ...] = (
    chunk_that_tells, chunk_of_a_true_size, chunk_of_lz4, chunks_without_end, record_that_claims_much, small_records,
    messages_packed_one_by_one, messages_that_add_up, packed_database, packed_mcap, view_instead_of_a_table,
    computed_column, aliases_in_metadata, metadata_of_itself, large_metadata, aliases_in_parameters,
    aliases_in_a_joint_file, deep_parameters, fifo_as_parameters, fifo_as_bag, fifo_in_a_bag, fifo_as_table,
    socket_as_bag, device_as_bag, device_as_parameters, folder_as_parameters, topics_of_one_definition,
    references_of_one_definition, definitions_of_one_type, long_definition, packed_table, table_that_claims_much,
    endless_simulation,
)  # fmt: skip


def state_file(version: object, body: bytes = b"{}") -> bytes:
    """A state file of a version, whose checksum is right."""
    header = {"format": "stickslip_ros state", "version": version, "crc32": zlib.crc32(body)}
    return json.dumps(header).encode() + b"\n" + body
