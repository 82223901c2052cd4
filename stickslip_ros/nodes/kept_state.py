# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the node keeps from one run to the next: files of dataclasses as plain data, and what was learnt of the joints.

A file has a line with kind, version and checksum, and is written whole or not at all. Reading is strict, because a file
may have been changed by anybody. The state of the joints is saved every minute and at the end, and restored at the
start. Beside it is a journal of ramps that are under way or were cut off, for a monitor that was killed.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import re
import types
import zlib
from collections.abc import Mapping
from concurrent.futures import Future, wait
from contextlib import suppress
from datetime import datetime, timezone
from enum import Enum
from functools import cache
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.files import remove_abandoned, write_whole
from stickslip_ros.messages.gain_parameters import GainPair
from stickslip_ros.monitoring.friction.change import FrictionChange, ParameterDifference
from stickslip_ros.monitoring.joint_monitor import JointMemory
from stickslip_ros.regular_files import read_regular

if TYPE_CHECKING:
    from rclpy.impl.rcutils_logger import RcutilsLogger
    from rclpy.node import Node

    from stickslip_ros.nodes.watched_joints import WatchedJoint

_FORMAT = "stickslip_ros state"
_VERSION = 3
# Keys of version 2, of what updates by single slips started from.
_OF_UPDATES = ("information", "prior", "spread", "widening")
_USER_ONLY = 0o600  # permissions of a file, mode bits: the user alone reads and writes it
_LARGEST = 256_000_000  # size of the file, bytes: a larger file is no state
# Sentence of version 1, whatever the sentence in diagnostics is today.
_SENTENCE = re.compile(r"friction changed abruptly at (?P<time>\S+) s(?P<anew>; learning anew)?(?:: (?P<what>.*))?")
_DIFFERENCE = re.compile(r"(?P<name>[a-z ]+) (?P<old>\S+) to (?P<new>\S+)")
_SAVED_EVERY = 60.0  # time between two files, s: a crash loses a minute of learning
_LONGEST_WAIT = 0.5  # wait for the last file at the end, s: whoever ends the node waits no longer
_JOURNAL, _JOURNALS_VERSION = "stickslip_ros ramps", 1
_LARGEST_JOURNAL = 1_000_000  # size of the file, bytes: it has an entry for each of at most 256 joints
Kind = TypeVar("Kind")


