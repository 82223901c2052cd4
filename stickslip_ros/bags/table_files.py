# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The columns of table files: text (CSV, TSV), Parquet, NPZ. What they mean is told in `table_columns.py`."""

from __future__ import annotations

import csv
import io
import re
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice, pairwise
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.bags.storage.unpacking import TooMuchUnpackedError, UnpackLimit
from stickslip_ros.bags.table_columns import Named
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.regular_files import open_regular

SUFFIXES = (".csv", ".tsv", ".txt", ".parquet", ".npz")
_LOOKED_AT = 1 << 16  # bytes from which the form of a text is told
_ROWS_LOOKED_AT = 50
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
_ZONE = re.compile(r"(Z|[-+]\d\d:?\d\d)$")
_BAD_VALUE = re.compile(r"In CSV column #(\d+): Row #(\d+): .*invalid value '(.*)'", re.DOTALL)
_BAD_ROW = re.compile(r"CSV parse error: Row #(\d+): Expected (\d+) columns, got (\d+)")
_BYTES_OF_A_VALUE = 8
_NAME_OF_A_JOINT = re.compile(r"(?:^|[./])(?:joint_)?names?\[?(\d+)\]?$")  # a column of joints' names in a message
_DELIMITERS = (";", "\t", ",", "|")
_COMMENT = re.compile(r"\s*(?:[#%]|//)+ *")
_LARGEST_CELL = 1_000_000  # characters
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
_DAY = re.compile(r"\d{4}-\d\d-\d\d")
_CLOCK = re.compile(r"\d\d:\d\d(:\d\d(\.\d{1,9})?)?")
_LONGEST_PREAMBLE = 100  # lines
_ECHOED = ("header.stamp.sec", "header.stamp.nanosec", "header.frame_id")
_ECHOED_FIELDS = ("position", "velocity", "effort")


class TableFile:
    """A table that is open; of most all columns have nothing but their names.

    Attributes
    ----------
    names : of the columns. dates : names of those that are dates; they are read as seconds since 1970.
    days, clocks : of those the ones without a time, and without a day, which are read as seconds since midnight.
    joints : names of the joints that numbers in the columns' names stand for, as far as the file has them.
    form : how it is written, in words; "" where there is only one way.
    named : what columns are, where the file's layout says it. units : of columns, where the file has them.
    notes : what of the file is not used, or not known, a sentence each.
    """

    names: tuple[str, ...]
    dates: frozenset[str] = frozenset()
    days: frozenset[str] = frozenset()
    clocks: frozenset[str] = frozenset()
    joints: Mapping[str, str] = {}
    form = ""
    named: Sequence[Named] = ()
    units: Mapping[str, str] = {}
    notes: Sequence[str] = ()

    def read(self, names: Sequence[str]) -> dict[str, FloatArray]:
        """Columns as numbers, NaN for what is empty.

        Raises
        ------
        ValueError
            If something is no number; the text says where.
        """
        raise NotImplementedError


@contextmanager
def open_table(path: Path, limit: UnpackLimit) -> Iterator[TableFile]:
    """Open a table; text unless its name ends in .npz or .parquet.

    Raises
    ------
    OSError
        If it cannot be opened.
    ValueError
        If it is no table, or unpacks to more than it may.
    ImportError
        If the package pyarrow is missing, which it needs.
    """
    with open_regular(path) as file:
        if path.suffix == ".npz":
            yield _Npz(file, limit.of_table(path.stat().st_size))
        elif path.suffix == ".parquet":
            yield ParquetFile(file, limit.of_table(path.stat().st_size))
        else:
            yield _Text(file)


def _pyarrow() -> Any:
    import pyarrow
    import pyarrow.compute
    import pyarrow.csv
    import pyarrow.parquet

    # It cancels what it reads when a signal comes, and that would be said of the table.
    pyarrow.enable_signal_handlers(False)
    return pyarrow


