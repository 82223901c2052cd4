# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Files that are written whole or not at all: who reads one meanwhile finds the one before, or the new one."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

_READ_BY_ALL = 0o666  # but for what the user's umask forbids


@contextmanager
def whole_file(path: Path, *, mode: int = _READ_BY_ALL, durable: bool = False) -> Iterator[IO[bytes]]:
    """A file to write to, which takes its place when the context ends; after an error all is as it was before.

    Parameters
    ----------
    mode : its permissions, less what the umask forbids. durable : whether it is to outlive a loss of power.

    Raises
    ------
    OSError
        If there is no room, or no permission.
    """
    # Other processes and threads may be writing the same one; a link that lies there is not followed.
    partial = path.with_name(f".{path.name[:100]}.{os.getpid()}.{threading.get_ident()}.part")
    handle = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, mode)
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
            if durable:
                file.flush()
                os.fsync(file.fileno())
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
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
