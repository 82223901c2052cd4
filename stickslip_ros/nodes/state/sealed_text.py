# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What a node keeps in files, under a line that tells its kind, its version and its checksum."""

from __future__ import annotations

import json
import zlib


class NewerVersionError(ValueError):
    """A sound file of a version that a later release writes."""


def sealed(kind: str, version: int, body: str) -> bytes:
    """The content of a file."""
    encoded = body.encode()
    return json.dumps({"format": kind, "version": version, "crc32": zlib.crc32(encoded)}).encode() + b"\n" + encoded


def unsealed(content: bytes, kind: str, newest: int) -> tuple[int, bytes]:
    """Version and body of a file's content.

    Parameters
    ----------
    kind : its format, two words of which the second says what it is. newest : version that is known.

    Raises
    ------
    NewerVersionError
        If a later release wrote it.
    ValueError
        If it is of another kind, or damaged.
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