class _Text(TableFile):
    """Values with delimiters, under a line of names; its form is told from its first lines."""

    def __init__(self, file: IO[bytes]) -> None:
        self._arrow = _pyarrow()
        self._file = file
        begin = file.read(_LOOKED_AT)
        # A log whose computer lost its power may end in zeros; of these the line is named.
        if b"\x00" in begin.rstrip(b"\x00"):
            raise ValueError(
                "must be text in UTF-8 (not UTF-16), .parquet or .npz; a spreadsheet is saved as CSV, "
                "a bag analysed as it is"
            )
        lines = begin.splitlines(keepends=True)
        self._skipped, header = _header_of(lines)
        self._above = 0
        below = _below_a_preamble(lines, self._skipped, header)
        if below is not None:
            self._above, (self._skipped, header) = below[0] - self._skipped, below
        texts = [line.decode("utf-8", "replace") for line in lines[self._skipped + 1 :]][:_ROWS_LOOKED_AT]
        texts = [text for text in texts if text.strip()]
        self._delimiter = _delimiter_of(header, texts)
        self._columns = _cells_of(header, self._delimiter)
        numbered = _numbered(self._columns, self._arrow.csv.ConvertOptions().null_values)
        named = _columns_of_an_echo(self._columns) or numbered
        if named:
            # The message's own layout, or numbers, stand for the line of names that is not there.
            self._columns, texts, self._skipped = named, [header, *texts], self._skipped - 1
        if not texts:
            raise ValueError("it has no rows under its line of names")
        self.names = tuple(dict.fromkeys(filter(None, self._columns)))
        rows = [_cells_of(text, self._delimiter) for text in texts]
        values = [cell for row in rows for cell in row]
        commas = self._delimiter != "," and any(_DECIMAL_COMMA.fullmatch(cell) for cell in values)
        self._decimal = "," if commas else "."
        namesakes = [name for name, count in Counter(self._columns).items() if name and count > 1]
        if namesakes:
            self.notes = (f"of columns of the same name only the first one is read: {', '.join(namesakes)}",)
        if numbered:
            self.notes = ("its columns have no names, and are numbered",)
        firsts = dict(zip(self._columns, rows[0], strict=False))
        self.joints = {
            found[1]: cell for name, cell in firsts.items() if (found := _NAME_OF_A_JOINT.search(name)) and cell
        }
        self._zones = {name: bool(_ZONE.search(cell)) for name, cell in firsts.items() if _DATE.match(cell)}
        self.days = frozenset(name for name, cell in firsts.items() if _DAY.fullmatch(cell))
        self.clocks = frozenset(name for name, cell in firsts.items() if _CLOCK.fullmatch(cell))
        self.dates = frozenset(self._zones) | self.days | self.clocks
        shown = {"\t": "tabs", " ": "blanks"}.get(self._delimiter, f"{self._delimiter!r}")
        above = f", below {self._above} other lines" if self._above else ""
        self.form = f"values between {shown}{', decimal commas' if commas else ''}{above}"
        self._start = sum(len(line) for line in lines[: self._skipped + 1])

    def read(self, names: Sequence[str]) -> dict[str, FloatArray]:
        """See :class:`TableFile`."""
        arrow = self._arrow
        # By their numbers, as several may have one name, of which the first serves.
        numbers = {name: str(self._columns.index(name)) for name in names}
        kinds = {numbers[name]: self._kind(name) for name in names}
        self._file.seek(self._start)
        source: IO[bytes] = self._file
        if self._delimiter == " ":
            source = io.BytesIO(b"\n".join(b" ".join(line.split()) for line in self._file.read().split(b"\n")))
        try:
            table = arrow.csv.read_csv(
                source,
                # One after the other, so that the row of what cannot be read is known.
                read_options=arrow.csv.ReadOptions(
                    use_threads=False, column_names=list(map(str, range(len(self._columns))))
                ),
                parse_options=arrow.csv.ParseOptions(delimiter=self._delimiter),
                convert_options=arrow.csv.ConvertOptions(
                    column_types=kinds, include_columns=list(kinds), decimal_point=self._decimal
                ),
            )
        except arrow.ArrowException as error:
            raise ValueError(self._in_words(str(error))) from error
        return {name: _numbers(arrow, table.column(number)) for name, number in numbers.items()}

    def _kind(self, name: str) -> Any:
        if name in self.clocks:
            return self._arrow.time64("ns")
        if name in self.dates:
            return self._arrow.timestamp("ns", "UTC" if self._zones.get(name) else None)
        return self._arrow.float64()

    def _in_words(self, text: str) -> str:
        """What pyarrow says, with the line and the column as an editor shows them."""
        value, row = _BAD_VALUE.search(text), _BAD_ROW.search(text)
        if value is not None:
            name, line = self._columns[int(value[1])], self._line(int(value[2]))
            wanted = "a date like 2026-01-31 12:00:00.125" if name in self.dates else "a number"
            wanted = "a time like 12:00:00.125" if name in self.clocks else wanted
            return f"line {line}, column {name!r}: must be {wanted}: {value[3]!r}"
        if row is not None:
            return f"line {self._line(int(row[1]))}: must have the header's {row[2]} values: it has {row[3]}"
        return text

    def _line(self, row: int) -> int:
        """The line of a row; empty lines are no rows."""
        self._file.seek(self._start)
        line = self._skipped + 1
        for text in self._file:
            line += 1
            row -= bool(text.strip())
            if row == 0:
                break
        return line