def to_plain(value: Any) -> Any:
    """Plain data of a value made of dataclasses, arrays of numbers, enumerations, tuples, numbers and texts."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {_key(field): to_plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, (list, tuple)):
        return [to_plain(one) for one in value]
    return value


def from_plain(kind: type[Kind], data: Any) -> Kind:
    """Dataclass of plain data.

    Raises
    ------
    ValueError
        If the data do not fit the dataclass; the text names the field.
    """
    found: Kind = _read(kind, data, kind.__name__)
    return found


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _read(hint: Any, data: Any, where: str) -> Any:
    if get_origin(hint) in (Union, types.UnionType):
        if data is None and type(None) in get_args(hint):
            return None
        # Of several kinds of number, the first one fits all.
        return _read(next(one for one in get_args(hint) if one is not type(None)), data, where)
    if dataclasses.is_dataclass(hint):
        return _dataclass(hint, data, where)
    if get_origin(hint) is tuple:
        return _tuple(hint, data, where)
    if _is_array(hint):
        return _array(data, where)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return hint(data)
    if hint is float and isinstance(data, (int, float)) and not isinstance(data, bool):
        return float(data)
    if hint in (bool, int, str) and type(data) is hint:
        return data
    raise ValueError(f"{where} cannot be {data!r:.60}")


def _is_array(hint: Any) -> bool:
    """Whether a type is that of arrays; with numpy 2.5 and Python 3.12 `NDArray[…]` is an alias of it."""
    origin = get_origin(hint) or hint
    alias = getattr(origin, "__value__", origin)
    return (get_origin(alias) or alias) is np.ndarray


def _key(field: dataclasses.Field[Any]) -> str:
    """Key of a field in files: its name, or the name before the field was renamed."""
    return str(field.metadata.get("key", field.name))


def _dataclass(kind: Any, data: Any, where: str) -> Any:
    names = {_key(field): field.name for field in dataclasses.fields(kind)}
    # Fields with a default are newer than some files, which lack them.
    later = {_key(field) for field in dataclasses.fields(kind) if field.default is not dataclasses.MISSING}
    if not isinstance(data, Mapping) or not set(names) - later <= set(data) <= set(names):
        raise ValueError(f"{where} must have exactly {', '.join(sorted(names))}")
    return kind(**{names[key]: _read(_hints(kind)[names[key]], data[key], f"{where}.{key}") for key in data})


def _tuple(hint: Any, data: Any, where: str) -> Any:
    """Tuple of any length, of one kind of element."""
    if not isinstance(data, list):
        raise ValueError(f"{where} cannot be {data!r:.60}")
    kind = get_args(hint)[0]
    return tuple(_read(kind, one, f"{where}[{number}]") for number, one in enumerate(data))


def _array(data: Any, where: str) -> Any:
    try:
        array = np.array(data)
    except ValueError as error:
        raise ValueError(f"{where} is no array") from error
    if array.dtype.kind not in "if":
        raise ValueError(f"{where} is no array of numbers")
    return array


class NewerVersionError(StickSlipError):
    """A sound file of a version that a later release writes."""


def sealed(kind: str, version: int, body: str) -> bytes:
    """Content of a file: a line with kind, version and checksum, and the body."""
    encoded = body.encode()
    return json.dumps({"format": kind, "version": version, "crc32": zlib.crc32(encoded)}).encode() + b"\n" + encoded


def unsealed(content: bytes, kind: str, newest: int) -> tuple[int, bytes]:
    """Version and body of a file's content.

    Parameters
    ----------
    kind : format of the file, two words, the second for error messages. newest : newest version that can be read.

    Raises
    ------
    NewerVersionError
        If a later release wrote the file.
    ValueError
        If the file is of another kind, or damaged.
    """
    line, _, body = content.partition(b"\n")
    header = json.loads(line)
    if not isinstance(header, dict) or header.get("format") != kind:
        raise ValueError(f"it is no {kind.partition(' ')[2]} of a stickslip_monitor")
    version = header.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise ValueError(f"it has version {version!r}, not {newest}")
    if version > newest:
        raise NewerVersionError(f"it has version {version}; this release reads versions up to {newest}")
    if header.get("crc32") != zlib.crc32(body):
        raise ValueError("its checksum is wrong")
    return version, body


class StateFileError(StickSlipError, ValueError):
    """A file that is no state, or damaged; the text has the reason."""


def default_path(node_name: str) -> Path:
    """Path of the state of a node of this fully qualified name, in ROS_HOME or ~/.ros."""
    home = Path(os.environ.get("ROS_HOME") or Path.home() / ".ros")
    # Node names have letters, digits and underscores alone; other characters are left out of the path.
    words = ["".join(c for c in word if c.isalnum() or c == "_") for word in node_name.split("/")]
    return home / "stickslip_ros" / f"{'.'.join(word for word in words if word)}.json"


def state_path(node: Node) -> Path | None:
    """Path of the state file, None for no file.

    Raises
    ------
    InvalidParameterError
        If there is a folder or a device of that name, or no file can have it.
    """
    given = str(node.get_parameter("state_file").value)
    if given == "none":
        return None
    try:
        path = Path(given).expanduser() if given else default_path(node.get_fully_qualified_name())
        no_file = path.exists() and not path.is_file()
    except (OSError, RuntimeError, ValueError) as error:
        raise InvalidParameterError("state_file", f"the name of a file ({error})", f"{given[:80]!r}") from error
    if no_file:
        raise InvalidParameterError("state_file", "the name of a regular file, not of a folder or a device", given)
    return path


def read_state(path: Path) -> dict[str, JointMemory]:
    """State of each joint; empty where there is no file.

    Raises
    ------
    NewerVersionError
        If a later release wrote the file.
    StateFileError
        If the file is damaged or no state.
    OSError
        If the file cannot be read, or is no regular file.
    """
    try:
        text = read_regular(path, _LARGEST)
    except FileNotFoundError:
        return {}
    try:
        version, body = unsealed(text, _FORMAT, _VERSION)
        joints: dict[str, Any] = json.loads(body)
        if version < _VERSION:
            joints = {name: as_of_now(data, version) for name, data in joints.items()}
        return {name: from_plain(JointMemory, data) for name, data in joints.items()}
    except (ValueError, RecursionError, AttributeError) as error:
        raise StateFileError(str(error)) from error


def as_text(joints: Mapping[str, JointMemory]) -> bytes:
    """Content of the file."""
    return sealed(_FORMAT, _VERSION, json.dumps({name: to_plain(memory) for name, memory in joints.items()}))


def write_state(path: Path, text: bytes) -> None:
    """Replace the file in one step; the user alone may read it, and a link to it stays.

    Raises
    ------
    OSError
        If there is no room, or no permission; the old file is then unchanged.
    """
    Path(os.path.realpath(path)).parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, text, mode=_USER_ONLY, durable=True)


def set_aside(path: Path) -> Path:
    """Rename a damaged file, in place of an earlier damaged one; returns the new path."""
    # A link to the file stays, and leads to the next file.
    path = Path(os.path.realpath(path))
    aside = path.with_name(f"{path.name}.damaged")
    path.replace(aside)
    return aside


def as_of_now(joint: Any, version: int) -> Any:
    """A joint's plain data of an earlier version in the present layout; unexpected data stay, and are refused later.

    Version 1 had an abrupt change of friction as a sentence, version 2 what updates by single slips started from.
    """
    friction = joint.get("friction") if isinstance(joint, Mapping) else None
    if not isinstance(friction, Mapping):
        return joint
    kept = dict(friction)
    if version == 1 and isinstance(kept.get("notice"), str):
        kept["change"] = to_plain(_change(kept.pop("notice")))
    if isinstance(kept.get("learnt"), Mapping):
        kept["learnt"] = {name: value for name, value in kept["learnt"].items() if name not in _OF_UPDATES}
    return {**joint, "friction": kept}


def _change(sentence: str) -> FrictionChange | None:
    """The change that a sentence describes, None if it describes none."""
    match = _SENTENCE.fullmatch(sentence)
    if match is None:
        return None
    parts = [_DIFFERENCE.fullmatch(part) for part in (match["what"] or "").split(", ")]
    try:
        return FrictionChange(
            time=float(match["time"]),
            learning_anew=match["anew"] is not None,
            differences=tuple(
                ParameterDifference(name=part["name"].replace(" ", "_"), old=float(part["old"]), new=float(part["new"]))
                for part in parts
                if part is not None
            ),
        )
    except ValueError:
        return None


class StateKeeper:
    """Keeper of the state. An error of reading or writing is logged and in ``trouble``; writing is tried again.

    Parameters
    ----------
    path : path of the file, None to keep nothing.
    """

    def __init__(self, path: Path | None, log: RcutilsLogger) -> None:
        self._path, self._log = path, log
        self._writing: Future[bytes] | None = None
        self._saved_at: float | None = None
        self._saved = b""
        self.trouble = ""
        self._known = self._read(path) if path is not None else {}

    def _read(self, path: Path) -> dict[str, JointMemory]:
        remove_abandoned(path)
        try:
            return read_state(path)
        except NewerVersionError as error:
            # The file is sound, and of use to the release that wrote it.
            self._path = None
            self._trouble(f"{path} is newer than this release ({error}); it is left as it is, and nothing is kept")
        except (StateFileError, OSError) as error:
            # A file that cannot be read must not be replaced either.
            try:
                aside = set_aside(path)
                self._log.warning(f"{path} is damaged ({error}); it is kept as {aside}, and learning begins anew")
            except OSError as second:
                self._trouble(f"{path} is damaged ({error}), and cannot be set aside: {second}")
        return {}

    def restore(self, joint: WatchedJoint) -> None:
        """Restore a joint's monitor from the state of its name."""
        memory = self._known.get(joint.name)
        if memory is None:
            return
        if joint.monitor.restore(memory):
            self._log.info(f"{joint.name}: going on from the friction learnt before, from {self._path}")
        elif memory.friction.learnt is not None:
            self._log.info(
                f"{joint.name}: another joint is configured than the friction in {self._path} was learnt with"
            )

    def forget(self, name: str) -> None:
        """Drop the state of a joint."""
        self._known.pop(name, None)

    def tick(self, joints: Mapping[str, WatchedJoint], now: float) -> None:
        """Save every minute; ``now`` is a steady time [s]."""
        if self._writing is not None and self._writing.done():
            self._finish(self._writing)
        if self._saved_at is None:
            self._saved_at = now
        if self._writing is None and now - self._saved_at >= _SAVED_EVERY:
            self._saved_at = now
            self._begin(joints)

    def save(self, joints: Mapping[str, WatchedJoint]) -> None:
        """Save now: at the end."""
        # A file that is being written already lacks the last samples.
        if self._path is None or not self._wait():
            return
        self._begin(joints)
        self._wait()

    def _wait(self) -> bool:
        """Wait for the file that is being written; returns whether it is complete."""
        if self._writing is None:
            return True
        wait([self._writing], _LONGEST_WAIT)
        if not self._writing.done():
            self._trouble(f"{self._path}: the disk is too slow to save what was learnt")
            return False
        self._finish(self._writing)
        return True

    def _begin(self, joints: Mapping[str, WatchedJoint]) -> None:
        """Write in a thread of its own, as disks can be slow; a daemon, as some hang."""
        if self._path is None:
            return
        # The state of joints that are absent now is kept.
        self._known |= {name: joint.monitor.memory() for name, joint in joints.items() if joint.monitor.cycle_count}
        self._writing = Future()
        arguments = (self._path, dict(self._known), self._saved, self._writing)
        Thread(target=_write_in_thread, args=arguments, daemon=True).start()

    def _finish(self, writing: Future[bytes]) -> None:
        self._writing = None
        error = writing.exception()
        if error is None:
            self._saved, self.trouble = writing.result(), ""
        else:
            self._trouble(f"what was learnt cannot be saved: {error}")

    def _trouble(self, what: str) -> None:
        if what != self.trouble:
            self._log.warning(what)
        self.trouble = what


