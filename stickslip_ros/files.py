# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Files that are written whole or not at all: who reads one meanwhile finds the one before, or the new one.

What a killed process left of a file is removed when that file is written next, or :func:`remove_abandoned` asked to.
"""

from __future__ import annotations

import fcntl
import os
import re
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from stickslip_ros.interrupts import at_hard_end

_PART = ".part"
_READ_BY_ALL = 0o666  # but for what the user's umask forbids
_begun: set[Path] = set()  # by this process, and not yet whole


@contextmanager
def whole_file(path: Path, *, mode: int = _READ_BY_ALL, durable: bool = False) -> Iterator[IO[bytes]]:
    """A file to write to, which takes its place when the context ends; after an error all is as it was before.

    Where the path is a link, what it leads to is written, and the link stays.

    Parameters
    ----------
    mode : its permissions, less what the umask forbids. durable : whether it is to outlive a loss of power.

    Raises
    ------
    OSError
        If there is no room, or no permission.
    """
    path = Path(os.path.realpath(path))
    remove_abandoned(path)
    partial, handle = _opened(path, mode)
    _begun.add(partial)
    try:
        with os.fdopen(handle, "wb") as file:
            # The lock goes with the process, however it ends; some network folders have none.
            with suppress(OSError):
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield file
            if durable:
                file.flush()
                os.fsync(file.fileno())
        partial.replace(path)
    except BaseException as error:
        partial.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename in (None, str(partial)):
            error.filename, error.filename2 = str(path), None
        raise
    finally:
        _begun.discard(partial)


def check_writable(path: Path) -> None:
    """See that a file of this name can be begun: permissions and read-only disks are told by trying alone.

    Raises
    ------
    OSError
        If it cannot; nothing is left of the trial.
    """
    partial, handle = _opened(Path(os.path.realpath(path)), _READ_BY_ALL)
    os.close(handle)
    partial.unlink(missing_ok=True)


def _opened(path: Path, mode: int) -> tuple[Path, int]:
    """The beginning of a file, and its handle; an error is about the file itself."""
    # Other processes and threads may be writing the same one; a link that lies there is not followed.
    partial = path.with_name(f"{_begin(path)}{os.getpid()}.{threading.get_ident()}{_PART}")
    try:
        return partial, os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, mode)
    except OSError as error:
        error.filename = str(path)
        raise


def write_whole(path: Path, content: str | bytes, *, mode: int = _READ_BY_ALL, durable: bool = False) -> None:
    """Write a file whole or not at all; see :func:`whole_file`.

    Raises
    ------
    OSError
        If there is no room, or no permission.
    """
    with whole_file(path, mode=mode, durable=durable) as file:
        file.write(content.encode() if isinstance(content, str) else content)


def remove_abandoned(path: Path) -> None:
    """Remove what was begun of a file by processes of this user that are gone; of others nothing."""
    path = Path(os.path.realpath(path))
    begin = _begin(path)
    ours = re.compile(rf"{re.escape(begin)}(\d+)\.\d+{re.escape(_PART)}", re.DOTALL)
    with suppress(OSError):
        for name in os.listdir(path.parent):
            found = ours.fullmatch(name)
            if found and not _lives(int(found[1])):
                _remove_unless_locked(path.with_name(name))


def _remove_begun() -> None:
    for partial in list(_begun):
        partial.unlink(missing_ok=True)


at_hard_end(_remove_begun)


def _begin(path: Path) -> str:
    """How the names of a file's beginnings begin; the whole of them is no longer than names may be."""
    return f".{path.name[:100]}."


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True


def _remove_unless_locked(partial: Path) -> None:
    """Remove a file of this user: a process of another container has a number that means nothing here, but locks it."""
    with suppress(OSError), in_nobodys_use(partial) as state:
        if stat.S_ISREG(state.st_mode):
            partial.unlink(missing_ok=True)


@contextmanager
def in_nobodys_use(path: Path) -> Iterator[os.stat_result]:
    """Hold the lock of a file or folder of this user that no living process holds; gives its state.

    Raises
    ------
    OSError
        If it is another user's, a link, or in use.
    """
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        state = os.fstat(handle)
        if state.st_uid != os.getuid():
            raise PermissionError(f"{path} is another user's")
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield state
    finally:
        os.close(handle)