def _numbers(arrow: Any, column: Any) -> FloatArray:
    """A column of pyarrow's as numbers; dates and times of the day as seconds."""
    if arrow.types.is_time(column.type):
        return 1e-9 * np.asarray(column.cast(arrow.int64()).cast(arrow.float64()), dtype=float)
    if arrow.types.is_timestamp(column.type):
        whole = column.cast(arrow.timestamp("ns", column.type.tz)).cast(arrow.int64())
        seconds = arrow.compute.divide(whole, 10**9)
        rest = arrow.compute.subtract(whole, arrow.compute.multiply(seconds, 10**9))
        begin, beyond = (np.asarray(part.cast(arrow.float64()), dtype=float) for part in (seconds, rest))
        return np.asarray(begin + 1e-9 * beyond)
    return np.asarray(column.cast(arrow.float64(), safe=False), dtype=float)


class ParquetFile(TableFile):
    """A Parquet file; parts of structures are columns `a.b`, lists of numbers columns `a[0]`, `a[1]` and so on."""

    def __init__(self, file: IO[bytes], largest: int) -> None:
        self._arrow = arrow = _pyarrow()
        try:
            self._file = arrow.parquet.ParquetFile(file)
            schema, self._groups = self._file.schema_arrow, self._file.metadata
        except (arrow.ArrowException, OSError) as error:
            raise ValueError(f"it is no Parquet file that can be read: {error}") from error
        self._largest = largest
        self._chosen = list(range(self._groups.num_row_groups))
        parts = _flat(arrow, schema.empty_table()).schema
        self._lengths = {part.name: length for part in parts if (length := self._length(part)) is not None}
        # Of each name the column, and which value of its lists is meant.
        self._places: dict[str, tuple[str, int | None]] = {}
        for name in parts.names:
            length = self._lengths.get(name)
            of_lists = {f"{name}[{number}]": (name, number) for number in range(length or 0)}
            self._places |= {name: (name, None)} if length is None else of_lists
        self.names = tuple(self._places)
        self.dates = frozenset(part.name for part in parts if arrow.types.is_timestamp(part.type))

    def _length(self, part: Any) -> int | None:
        """How many values the lists of a column have, by the first row; None if it has no lists."""
        types = self._arrow.types
        if types.is_fixed_size_list(part.type):
            return int(part.type.list_size)
        if not (types.is_list(part.type) or types.is_large_list(part.type)):
            return None
        try:
            rows: list[Any] = []
            for batch in islice(self._file.iter_batches(batch_size=1, columns=[part.name]), 1):
                rows = _flat(self._arrow, self._arrow.Table.from_batches([batch])).column(part.name).to_pylist()
        except (self._arrow.ArrowException, OSError, KeyError) as error:
            raise ValueError(f"column {part.name!r} cannot be read: {error}") from error
        return len(next((row for row in rows if row is not None), ()))

    def choose_groups(self, name: str, value: int) -> None:
        """Read only the groups of rows in which a column may have a value, as far as the file says it."""
        paths = [self._file.schema.column(number).path for number in range(self._groups.num_columns)]
        if name not in paths:
            return
        place = paths.index(name)
        numbers = range(self._groups.num_row_groups)
        known = {number: self._groups.row_group(number).column(place).statistics for number in numbers}
        self._chosen = [
            number for number, one in known.items() if one is None or not one.has_min_max or one.min <= value <= one.max
        ]

    def read(self, names: Sequence[str]) -> dict[str, FloatArray]:
        """See :class:`TableFile`."""
        arrow = self._arrow
        chosen = {name: self._places[name] for name in names}
        # The file declares its uncompressed size [bytes].
        groups = [self._groups.row_group(number) for number in self._chosen]
        declared = sum(group.total_byte_size for group in groups)
        if max(declared, sum(group.num_rows for group in groups) * len(names) * _BYTES_OF_A_VALUE) > self._largest:
            raise TooMuchUnpackedError("it", self._largest)
        columns = sorted({found[0] for found in chosen.values()})
        try:
            table = _flat(arrow, self._file.read_row_groups(self._chosen, columns=columns, use_threads=False))
            found = {}
            for name, (column, number) in chosen.items():
                values = table.column(column)
                if number is not None:
                    lengths = set(arrow.compute.list_value_length(values).to_pylist())
                    if lengths - {self._lengths[column]}:
                        raise ValueError(f"column {column!r} must have as many values in every row")
                    values = arrow.compute.list_element(values, number)
                found[name] = _numbers(arrow, values)
        except ValueError as error:
            if isinstance(error, arrow.ArrowException):
                raise ValueError(f"columns {', '.join(names)} must hold numbers: {error}") from error
            raise
        except (arrow.ArrowException, OSError) as error:
            raise ValueError(f"it is damaged: {error}") from error
        return found


