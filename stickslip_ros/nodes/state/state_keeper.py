# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""State of the joints, saved every minute and at the end, and restored at the start."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future, wait
from pathlib import Path
from threading import Thread

from rclpy.impl.rcutils_logger import RcutilsLogger

from stickslip_ros.files import remove_abandoned
from stickslip_ros.monitoring.joint_monitor import JointMemory
from stickslip_ros.nodes.joints.watched_joints import WatchedJoint
from stickslip_ros.nodes.state.plain_data import NewerVersionError
from stickslip_ros.nodes.state.state_file import StateFileError, as_text, read_state, set_aside, write_state

_EVERY = 60.0  # time between two files, s: a crash loses a minute of learning
_LONGEST_WAIT = 0.5  # wait for the last file at the end, s: whoever ends the node waits no longer


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
        if self._writing is None and now - self._saved_at >= _EVERY:
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
        Thread(target=_write, args=arguments, daemon=True).start()

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


def _write(path: Path, joints: dict[str, JointMemory], saved: bytes, writing: Future[bytes]) -> None:
    """Write the file unless its content is unchanged; the future then holds the content."""
    try:
        text = as_text(joints)
        if text != saved:
            write_state(path, text)
    except BaseException as error:
        writing.set_exception(error)
    else:
        writing.set_result(text)