def _write_in_thread(path: Path, joints: dict[str, JointMemory], saved: bytes, writing: Future[bytes]) -> None:
    """Write the file unless its content is unchanged; the future then holds the content."""
    try:
        text = as_text(joints)
        if text != saved:
            write_state(path, text)
    except BaseException as error:
        writing.set_exception(error)
    else:
        writing.set_result(text)


class JournalError(StickSlipError):
    """A journal that cannot be written; the text has the reason."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class UnfinishedRamp:
    """A ramp that has not come to a good end.

    Attributes
    ----------
    before, target : gains in the controller's units.
    offset : offset of the damping on the way, as in :class:`GainRamp`, in the same units.
    begun : beginning, UTC in ISO 8601.
    """

    joint: str
    controller: str
    before: GainPair
    target: GainPair = dataclasses.field(metadata={"key": "asked"})
    offset: float
    begun: str = ""


class RampJournal(dict[str, UnfinishedRamp]):
    """Unfinished ramps by joint.

    Parameters
    ----------
    path : path of the file; None to keep the ramps in this process alone.

    ``trouble`` is why the file cannot be read or written, "" if it can.
    """

    def __init__(self, path: Path | None) -> None:
        super().__init__()
        self._path = path
        self.trouble = ""
        try:
            self.update(_read_journal(path) if path is not None else {})
        except NewerVersionError as error:
            # The file is sound, and of use to the release that wrote it.
            self._path = None
            self.trouble = (
                f"{path}, the journal of ramps of gains that were cut off, is newer than this release ({error}); it is "
                "left as it is, and ramps are kept in this process alone"
            )
        except (OSError, ValueError, RecursionError) as error:
            self.trouble = f"{path}, the journal of ramps of gains that were cut off, cannot be read: {error}"
            # The next ramp would replace the only record of the gains before.
            if path is not None and path.is_file():
                with suppress(OSError):
                    self.trouble += f"; it is kept as {set_aside(path)}"

    @classmethod
    def beside(cls, state_path: Path | None) -> RampJournal:
        """The journal beside a state file, None for no file."""
        return cls(state_path and state_path.with_name(f"{state_path.stem}.ramps.json"))

    def begin(self, ramp: UnfinishedRamp) -> None:
        """Record a ramp before its first step. If an earlier ramp was cut off, its beginning is kept.

        Raises
        ------
        JournalError
            If the file cannot be written.
        """
        earlier = self.get(ramp.joint)
        now = datetime.now(timezone.utc).isoformat(timespec="seconds")
        ramp = dataclasses.replace(ramp, begun=now)
        if earlier is not None:
            ramp = dataclasses.replace(ramp, before=earlier.before, begun=earlier.begun)
        self._write({**self, ramp.joint: ramp})
        self[ramp.joint] = ramp

    def end(self, joint: str) -> None:
        """Remove a ramp; a file that cannot be written does no harm, because it has too much and not too little."""
        if self.pop(joint, None) is not None:
            try:
                self._write(self)
            except JournalError as error:
                self.trouble = str(error)

    def _write(self, ramps: Mapping[str, UnfinishedRamp]) -> None:
        if self._path is not None:
            content = sealed(_JOURNAL, _JOURNALS_VERSION, json.dumps([to_plain(one) for one in ramps.values()]))
            try:
                write_state(self._path, content)
            except OSError as error:
                raise JournalError(
                    f"what is to be changed cannot be noted in {self._path} first: {error.strerror or error}"
                ) from error
            self.trouble = ""


def _read_journal(path: Path) -> dict[str, UnfinishedRamp]:
    try:
        _, body = unsealed(read_regular(path, _LARGEST_JOURNAL), _JOURNAL, _JOURNALS_VERSION)
    except FileNotFoundError:
        return {}
    ramps = [from_plain(UnfinishedRamp, one) for one in json.loads(body)]
    for ramp in ramps:
        # NaN would pass every comparison.
        if not all(math.isfinite(value) for gains in (ramp.before, ramp.target) for value in gains.values().values()):
            raise ValueError(f"the gains of {ramp.joint} are not finite")
    return {ramp.joint: ramp for ramp in ramps}