def _flat(arrow: Any, table: Any) -> Any:
    """A table whose structures are columns, one for each part, named a.b."""
    while any(map(arrow.types.is_struct, table.schema.types)):
        table = table.flatten()
    return table


class _Npz(TableFile):
    """An archive of numpy's: rows of numbers, tables of one column a joint, names of joints."""

    def __init__(self, file: IO[bytes], largest: int) -> None:
        # What the archive says of its members is what is unpacked of them at most.
        with zipfile.ZipFile(file) as members:
            if sum(member.file_size for member in members.infolist()) > largest:
                raise TooMuchUnpackedError("it", largest)
        file.seek(0)
        with np.load(file, allow_pickle=False) as archive:
            found = {name: np.atleast_1d(archive[name]) for name in archive.files}
        texts = [array for array in found.values() if array.dtype.kind == "U" and array.ndim == 1]
        self._columns: dict[str, NDArray[Any]] = {}
        for name, array in found.items():
            if array.dtype.kind not in "fiub":
                continue
            if array.ndim == 1:
                self._columns[name] = array
            elif array.ndim == 2:
                self._columns |= {f"{name}[{number}]": array[:, number] for number in range(array.shape[1])}
                joints = next((text for text in texts if len(text) == array.shape[1]), ())
                self.joints = {str(number): str(joint) for number, joint in enumerate(joints)} or self.joints
        self.names = tuple(self._columns)

    def read(self, names: Sequence[str]) -> dict[str, FloatArray]:
        """See :class:`TableFile`."""
        lengths = {name: len(self._columns[name]) for name in names}
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise ValueError(f"every column must have as many numbers as the others: {listed}")
        return {name: self._columns[name].astype(float) for name in names}


def _header_of(lines: Sequence[bytes]) -> tuple[int, str]:
    """Which line has the names, counted from 0, and its text: the first one that is no comment, or a comment above
    as many numbers.

    Raises
    ------
    ValueError
        If there is none, or a line is no text in UTF-8.
    """
    comment = None
    for number, line in enumerate(lines):
        try:
            text = line.decode("utf-8-sig" if number == 0 else "utf-8").strip("\r\n")
        except UnicodeDecodeError as error:
            byte = error.object[error.start]
            raise ValueError(f"line {number + 1}: must be text in UTF-8: it has the byte 0x{byte:02x}") from error
        if not text.strip():
            continue
        if found := _COMMENT.match(text):
            comment = number, text[found.end() :]
            continue
        begins = re.split(r"[;,\t| ]+", text.strip())[0]
        return (
            comment if comment is not None and _is_value(begins) and _same_width(comment[1], text) else (number, text)
        )
    raise ValueError("the file is empty" if not lines else "it has no line that names the columns")


