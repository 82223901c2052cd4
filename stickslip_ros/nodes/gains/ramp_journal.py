# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Journal of ramps that are under way or were cut off, in a file beside the state, for a monitor that was killed."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from pathlib import Path

from stickslip_ros.errors import StickSlipError
from stickslip_ros.messages.gain_parameters import GainPair
from stickslip_ros.nodes.kept_state import (
    NewerVersionError,
    from_plain,
    sealed,
    set_aside,
    to_plain,
    unsealed,
    write_state,
)
from stickslip_ros.regular_files import read_regular

_FORMAT, _VERSION = "stickslip_ros ramps", 1
_LARGEST = 1_000_000  # size of the file, bytes: it has an entry for each of at most 256 joints


class JournalError(StickSlipError):
    """A journal that cannot be written; the text has the reason."""


@dataclass(frozen=True, kw_only=True)
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
    target: GainPair = field(metadata={"key": "asked"})
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
            self.update(_read(path) if path is not None else {})
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
        ramp = replace(ramp, begun=now)
        if earlier is not None:
            ramp = replace(ramp, before=earlier.before, begun=earlier.begun)
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
            content = sealed(_FORMAT, _VERSION, json.dumps([to_plain(one) for one in ramps.values()]))
            try:
                write_state(self._path, content)
            except OSError as error:
                raise JournalError(
                    f"what is to be changed cannot be noted in {self._path} first: {error.strerror or error}"
                ) from error
            self.trouble = ""


def _read(path: Path) -> dict[str, UnfinishedRamp]:
    try:
        _, body = unsealed(read_regular(path, _LARGEST), _FORMAT, _VERSION)
    except FileNotFoundError:
        return {}
    ramps = [from_plain(UnfinishedRamp, one) for one in json.loads(body)]
    for ramp in ramps:
        # NaN would pass every comparison.
        if not all(math.isfinite(value) for gains in (ramp.before, ramp.target) for value in gains.values().values()):
            raise ValueError(f"the gains of {ramp.joint} are not finite")
    return {ramp.joint: ramp for ramp in ramps}
