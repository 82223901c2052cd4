# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Folders for what is unpacked: gone with their use, or, where a process was killed, at the next one's start."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from stickslip_ros.files import in_nobodys_use

_PREFIX = "stickslip_unpacked_"


@contextmanager
def own_folder() -> Iterator[Path]:
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