def _same_width(names: str, values: str) -> bool:
    """Whether two lines have as many cells, several, between some delimiter."""
    return any(len(_cells_of(names, one)) == len(_cells_of(values, one)) > 1 for one in (*_DELIMITERS, " "))


def _below_a_preamble(lines: Sequence[bytes], first: int, header: str) -> tuple[int, str] | None:
    """The line of names, or the first of values, and its number, where others stand above it: as many as there are
    values below, while the header, which is the first line, has another number. None if there are no such lines.
    """
    # The last line may be cut off.
    texts = {number: line.decode("utf-8", "replace").strip("\r\n") for number, line in enumerate(lines[:-1])}
    texts = {number: text for number, text in texts.items() if number >= first and text.strip()}
    texts |= {first: header} if first in texts else {}
    numbers = list(texts)[: _LONGEST_PREAMBLE + 1]
    for delimiter in (*_DELIMITERS, " "):
        # Spreadsheets fill every line with empty cells.
        counts = {number: len(_cells_of(texts[number].rstrip(delimiter), delimiter)) for number in numbers}
        if not numbers or counts[numbers[-1]] < 2 or counts[first] == counts[numbers[-1]]:
            continue
        for number, after in pairwise(numbers):
            values = _cells_of(texts[after], delimiter)
            if counts[number] == counts[after] == counts[numbers[-1]] and _is_value(values[0]):
                # Where all of them are values, there are no names.
                are_values = set(map(_is_value, _cells_of(texts[number], delimiter)))
                return (number, texts[number]) if len(are_values) == 1 else None
    return None


def _is_value(cell: str) -> bool:
    return _is_number(cell) or _DATE.match(cell) is not None or bool(_DAY.fullmatch(cell) or _CLOCK.fullmatch(cell))


def _columns_of_an_echo(cells: Sequence[str]) -> list[str]:
    """Names of the columns that `ros2 topic echo --csv` prints of a JointState, which has no line of names: stamp,
    frame, names, and as many positions, then velocities, then efforts; [] if it is none.
    """
    stamp, rest = cells[: len(_ECHOED)], cells[len(_ECHOED) :]
    count = next((number for number, cell in enumerate(rest) if _is_number(cell)), 0)
    kinds, more = divmod(len(rest) - count, count) if count else (0, 0)
    numbers = [*stamp[:2], *rest[count:]]
    if not 1 <= kinds <= len(_ECHOED_FIELDS) or more or not all(map(_is_number, numbers)) or _is_number(stamp[2]):
        return []
    fields = ("name", *_ECHOED_FIELDS[:kinds])
    return [*_ECHOED, *(f"{field}[{number}]" for field in fields for number in range(count))]


def _numbered(cells: Sequence[str], missing: Sequence[str]) -> list[str]:
    """Names for the columns of a table that begins with values, some of them missing, for --column; [] if it begins
    with names.
    """
    begins_with_values = all(cell in missing or _is_value(cell) for cell in cells)
    return [f"column{number}" for number in range(1, len(cells) + 1)] if begins_with_values else []


def _delimiter_of(header: str, rows: Sequence[str]) -> str:
    """What stands between values: what the names and the first rows have as often."""
    for delimiter in _DELIMITERS:
        count = len(_cells_of(header, delimiter))
        if count > 1 and rows and len(_cells_of(rows[0], delimiter)) == count:
            return delimiter
    most = max(_DELIMITERS, key=header.count)
    if header.count(most):
        return most
    return " " if " " in header.strip() else ","


def _cells_of(line: str, delimiter: str) -> list[str]:
    """The cells of a line, without the blanks around them.

    Raises
    ------
    ValueError
        If one is too long.
    """
    if delimiter == " ":
        return line.split()
    csv.field_size_limit(_LARGEST_CELL)
    try:
        return [cell.strip() for cell in next(csv.reader([line.strip("\r\n")], delimiter=delimiter), [])]
    except csv.Error as error:
        raise ValueError(str(error)) from error


def _is_number(cell: str) -> bool:
    """Whether a cell is a number, with a decimal point or comma."""
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True
